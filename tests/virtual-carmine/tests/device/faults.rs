//! What goes wrong on demand.

use ps1080::host::{Nack, Request};
use ps1080::parameter::Parameter;
use ps1080::samples::SampleFormat;
use ps1080::stream::{FrameEvent, FrameReceiver, PacketKind, StreamKind, TickRate};
use virtual_carmine::{
    Alarm, Control, Faults, Personality, Refusal, Setup, Stall, StreamName, TestPattern,
    TransferStatus, Trouble,
};

use crate::host::{Host, MILLISECOND, SECOND, SEED, codes, frames};

fn with(faults: Faults) -> Host {
    Host::new(Personality::carmine_1_09(), faults)
}

fn streaming(faults: Faults) -> Host {
    let mut host = with(faults);
    host.set(Parameter::DepthMirror, 0);
    host.set(Parameter::Stream1Mode, 2);
    host
}

#[test]
fn requests_are_refused_so_many_times() {
    let mut host = with(Faults {
        refusals: vec![Refusal {
            opcode: Some(5),
            error: 13,
            count: 2,
        }],
        ..Faults::default()
    });
    assert!(host.ask(Request::GetVersion).unwrap().is_ok());
    for _ in 0..2 {
        assert_eq!(host.ask(Request::GetMode), Some(Err(Nack::NotReady)));
    }
    assert_eq!(host.ask(Request::GetMode), Some(Ok(vec![1, 0])));
}

#[test]
fn a_camera_that_boots_answers_the_second_time() {
    let mut host = with(Faults {
        unanswered_requests: 1,
        ..Faults::default()
    });
    assert_eq!(host.ask(Request::GetVersion), None);
    assert!(host.ask(Request::GetVersion).unwrap().is_ok());
    let mut host = with(Faults {
        dead_requests: 1,
        ..Faults::default()
    });
    let mut packet = [0; 8];
    let out = Setup::vendor_out(8);
    assert_eq!(host.bus.control(0, out, &mut packet), Control::NoAnswer);
    assert_eq!(host.bus.control(0, out, &mut packet), Control::Done(8));
}

#[test]
fn replies_survive_what_a_reader_must_survive() {
    let mut host = with(Faults {
        stale_replies: 3,
        empty_replies: 2,
        split_replies: 5,
        garbage_bytes: 5,
        ..Faults::default()
    });
    for _ in 0..6 {
        let version = host.ask(Request::GetVersion).unwrap().unwrap();
        assert_eq!(version[..4], [8, 5, 0x22, 0]);
    }
    assert!(host.bus.camera().counters().empty_reply_count >= 12);
}

#[test]
fn a_cut_reply_never_ends_and_the_next_is_whole() {
    let mut host = with(Faults {
        cut_replies: 1,
        ..Faults::default()
    });
    assert_eq!(host.ask(Request::GetVersion), None);
    assert!(host.ask(Request::GetVersion).unwrap().is_ok());
}

#[test]
fn harmed_packets_cost_frames_and_whole_frames_are_as_filmed() {
    let pattern = TestPattern::new(SEED);
    for faults in [
        Faults {
            packet_drop_chance: 0.003,
            ..Faults::default()
        },
        Faults {
            packet_duplicate_chance: 0.003,
            ..Faults::default()
        },
        Faults {
            transfer_split_chance: 0.5,
            ..Faults::default()
        },
    ] {
        let is_harmless = faults.packet_drop_chance == 0.0;
        let mut host = streaming(faults.clone());
        let transfers = host.transfers(&[0x81], 2 * SECOND);
        let (frames, lost_count) = frames(StreamKind::Depth, 0x81, &transfers);
        let counters = host.bus.camera().counters().depth;
        assert_eq!(counters.dropped_packets == 0, is_harmless);
        let doubles = counters.duplicated_packets > 0;
        assert_eq!(doubles, faults.packet_duplicate_chance > 0.0);
        assert_eq!(lost_count == 0, is_harmless);
        assert_eq!(counters.frames_damaged == 0, is_harmless);
        let delivered = host.bus.camera().delivered(StreamKind::Depth);
        assert!(delivered.len() >= 20);
        for frame in &frames {
            let Some(made) = delivered.iter().find(|made| made.ticks == frame.ticks.0) else {
                continue;
            };
            let got = codes(SampleFormat::Packed11, 320 * 240, &frame.payload);
            assert_eq!(got[0], pattern.shift(made.film_index, 0, 0, false));
            assert_eq!(got[9_999], pattern.shift(made.film_index, 79, 31, false));
        }
    }
}

#[test]
fn a_flipped_bit_is_counted() {
    let mut host = streaming(Faults {
        header_bit_chance: 0.01,
        payload_bit_chance: 0.01,
        ..Faults::default()
    });
    host.transfers(&[0x81], SECOND);
    let counters = host.bus.camera().counters().depth;
    assert!(counters.flipped_packets > 5);
    assert!(counters.frames_delivered + counters.frames_damaged >= 28);
}

#[test]
fn the_counter_wraps_and_drifts() {
    let mut host = streaming(Faults {
        first_ticks: u32::MAX - 10_000_000,
        clock_drift_ppm: 100.0,
        ..Faults::default()
    });
    let transfers = host.transfers(&[0x81], 10 * SECOND);
    let (frames, _) = frames(StreamKind::Depth, 0x81, &transfers);
    assert!(frames[0].ticks.0 > u32::MAX - 10_000_000);
    assert!(frames[20].ticks.0 < 100_000_000);
    let delivered = host.bus.camera().delivered(StreamKind::Depth);
    let (first, last) = (delivered[0], delivered[delivered.len() - 1]);
    let elapsed = f64::from(last.ticks.wrapping_sub(first.ticks));
    let host_seconds = (last.ready_nanos - first.ready_nanos) as f64 / 1e9;
    let rate = elapsed / host_seconds / TickRate::PS1080.hz() as f64;
    assert!((rate - 1.0001).abs() < 1e-6, "{rate}");
}

#[test]
fn a_stall_is_silent_and_then_packets_are_missing() {
    let mut host = streaming(Faults {
        stalls: vec![Stall {
            stream: StreamName::Depth,
            after_nanos: 500 * MILLISECOND,
            length_nanos: 300 * MILLISECOND,
        }],
        ..Faults::default()
    });
    let before = host.transfers(&[0x81], 505 * MILLISECOND).len();
    let during = host.transfers(&[0x81], 280 * MILLISECOND).len();
    assert!(before > 50 && during <= 1, "{before}, {during}");
    let after = host.transfers(&[0x81], 300 * MILLISECOND);
    let (frames, _) = frames(StreamKind::Depth, 0x81, &after);
    assert!(frames.len() >= 6, "{} frames", frames.len());
    assert!(host.bus.camera().counters().depth.fifo_lost_packets > 0);
}

#[test]
fn unplugging_ends_every_transfer() {
    for faults in [
        Faults {
            unplug_after_nanos: Some(400 * MILLISECOND),
            ..Faults::default()
        },
        Faults {
            unplug_after_bytes: Some(700_000),
            ..Faults::default()
        },
    ] {
        let mut host = streaming(faults);
        for token in 0..200 {
            host.bus.submit(host.now_nanos, 0x81, token, 20_480);
        }
        host.bus.advance(host.now_nanos + SECOND);
        let ended: Vec<_> = std::iter::from_fn(|| host.bus.completed()).collect();
        assert_eq!(ended.len(), 200);
        assert!(
            ended
                .iter()
                .any(|one| one.status == TransferStatus::Completed)
        );
        assert_eq!(ended[199].status, TransferStatus::NoDevice);
        assert!(host.ask(Request::GetMode).is_none());
    }
}

#[test]
fn short_and_repeated_frames_are_as_whole_on_the_wire() {
    let mut host = streaming(Faults {
        short_frame_chance: 0.2,
        repeat_frame_chance: 0.2,
        ..Faults::default()
    });
    let transfers = host.transfers(&[0x81], 2 * SECOND);
    let (frames, lost_count) = frames(StreamKind::Depth, 0x81, &transfers);
    let counters = host.bus.camera().counters().depth;
    assert_eq!(lost_count, 0);
    let short = frames.iter().filter(|frame| frame.payload.len() < 105_600);
    assert_eq!(short.count() as u64, counters.frames_damaged);
    assert!(counters.shortened_frames > 3 && counters.repeated_frames > 3);
    let whole: Vec<_> = frames
        .iter()
        .filter(|frame| frame.payload.len() == 105_600)
        .collect();
    let delivered = host.bus.camera().delivered(StreamKind::Depth);
    let mut repeats = delivered.windows(2).zip(whole.windows(2));
    assert!(
        repeats.any(|(made, got)| made[0].film_index == made[1].film_index
            && got[0].payload == got[1].payload
            && got[0].ticks != got[1].ticks)
    );
}

#[test]
fn an_alarm_stands_between_frames_and_harms_none() {
    let mut host = streaming(Faults {
        alarms: vec![Alarm {
            stream: StreamName::Depth,
            after_nanos: 200 * MILLISECOND,
            trouble: Trouble::Overheat,
        }],
        ..Faults::default()
    });
    let transfers = host.transfers(&[0x81], 500 * MILLISECOND);
    let mut receiver = FrameReceiver::new(StreamKind::Depth);
    let (mut alarms, mut frame_count) = (Vec::new(), 0);
    for (_, data) in &transfers {
        let mut transfer = data.as_slice();
        while let Some(event) = receiver.next(&mut transfer) {
            match event {
                FrameEvent::Fault(kind) => alarms.push((kind, frame_count)),
                FrameEvent::Ended(_) => frame_count += 1,
                FrameEvent::Lost(loss) => panic!("{loss:?}"),
                _ => {}
            }
        }
    }
    assert!(
        matches!(alarms.as_slice(), [(PacketKind::Overheat, 4..=7)]),
        "{alarms:?}"
    );
    assert!(frame_count >= 13);
}
