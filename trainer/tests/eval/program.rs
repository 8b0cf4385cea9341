//! The program as a user types it.

use std::path::Path;
use std::process::{Command, Output};

use geometry::{DVec3, Pose};
use sequence::DEPTH_STREAM;
use serde_json::Value;

use crate::recording::{all_ok, swinging_frames, write};

fn glint(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glint"))
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// What the program says when it refuses.
pub(crate) fn refused(arguments: &[&str]) -> String {
    let output = glint(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// A square of two triangles, 2 m in front of the first pose, as text.
pub(crate) fn write_square(path: &Path, z: f64) {
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n-1 -1 {z}\n1 -1 {z}\n1 1 {z}\n-1 1 {z}\n3 0 1 2\n3 0 2 3\n"
    );
    std::fs::write(path, text).unwrap();
}

#[test]
fn a_recording_is_judged_with_its_mesh() {
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name).to_str().unwrap().to_owned();
    let source = swinging_frames(120);
    let shift = DVec3::new(0.5, -0.25, 0.125);
    let live: Vec<Pose> = source
        .iter()
        .map(|pose| Pose::from_translation(shift) * *pose)
        .collect();
    let sets = [
        ("source", DEPTH_STREAM, all_ok(&source)),
        ("live", DEPTH_STREAM, all_ok(&live)),
    ];
    write(Path::new(&at("x.glint")), 120, &[], &sets);
    write_square(Path::new(&at("reference.ply")), 2.0);
    write_square(Path::new(&at("estimate.ply")), 2.0 + 0.003 + shift.z);
    let output = glint(&[
        "--json",
        "eval",
        &at("x.glint"),
        "--trajectory",
        "source",
        "--range",
        "0..60",
        "--mesh",
        &at("reference.ply"),
        "--estimated-mesh",
        &at("estimate.ply"),
    ]);
    let text = String::from_utf8(output.stdout).unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    let value: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let number = |key: &str| {
        value[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key} in {value}"))
    };
    assert_eq!(value["event"], "summary");
    assert!(number("ate_m") < 1e-9 && number("ate_first_pose_m") < 1e-9);
    assert_eq!(number("tracked_fraction"), 1.0);
    assert_eq!(value["alignment_rank"], "full");
    assert_eq!(value["segments"][0]["range"], serde_json::json!([0, 60]));
    // The squares are 3 mm apart and beside each other by half a metre and a quarter.
    assert!((number("mesh_accuracy_median_m") - 0.003).abs() < 1e-4);
    assert!(number("mesh_seen_fraction") > 0.5 && number("normal_error_deg") < 1e-3);
}

#[test]
fn what_the_user_forgot_is_named() {
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name).to_str().unwrap().to_owned();
    let sets = [("source", DEPTH_STREAM, all_ok(&swinging_frames(9)))];
    write(Path::new(&at("x.glint")), 9, &[], &sets);
    let x = at("x.glint");
    assert!(refused(&["eval", &x]).contains("give --trajectory"));
    assert!(refused(&["eval", &x, "--truth", "t"]).contains("is a recording"));
    let none = refused(&["eval", &x, "--trajectory", "source"]);
    assert!(none.contains("no poses named `live`"), "{none}");
    let few = refused(&["eval", &x, "--trajectory", "source", "--poses", "source"]);
    assert!(few.contains("9 poses are too few"), "{few}");
    let bare = refused(&["eval", &x, "--trajectory", "source", "--mesh", "m.ply"]);
    assert!(bare.contains("--estimated-mesh"), "{bare}");
    let range = refused(&["eval", &x, "--trajectory", "source", "--range", "5..5"]);
    assert!(range.contains("A below B"), "{range}");
}
