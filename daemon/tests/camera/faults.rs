//! What the camera does wrong is recovered, or a gap with its cause.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::GapCause;
use virtual_carmine::{Faults, Personality, Refusal, Stall, StreamName};

use crate::transport::{Filmed, bus, film, open, small};

/// Until the plug is pulled.
const LENGTH_NANOS: i64 = 2_500_000_000;

fn with(faults: Faults) -> Filmed {
    let faults = Faults {
        unplug_after_nanos: Some(faults.unplug_after_nanos.unwrap_or(LENGTH_NANOS)),
        seed: 5,
        ..faults
    };
    film(Personality::carmine_1_09(), faults, small())
}

/// The books balance, no pixel is wrong; causes and counts of what is missing.
fn gaps(filmed: &Filmed) -> Vec<(GapCause, u64)> {
    filmed.assert_pixels();
    assert!(
        filmed.verified.findings.is_empty(),
        "{:?}",
        filmed.verified.findings
    );
    for book in &filmed.verified.books {
        assert!(book.balances, "{book:?}");
    }
    let mut counts: Vec<(GapCause, u64)> = Vec::new();
    for gap in &filmed.recording.contents().gaps {
        let cause = gap.cause.unwrap();
        match counts.iter_mut().find(|(known, _)| *known == cause) {
            Some((_, count)) => *count += gap.count,
            None => counts.push((cause, gap.count)),
        }
    }
    counts.retain(|(cause, _)| *cause != GapCause::Unplug);
    counts
}

#[test]
fn the_conversation_survives_what_it_must() {
    let refusal = |opcode, error, count| Refusal {
        opcode: Some(opcode),
        error,
        count,
    };
    let length = Some(60_000_000_000);
    let cases = [
        Faults {
            unanswered_requests: 1,
            ..Faults::default()
        },
        Faults {
            dead_requests: 1,
            ..Faults::default()
        },
        Faults {
            dead_requests: 3,
            ..Faults::default()
        },
        Faults {
            stale_replies: 9,
            ..Faults::default()
        },
        Faults {
            empty_replies: 2,
            ..Faults::default()
        },
        Faults {
            split_replies: 9,
            ..Faults::default()
        },
        Faults {
            garbage_bytes: 5,
            ..Faults::default()
        },
        Faults {
            refusals: vec![refusal(5, 13, 2)],
            ..Faults::default()
        },
        Faults {
            refusals: vec![refusal(3, 13, 2)],
            ..Faults::default()
        },
        Faults {
            refusals: vec![refusal(3, 14, 4)],
            ..Faults::default()
        },
        Faults {
            refusals: vec![refusal(40, 2, 1)],
            ..Faults::default()
        },
    ];
    for faults in cases {
        let name = format!("{faults:?}");
        let bus = bus(
            Personality::carmine_1_09(),
            Faults {
                unplug_after_nanos: length,
                ..faults
            },
        );
        let opened = open(&bus, small());
        assert!(opened.is_ok(), "{:?} with {name}", opened.err());
    }
}

#[test]
fn a_camera_that_cannot_be_used_is_refused_with_a_reason() {
    let refuse = |opcode, error, count| Faults {
        refusals: vec![Refusal {
            opcode: Some(opcode),
            error,
            count,
        }],
        ..Faults::default()
    };
    let mut safe = Personality::carmine_1_09();
    safe.mode = ps1080::mode::CameraMode::Safe;
    let mut old = Personality::firmware_5_1();
    old.version.firmware = ps1080::firmware::Firmware::new(5, 0, 17);
    let cases = [
        (safe, Faults::default(), "safe mode"),
        (old, Faults::default(), "5.0.17"),
        (Personality::carmine_1_09(), refuse(5, 13, 3), "not ready"),
        (
            Personality::carmine_1_09(),
            refuse(4, 6, 1),
            "sensor does not answer",
        ),
        (
            Personality::carmine_1_09(),
            Faults {
                dead_requests: 10_000,
                ..Faults::default()
            },
            "no answer in time",
        ),
        (
            Personality::carmine_1_09(),
            Faults {
                unplug_after_nanos: Some(3_000_000),
                ..Faults::default()
            },
            "unplugged",
        ),
    ];
    for (personality, faults, expected) in cases {
        let bus = bus(personality, faults);
        let error = open(&bus, small()).err().expect(expected);
        let words = format!("{error:#}");
        assert!(words.contains(expected), "{words}");
    }
}

#[test]
fn packets_that_are_lost_make_gaps_of_packet_loss() {
    let filmed = with(Faults {
        packet_drop_chance: 0.002,
        ..Faults::default()
    });
    let gaps = gaps(&filmed);
    let causes: Vec<GapCause> = gaps.iter().map(|(cause, _)| *cause).collect();
    assert_eq!(causes, [GapCause::PacketLoss], "{gaps:?}");
    let damaged = filmed.counters.depth.frames_damaged + filmed.counters.image.frames_damaged;
    assert!(gaps[0].1 >= damaged && gaps[0].1 > 3, "{gaps:?} {damaged}");
    assert!(!filmed.outcome.is_whole());
}

#[test]
fn packets_that_come_twice_are_left_out() {
    let filmed = with(Faults {
        packet_duplicate_chance: 0.05,
        ..Faults::default()
    });
    assert!(filmed.counters.depth.duplicated_packets > 10);
    assert_eq!(gaps(&filmed), []);
}

#[test]
fn transfers_may_end_anywhere() {
    let filmed = with(Faults {
        transfer_split_chance: 0.3,
        ..Faults::default()
    });
    assert_eq!(gaps(&filmed), []);
}

#[test]
fn damaged_headers_cost_frames_and_never_pixels() {
    let filmed = with(Faults {
        header_bit_chance: 0.004,
        ..Faults::default()
    });
    let flipped = filmed.counters.depth.flipped_packets + filmed.counters.image.flipped_packets;
    let gaps = gaps(&filmed);
    let missing: u64 = gaps.iter().map(|(_, count)| count).sum();
    assert!(flipped > 5 && missing > 0, "{flipped} {gaps:?}");
    let known = [GapCause::PacketLoss, GapCause::Corrupt, GapCause::Source];
    assert!(
        gaps.iter().all(|(cause, _)| known.contains(cause)),
        "{gaps:?}"
    );
}

#[test]
fn a_stalled_endpoint_is_packet_loss() {
    let filmed = with(Faults {
        stalls: vec![Stall {
            stream: StreamName::Depth,
            after_nanos: 700_000_000,
            length_nanos: 500_000_000,
        }],
        ..Faults::default()
    });
    let gaps = gaps(&filmed);
    assert_eq!(gaps.len(), 1, "{gaps:?}");
    assert_eq!(gaps[0].0, GapCause::PacketLoss);
    assert!((12..=17).contains(&gaps[0].1), "{gaps:?}");
}

#[test]
fn a_camera_that_falls_silent_is_started_anew() {
    let filmed = with(Faults {
        stalls: vec![Stall {
            stream: StreamName::Image,
            after_nanos: 700_000_000,
            length_nanos: 3_200_000_000,
        }],
        unplug_after_nanos: Some(9_000_000_000),
        ..Faults::default()
    });
    let gaps = gaps(&filmed);
    assert!(
        gaps.iter().any(|(cause, _)| *cause == GapCause::Restart),
        "{gaps:?}"
    );
    let events = &filmed.recording.contents().events;
    let is_warned = events.iter().any(|event| {
        event.details["message"]
            .as_str()
            .is_some_and(|message| message.contains("silent"))
    });
    assert!(is_warned, "{events:?}");
}

#[test]
fn a_counter_that_wraps_or_drifts_changes_nothing() {
    for (first_ticks, clock_drift_ppm) in [(u32::MAX - 60_000_000, 0.0), (0, 150.0), (9, -150.0)] {
        let filmed = with(Faults {
            first_ticks,
            clock_drift_ppm,
            ..Faults::default()
        });
        assert_eq!(gaps(&filmed), []);
        let frames = filmed.recording.contents().stream(sequence::DEPTH_STREAM);
        for pair in frames.windows(2) {
            let step = pair[1].label.device_nanos - pair[0].label.device_nanos;
            assert!((32_000_000..35_000_000).contains(&step), "{step}");
        }
    }
}

#[test]
fn everything_at_once_is_survived_without_a_wrong_pixel() {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    for seed in 0..4 {
        let mut chance = |most: f64| random.random_range(0.0..most);
        let faults = Faults {
            seed,
            stale_replies: 3,
            empty_replies: 1,
            garbage_bytes: 3,
            packet_drop_chance: chance(0.003),
            packet_duplicate_chance: chance(0.01),
            header_bit_chance: chance(0.002),
            transfer_split_chance: chance(0.2),
            clock_drift_ppm: chance(200.0),
            first_ticks: u32::MAX - 70_000_000,
            stalls: vec![Stall {
                stream: StreamName::Depth,
                after_nanos: 900_000_000,
                length_nanos: 150_000_000,
            }],
            unplug_after_nanos: Some(2_000_000_000),
            ..Faults::default()
        };
        let name = format!("{faults:?}");
        let filmed = film(Personality::carmine_1_09(), faults, small());
        let (depth, color) = filmed.assert_pixels();
        assert!(depth > 10 && color > 10, "{depth} {color} with {name}");
        let verified = &filmed.verified;
        assert!(verified.findings.is_empty(), "{verified:?} with {name}");
        assert!(
            verified.books.iter().all(|book| book.balances),
            "{:?} with {name}",
            verified.books
        );
    }
}
