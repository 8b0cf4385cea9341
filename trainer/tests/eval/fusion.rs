//! Subject `fusion` with a script in the place of the recorder.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::Duration;

use geometry::{DVec3, Pose};
use glint::progress::Progress;
use glint::tradeoff::fusion::{BESIDE, COST, ERROR, Flag, FusionRunner, TRACKED};
use glint::tradeoff::subject::{Knob, Subject};
use glint::tradeoff::{PointStatus, TradeoffOptions, measure};
use sequence::{DEPTH_STREAM, PoseState};

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
    let ate = |name: &str| point(name).median("ate_m").unwrap();
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
