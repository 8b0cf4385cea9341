//! A damaged recording: what is whole is exported, the rest is listed, the code is 3.

use std::path::Path;
use std::process::{Command, Output};

use glint::export::ExportTarget;
use sequence::{COLOR_STREAM, ColorEncoding, DEPTH_STREAM};
use serde_json::Value;

use crate::made::{COLOR_NUMBERS, DEPTH_NUMBERS, LAST_OF_FIRST_CHUNK, Made};

/// A recording of which depth frame 2 and colour frame 5 are damaged.
fn damaged() -> Made {
    let made = Made::new(ColorEncoding::Jpeg);
    let places = {
        let recording = made.open();
        let place = |stream, number| {
            let mut places = recording.contents().stream(stream).iter();
            *places.find(|place| place.label.number == number).unwrap()
        };
        [place(DEPTH_STREAM, 2), place(COLOR_STREAM, 5)]
    };
    let mut bytes = made.read("x.glint");
    for place in places {
        bytes[place.offset as usize + 24 + place.payload_bytes as usize / 2] ^= 0x10;
    }
    std::fs::write(made.at("x.glint"), bytes).unwrap();
    made
}

fn glint(arguments: &[&str], paths: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glint"))
        .args(arguments)
        .args(paths)
        .output()
        .expect("the program starts")
}

#[test]
fn damaged_frames_are_left_out_and_listed() {
    let made = damaged();
    let report = made.export(ExportTarget::Tum, "tum");
    assert_eq!(report.missing.len(), 2, "{:?}", report.missing);
    assert!(
        report.missing[0].starts_with("depth frame 2: "),
        "{:?}",
        report.missing
    );
    assert!(
        report.missing[1].starts_with("colour frame 5: "),
        "{:?}",
        report.missing
    );
    assert!(
        report
            .text
            .starts_with("7 depth images and 7 colour images, 5 pairs")
    );
    let readme = made.text("tum/README.txt");
    assert!(
        readme.contains("missing here\n- depth frame 2: "),
        "{readme}"
    );
    let again = made.import("tum");
    assert_eq!(again.contents().stream(DEPTH_STREAM).len(), 7);
    // Numbers 0, 1, 4 train; of the pairs 0, 1, 4, 7, 8 the last two are held out.
    assert_eq!(again.split().test, [3, 4]);
    for (target, name) in [
        (ExportTarget::SevenScenes, "scenes"),
        (ExportTarget::Folder, "folder"),
    ] {
        let report = made.export(target, name);
        assert_eq!(report.missing.len(), 2);
        assert!(report.text.starts_with("5 pairs"), "{}", report.text);
        let again = made.import(name);
        assert_eq!(again.frame_count(), 5);
        assert_eq!(again.split().test, [3, 4]);
    }
}

#[test]
fn a_recording_that_was_cut_is_exported_as_far_as_it_is_sealed() {
    let made = Made::new(ColorEncoding::Jpeg);
    let bytes = made.read("x.glint");
    // In front of the commit mark of the last chunk.
    let last_chunk = (0..bytes.len())
        .step_by(4096)
        .rfind(|at| bytes[*at..].starts_with(b"\x89glchunk"))
        .unwrap();
    std::fs::write(made.at("x.glint"), &bytes[..last_chunk + 64]).unwrap();
    let report = made.export(ExportTarget::Tum, "tum");
    let sealed = |numbers: &[u64]| {
        let numbers = numbers.iter();
        numbers
            .filter(|number| **number <= LAST_OF_FIRST_CHUNK)
            .count()
    };
    let counts = format!(
        "{} depth images and {} colour images, 5 pairs, 0 poses",
        sealed(&DEPTH_NUMBERS),
        sealed(&COLOR_NUMBERS)
    );
    assert!(report.text.starts_with(&counts), "{}", report.text);
    assert!(
        report.text.contains("no poses are exported"),
        "{}",
        report.text
    );
    let [line] = report.missing.as_slice() else {
        panic!("{:?}", report.missing);
    };
    assert!(line.contains("were never sealed"), "{line}");
    assert!(
        made.text("tum/README.txt")
            .contains("the recording was never closed")
    );
}

#[test]
fn the_program_ends_with_code_3_and_the_list() {
    let made = damaged();
    for target in ["tum", "7scenes", "folder"] {
        let output = made.at(target);
        let ended = glint(
            &["--json", "export", "--to", target],
            &[&made.at("x.glint"), Path::new("-o"), &output],
        );
        let (out, err) = (
            String::from_utf8(ended.stdout).unwrap(),
            String::from_utf8(ended.stderr).unwrap(),
        );
        assert_eq!(ended.status.code(), Some(3), "{err}");
        assert!(
            err.contains("2 parts of the recording could not be read"),
            "{err}"
        );
        assert!(
            err.contains("depth frame 2: ") && err.contains("colour frame 5: "),
            "{err}"
        );
        let last: Value = serde_json::from_str(out.lines().last().unwrap()).unwrap();
        assert_eq!(last["event"], "summary");
        assert_eq!(last["missing"].as_array().unwrap().len(), 2);
        assert!(output.join("README.txt").is_file());
    }
    let ended = glint(
        &["export", "--to", "tum"],
        &[&made.at("x.glint"), Path::new("-o"), &made.at("tum")],
    );
    assert_eq!(ended.status.code(), Some(2), "the folder is there already");
    let err = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(err.trim_end().lines().count(), 1, "{err}");
}

#[test]
fn a_whole_recording_ends_with_code_0() {
    let made = Made::new(ColorEncoding::Jpeg);
    for target in ["tum", "7scenes", "folder", "ply", "tum-trajectory"] {
        let ended = glint(
            &["export", "--to", target],
            &[&made.at("x.glint"), Path::new("-o"), &made.at(target)],
        );
        let err = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(0), "{err}");
        assert!(made.at(target).exists());
    }
}
