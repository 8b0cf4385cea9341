//! What is filmed arrives, when it should.

use ps1080::color::{ColorDecoder, ColorFormat};
use ps1080::host::{Nack, Request};
use ps1080::parameter::Parameter;
use ps1080::samples::{SampleFormat, encode_samples, measured_shift};
use ps1080::stream::StreamKind;
use virtual_carmine::{Faults, Personality, TestPattern};

use crate::host::{Host, MILLISECOND, SECOND, SEED, codes, frames};

const PIXELS: usize = 320 * 240;

fn expected_codes(index: u64, mirrored: bool, registered: bool) -> Vec<u16> {
    let pattern = TestPattern::new(SEED);
    let column = |x: u32| if mirrored { 319 - x } else { x };
    (0..240)
        .flat_map(|y| (0..320).map(move |x| pattern.shift(index, column(x), y, registered)))
        .collect()
}

#[test]
fn every_depth_format_arrives_as_filmed() {
    for format in [
        SampleFormat::Raw16,
        SampleFormat::Compressed,
        SampleFormat::Packed11,
        SampleFormat::Packed12,
    ] {
        for (mirrored, registered) in [(false, true), (true, false)] {
            let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
            host.set(Parameter::DepthFormat, format.code());
            host.set(Parameter::DepthMirror, u16::from(mirrored));
            host.set(Parameter::Registration, u16::from(registered));
            host.set(Parameter::Stream1Mode, 2);
            let transfers = host.transfers(&[0x81], 300 * MILLISECOND);
            let (frames, lost_count) = frames(StreamKind::Depth, 0x81, &transfers);
            assert_eq!(lost_count, 0);
            assert!(frames.len() >= 7, "{} frames", frames.len());
            let delivered = host.bus.camera().delivered(StreamKind::Depth);
            for (frame, delivered) in frames.iter().zip(delivered) {
                let expected = expected_codes(delivered.film_index, mirrored, registered);
                assert_eq!(frame.ticks.0, delivered.ticks);
                assert!(
                    codes(format, PIXELS, &frame.payload) == expected,
                    "{format:?}"
                );
            }
        }
    }
}

#[test]
fn every_colour_format_arrives_as_filmed() {
    let pattern = TestPattern::new(SEED);
    for format in [
        ColorFormat::CompressedYuv422,
        ColorFormat::Uyvy,
        ColorFormat::Yuyv,
        ColorFormat::CompressedBayer,
        ColorFormat::Bayer,
    ] {
        let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
        host.set(Parameter::ImageFormat, format.code());
        host.set(Parameter::ImageMirror, 0);
        host.set(Parameter::Stream0Mode, 1);
        let transfers = host.transfers(&[0x82], 150 * MILLISECOND);
        let (frames, lost_count) = frames(StreamKind::Image, 0x82, &transfers);
        assert!(lost_count == 0 && frames.len() >= 2);
        let index = host.bus.camera().delivered(StreamKind::Image)[0].film_index;
        let line = format.line_bytes(320).unwrap() as u32;
        let expected: Vec<u8> = (0..240)
            .flat_map(|y| {
                (0..line).map(move |column| match format {
                    ColorFormat::Bayer | ColorFormat::CompressedBayer => {
                        pattern.bayer_byte(index, column, y)
                    }
                    ColorFormat::Yuyv => pattern.uyvy_byte(index, column ^ 1, y),
                    _ => pattern.uyvy_byte(index, column, y),
                })
            })
            .collect();
        let mut decoder = ColorDecoder::new(format, 320, 240).unwrap();
        let mut decoded = vec![0; expected.len()];
        decoder.begin();
        decoder.push(&frames[0].payload, &mut decoded).unwrap();
        assert_eq!(decoder.finish(), Ok(expected.len()));
        assert!(decoded == expected, "{format:?}");
    }
}

#[test]
fn infrared_has_eight_rows_more_and_a_stamp_that_stands_without_depth() {
    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    host.set(Parameter::Stream0Mode, 3);
    let transfers = host.transfers(&[0x82], 150 * MILLISECOND);
    let (alone, _) = frames(StreamKind::Image, 0x82, &transfers);
    assert_eq!(alone[0].payload.len(), 96_000 + 3_200);
    assert_eq!(alone[0].ticks, alone[1].ticks);
    let pattern = TestPattern::new(SEED);
    let index = host.bus.camera().delivered(StreamKind::Image)[0].film_index;
    let samples: Vec<u16> = (0..240)
        .flat_map(|y| (0..320).map(move |x| pattern.infrared_sample(index, x, y)))
        .collect();
    let mut expected = vec![0; 96_000];
    encode_samples(SampleFormat::Packed10, &samples, 320, &mut expected).unwrap();
    assert!(alone[0].payload[..96_000] == expected);
}

#[test]
fn without_its_emitter_nothing_is_measured_and_infrared_has_no_dots() {
    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    let pattern = TestPattern::new(SEED);
    host.set(Parameter::Stream1Mode, 2);
    host.set(Parameter::Stream0Mode, 3);
    for on in [0, 1] {
        let switched = host.ask(Request::EnableEmitter { on });
        assert!(switched.unwrap().is_ok());
        let is_lit = on == 1;
        assert_eq!(host.bus.camera().is_lit(), is_lit);
        let transfers = host.transfers(&[0x81, 0x82], 300 * MILLISECOND);
        let (depth, _) = frames(StreamKind::Depth, 0x81, &transfers);
        let (infrared, _) = frames(StreamKind::Image, 0x82, &transfers);
        let shifts = codes(
            SampleFormat::Packed11,
            PIXELS,
            &depth.last().unwrap().payload,
        );
        let is_measured = shifts.iter().any(|&code| measured_shift(code).is_some());
        assert_eq!(is_measured, is_lit);
        let sent = &infrared.last().unwrap().payload[..96_000];
        let shown = codes(SampleFormat::Packed10, PIXELS, sent);
        let index = u64::from(shown[0]);
        for (place, &got) in (0..).zip(&shown) {
            let (x, y) = (place % 320, place / 320);
            let expected = if is_lit {
                pattern.infrared_sample(index, x, y)
            } else {
                pattern.unlit_infrared_sample(index, x, y)
            };
            assert_eq!(got, expected, "{x} {y}");
        }
    }
    let neither = host.ask(Request::EnableEmitter { on: 2 });
    assert_eq!(neither, Some(Err(Nack::BadParameters)));
    let mut old = Host::new(Personality::firmware_5_4(), Faults::default());
    let unknown = old.ask(Request::EnableEmitter { on: 0 });
    assert_eq!(unknown, Some(Err(Nack::InvalidCommand)));
}

#[test]
fn frame_sync_starts_both_sensors_together_and_else_they_are_skewed() {
    for (sync, skew_nanos) in [(0, 9 * MILLISECOND), (1, 0)] {
        let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
        host.set(Parameter::Stream1Mode, 2);
        host.set(Parameter::Stream0Mode, 1);
        host.set(Parameter::FrameSync, sync);
        let transfers = host.transfers(&[0x81, 0x82], 500 * MILLISECOND);
        let (depth, depth_lost) = frames(StreamKind::Depth, 0x81, &transfers);
        let (color, color_lost) = frames(StreamKind::Image, 0x82, &transfers);
        assert_eq!((depth_lost, color_lost), (0, 0));
        assert!(depth.len() >= 12 && color.len() >= 12);
        let last = color.last().unwrap().ticks;
        let nearest = depth.iter().map(|frame| last.since(frame.ticks));
        let nearest = nearest.filter(|&ticks| ticks >= 0).min().unwrap();
        assert_eq!(i64::from(nearest) * 1000 / 60, skew_nanos);
        // 30 a second: two million ticks.
        let steps = depth
            .windows(2)
            .map(|pair| pair[1].ticks.since(pair[0].ticks));
        assert!(steps.into_iter().all(|step| (step - 2_000_000).abs() <= 1));
    }
}

#[test]
fn padding_stands_in_the_start_packet_and_its_pixels_are_not_sent() {
    let mut unit = Personality::carmine_1_09();
    unit.padding = ps1080::stream::Padding::from_field(0x0010_0020);
    let mut host = Host::new(unit, Faults::default());
    host.set(Parameter::Registration, 1);
    host.set(Parameter::Stream1Mode, 2);
    let transfers = host.transfers(&[0x81], 100 * MILLISECOND);
    assert_eq!(transfers[0].1[8..12], [0x20, 0, 0x10, 0]);
    let (frames, _) = frames(StreamKind::Depth, 0x81, &transfers);
    assert_eq!(frames[0].payload.len(), (PIXELS - 48) * 11 / 8);
}

#[test]
fn a_host_that_does_not_read_loses_whole_packets_and_the_camera_counts_them() {
    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    host.set(Parameter::Stream1Mode, 2);
    host.now_nanos += 2 * SECOND;
    let transfers = host.transfers(&[0x81], 500 * MILLISECOND);
    let (frames, lost_count) = frames(StreamKind::Depth, 0x81, &transfers);
    let counters = host.bus.camera().counters().depth;
    assert!(counters.fifo_lost_bytes > 6_000_000, "{counters:?}");
    assert_eq!(counters.frames_delivered, frames.len() as u64);
    assert!(lost_count >= 1 && frames.len() >= 14);
    // What was filmed is delivered or damaged, or was under way when the test ended.
    let ended = counters.frames_delivered + counters.frames_damaged;
    assert!(counters.frames_filmed >= 70 && counters.frames_filmed - ended <= 1);
}

#[test]
fn synchronous_reads_of_a_whole_frame_lose_data_and_queued_ones_do_not() {
    // One read at a time, queued only after the last one has been looked at.
    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    host.set(Parameter::DepthResolution, 1);
    host.set(Parameter::Stream1Mode, 2);
    for token in 0..60 {
        host.bus.submit(host.now_nanos, 0x81, token, 422_400);
        while host.bus.completed().is_none() {
            host.now_nanos += MILLISECOND;
            host.bus.advance(host.now_nanos);
        }
        host.now_nanos += 8 * MILLISECOND;
    }
    assert!(host.bus.camera().counters().depth.fifo_lost_bytes > 0);

    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    host.set(Parameter::DepthResolution, 1);
    host.set(Parameter::Stream1Mode, 2);
    host.transfers(&[0x81], SECOND);
    let counters = host.bus.camera().counters().depth;
    assert_eq!(counters.fifo_lost_bytes, 0);
    assert!(counters.frames_delivered >= 28);
}

#[test]
fn older_firmware_has_depth_on_the_second_endpoint_and_bulk_in_setting_1() {
    let mut host = Host::new(Personality::firmware_5_1(), Faults::default());
    assert!(host.bus.set_alt_setting(host.now_nanos, 1));
    host.set(Parameter::Stream1Mode, 2);
    let transfers = host.transfers(&[0x81, 0x82], 100 * MILLISECOND);
    assert!(transfers.iter().all(|(endpoint, _)| *endpoint == 0x82));
    let (frames, _) = frames(StreamKind::Depth, 0x82, &transfers);
    assert!(frames.len() >= 2);
}

#[test]
fn isochronous_packets_come_once_a_microframe() {
    let mut host = Host::new(Personality::carmine_1_09(), Faults::default());
    assert!(host.bus.set_alt_setting(host.now_nanos, 1));
    host.set(Parameter::Stream1Mode, 2);
    let mut bytes = Vec::new();
    for token in 0..4 {
        host.bus
            .submit_iso(host.now_nanos, 0x81, token, &[2040; 32]);
    }
    for token in 4..100 {
        host.now_nanos += 4 * MILLISECOND;
        host.bus.advance(host.now_nanos);
        let done = host.bus.completed().unwrap();
        assert_eq!(done.packet_bytes.len(), 32);
        assert_eq!(done.packet_bytes.iter().sum::<usize>(), done.data.len());
        bytes.push((0x81, done.data));
        host.bus
            .submit_iso(host.now_nanos, 0x81, token, &[2040; 32]);
    }
    let (frames, lost_count) = frames(StreamKind::Depth, 0x81, &bytes);
    assert_eq!(lost_count, 0);
    assert!(frames.len() >= 9, "{} frames", frames.len());
}
