//! Replays in lock-step: every frame is tracked.

use std::path::{Path, PathBuf};

use geometry::Pose;
use glintd::capture::{CaptureOptions, capture};
use glintd::clock::HostClock;
use glintd::disk::Rotation;
use glintd::fuse::FuseOptions;
use glintd::outcome::Outcome;
use glintd::status::StopFlag;
use sequence::contents::StoredPoses;
use sequence::copy::{cut, recover};
use sequence::verify::verify;
use sequence::{ColorEncoding, Contents, FramePose, PoseState, Recording};

use super::scene::{self, Shot};

pub(crate) fn options(source: &Path, output: &Path) -> CaptureOptions {
    let text = format!("replay:{}?speed=max", source.display());
    let mut options = CaptureOptions::new(text.parse().unwrap(), output.to_path_buf());
    // The machine's disk is not what is tested.
    options.reserve_bytes = Some(0);
    let mut fuse = FuseOptions::default();
    fuse.live.volume.voxel_size = 0.01;
    options.fuse = Some(fuse);
    options
}

/// The path from place 0 on.
pub(crate) fn walk(count: u64) -> Vec<Shot> {
    (0..count).map(Shot::From).collect()
}

fn record(folder: &Path, shots: &[Shot], threads: usize) -> (Outcome, PathBuf) {
    record_of(&scene::write(folder, shots), folder, threads)
}

fn record_of(input: &Path, folder: &Path, threads: usize) -> (Outcome, PathBuf) {
    let output = folder.join(format!("out-{threads}.glint"));
    let mut options = options(input, &output);
    if let Some(fuse) = &mut options.fuse {
        fuse.threads = threads;
    }
    let outcome = capture(options, &StopFlag::default()).unwrap();
    (outcome, output)
}

fn live(contents: &Contents) -> Option<&StoredPoses> {
    let mut sets = contents.pose_sets.iter();
    sets.find(|set| set.head.name == "live")
}

/// Equal but for the last bits of a rotation, which is made a unit again when it is read.
fn is_same(one: &FramePose, other: &FramePose) -> bool {
    let change = one.world_from_camera.inverse() * other.world_from_camera;
    let moved = change.translation().length() + (1.0 - change.rotation().w.abs());
    let rest = |pose: &FramePose| (pose.number, pose.map, pose.state, pose.covariance);
    moved < 1e-12 && rest(one) == rest(other)
}

/// Distance of two poses, metres.
fn apart(one: Option<Pose>, other: Pose) -> f64 {
    (one.unwrap().inverse() * other).translation().length()
}

#[test]
fn every_frame_is_tracked_from_the_first_pose_of_the_source_on() {
    let folder = tempfile::tempdir().unwrap();
    let (outcome, output) = record(folder.path(), &walk(40), 2);
    let fusion = &outcome.fusion;
    assert_eq!((fusion.tracked, fusion.lost, fusion.skipped), (40, 0, 0));
    assert_eq!((fusion.fused, fusion.effort_frames), (40, [40, 0, 0, 0]));
    assert_eq!((outcome.frames_recorded, outcome.gaps), (80, 0));
    let recording = Recording::open(&output).unwrap();
    let stored = live(recording.contents()).unwrap();
    assert!(stored.head.producer.starts_with("glintd "));
    let numbers = stored.poses.iter().map(|pose| pose.number);
    assert!(numbers.eq(0..40));
    assert!(stored.poses.iter().all(|pose| pose.covariance.is_some()));
    let poses = recording.poses("live").unwrap();
    assert!(apart(poses[0], scene::pose(0)) < 1e-12);
    let errors = (0..)
        .zip(poses)
        .map(|(place, pose)| apart(*pose, scene::pose(place)));
    let worst = errors.fold(0.0, f64::max);
    // A voxel.
    assert!(worst < 0.01, "{worst} m");
    // What the replay brought came along.
    let source = recording.poses("source").unwrap();
    assert!(
        (0..)
            .zip(source)
            .all(|(place, pose)| apart(*pose, scene::pose(place)) < 1e-12)
    );
    let names: Vec<&str> = recording
        .contents()
        .histograms
        .iter()
        .map(|(_, histogram)| histogram.name.as_str())
        .collect();
    for name in [
        "fuse-track",
        "last-packet-to-fused",
        "last-packet-to-recorded",
        "pair-skew",
    ] {
        assert!(names.contains(&name), "{names:?}");
    }
    assert!(verify(&output, true).unwrap().is_whole());
}

#[test]
fn infrared_dots_that_move_with_the_camera_hold_nobody_back() {
    let folder = tempfile::tempdir().unwrap();
    let input = scene::write_as(folder.path(), &walk(40), ColorEncoding::Infrared10);
    let (outcome, output) = record_of(&input, folder.path(), 2);
    let fusion = &outcome.fusion;
    assert_eq!((fusion.tracked, fusion.lost, fusion.fused), (40, 0, 40));
    let recording = Recording::open(&output).unwrap();
    let poses = recording.poses("live").unwrap();
    let errors = (0..)
        .zip(poses)
        .map(|(place, pose)| apart(*pose, scene::pose(place)));
    let worst = errors.fold(0.0, f64::max);
    // A voxel.
    assert!(worst < 0.01, "{worst} m");
    assert!(verify(&output, true).unwrap().is_whole());
}

#[test]
fn poses_have_the_same_bits_for_one_worker_and_two() {
    let folder = tempfile::tempdir().unwrap();
    let poses = [1, 2].map(|threads| {
        let (_, output) = record(folder.path(), &walk(25), threads);
        let recording = Recording::open(&output).unwrap();
        live(recording.contents()).unwrap().poses.clone()
    });
    assert_eq!(poses[0].len(), 25);
    assert_eq!(poses[0], poses[1]);
}

#[test]
fn a_repeat_is_recorded_and_neither_tracked_nor_fused() {
    let folder = tempfile::tempdir().unwrap();
    let mut shots = walk(12);
    // Ten repeats of frame 5.
    shots.splice(6..6, [Shot::From(5); 10]);
    let (outcome, output) = record(folder.path(), &shots, 2);
    let fusion = &outcome.fusion;
    assert_eq!((fusion.tracked, fusion.depth_repeats), (12, 10));
    assert_eq!((fusion.fused, fusion.skipped), (12, 0));
    assert_eq!(outcome.frames_recorded, 44);
    let recording = Recording::open(&output).unwrap();
    let numbers = live(recording.contents()).unwrap().poses.iter();
    assert!(numbers.map(|pose| pose.number).eq((0..6).chain(16..22)));
}

#[test]
fn blank_frames_are_lost_not_fused_and_the_way_back_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let mut shots = walk(16);
    shots.splice(10..10, (0..5).map(Shot::Blank));
    let (outcome, output) = record(folder.path(), &shots, 2);
    let recording = Recording::open(&output).unwrap();
    let poses = &live(recording.contents()).unwrap().poses;
    assert_eq!(poses.len(), 21);
    for pose in &poses[10..15] {
        assert_eq!(pose.state, PoseState::Lost);
    }
    assert!(poses[..10].iter().all(|pose| pose.state == PoseState::Ok));
    assert_eq!(poses[20].state, PoseState::Ok);
    let fusion = &outcome.fusion;
    assert_eq!(fusion.tracked + fusion.lost, 21);
    assert_eq!(fusion.fused, fusion.tracked);
}

#[test]
fn poses_of_a_split_recording_are_in_the_file_of_their_frames() {
    let folder = tempfile::tempdir().unwrap();
    let input = scene::write(folder.path(), &walk(80));
    let output = folder.path().join("out.glint");
    let mut options = options(&input, &output);
    options.clock = {
        use std::sync::atomic::{AtomicI64, Ordering};
        // Twenty milliseconds a look: chunks of a few frames.
        static NANOS: AtomicI64 = AtomicI64::new(0);
        HostClock {
            monotonic: || NANOS.fetch_add(20_000_000, Ordering::Relaxed),
            wall: || 0,
        }
    };
    options.rotation = Rotation {
        bytes: Some(1),
        age: None,
    };
    let outcome = capture(options, &StopFlag::default()).unwrap();
    assert!(outcome.files.len() > 2, "{:?}", outcome.files);
    let mut next = 0;
    for file in &outcome.files {
        let recording = Recording::open(file).unwrap();
        let contents = recording.contents();
        let frames: Vec<u64> = contents
            .stream(1)
            .iter()
            .map(|place| place.label.number)
            .collect();
        for name in ["live", "source"] {
            let set = contents.pose_sets.iter().find(|set| set.head.name == name);
            let poses = set.map_or(&[][..], |set| set.poses.as_slice());
            let numbers: Vec<u64> = poses.iter().map(|pose| pose.number).collect();
            assert_eq!(numbers, frames, "{name} in {file:?}");
        }
        for number in frames {
            assert_eq!(number, next);
            next += 1;
        }
        assert!(verify(file, true).unwrap().is_whole());
    }
    assert_eq!(next, 80);
}

#[test]
fn live_poses_survive_cut_and_recover() {
    let folder = tempfile::tempdir().unwrap();
    let (_, output) = record(folder.path(), &walk(20), 2);
    let whole = Recording::open(&output).unwrap();
    let expected = &live(whole.contents()).unwrap().poses;
    let part = folder.path().join("part.glint");
    cut(&output, &part, 5..12).unwrap();
    let cut_out = Recording::open(&part).unwrap();
    let kept = &live(cut_out.contents()).unwrap().poses;
    assert_eq!(kept.len(), 7);
    assert!(
        kept.iter()
            .zip(&expected[5..])
            .all(|(one, other)| is_same(one, other))
    );
    // A byte in a frame costs that frame and no pose.
    let place = *whole.depth_place(7).unwrap();
    let mut bytes = std::fs::read(&output).unwrap();
    bytes[place.offset as usize + 100] ^= 4;
    let broken = folder.path().join("broken.glint");
    std::fs::write(&broken, &bytes).unwrap();
    let mended = folder.path().join("mended.glint");
    recover(&broken, &mended).unwrap();
    let mended = Recording::open(&mended).unwrap();
    let poses = &live(mended.contents()).unwrap().poses;
    assert_eq!(poses.len(), 20);
    assert!(
        poses
            .iter()
            .zip(expected)
            .all(|(one, other)| is_same(one, other))
    );
}

#[test]
fn a_stride_fuses_every_so_many_th_frame_and_tracks_all() {
    let folder = tempfile::tempdir().unwrap();
    let input = scene::write(folder.path(), &walk(12));
    let output = folder.path().join("out.glint");
    let mut options = options(&input, &output);
    if let Some(fuse) = &mut options.fuse {
        fuse.stride = 3;
    }
    let outcome = capture(options, &StopFlag::default()).unwrap();
    assert_eq!((outcome.fusion.tracked, outcome.fusion.fused), (12, 4));
}

#[test]
fn a_volume_that_is_full_says_so_in_the_file_and_the_recording_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let input = scene::write(folder.path(), &walk(12));
    let output = folder.path().join("out.glint");
    let mut options = options(&input, &output);
    if let Some(fuse) = &mut options.fuse {
        fuse.live.volume.memory_limit_bytes = 2 << 20;
    }
    let outcome = capture(options, &StopFlag::default()).unwrap();
    assert!(outcome.fusion.fuse_memory_limit_reached);
    assert_eq!((outcome.frames_recorded, outcome.gaps), (24, 0));
    let recording = Recording::open(&output).unwrap();
    let said = |event: &sequence::Event| event.details["message"].to_string().contains("full");
    assert_eq!(
        recording
            .contents()
            .events
            .iter()
            .filter(|event| said(event))
            .count(),
        1
    );
}
