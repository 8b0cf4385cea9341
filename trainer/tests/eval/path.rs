//! Camera paths with errors put in.

use std::path::PathBuf;

use geometry::{DVec3, Pose, rotation};
use glint::eval::trajectory::{
    JudgedPath, TrajectoryOptions, TrajectoryReference, alignment_to_source, evaluate,
};
use glint::import::rig::PoseCamera;
use sequence::{COLOR_STREAM, DEPTH_STREAM, FramePose, PoseState, Recording};

use crate::recording::{
    BASELINE, FRAME_NANOS, all_ok, swinging, swinging_frames, with_state, write, write_tum,
};

struct Desk {
    folder: tempfile::TempDir,
}

impl Desk {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A recording with the set `source` of the depth camera and another set.
    fn record(&self, source: &[Pose], live: Vec<FramePose>, repeats: &[u64]) -> Recording {
        let path = self.path("x.glint");
        let sets = [
            ("source", DEPTH_STREAM, all_ok(source)),
            ("live", DEPTH_STREAM, live),
        ];
        write(&path, source.len(), repeats, &sets);
        Recording::open(&path).unwrap()
    }
}

fn options(reference: TrajectoryReference) -> TrajectoryOptions {
    TrajectoryOptions {
        reference,
        poses: "live".to_owned(),
        fit_offset: false,
        ranges: Vec::new(),
    }
}

fn against_source(recording: &Recording) -> JudgedPath {
    evaluate(recording, &options(TrajectoryReference::Source)).unwrap()
}

/// A world that is turned by 40 degrees and far away.
fn other_world() -> Pose {
    let turn = DVec3::new(1.0, 2.0, -0.5).normalize() * 40.0_f64.to_radians();
    Pose::new(rotation::exp(turn), DVec3::new(3.0, -2.0, 7.0)).unwrap()
}

fn moved(poses: &[Pose]) -> Vec<Pose> {
    poses.iter().map(|pose| other_world() * *pose).collect()
}

#[test]
fn a_true_path_in_another_world_has_no_error_and_the_angle_is_told() {
    let desk = Desk::new();
    let source = swinging_frames(120);
    let recording = desk.record(&source, all_ok(&moved(&source)), &[]);
    let judged = against_source(&recording);
    let whole = &judged.metrics.whole;
    assert!(whole.ate.max < 1e-9 && whole.ate_with_lost.max < 1e-9);
    assert!(whole.rpe_1s.unwrap().translation_m < 1e-9);
    assert!(whole.rpe_10cm.unwrap().rotation_deg < 1e-6);
    assert!((whole.alignment_angle_deg - 40.0).abs() < 1e-6);
    assert_eq!((whole.tracked_fraction, whole.wrong_accepted), (1.0, 0));
    assert_eq!(whole.rank, "full");
    assert_eq!(judged.metrics.time_offset, None);
    let alignment = alignment_to_source(&recording, "live").unwrap().unwrap();
    let difference = alignment.reference_from_estimate * other_world();
    assert!(rotation::log(difference.rotation()).length() < 1e-9);
}

#[test]
fn a_lost_end_counts_where_it_was_left() {
    let desk = Desk::new();
    let source = swinging_frames(120);
    let mut live = all_ok(&source);
    for pose in &mut live[80..] {
        *pose = with_state(pose, PoseState::Lost);
    }
    let whole = against_source(&desk.record(&source, live, &[]))
        .metrics
        .whole;
    assert!(whole.ate.max < 1e-9);
    assert_eq!((whole.compared_count, whole.referenced_count), (80, 120));
    assert!((whole.tracked_fraction - 80.0 / 120.0).abs() < 1e-12);
    let held = source[79].translation();
    let squares = source[80..]
        .iter()
        .map(|p| (p.translation() - held).length_squared());
    let expected = (squares.sum::<f64>() / 120.0).sqrt();
    assert!((whole.ate_with_lost.rmse - expected).abs() < 1e-9 && expected > 0.05);
}

#[test]
fn frames_of_other_maps_and_absent_frames_are_not_tracked_but_repeats_may_be_left_out() {
    let desk = Desk::new();
    let source = swinging_frames(60);
    let mut live = all_ok(&source);
    for pose in &mut live[40..50] {
        pose.map = 1;
        pose.world_from_camera = other_world() * pose.world_from_camera;
    }
    // 55 is absent as a repeat, 56 without a reason; 57 is a repeat that was tracked.
    live.retain(|pose| pose.number != 55 && pose.number != 56);
    let judged = against_source(&desk.record(&source, live, &[55, 57]));
    let whole = &judged.metrics.whole;
    assert_eq!(
        (whole.frame_count, whole.other_map_count, whole.absent_count),
        (59, 10, 1)
    );
    assert_eq!((whole.ok_count, whole.compared_count), (48, 48));
    assert!(whole.ate.max < 1e-9);
    assert!(judged.metrics.notes[0].contains("10 frames are in other maps"));
}

#[test]
fn accepted_poses_that_are_wrong_are_counted_and_weak_ones_are_not() {
    let desk = Desk::new();
    let source = swinging_frames(150);
    let mut live = all_ok(&source);
    let beside = |pose: &Pose, metres: f64, degrees: f64| {
        let step = Pose::new(
            rotation::exp(DVec3::Z * degrees.to_radians()),
            DVec3::Y * metres,
        );
        *pose * step.unwrap()
    };
    for (index, metres, degrees) in [
        (20, 0.08, 0.0),
        (21, 0.03, 0.0),
        (60, 0.0, 8.0),
        (61, 0.0, 3.0),
        (100, 0.2, 0.0),
    ] {
        live[index].world_from_camera = beside(&source[index], metres, degrees);
    }
    live[100].state = PoseState::Weak(0b1000);
    let whole = against_source(&desk.record(&source, live, &[]))
        .metrics
        .whole;
    assert_eq!((whole.wrong_accepted, whole.weak_count), (2, 1));
    assert_eq!(whole.tracked_fraction, 1.0);
    assert!(whole.ate.max > 0.15 && whole.ate.median < 0.01);
}

#[test]
fn a_jump_of_the_reference_is_told_apart_by_ranges() {
    let desk = Desk::new();
    let mut source = swinging_frames(150);
    let live = all_ok(&source);
    for pose in &mut source[75..] {
        *pose = Pose::from_translation(DVec3::X * 0.1) * *pose;
    }
    let recording = desk.record(&source, live, &[]);
    let mut options = options(TrajectoryReference::Source);
    options.ranges = vec![0..75, 75..150];
    let metrics = evaluate(&recording, &options).unwrap().metrics;
    assert!(metrics.whole.ate.rmse > 0.02);
    for (segment, range) in metrics.segments.iter().zip([[0, 75], [75, 150]]) {
        assert_eq!(segment.range, Some(range));
        assert!(segment.ate.max < 1e-9, "a segment has its own alignment");
        assert!(segment.ate_in_whole_m.unwrap() > 0.02);
    }
    // The first pose laid on the reference: the second half is off by the jump.
    assert!((metrics.whole.ate_first_pose.max - 0.1).abs() < 1e-9);
    options.ranges.clear();
    options.ranges.push(100..151);
    let error = evaluate(&recording, &options).unwrap_err().to_string();
    assert!(
        error.contains("100..151 reaches beyond the 150 frames"),
        "{error}"
    );
    options.ranges[0] = 100..109;
    let error = format!("{:#}", evaluate(&recording, &options).unwrap_err());
    assert!(error.contains("9 tracked poses are too few"), "{error}");
}

#[test]
fn motion_capture_with_its_own_clock_is_brought_in_time() {
    let desk = Desk::new();
    let source = swinging_frames(150);
    let recording = desk.record(&source, all_ok(&source), &[]);
    // The reference stamps everything 25 ms later, a hundred times a second, in its own world.
    let late = 25_000_000;
    let file = desk.path("mocap.txt");
    let stamps = (0..520).map(|index| index * 10_000_000);
    write_tum(
        &file,
        stamps.map(|nanos| {
            (
                nanos,
                other_world() * swinging((nanos - late) as f64 * 1e-9),
            )
        }),
    );
    let reference = TrajectoryReference::File(file, PoseCamera::Depth);
    let metrics = evaluate(&recording, &options(reference)).unwrap().metrics;
    let offset = metrics.time_offset.expect("the stamps are its own");
    assert!((offset.seconds - 0.025).abs() < 2e-4, "{}", offset.seconds);
    assert!(offset.rotation_deg < 0.2 * offset.rotation_deg_at_zero);
    // Stamps up to 5 ms apart at up to 0.7 m/s.
    assert!(metrics.whole.ate.max < 0.004, "{}", metrics.whole.ate.max);
    assert_eq!(metrics.whole.wrong_accepted, 0);
}

#[test]
fn a_file_of_the_colour_camera_with_the_frames_own_stamps_needs_no_clock() {
    let desk = Desk::new();
    let source = swinging_frames(60);
    let depth_from_color = Pose::from_translation(BASELINE).inverse();
    let live = source.iter().map(|pose| *pose * depth_from_color);
    let live = all_ok(&live.collect::<Vec<_>>());
    let path = desk.path("x.glint");
    write(&path, 60, &[], &[("live", COLOR_STREAM, live)]);
    let recording = Recording::open(&path).unwrap();
    let file = desk.path("color.txt");
    let stamped = source.iter().enumerate();
    write_tum(
        &file,
        stamped.map(|(index, pose)| (index as i64 * FRAME_NANOS, *pose * depth_from_color)),
    );
    let reference = TrajectoryReference::File(file.clone(), PoseCamera::Color);
    let judged = evaluate(&recording, &options(reference)).unwrap();
    assert_eq!(judged.metrics.time_offset, None);
    // Poses of the depth camera, whatever camera both were given for.
    for (found, expected) in judged.reference.iter().zip(&source) {
        let distance = found.unwrap().translation() - expected.translation();
        assert!(distance.length() < 1e-9);
    }
    assert!(judged.metrics.whole.ate.max < 1e-9);
    assert!(judged.metrics.whole.alignment_angle_deg < 1e-6);
    assert!(alignment_to_source(&recording, "live").unwrap().is_none());
}

#[test]
fn what_cannot_be_judged_is_said_in_a_sentence() {
    let desk = Desk::new();
    let source = swinging_frames(30);
    let mut live = all_ok(&source);
    for pose in &mut live[9..] {
        pose.state = PoseState::Lost;
    }
    let recording = desk.record(&source, live, &[]);
    let refused = |options: &TrajectoryOptions| {
        format!(
            "{:#}",
            evaluate(&recording, options).map(|_| ()).unwrap_err()
        )
    };
    let few = refused(&options(TrajectoryReference::Source));
    assert!(few.contains("9 tracked poses are too few"), "{few}");
    let mut other = options(TrajectoryReference::Source);
    other.poses = "refined".to_owned();
    let unknown = refused(&other);
    assert!(
        unknown.contains("no poses named `refined`; it has source, live"),
        "{unknown}"
    );
    let short = desk.path("short.txt");
    write_tum(&short, [(0, Pose::IDENTITY)]);
    let short = refused(&options(TrajectoryReference::File(
        short,
        PoseCamera::Depth,
    )));
    assert!(short.contains("1 poses are too few"), "{short}");
    let absent = TrajectoryReference::File(desk.path("absent.txt"), PoseCamera::Depth);
    assert!(refused(&options(absent)).contains("absent.txt"));
}
