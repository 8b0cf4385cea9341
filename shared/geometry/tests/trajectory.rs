//! Trajectory measures against paths whose errors are known.

mod sampling;

use geometry::trajectory::{
    OffsetSearch, Spread, align_poses, fit_time_offset, mean_rotation, pairs_by_distance,
    pairs_by_time, relative_error,
};
use geometry::{AlignmentRank, DVec3, Pose, rotation};
use sampling::{generator, uniform, unit_vector};

const FRAME_NANOS: i64 = 33_333_333;

/// A hand-held path: position and orientation swing with different periods.
fn swinging(seconds: f64) -> Pose {
    let position = DVec3::new(
        0.4 * (1.3 * seconds).sin(),
        0.2 * (2.1 * seconds).cos(),
        0.3 * (0.7 * seconds).sin(),
    );
    let turn = DVec3::new(
        0.5 * (2.9 * seconds).sin(),
        0.4 * (1.7 * seconds + 0.3).sin(),
        0.2 * (3.7 * seconds).cos(),
    );
    Pose::new(rotation::exp(turn), position).expect("finite")
}

fn timed(count: i64, step_nanos: i64, shift_nanos: i64) -> Vec<(i64, Pose)> {
    let pose = |index: i64| {
        let nanos = index * step_nanos;
        (nanos, swinging((nanos + shift_nanos) as f64 * 1e-9))
    };
    (0..count).map(pose).collect()
}

fn poses(timed: &[(i64, Pose)]) -> Vec<Pose> {
    timed.iter().map(|(_, pose)| *pose).collect()
}

fn nanos(timed: &[(i64, Pose)]) -> Vec<i64> {
    timed.iter().map(|(nanos, _)| *nanos).collect()
}

#[test]
fn the_spread_of_no_errors_and_of_nan_is_none() {
    assert_eq!(Spread::of(&[]), None);
    assert_eq!(Spread::of(&[1.0, f64::NAN]), None);
    let spread = Spread::of(&[3.0, 0.0, 4.0, 0.0]).expect("numbers");
    assert_eq!((spread.rmse, spread.median, spread.max), (2.5, 1.5, 4.0));
}

#[test]
fn another_world_does_not_change_the_relative_error() {
    let path = timed(120, FRAME_NANOS, 0);
    let world = Pose::new(
        rotation::exp(DVec3::new(0.4, -2.0, 1.0)),
        DVec3::new(5.0, -3.0, 9.0),
    );
    let world = world.expect("finite");
    let moved: Vec<Pose> = poses(&path).iter().map(|pose| world * *pose).collect();
    let pairs = pairs_by_time(&nanos(&path), 1_000_000_000, FRAME_NANOS / 2);
    let error = relative_error(&poses(&path), &moved, &pairs).expect("pairs");
    assert_eq!(error.count, 90);
    assert!(error.translation_rmse < 1e-12 && error.rotation_rmse < 1e-12);
}

#[test]
fn a_steady_drift_is_its_rate_times_the_step() {
    // 2 mm and 0.1 degree of drift a frame, in camera axes.
    let drift = Pose::new(
        rotation::exp(DVec3::Z * 0.1_f64.to_radians()),
        DVec3::Z * 0.002,
    )
    .expect("finite");
    let count = 100;
    let reference: Vec<Pose> = vec![Pose::IDENTITY; count];
    let mut estimate = vec![Pose::IDENTITY];
    for index in 1..count {
        estimate.push(estimate[index - 1] * drift);
    }
    let times: Vec<i64> = (0..count as i64).map(|index| index * FRAME_NANOS).collect();
    let pairs = pairs_by_time(&times, 1_000_000_000, FRAME_NANOS / 2);
    let error = relative_error(&reference, &estimate, &pairs).expect("pairs");
    assert!((error.translation_rmse - 30.0 * 0.002).abs() < 1e-9);
    assert!((error.rotation_rmse - 30.0 * 0.1_f64.to_radians()).abs() < 1e-9);
}

#[test]
fn pairs_by_time_skip_gaps_and_never_pair_a_frame_with_itself() {
    let times = [0, 10, 20, 100, 110];
    assert_eq!(pairs_by_time(&times, 10, 2), [(0, 1), (1, 2), (3, 4)]);
    assert_eq!(pairs_by_time(&times, 1, 3), []);
    assert_eq!(pairs_by_time(&times, i64::MAX, 5), []);
    assert_eq!(pairs_by_time(&[], 10, 2), []);
}

#[test]
fn pairs_by_distance_follow_the_path_not_the_air_line() {
    let at = |x: f64| Pose::from_translation(DVec3::X * x);
    let there_and_back = [at(0.0), at(0.06), at(0.0), at(0.06)];
    assert_eq!(pairs_by_distance(&there_and_back, 0.1), [(0, 2), (1, 3)]);
    assert_eq!(pairs_by_distance(&[at(0.0); 5], 0.1), []);
    assert_eq!(pairs_by_distance(&[], 0.1), []);
}

#[test]
fn the_mean_of_noisy_orientations_is_the_common_turn() {
    let mut rng = generator(5);
    for _ in 0..1000 {
        let turn = rotation::exp(unit_vector(&mut rng) * uniform(&mut rng, 0.0, 3.1));
        let pairs: Vec<_> = (0..200)
            .map(|_| {
                let own = rotation::exp(unit_vector(&mut rng) * uniform(&mut rng, 0.0, 3.0));
                let noise = rotation::exp(unit_vector(&mut rng) * 0.01);
                (noise * turn * own, own)
            })
            .collect();
        let mean = mean_rotation(pairs).expect("orientations agree");
        assert!(rotation::log(mean * turn.conjugate()).length() < 3e-3);
    }
    assert_eq!(mean_rotation([]), None);
}

#[test]
fn a_camera_that_only_turns_is_aligned_by_its_orientations() {
    let world = Pose::new(
        rotation::exp(DVec3::new(0.0, 2.5, 0.3)),
        DVec3::new(1.0, 2.0, 3.0),
    );
    let world = world.expect("finite");
    let turning = |index: usize| {
        let turn = DVec3::new(0.02, 0.01, -0.005) * index as f64;
        Pose::new(rotation::exp(turn), DVec3::ZERO).expect("finite")
    };
    let estimate: Vec<Pose> = (0..50).map(turning).collect();
    let reference: Vec<Pose> = estimate.iter().map(|pose| world * *pose).collect();
    let found = align_poses(&reference, &estimate).expect("50 poses");
    assert_eq!(found.rank, AlignmentRank::Point);
    assert!(found.is_by_orientation);
    let difference = found.reference_from_estimate.inverse() * world;
    assert!(rotation::log(difference.rotation()).length() < 1e-9);
    assert!(difference.translation().length() < 1e-9);
}

#[test]
fn positions_and_orientations_that_disagree_are_told() {
    let path: Vec<Pose> = poses(&timed(120, FRAME_NANOS, 0));
    let tilt = rotation::exp(DVec3::X * 0.05);
    let tilted: Vec<Pose> = path
        .iter()
        .map(|pose| Pose::new(tilt * pose.rotation(), pose.translation()).expect("finite"))
        .collect();
    let found = align_poses(&path, &tilted).expect("120 poses");
    assert!(!found.is_by_orientation && found.rank == AlignmentRank::Full);
    assert!((found.disagreement.expect("both speak") - 0.05).abs() < 1e-9);
}

/// Largest error of a fitted offset, nanoseconds: the search ends at 0.05 ms, and the reference is linear
/// between stamps 10 ms apart.
const OFFSET_TOLERANCE: i64 = 200_000;

#[test]
fn the_offset_between_two_clocks_is_found_on_random_paths() {
    let mut rng = generator(11);
    let mut worst = 0;
    for _ in 0..40 {
        let shift = uniform(&mut rng, -0.15e9, 0.15e9).round() as i64;
        let reference = timed(600, 10_000_000, 0);
        let start = 500_000_000;
        let mut estimate = timed(140, FRAME_NANOS, start + shift);
        for (time, pose) in &mut estimate {
            *time += start;
            let noise = rotation::exp(unit_vector(&mut rng) * 0.001);
            *pose = Pose::new(pose.rotation() * noise, pose.translation()).expect("finite");
        }
        let found = fit_time_offset(&reference, &estimate, &OffsetSearch::default());
        let found = found.expect("the path swings");
        worst = worst.max((found.offset_nanos - shift).abs());
        assert!(found.rotation_rmse <= found.rotation_rmse_at_zero + 1e-12);
    }
    println!("worst offset error {worst} ns, tolerance {OFFSET_TOLERANCE}");
    assert!(worst <= OFFSET_TOLERANCE);
}

#[test]
fn a_camera_that_does_not_turn_tells_no_offset() {
    let still: Vec<(i64, Pose)> = (0..300).map(|i| (i * 10_000_000, Pose::IDENTITY)).collect();
    assert_eq!(
        fit_time_offset(&still, &still, &OffsetSearch::default()),
        None
    );
    let even: Vec<(i64, Pose)> = (0..300_i64)
        .map(|i| {
            (
                i * 10_000_000,
                Pose::from_axis_angle(DVec3::Y, i as f64 * 0.01),
            )
        })
        .collect();
    assert_eq!(
        fit_time_offset(&even, &even, &OffsetSearch::default()),
        None
    );
    assert_eq!(fit_time_offset(&[], &even, &OffsetSearch::default()), None);
}
