//! The driver of OpenNI2, unmodified as Debian has it, streams from the virtual camera; every pixel that it decodes is
//! compared with what was filmed. The camera and our driver share one description of the protocol and one crate, and so
//! perhaps an error; that driver shares neither.

mod expected;
mod stream;

use std::path::Path;

use expected::{
    depth_mm, infrared, measured_shifts, mosaic, registered_shifts, rgb, shifts, unlit_infrared,
    uyvy, yuyv,
};
use ps1080::samples::NO_SHIFT;
use stream::{Frame, Outcome, Setting, stream};
use virtual_carmine::TestPattern;

const SEED: u64 = 23;
/// As many frames as the pattern has before it repeats; a frame that is none of them is wrong.
const CYCLE: u64 = 8;
const SECOND_MICROS: u64 = 1_000_000;
const INFRARED: u64 = 1;
const COLOR: u64 = 2;
const DEPTH: u64 = 3;
const WHERE: &str = "/usr/lib/x86_64-linux-gnu/libOpenNI2.so.0";

fn pattern() -> TestPattern {
    TestPattern::with_cycle(SEED, CYCLE)
}

/// Runs the driver; `None` and a line where it is not installed.
fn run(setting: &Setting) -> Option<Outcome> {
    let outcome = stream(setting);
    if outcome.is_none() {
        println!("skipped: libopenni2 is not installed");
        assert!(!Path::new(WHERE).exists(), "installed but not loaded");
    }
    outcome
}

/// How many frames are, byte for byte, a frame of the pattern, and the one that their time says. A frame that came late to
/// a busy machine may be missing; no other may stand in its place.
fn count_as_filmed(frames: &[Frame], expected: impl Fn(u64) -> Vec<u8>) -> usize {
    let filmed: Vec<Vec<u8>> = (0..CYCLE).map(expected).collect();
    let mut last: Option<(u64, u64)> = None;
    let mut count = 0;
    for frame in frames {
        let found = filmed.iter().position(|filmed| *filmed == frame.data);
        let Some(found) = found.map(|found| found as u64) else {
            continue;
        };
        let is_due = last.is_none_or(|(index, micros)| {
            let periods = ((frame.micros - micros) * frame.fps + SECOND_MICROS / 2) / SECOND_MICROS;
            // Without depth the time of infrared stands still; the driver then takes the host's.
            frame.sensor == INFRARED || (index + periods) % CYCLE == found
        });
        count += usize::from(is_due);
        last = Some((found, frame.micros));
    }
    count
}

#[track_caller]
fn all_are_filmed(setting: &Setting, expected: impl Fn(u64) -> Vec<u8>) {
    let Some(outcome) = run(setting) else {
        return;
    };
    let frames = outcome.frames;
    assert_eq!(frames.len(), setting.frame_count);
    let count = count_as_filmed(&frames, expected);
    assert_eq!(count, frames.len(), "{setting:?}");
}

fn of(personality: &'static str, streams: &[&'static str]) -> Setting {
    Setting {
        personality,
        streams: streams.to_vec(),
        frame_count: 5,
        camera: String::new(),
        does_close: false,
        registers: false,
        is_dark: false,
    }
}

#[test]
fn depth_of_every_format_is_the_table_of_what_was_filmed() {
    let pattern = pattern();
    for stream in [
        "3:0:100:320:240:30",
        "3:1:100:320:240:30",
        "3:3:100:320:240:30",
        "3:4:100:320:240:30",
    ] {
        let setting = of("carmine-1.08", &[stream]);
        all_are_filmed(&setting, |index| depth_mm(&pattern, index, 320, 240, 1.0));
    }
}

#[test]
fn depth_of_other_sizes_and_rates_has_their_table() {
    let pattern = pattern();
    let setting = of("carmine-1.08", &["3:3:100:160:120:30"]);
    all_are_filmed(&setting, |index| depth_mm(&pattern, index, 160, 120, 1.0));
    let setting = of("carmine-1.08", &["3:1:100:640:480:30"]);
    all_are_filmed(&setting, |index| depth_mm(&pattern, index, 640, 480, 1.0));
    // At 60 frames a second the sensor uses the reference pattern of VGA.
    let setting = of("carmine-1.08", &["3:3:100:320:240:60"]);
    all_are_filmed(&setting, |index| depth_mm(&pattern, index, 320, 240, 2.0));
}

#[test]
fn packets_of_any_size_make_the_same_picture() {
    let pattern = pattern();
    for packet_bytes in [512, 1_000, 65_512] {
        let mut setting = of("carmine-1.08", &["3:3:102:640:480:30"]);
        setting.camera = format!("packet_bytes = {packet_bytes}\n");
        all_are_filmed(&setting, |index| shifts(&pattern, index, 640, 480));
    }
}

#[test]
fn what_section_10_says_that_the_driver_tolerates_is_tolerated() {
    let pattern = pattern();
    let mut setting = of("carmine-1.08", &["3:3:102:320:240:30"]);
    setting.camera = "[camera.faults]\nempty_replies = 2\ngarbage_bytes = 5\nstale_replies = 3\n\
        refusals = [{ opcode = 5, error = 13, count = 1 }]\ntransfer_split_chance = 0.3\n"
        .to_owned();
    all_are_filmed(&setting, |index| shifts(&pattern, index, 320, 240));
}

#[test]
fn padding_of_a_registered_picture_is_no_depth() {
    let pattern = pattern();
    // Two rows and a half above, one and a half below.
    let (before, after) = (800, 480);
    let mut setting = of("carmine-1.08", &["3:3:102:320:240:30"]);
    setting.registers = true;
    setting.camera = format!("padding = [{before}, {after}]\n");
    all_are_filmed(&setting, |index| {
        let mut bytes = registered_shifts(&pattern, index, 320, 240);
        let sent = 2 * before..bytes.len() - 2 * after;
        for unsent in [0..sent.start, sent.end..bytes.len()] {
            let places = bytes[unsent].as_chunks_mut().0;
            places.fill(NO_SHIFT.to_le_bytes());
        }
        bytes
    });
}

#[test]
fn shifts_come_through_as_they_are() {
    let pattern = pattern();
    for stream in ["3:3:102:640:480:30", "3:1:102:640:480:30"] {
        let setting = of("carmine-1.08", &[stream]);
        all_are_filmed(&setting, |index| shifts(&pattern, index, 640, 480));
    }
    // Of these formats the driver takes the shift that is no measurement out.
    for stream in ["3:0:102:320:240:30", "3:4:102:320:240:30"] {
        let setting = of("carmine-1.08", &[stream]);
        all_are_filmed(&setting, |index| measured_shifts(&pattern, index, 320, 240));
    }
}

#[test]
fn colour_of_every_format_is_what_was_filmed() {
    let pattern = pattern();
    for stream in ["2:1:201:320:240:30", "2:5:201:320:240:30"] {
        let setting = of("carmine-1.09", &[stream]);
        all_are_filmed(&setting, |index| uyvy(&pattern, index, 320, 240));
    }
    let setting = of("carmine-1.09", &["2:7:205:320:240:30"]);
    all_are_filmed(&setting, |index| yuyv(&pattern, index, 320, 240));
    for stream in ["2:0:202:320:240:30", "2:6:202:320:240:30"] {
        let setting = of("carmine-1.09", &[stream]);
        all_are_filmed(&setting, |index| mosaic(&pattern, index, 320, 240));
    }
}

#[test]
fn colour_as_rgb_is_the_formula_of_what_was_filmed() {
    let pattern = pattern();
    for stream in ["2:1:200:320:240:30", "2:5:200:320:240:30"] {
        let setting = of("carmine-1.09", &[stream]);
        all_are_filmed(&setting, |index| rgb(&pattern, index, 320, 240));
    }
}

#[test]
fn infrared_is_what_was_filmed() {
    let pattern = pattern();
    let setting = of("carmine-1.08", &["1:0:203:320:240:30"]);
    all_are_filmed(&setting, |index| infrared(&pattern, index, 320, 240));
}

#[test]
fn the_emitter_goes_off_by_the_request_that_this_driver_sends() {
    let pattern = pattern();
    let setting = Setting {
        frame_count: 8,
        is_dark: true,
        ..of("carmine-1.08", &["1:0:203:320:240:30"])
    };
    let Some(outcome) = run(&setting) else {
        return;
    };
    let count = count_as_filmed(&outcome.frames, |index| {
        unlit_infrared(&pattern, index, 320, 240)
    });
    // The first ones may have been taken before.
    assert!(count >= 4, "{count}");
}

/// Our recordings of depth beside infrared have the constants that this driver converts by.
#[test]
fn depth_beside_infrared_is_converted_by_the_pattern_of_vga_at_qvga() {
    let pattern = pattern();
    let qvga = ["3:3:100:320:240:30", "1:0:203:320:240:30"];
    let vga = ["3:3:100:640:480:30", "1:0:203:640:480:30"];
    for (streams, width, height, factor) in [(qvga, 320, 240, 2.0), (vga, 640, 480, 1.0)] {
        let setting = of("carmine-1.08", &streams);
        let Some(outcome) = run(&setting) else {
            return;
        };
        let count = count_as_filmed(&outcome.from(INFRARED), |index| {
            infrared(&pattern, index, width, height)
        });
        assert_eq!(count, setting.frame_count, "infrared of {width} columns");
        let count = count_as_filmed(&outcome.from(DEPTH), |index| {
            depth_mm(&pattern, index, width, height, factor)
        });
        assert_eq!(count, setting.frame_count, "depth of {width} columns");
    }
}

#[test]
fn older_firmware_streams_too() {
    let pattern = pattern();
    // One run each: the driver takes seconds to ask this firmware all it wants to know.
    for personality in ["firmware-5.4", "firmware-5.1"] {
        let setting = of(personality, &["3:3:100:320:240:30", "2:1:201:320:240:30"]);
        let Some(outcome) = run(&setting) else {
            return;
        };
        let count = count_as_filmed(&outcome.from(DEPTH), |index| {
            depth_mm(&pattern, index, 320, 240, 1.0)
        });
        assert_eq!(count, setting.frame_count, "{personality}: depth");
        let count = count_as_filmed(&outcome.from(COLOR), |index| {
            uyvy(&pattern, index, 320, 240)
        });
        assert_eq!(count, setting.frame_count, "{personality}: colour");
    }
}

#[test]
fn both_streams_at_vga_come_together_and_the_camera_loses_nothing() {
    let setting = Setting {
        frame_count: 20,
        does_close: true,
        ..of(
            "carmine-1.08",
            &["3:3:102:640:480:30", "2:1:201:640:480:30"],
        )
    };
    let Some(outcome) = run(&setting) else {
        return;
    };
    let pattern = pattern();
    let (depth, color) = (outcome.from(DEPTH), outcome.from(COLOR));
    let count = count_as_filmed(&depth, |index| shifts(&pattern, index, 640, 480));
    assert_eq!(count, 20);
    let count = count_as_filmed(&color, |index| uyvy(&pattern, index, 640, 480));
    assert_eq!(count, 20);
    let counters = &outcome.log["cameras"][0]["counters"];
    for stream in ["depth", "image"] {
        assert_eq!(counters[stream]["fifo_lost_bytes"], 0, "{counters}");
    }
    // Sensors that start together: the depth frame that came last has a colour frame of its time.
    let last = depth.last().unwrap().micros;
    let apart = color.iter().map(|frame| frame.micros.abs_diff(last)).min();
    assert!(apart.unwrap() < 3_000, "{apart:?} us");
}

#[test]
fn a_camera_that_deviates_is_caught() {
    let pattern = pattern();
    for (deviation, stream, is_depth) in [
        ("nibble-order", "3:3:100:320:240:30", true),
        ("chroma-swapped", "2:5:201:320:240:30", false),
        ("predictors-kept", "2:1:201:320:240:30", false),
    ] {
        let mut setting = of("carmine-1.08", &[stream]);
        setting.camera = format!("[camera.faults]\ndeviation = \"{deviation}\"\n");
        let Some(outcome) = run(&setting) else {
            return;
        };
        let count = count_as_filmed(&outcome.frames, |index| {
            if is_depth {
                depth_mm(&pattern, index, 320, 240, 1.0)
            } else {
                uyvy(&pattern, index, 320, 240)
            }
        });
        assert_eq!(count, 0, "{deviation} was not noticed");
    }
}
