//! Refinement of camera poses on the small studio, where the truth is known.

#[expect(dead_code, reason = "the studio serves other tests too")]
mod studio;

use std::path::Path;
use std::sync::OnceLock;

use geometry::trajectory::align_poses;
use geometry::{DVec3, Pose, rotation};
use glint::progress::Progress;
use glint::refine::{Refinement, StartFrame, refine};
use glint::run_folder::RunFolder;
use glint::stages::poses::{self, PosesSummary, SUMMARY_FILE, poses_of_run};
use imaging::Image;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::Recording;
use studio::{Finish, Frame};

/// Training frames of a studio recording.
const TRAIN_COUNT: usize = studio::FRAME_COUNT as usize * 3 / 4;

fn film() -> &'static [Frame] {
    static FILM: OnceLock<Vec<Frame>> = OnceLock::new();
    FILM.get_or_init(|| studio::film(Finish::Shiny))
}

fn record(path: &Path, frames: &[Frame], poses: &[Pose]) -> Recording {
    studio::write(path, frames, poses);
    Recording::open(path).unwrap()
}

/// The path with noise of 5 mm and 0.5 degrees a frame on a drift that reaches 10 mm and 0.6 degrees.
fn perturbed(path: &[Pose], seed: u64) -> Vec<Pose> {
    let mut generator = Pcg64Mcg::seed_from_u64(seed);
    let mut normal = || {
        let sum: f64 = (0..12).map(|_| generator.random::<f64>()).sum();
        sum - 6.0
    };
    let mut vector = |sigma: f64| DVec3::new(normal(), normal(), normal()) * (sigma / 3f64.sqrt());
    path.iter()
        .enumerate()
        .map(|(index, pose)| {
            let share = index as f64 / TRAIN_COUNT as f64;
            let drift = rotation::exp_twist(
                DVec3::new(0.003, -0.008, 0.005) * share,
                DVec3::new(0.006, -0.004, 0.007) * share,
            );
            let noise = rotation::exp_twist(vector(0.5_f64.to_radians()), vector(0.005));
            drift * *pose * noise
        })
        .collect()
}

fn starts(poses: &[Pose]) -> Vec<StartFrame> {
    poses
        .iter()
        .take(TRAIN_COUNT)
        .enumerate()
        .map(|(index, pose)| StartFrame {
            index,
            world_from_camera: *pose,
            covariance: None,
            follows_lost: false,
        })
        .collect()
}

fn refined(recording: &Recording, frames: &[StartFrame], threads: usize) -> Refinement {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| refine(recording, frames, &mut |_, _| {}))
        .unwrap()
}

/// Root mean square distance and largest angle from the truth after alignment.
fn errors(truth: &[Pose], found: &[Pose]) -> (f64, f64) {
    let truth = &truth[..found.len()];
    let moved = align_poses(truth, found).unwrap().reference_from_estimate;
    let (mut square, mut turn) = (0.0, 0.0_f64);
    for (truth, found) in truth.iter().zip(found) {
        let error = truth.inverse() * moved * *found;
        square += error.translation().length_squared();
        turn = turn.max(rotation::log(error.rotation()).length());
    }
    ((square / truth.len() as f64).sqrt(), turn.to_degrees())
}

#[test]
fn one_thread_and_two_give_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let truth = studio::path();
    let recording = record(&folder.path().join("a.glint"), film(), &truth);
    let start = &starts(&perturbed(&truth, 6))[..12];
    let (one, two) = (refined(&recording, start, 1), refined(&recording, start, 2));
    assert_eq!(one.poses, two.poses);
    assert_eq!(one.summary, two.summary);
}

#[test]
fn exact_poses_stay_exact() {
    let folder = tempfile::tempdir().unwrap();
    let truth = studio::path();
    let recording = record(&folder.path().join("a.glint"), film(), &truth);
    let found = refined(&recording, &starts(&truth)[..30], 2);
    let (ate, turn) = errors(&truth, &found.poses);
    println!(
        "{:#?}\nATE {ate:.6} m, turn {turn:.4} degrees",
        found.summary
    );
    assert!(ate < 3e-4, "{ate}");
}

#[test]
fn too_little_to_compare_keeps_the_start_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let truth = studio::path();
    let recording = record(&folder.path().join("a.glint"), film(), &truth);
    let start = starts(&truth);
    for count in [0, 1, 2] {
        let found = refined(&recording, &start[..count], 2);
        assert_eq!(found.poses, truth[..count]);
        assert!(!found.summary.is_used);
        assert!(
            found.summary.reason.contains("nothing to compare"),
            "{}",
            found.summary.reason
        );
    }
    let blank: Vec<Frame> = film()
        .iter()
        .map(|frame| Frame {
            time_nanos: frame.time_nanos,
            depth: frame.depth.map(|_| 0),
            color: frame.color.clone(),
        })
        .collect();
    let recording = record(&folder.path().join("blank.glint"), &blank, &truth);
    let found = refined(&recording, &start[..6], 2);
    assert_eq!(found.poses, truth[..6]);
    // Blank frames repeat each other; were they marked, none would be left.
    assert!(!found.summary.is_used, "{}", found.summary.reason);
}

#[test]
fn without_light_depth_alone_decides() {
    let folder = tempfile::tempdir().unwrap();
    let truth = studio::path();
    let dark: Vec<Frame> = film()
        .iter()
        .map(|frame| Frame {
            time_nanos: frame.time_nanos,
            depth: frame.depth.clone(),
            color: Image::new(frame.color.width(), frame.color.height(), [0; 3]),
        })
        .collect();
    let recording = record(&folder.path().join("dark.glint"), &dark, &truth);
    let start = perturbed(&truth, 8);
    let found = refined(&recording, &starts(&start)[..12], 2);
    println!("{:#?}", found.summary);
    let before = found.summary.before.unwrap();
    assert_eq!((before.flow_px, before.patch_count), (None, 0));
    assert!(
        found.summary.reason.contains("no texture"),
        "{}",
        found.summary.reason
    );
}

#[test]
fn noise_and_drift_go_away_and_the_run_keeps_the_path_of_all_frames() {
    let folder = tempfile::tempdir().unwrap();
    let truth = studio::path();
    let start = perturbed(&truth, 9);
    let recording = record(&folder.path().join("a.glint"), film(), &start);
    let run = RunFolder::create(&folder.path().join("run"), false).unwrap();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build()
        .unwrap();
    let frames = pool
        .install(|| poses::run(&recording, "refined", false, &run, &Progress::silent()))
        .unwrap()
        .frames;
    let summary: PosesSummary = run.read_json(SUMMARY_FILE).unwrap();
    assert_eq!(
        (summary.set.as_str(), summary.started_from.as_str()),
        ("refined", "source")
    );
    assert_eq!((summary.frame_count, summary.lost_count), (TRAIN_COUNT, 0));
    let refinement = summary.refinement.unwrap();
    assert!(refinement.is_used, "{}", refinement.reason);
    let found: Vec<Pose> = frames.iter().map(|frame| frame.world_from_camera).collect();
    let (ate_before, turn_before) = errors(&truth, &start[..found.len()]);
    let (ate, turn) = errors(&truth, &found);
    println!(
        "ATE {ate_before:.5} to {ate:.5} m, largest turn {turn_before:.3} to {turn:.3} degrees"
    );
    assert!(ate_before > 0.004 && ate < 0.001, "{ate_before} to {ate}");
    let all = poses_of_run(&run, &recording, "refined").unwrap();
    for frame in &frames {
        // Decimal digits of a file may cost the last bit.
        let error = all[frame.index].unwrap().inverse() * frame.world_from_camera;
        assert!(error.translation().length() < 1e-12);
        assert!(rotation::log(error.rotation()).length() < 1e-12);
    }
    // Frames that are held out move with their neighbours.
    let last = all[studio::FRAME_COUNT as usize - 1].unwrap();
    assert_ne!(last, start[studio::FRAME_COUNT as usize - 1]);
    assert!(
        (last.translation() - start[studio::FRAME_COUNT as usize - 1].translation()).length()
            < 0.03
    );
    assert!(run.path("poses/poses.txt").exists());
    assert_eq!(poses::default_set(&recording), "source");
    assert!(poses::run(&recording, "live", false, &run, &Progress::silent()).is_err());
}
