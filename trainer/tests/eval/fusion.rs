//! Subject `fusion` with a script in the place of the recorder.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::Duration;

use geometry::{DVec3, Pose};
use glint::eval::mesh::read_mesh;
use glint::progress::Progress;
use glint::tradeoff::fusion::careful::careful_mesh;
use glint::tradeoff::fusion::{self, BESIDE, COST, ERROR, FLAGS, Flag, FusionRunner, TRACKED};
use glint::tradeoff::subject::{Knob, MOST_POINTS, PointRunner as _, Subject};
use glint::tradeoff::{PointStatus, TradeoffOptions, measure};
use sequence::{DEPTH_STREAM, PoseState};

use crate::program::{refused, write_square};
use crate::recording::{all_ok, swinging_frames, with_state, write};

const SUBJECT: Subject = Subject {
    name: "fusion",
    knobs: &[
        Knob {
            name: "voxel-mm",
            default: "5",
            others: &["10", "2"],
        },
        Knob {
            name: "photometric",
            default: "on",
            others: &["off"],
        },
    ],
    cost: COST,
    error: ERROR,
    beside: BESIDE,
    exact: &[],
    no_candidates: &[],
    tracked: Some(TRACKED),
};

/// A recording whose live poses are off by up to `error` metres, the last third lost where `is_lost`.
fn record(path: &Path, error: f64, is_lost: bool) {
    let source = swinging_frames(90);
    let off = |(index, pose): (usize, &Pose)| {
        Pose::from_translation(DVec3::Y * error * (index as f64).sin()) * *pose
    };
    let mut live = all_ok(&source.iter().enumerate().map(off).collect::<Vec<_>>());
    if is_lost {
        for pose in &mut live[60..] {
            *pose = with_state(pose, PoseState::Lost);
        }
    }
    let sets = [
        ("source", DEPTH_STREAM, all_ok(&source)),
        ("live", DEPTH_STREAM, live),
    ];
    write(path, 90, &[], &sets);
}

#[test]
fn the_recorder_is_called_with_its_flags_and_its_path_is_judged() {
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name);
    record(&at("good.glint"), 0.002, false);
    record(&at("coarse.glint"), 0.01, false);
    record(&at("lost.glint"), 0.001, true);
    // The script says what it was called with, and leaves a prepared recording: coarse without photometric term, lost at 2 mm; at 10 mm it breaks.
    let script = format!(
        "#!/bin/sh\nname=good\nfor word; do\n[ \"$before\" = -o ] && out=\"$word\"\n[ \"$before\" = --voxel-mm ] && voxel=\"$word\"\n[ \"$word\" = --photometric ] && photometric=1\nbefore=\"$word\"\ndone\n[ -z \"$photometric\" ] && name=coarse\n[ \"$voxel\" = 2 ] && name=lost\n[ \"$voxel\" = 10 ] && {{ echo 'no memory for it' >&2; exit 2; }}\ncp {}/$name.glint \"$out\"\necho '{{\"event\":\"summary\",\"frames_in\":90,\"realtime_factor\":1.5,\"tracked\":90}}'\n",
        desk.path().display()
    );
    std::fs::write(at("glintd"), script).unwrap();
    std::fs::set_permissions(at("glintd"), std::fs::Permissions::from_mode(0o755)).unwrap();
    let runner = FusionRunner {
        subject: SUBJECT,
        flags: &[
            ("voxel-mm", Flag::Value("--voxel-mm")),
            ("photometric", Flag::Switch("--photometric")),
        ],
        program: at("glintd"),
        recording: at("good.glint"),
        mesh: None,
        judged_meshes: fusion::JudgedMeshes::default(),
    };
    let options = TradeoffOptions {
        output: at("out"),
        scene: "swinging".to_owned(),
        scene_blake3: String::new(),
        program: at("glintd"),
        repetitions: 1,
        seed: 1,
        timeout: Duration::from_secs(60),
    };
    let measured = measure(&runner, &options, &Progress::silent()).unwrap();
    let point = |name: &str| {
        let found = measured.points.iter().find(|point| point.name == name);
        found.unwrap_or_else(|| panic!("{name} is a point"))
    };
    let ate = |name: &str| 1e-3 * point(name).median("ate_mm").unwrap();
    let expected = 0.002 * 0.5_f64.sqrt();
    assert!(
        (ate("default") / expected - 1.0).abs() < 0.1,
        "{}",
        ate("default")
    );
    assert!(ate("photometric=off") > 4.0 * ate("default"));
    assert_eq!(point("default").median("realtime_factor"), Some(1.5));
    // The least error, of a third of the frames less.
    assert!(ate("voxel-mm=2") < ate("default"));
    assert!(measured.no_candidate(point("voxel-mm=2")).is_some());
    assert_eq!(point("voxel-mm=10").status, Some(PointStatus::Failed));
    assert_eq!(point("voxel-mm=10").reason(), "no memory for it");
    let words = point("default").runs[0].command.join(" ");
    assert!(
        words.contains("?speed=max --json -o") && words.contains("--voxel-mm 5"),
        "{words}"
    );
}

/// A recorder that leaves `moved.glint` and `moved.ply` and says so many core-seconds; it counts its calls in `calls`.
fn write_recorder(desk: &Path, core_s: f64) {
    let folder = desk.display();
    let script = format!(
        "#!/bin/sh\necho call >> {folder}/calls\nfor word; do\n[ \"$before\" = -o ] && cp {folder}/moved.glint \"$word\"\n[ \"$before\" = --mesh ] && cp {folder}/moved.ply \"$word\"\nbefore=\"$word\"\ndone\necho '{{\"event\":\"summary\",\"cpu_s\":{core_s},\"rss_peak_mb\":40}}'\n"
    );
    std::fs::write(desk.join("glintd"), script).unwrap();
    let mode = std::fs::Permissions::from_mode(0o755);
    std::fs::set_permissions(desk.join("glintd"), mode).unwrap();
}

#[test]
fn meshes_are_compared_in_the_world_of_the_reference_and_cost_no_frame() {
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name);
    let source = swinging_frames(90);
    let shift = DVec3::new(0.5, -0.25, 0.125);
    let live: Vec<Pose> = source
        .iter()
        .map(|pose| Pose::from_translation(shift) * *pose)
        .collect();
    let sets = [
        ("source", DEPTH_STREAM, all_ok(&source)),
        ("live", DEPTH_STREAM, all_ok(&live)),
    ];
    write(&at("moved.glint"), 90, &[], &sets);
    write_square(&at("moved.ply"), 2.0 + shift.z);
    write_recorder(desk.path(), 0.0);
    let mut runner = FusionRunner {
        subject: fusion::SUBJECT,
        flags: FLAGS,
        program: at("glintd"),
        recording: at("moved.glint"),
        mesh: None,
        judged_meshes: fusion::JudgedMeshes::default(),
    };
    let make = |runner: &FusionRunner| {
        let timeout = Duration::from_secs(60);
        careful_mesh(runner, &at("out"), "ab12", timeout, &Progress::silent()).unwrap()
    };
    let reference = make(&runner);
    let mesh = read_mesh(&reference).unwrap();
    let first = mesh.origin + mesh.positions[0].as_dvec3();
    assert!((first - (DVec3::new(-1.0, -1.0, 2.0 + shift.z) - shift)).length() < 1e-6);
    assert_eq!(make(&runner), reference);
    let calls = std::fs::read_to_string(at("calls")).unwrap();
    assert_eq!(calls.lines().count(), 1, "a mesh that is there is taken");

    runner.mesh = Some(reference);
    let point = at("point");
    std::fs::create_dir(&point).unwrap();
    std::fs::copy(at("moved.glint"), point.join("live.glint")).unwrap();
    std::fs::copy(at("moved.ply"), point.join("live.ply")).unwrap();
    // Three seconds from outside, of which the mesh took one.
    let figures = runner.figures("{\"cpu_s\":2.0}", &point, 3.0).unwrap();
    assert!((figures.metrics[COST.key] - 1e3 * 2.0 / 90.0).abs() < 1e-9);
    assert!(figures.metrics[ERROR.key] < 1e-6);
    assert!((figures.metrics["fscore_5mm"] - 1.0).abs() < 1e-12);
    for (line, wrong) in [
        ("{\"cpu_s\":3.5}", "counts 3.50"),
        ("{}", "no cpu_s"),
        (
            "{\"cpu_s\":2.0,\"fuse_failure\":\"no volume\"}",
            "no volume",
        ),
    ] {
        let error = runner.figures(line, &point, 3.0).unwrap_err();
        assert!(format!("{error:#}").contains(wrong), "{error:#}");
    }
}

#[test]
fn every_knob_has_its_flag_and_the_grid_is_a_comparison() {
    let points = fusion::SUBJECT.points();
    assert!((10..=MOST_POINTS).contains(&points.len()));
    let knobs = fusion::SUBJECT.knobs.iter().map(|knob| knob.name);
    let flags = FLAGS.iter().map(|(name, _)| *name);
    assert!(knobs.eq(flags));
}

#[test]
fn what_cannot_be_measured_is_refused_with_a_sentence() {
    let desk = tempfile::tempdir().unwrap();
    let at = |name: &str| desk.path().join(name).to_str().unwrap().to_owned();
    write_recorder(desk.path(), 1.0);
    let sets = [("live", DEPTH_STREAM, all_ok(&swinging_frames(30)))];
    for folder in ["a", "b"] {
        std::fs::create_dir(at(folder)).unwrap();
        write(Path::new(&at(&format!("{folder}/x.glint"))), 30, &[], &sets);
    }
    let (one, other, out) = (at("a/x.glint"), at("b/x.glint"), at("out"));
    let recorder = at("glintd");
    let call = |more: &[&str]| {
        let fixed = ["tradeoff", "fusion", "-o", &out, "--glintd", &recorder];
        refused(&[&fixed[..], more].concat())
    };
    assert!(call(&[&one]).contains("no poses `source`"));
    assert!(call(&[&one, &other]).contains("two recordings are named `x`"));
    assert!(call(&[&one, &other, "--reference-mesh", "m.ply"]).contains("of one recording"));
}
