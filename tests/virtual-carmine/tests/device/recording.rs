//! A recording as film: codes arrive as they are in the file.

use std::path::Path;

use geometry::{Intrinsics, Pose};
use ps1080::parameter::Parameter;
use ps1080::samples::SampleFormat;
use ps1080::stream::StreamKind;
use sequence::cameras::DepthSamples;
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FrameTimes, RecordingWriter, ResponseCurve, StreamTiming, Streams, VignettingCurve,
};
use virtual_carmine::{
    Bus, Faults, FilmError, Personality, RecordingFilm, TestPattern, VirtualCarmine,
};

use crate::host::{Host, MILLISECOND, SEED, codes, frames};

const PAIR_COUNT: u64 = 3;

fn description(samples: DepthSamples, encoding: ColorEncoding) -> Description {
    let intrinsics = Intrinsics::pinhole(320, 240, 285.0, 285.0, 159.5, 119.5).unwrap();
    let mut depth = DepthCamera::new(intrinsics, 0.001, 0.4..=4.0).unwrap();
    depth.samples = samples;
    Description {
        writer: "test".to_owned(),
        created: Created {
            unix_nanos: 0,
            host_nanos: 0,
        },
        part: None,
        streams: Streams {
            depth,
            color: ColorCamera::new(
                intrinsics,
                encoding,
                1.0,
                ResponseCurve::Identity,
                VignettingCurve::None,
            )
            .unwrap(),
            color_from_depth: Pose::IDENTITY,
            depth_timing: StreamTiming::at_rate(30.0),
            color_timing: StreamTiming::at_rate(30.0),
            device: None,
        },
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    }
}

fn shifts(number: u64) -> Vec<u16> {
    let pattern = TestPattern::new(SEED);
    let rows = 0..240;
    rows.flat_map(|y| (0..320).map(move |x| pattern.shift(number, x, y, false)))
        .collect()
}

fn mosaic(number: u64) -> Vec<u8> {
    let pattern = TestPattern::new(SEED);
    let rows = 0..240;
    rows.flat_map(|y| (0..320).map(move |x| pattern.bayer_byte(number, x, y)))
        .collect()
}

fn infrared(number: u64) -> Vec<u16> {
    let pattern = TestPattern::new(SEED);
    let rows = 0..240;
    rows.flat_map(|y| (0..320).map(move |x| pattern.infrared_sample(number, x, y)))
        .collect()
}

fn write(path: &Path, samples: DepthSamples, encoding: ColorEncoding) {
    let description = description(samples, encoding);
    let mut writer =
        RecordingWriter::create_beside(path, FileId(*b"a film of three!"), &description).unwrap();
    let mut depth = DepthStreamEncoder::new(&description.streams, DepthCodec::Fast).unwrap();
    let mut color = ColorStreamEncoder::new(&description.streams).unwrap();
    for number in 0..PAIR_COUNT {
        let times = FrameTimes {
            number,
            device_ticks: None,
            device_nanos: 33_333_333 * number as i64,
            host_nanos: None,
            is_repeat: false,
        };
        let samples = shifts(number);
        let (payload, table) = depth.encode(&samples).unwrap();
        if let Some(table) = table.cloned() {
            writer.write_table(DEPTH_STREAM, &table).unwrap();
        }
        writer.write_frame(DEPTH_STREAM, &times, payload).unwrap();
        let frame = match encoding {
            ColorEncoding::Infrared10 => infrared(number)
                .iter()
                .flat_map(|sample| sample.to_le_bytes())
                .collect(),
            _ => mosaic(number),
        };
        let payload = color.encode(&frame).unwrap();
        writer.write_frame(COLOR_STREAM, &times, payload).unwrap();
    }
    writer.finish("end").unwrap();
}

#[test]
fn a_recording_is_played_round_and_round() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.glint");
    write(&path, DepthSamples::Codes, ColorEncoding::BayerGrbg);
    let film = Box::new(RecordingFilm::open(&path).unwrap());
    let unit = Personality::carmine_1_09();
    let mut host = Host::new(unit.clone(), Faults::default());
    host.bus = Bus::new(VirtualCarmine::new(unit, film, Faults::default()));
    host.set(Parameter::DepthMirror, 0);
    host.set(Parameter::ImageMirror, 0);
    // The recording has no U and V.
    host.refuses(Parameter::Stream0Mode, 1);
    host.set(Parameter::ImageFormat, 6);
    host.set(Parameter::Stream1Mode, 2);
    host.set(Parameter::Stream0Mode, 1);
    let transfers = host.transfers(&[0x81, 0x82], 300 * MILLISECOND);
    let (depth, _) = frames(StreamKind::Depth, 0x81, &transfers);
    let (color, _) = frames(StreamKind::Image, 0x82, &transfers);
    assert!(depth.len() as u64 > 2 * PAIR_COUNT && color.len() as u64 > 2 * PAIR_COUNT);
    for (frame, made) in depth
        .iter()
        .zip(host.bus.camera().delivered(StreamKind::Depth))
    {
        let got = codes(SampleFormat::Packed11, 320 * 240, &frame.payload);
        assert!(got == shifts(made.film_index % PAIR_COUNT));
    }
    for (frame, made) in color
        .iter()
        .zip(host.bus.camera().delivered(StreamKind::Image))
    {
        assert!(frame.payload == mosaic(made.film_index % PAIR_COUNT));
    }
}

#[test]
fn a_recording_of_infrared_is_a_film_of_it_and_of_no_colour() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.glint");
    write(&path, DepthSamples::Codes, ColorEncoding::Infrared10);
    let film = Box::new(RecordingFilm::open(&path).unwrap());
    let unit = Personality::carmine_1_09();
    let mut host = Host::new(unit.clone(), Faults::default());
    host.bus = Bus::new(VirtualCarmine::new(unit, film, Faults::default()));
    host.refuses(Parameter::Stream0Mode, 1);
    host.set(Parameter::Stream1Mode, 2);
    host.set(Parameter::Stream0Mode, 3);
    let transfers = host.transfers(&[0x81, 0x82], 300 * MILLISECOND);
    let (frames, _) = frames(StreamKind::Image, 0x82, &transfers);
    let delivered = host.bus.camera().delivered(StreamKind::Image);
    assert!(frames.len() as u64 > 2 * PAIR_COUNT);
    for (frame, made) in frames.iter().zip(delivered) {
        // Rows below the picture come too.
        let got = codes(SampleFormat::Packed10, 320 * 240, &frame.payload[..96_000]);
        assert!(got == infrared(made.film_index % PAIR_COUNT));
    }
}

#[test]
fn depth_in_millimetres_is_no_film() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.glint");
    write(&path, DepthSamples::Values, ColorEncoding::BayerGrbg);
    let opened = RecordingFilm::open(&path);
    assert!(matches!(opened.err(), Some(FilmError::NoShifts)));
}
