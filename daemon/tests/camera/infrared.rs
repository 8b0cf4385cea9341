//! Infrared in place of colour, and the emitter.

use glintd::ps1080::modes::{ColorChoice, EmitterPlan, Wanted};
use ps1080::blocks::FixedField;
use ps1080::host::{MAX_HOST_PACKET_BYTES, Request};
use ps1080::mode::Resolution;
use ps1080::parameter::Parameter;
use ps1080::samples::{DepthSensor, measured_shift};
use sequence::{ColorEncoding, GapCause};
use serde_json::Value;
use virtual_carmine::{Faults, Personality, Refusal, Setup};

use crate::transport::{Filmed, bus, failure, film, film_with, open, pattern, small};
use crate::whole::{assert_whole, unplugged_after};

const SECOND_NANOS: i64 = 1_000_000_000;
/// ENABLE_EMITTER.
const EMITTER_OPCODE: u16 = 42;

fn infrared(wanted: Wanted) -> Wanted {
    Wanted {
        color: ColorChoice::Infrared,
        ..wanted
    }
}

fn dark(wanted: Wanted) -> Wanted {
    Wanted {
        emitter: EmitterPlan::Off,
        ..infrared(wanted)
    }
}

/// What the file says of the emitter, in order.
fn emitter_events(filmed: &Filmed) -> Vec<Value> {
    let events = filmed.recording.contents().events.iter();
    let words = events.filter_map(|event| event.details.get("emitter").cloned());
    words.collect()
}

#[test]
fn infrared_of_every_size_and_firmware_comes_as_filmed() {
    let vga = Wanted::default();
    let fast = Wanted { fps: 60, ..small() };
    for (personality, wanted, seconds) in [
        (Personality::firmware_5_1(), small(), 10),
        (Personality::firmware_5_4(), small(), 2),
        (Personality::carmine_1_08(), fast, 2),
        (Personality::carmine_1_09(), small(), 2),
        (Personality::carmine_1_09(), vga, 2),
    ] {
        let faults = unplugged_after(seconds * SECOND_NANOS);
        let filmed = film(personality, faults, infrared(wanted));
        let camera = filmed.recording.color_camera();
        assert_eq!(camera.encoding, ColorEncoding::Infrared10);
        assert_whole(&filmed, 30);
        assert!(filmed.recording.frame_count() >= 30);
    }
}

#[test]
fn a_sensor_that_sends_no_rows_below_the_picture_is_understood_too() {
    let mut personality = Personality::carmine_1_09();
    personality
        .fixed
        .set(FixedField::DepthSensor, DepthSensor::Ar0130.code());
    let faults = unplugged_after(2 * SECOND_NANOS);
    assert_whole(&film(personality, faults, infrared(small())), 30);
}

#[test]
fn infrared_is_what_the_depth_camera_sees() {
    let bus = bus(
        Personality::carmine_1_08(),
        unplugged_after(2 * SECOND_NANOS),
    );
    let filmed = film_with(open(&bus, infrared(small())).unwrap(), &bus);
    let streams = &filmed.recording.description().streams;
    assert_eq!(streams.color.intrinsics, streams.depth.intrinsics);
    assert_eq!(streams.color_from_depth, geometry::Pose::IDENTITY);
    assert!(streams.color.yuv.is_none());
    // Beside infrared of this size depth is measured by the pattern of VGA, as OpenNI2 has it too.
    let shift = streams.depth.shift.as_ref().unwrap();
    assert_eq!(shift.pixel_size_factor, 2.0);
    assert_eq!(emitter_events(&filmed), [] as [Value; 0]);
    let bus = bus.lock().unwrap();
    let value = |parameter| bus.camera().parameter(parameter);
    assert_eq!(value(Parameter::FrameSync), 0);
    assert_eq!(value(Parameter::InfraredMirror), 0);
    assert_eq!(value(Parameter::DepthMirror), 0);
    // Colour's exposure is not touched.
    assert_eq!(value(Parameter::AutoExposure), 1);
    assert!(bus.camera().is_lit());
}

/// Frames of infrared without dots come after those with dots, and nothing else; how many of each.
fn lit_and_dark(filmed: &Filmed) -> (usize, usize) {
    let pattern = pattern();
    let recording = &filmed.recording;
    let (mut lit_count, mut dark_count) = (0, 0);
    for place in recording.contents().stream(sequence::COLOR_STREAM) {
        let frame = recording.color_frame(place).unwrap();
        let image = sequence::infrared_samples(&frame, 320, 240).unwrap();
        let index = u64::from(image.pixels()[0]);
        let is_all = |sample: &dyn Fn(u32, u32) -> u16| {
            let mut places = (0..).zip(image.pixels());
            places.all(|(place, got)| *got == sample(place % 320, place / 320))
        };
        if is_all(&|x, y| pattern.unlit_infrared_sample(index, x, y)) {
            dark_count += 1;
        } else {
            assert!(is_all(&|x, y| pattern.infrared_sample(index, x, y)));
            assert_eq!(dark_count, 0, "dots after frame {}", place.label.number);
            lit_count += 1;
        }
    }
    (lit_count, dark_count)
}

#[test]
fn with_the_emitter_off_infrared_has_no_dots_and_depth_no_measurement() {
    let faults = unplugged_after(2 * SECOND_NANOS);
    let filmed = film(Personality::carmine_1_09(), faults, dark(small()));
    assert_eq!(emitter_events(&filmed), ["off"]);
    let (lit_count, dark_count) = lit_and_dark(&filmed);
    assert!(
        lit_count <= 2 && dark_count >= 30,
        "{lit_count} {dark_count}"
    );
    let depth = filmed.recording.contents().stream(sequence::DEPTH_STREAM);
    let has_measured = |place: &&sequence::scan::RecordPlace| {
        let samples = filmed.recording.depth_frame(place).unwrap();
        samples
            .pixels()
            .iter()
            .any(|&code| measured_shift(code).is_some())
    };
    assert!(depth.len() >= 30);
    assert!(depth.iter().filter(has_measured).count() <= 2);
    assert!(filmed.outcome.is_whole(), "{:?}", filmed.outcome.missing);
    assert!(filmed.verified.findings.is_empty(), "{:?}", filmed.verified);
    assert!(filmed.verified.books.iter().all(|book| book.balances));
}

#[test]
fn an_emitter_that_was_left_off_is_lit_where_that_is_asked_for() {
    let lit = Wanted {
        emitter: EmitterPlan::On,
        ..infrared(small())
    };
    let bus = bus(
        Personality::carmine_1_09(),
        unplugged_after(2 * SECOND_NANOS),
    );
    // What a program leaves behind that is killed.
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let length = Request::EnableEmitter { on: 0 }.encode(1, &mut packet);
    let setup = Setup::vendor_out(length as u16);
    let before_nanos = 999_000_000;
    let mut locked = bus.lock().unwrap();
    locked.control(before_nanos, setup, &mut packet[..length]);
    assert!(!locked.camera().is_lit());
    drop(locked);
    let filmed = film_with(open(&bus, lit).unwrap(), &bus);
    assert_eq!(emitter_events(&filmed), ["on"]);
    assert_whole(&filmed, 30);
}

#[test]
fn an_emitter_that_refuses_ends_a_recording_that_needs_it_off_and_no_other() {
    let refusing = || Faults {
        refusals: vec![Refusal {
            opcode: Some(EMITTER_OPCODE),
            error: 5,
            count: 9,
        }],
        ..unplugged_after(2 * SECOND_NANOS)
    };
    let dim = bus(Personality::carmine_1_09(), refusing());
    let words = failure(open(&dim, dark(small())).unwrap());
    assert!(words.contains("EnableEmitter"), "{words}");
    let lit = Wanted {
        emitter: EmitterPlan::On,
        ..infrared(small())
    };
    assert_whole(&film(Personality::carmine_1_09(), refusing(), lit), 30);
}

#[test]
fn a_camera_that_is_unplugged_at_any_moment_leaves_a_whole_file() {
    for after_bytes in [1, 70_000, 1_000_003] {
        let faults = Faults {
            unplug_after_bytes: Some(after_bytes),
            ..Faults::default()
        };
        let filmed = film(Personality::carmine_1_09(), faults, dark(small()));
        assert_eq!(filmed.outcome.reason, "unplugged");
        assert!(filmed.verified.findings.is_empty(), "{:?}", filmed.verified);
        let gaps = &filmed.recording.contents().gaps;
        assert!(
            gaps.iter().all(|gap| gap.cause == Some(GapCause::Unplug)),
            "{gaps:?}"
        );
    }
}

#[test]
fn packets_that_are_lost_make_gaps_and_no_wrong_brightness() {
    let faults = Faults {
        packet_drop_chance: 0.002,
        seed: 5,
        ..unplugged_after(3 * SECOND_NANOS)
    };
    let filmed = film(Personality::carmine_1_09(), faults, infrared(small()));
    let (depth, image) = filmed.assert_pixels();
    assert!(depth > 40 && image > 40);
    assert!(!filmed.outcome.is_whole());
    assert!(filmed.verified.findings.is_empty(), "{:?}", filmed.verified);
    assert!(filmed.verified.books.iter().all(|book| book.balances));
}

#[test]
fn what_cannot_be_done_is_refused_before_anything_streams() {
    let vga = Resolution::Vga;
    for (personality, wanted, expected) in [
        (Personality::firmware_5_4(), dark(small()), "5.8.15"),
        (
            Personality::carmine_1_09(),
            Wanted {
                is_registered: true,
                ..infrared(small())
            },
            "registration",
        ),
        (
            Personality::carmine_1_09(),
            Wanted {
                fps: 60,
                ..infrared(Wanted::default())
            },
            "qvga at 30 or 60",
        ),
        (
            Personality::carmine_1_09(),
            Wanted {
                color_resolution: vga,
                ..infrared(small())
            },
            "one size",
        ),
    ] {
        let bus = bus(personality, Faults::default());
        let error = open(&bus, wanted).err().expect(expected);
        let words = format!("{error:#}");
        assert!(words.contains(expected), "{words}");
    }
}
