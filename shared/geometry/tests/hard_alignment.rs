//! Hard cases L05 to L07: alignment of degenerate and short paths, and frames that are lost.

mod rows;
mod sampling;

use geometry::direction::angle_between;
use geometry::rotation::log;
use geometry::svd::signed_svd;
use geometry::{AlignmentError, AlignmentRank, DMat3, DVec3, Pose, align_rigid, trajectory_error};
use rand_pcg::Pcg64;
use rows::{bites, holds, worse};
use sampling::{generator, uniform, unit_vector};
use std::f64::consts::PI;

/// Normal noise per axis by Box and Muller.
fn noise(rng: &mut Pcg64, sigma: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| {
        let radius = (-2.0 * (1.0 - uniform(rng, 0.0, 1.0)).ln()).sqrt();
        sigma * radius * uniform(rng, 0.0, 2.0 * PI).cos()
    }))
}

fn random_pose(rng: &mut Pcg64) -> Pose {
    let turn = Pose::from_axis_angle(unit_vector(rng), uniform(rng, 0.0, PI));
    Pose::from_translation(unit_vector(rng) * uniform(rng, 0.0, 100.0)) * turn
}

fn mean(points: &[DVec3]) -> DVec3 {
    points.iter().sum::<DVec3>() / points.len() as f64
}

fn covariance(reference: &[DVec3], estimate: &[DVec3]) -> DMat3 {
    let (r0, e0) = (mean(reference), mean(estimate));
    reference
        .iter()
        .zip(estimate)
        .map(|(r, e)| {
            let (r, e) = (*r - r0, *e - e0);
            DMat3::from_cols(r * e.x, r * e.y, r * e.z)
        })
        .fold(DMat3::ZERO, |sum, one| sum + one)
}

/// The textbook: always six degrees of freedom, any number of pairs.
fn naive_rotation(reference: &[DVec3], estimate: &[DVec3]) -> DMat3 {
    let svd = signed_svd(covariance(reference, estimate));
    svd.left * svd.right.transpose()
}

fn naive_rmse(reference: &[DVec3], estimate: &[DVec3]) -> f64 {
    let rotation = naive_rotation(reference, estimate);
    let (r0, e0) = (mean(reference), mean(estimate));
    let square: f64 = reference
        .iter()
        .zip(estimate)
        .map(|(r, e)| (*r - r0 - rotation * (*e - e0)).length_squared())
        .sum();
    (square / reference.len() as f64).sqrt()
}

/// How far the rotation of a pose is from a rotation, radians.
fn angle_from(pose: &Pose, truth: &Pose) -> f64 {
    log(pose.rotation().conjugate() * truth.rotation()).length()
}

#[test]
fn hc_l05_a_line_leaves_the_turn_about_it() {
    let mut rng = generator(505);
    // 1 mm across 100 samples of 1 m: 3.5e-4 rad of either list's direction, and 5 of those.
    let tolerance = 2.5e-3;
    let (mut naive_worst, mut worst) = (0.0, 0.0);
    for round in 0..1000 {
        let direction = if round == 0 {
            DVec3::X
        } else {
            unit_vector(&mut rng)
        };
        let line: Vec<DVec3> = (0..100)
            .map(|k| direction * (f64::from(k) * 0.01))
            .collect();
        let mut noisy = || {
            line.iter()
                .map(|p| *p + noise(&mut rng, 1e-3))
                .collect::<Vec<_>>()
        };
        let (reference, estimate) = (noisy(), noisy());
        let naive = Pose::from_matrix(naive_rotation(&reference, &estimate), DVec3::ZERO);
        naive_worst = worse(
            naive_worst,
            angle_from(&naive.expect("a rotation"), &Pose::IDENTITY),
        );
        let alignment = align_rigid(&reference, &estimate).expect("100 pairs");
        assert_eq!(alignment.rank, AlignmentRank::Line);
        assert_eq!(alignment.rank.degrees_of_freedom(), 5);
        worst = worse(
            worst,
            angle_from(&alignment.reference_from_estimate, &Pose::IDENTITY),
        );
    }
    bites("l05 line", naive_worst, tolerance);
    holds("l05 line", worst, tolerance);
}

#[test]
fn hc_l05_lines_in_any_direction_meet() {
    let mut rng = generator(515);
    let (mut worst, mut worst_extra) = (0.0, 0.0);
    for round in 0..1000 {
        let from = unit_vector(&mut rng);
        let to = match round % 4 {
            0 => from,
            1 => -from,
            2 => (unit_vector(&mut rng) * 1e-9 - from).normalize(),
            _ => unit_vector(&mut rng),
        };
        let offset = unit_vector(&mut rng);
        let estimate: Vec<DVec3> = (0..20).map(|k| from * f64::from(k)).collect();
        let reference: Vec<DVec3> = (0..20).map(|k| offset + to * f64::from(k)).collect();
        let alignment = align_rigid(&reference, &estimate).expect("20 pairs");
        assert_eq!(alignment.rank, AlignmentRank::Line);
        worst = worse(worst, alignment.rmse);
        let turned = log(alignment.reference_from_estimate.rotation()).length();
        worst_extra = worse(worst_extra, (turned - angle_between(from, to)).abs());
    }
    // Opposed to 1e-8 rad counts as opposed: 19 m times that.
    holds("l05 residual of exact lines", worst, 2e-7);
    holds("l05 no turn but the shortest", worst_extra, 2e-8);
}

#[test]
fn hc_l05_standing_still_gives_a_translation() {
    let mut rng = generator(525);
    let tolerance = 0.0;
    let (mut naive_worst, mut worst, mut worst_shift) = (0.0, 0.0, 0.0);
    for round in 0..1000 {
        let sigma = if round == 0 { 0.0 } else { 1e-3 };
        let (here, there) = (unit_vector(&mut rng) * 1e4, unit_vector(&mut rng));
        let mut jitter = |at: DVec3| {
            (0..50)
                .map(|_| at + noise(&mut rng, sigma))
                .collect::<Vec<_>>()
        };
        let (reference, estimate) = (jitter(here), jitter(there));
        let naive = Pose::from_matrix(naive_rotation(&reference, &estimate), DVec3::ZERO);
        naive_worst = worse(
            naive_worst,
            angle_from(&naive.expect("a rotation"), &Pose::IDENTITY),
        );
        let alignment = align_rigid(&reference, &estimate).expect("50 pairs");
        assert_eq!(alignment.rank, AlignmentRank::Point);
        worst = worse(
            worst,
            angle_from(&alignment.reference_from_estimate, &Pose::IDENTITY),
        );
        let shift = alignment.reference_from_estimate.translation() - (here - there);
        worst_shift = worse(worst_shift, shift.length());
    }
    bites("l05 still", naive_worst, tolerance);
    holds("l05 still", worst, tolerance);
    // A tracker that is stuck while the camera moves says nothing about the rotation either.
    let moving: Vec<DVec3> = (0..50).map(|_| unit_vector(&mut rng)).collect();
    for (reference, estimate) in [
        (&moving, &vec![DVec3::X; 50]),
        (&vec![DVec3::X; 50], &moving),
    ] {
        let alignment = align_rigid(reference, estimate).expect("50 pairs");
        assert_eq!(alignment.rank, AlignmentRank::Point);
    }
    // Two means of 50 samples of 1 mm: 0.35 mm by length, and 4 of those.
    holds("l05 shift", worst_shift, 1.4e-3);
}

#[test]
fn hc_l05_planes_and_space_are_recovered() {
    let mut rng = generator(535);
    let (mut worst_angle, mut worst_rmse, mut worst_place) = (0.0, 0.0, 0.0);
    for round in 0..2000 {
        let truth = random_pose(&mut rng);
        let flatten = if round % 2 == 0 {
            DVec3::new(1.0, 1.0, 0.0)
        } else {
            DVec3::ONE
        };
        let turn = random_pose(&mut rng);
        let estimate: Vec<DVec3> = (0..30)
            .map(|_| turn.transform_point(unit_vector(&mut rng) * flatten))
            .collect();
        let reference: Vec<DVec3> = estimate.iter().map(|e| truth.transform_point(*e)).collect();
        let alignment = align_rigid(&reference, &estimate).expect("30 pairs");
        assert_eq!(
            alignment.rank,
            AlignmentRank::Full,
            "a plane determines all six"
        );
        assert_eq!(alignment.count, 30);
        worst_angle = worse(
            worst_angle,
            angle_from(&alignment.reference_from_estimate, &truth),
        );
        worst_rmse = worse(worst_rmse, alignment.rmse);
        let place = alignment.reference_from_estimate.translation() - truth.translation();
        worst_place = worse(worst_place, place.length());
    }
    holds("l05 angle", worst_angle, 1e-13);
    holds("l05 rmse", worst_rmse, 1e-12);
    holds("l05 place", worst_place, 1e-11);
}

#[test]
fn hc_l05_a_mirror_image_gets_a_rotation() {
    let mut rng = generator(545);
    let mut naive_determinant = 1.0_f64;
    let (mut worst_determinant, mut worst_gain) = (0.0, 0.0);
    for _ in 0..1000 {
        // Semi-axes apart, so that the axis to give up is the thinnest.
        let estimate: Vec<DVec3> = (0..40)
            .map(|_| unit_vector(&mut rng) * DVec3::new(3.0, 2.0, 1.0))
            .collect();
        let reference: Vec<DVec3> = estimate.iter().map(|e| e.with_x(-e.x)).collect();
        let svd = signed_svd(covariance(&reference, &estimate));
        let without_sign =
            svd.left * DMat3::from_diagonal(DVec3::new(1.0, 1.0, svd.values.z.signum()));
        naive_determinant =
            naive_determinant.min((without_sign * svd.right.transpose()).determinant());
        let alignment = align_rigid(&reference, &estimate).expect("40 pairs");
        let pose = alignment.reference_from_estimate;
        worst_determinant = worse(worst_determinant, (pose.matrix().determinant() - 1.0).abs());
        assert!(
            alignment.singular_values.z < 0.0,
            "the sign says that the paths mirror each other"
        );
        // No rotation nearby does better.
        let rmse = |pose: &Pose| {
            let squares = reference.iter().zip(&estimate);
            let sum: f64 = squares
                .map(|(r, e)| (*r - pose.transform_point(*e)).length_squared())
                .sum();
            (sum / 40.0).sqrt()
        };
        worst_gain = worse(worst_gain, (rmse(&pose) - alignment.rmse).abs());
        for axis in [
            DVec3::X,
            DVec3::Y,
            DVec3::Z,
            DVec3::NEG_X,
            DVec3::NEG_Y,
            DVec3::NEG_Z,
        ] {
            let center = mean(&reference);
            let about = Pose::from_translation(center)
                * Pose::from_axis_angle(axis, 1e-3)
                * Pose::from_translation(-center);
            worst_gain = worse(worst_gain, alignment.rmse - rmse(&(about * pose)));
            let shifted = Pose::from_translation(axis * 1e-3) * pose;
            worst_gain = worse(worst_gain, alignment.rmse - rmse(&shifted));
        }
    }
    bites("l05 mirror", (naive_determinant - 1.0).abs(), 1e-12);
    holds("l05 mirror", worst_determinant, 1e-12);
    holds("l05 gain by a nearby pose", worst_gain, 1e-12);
}

#[test]
fn hc_l06_few_poses_hide_the_error() {
    let mut rng = generator(506);
    let sigma = 0.01;
    let mut trial = |count: usize, shipped: bool| {
        let mut sum = 0.0;
        for _ in 0..1000 {
            let reference: Vec<DVec3> = (0..count).map(|_| unit_vector(&mut rng)).collect();
            let estimate: Vec<DVec3> = reference
                .iter()
                .map(|r| *r + noise(&mut rng, sigma))
                .collect();
            sum += if shipped {
                align_rigid(&reference, &estimate)
                    .expect("enough pairs")
                    .rmse
            } else {
                naive_rmse(&reference, &estimate)
            };
        }
        sum / 1000.0 / (sigma * 3.0_f64.sqrt())
    };
    // At most a ninth of the error may hide in the fit.
    let tolerance = 0.12;
    for count in [2, 3, 5] {
        bites(
            &format!("l06 n={count}"),
            1.0 - trial(count, false),
            tolerance,
        );
    }
    let (ten, hundred) = (trial(10, true), trial(100, true));
    println!("l06: n=10 shows {ten:.3} of the error, n=100 {hundred:.3}");
    // sqrt(1 − 6/3n) is 0.894 and 0.990; the mean of a root lies a little below the root of a mean.
    holds("l06 n=10", (ten - 0.89).abs(), 0.015);
    holds("l06 n=100", (hundred - 0.989).abs(), 0.005);
    let nine = vec![DVec3::X; 9];
    assert_eq!(
        align_rigid(&nine, &nine),
        Err(AlignmentError::TooFew { count: 9 })
    );
    assert_eq!(
        align_rigid(&[], &[]),
        Err(AlignmentError::TooFew { count: 0 })
    );
    assert_eq!(
        align_rigid(&nine, &[]),
        Err(AlignmentError::Length {
            reference: 9,
            estimate: 0
        })
    );
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        let mut points: Vec<DVec3> = (0..12).map(|_| unit_vector(&mut rng)).collect();
        points[7].y = bad;
        assert_eq!(
            align_rigid(&points, &points),
            Err(AlignmentError::NotFinite { index: 7 })
        );
    }
}

/// A path of 200 frames whose second half the tracker gets wrong by a growing drift.
fn drifting(rng: &mut Pcg64) -> (Vec<DVec3>, Vec<DVec3>) {
    let turn = random_pose(rng);
    let reference: Vec<DVec3> = (0..200)
        .map(|k| {
            let s = f64::from(k) * 0.03;
            DVec3::new(s.cos(), 0.5 * s, (1.3 * s).sin())
        })
        .collect();
    let drift = unit_vector(rng);
    let estimate = reference
        .iter()
        .enumerate()
        .map(|(k, r)| {
            let late = k.saturating_sub(100) as f64 * 1e-3;
            turn.transform_point(*r + drift * late + noise(rng, 1e-3))
        })
        .collect();
    (reference, estimate)
}

#[test]
fn hc_l07_losing_the_hard_half_does_not_improve_a_tracker() {
    let mut rng = generator(507);
    let (mut naive_best_gain, mut worst_deficit) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..1000 {
        let (reference, estimate) = drifting(&mut rng);
        let all: Vec<Option<DVec3>> = estimate.iter().copied().map(Some).collect();
        let lost: Vec<Option<DVec3>> = all
            .iter()
            .enumerate()
            .map(|(k, e)| e.filter(|_| k < 100))
            .collect();
        let full = trajectory_error(&reference, &all).expect("200 frames");
        let half = trajectory_error(&reference, &lost).expect("100 frames");
        assert_eq!((full.tracked_fraction, full.count), (1.0, 200));
        assert_eq!(
            (half.tracked_fraction, half.count),
            (0.5, 100),
            "the loss is said"
        );
        assert_eq!(half.rank, AlignmentRank::Full);
        assert!(
            (full.ate_rmse - full.ate_with_lost_at_last_pose).abs() < 1e-15,
            "nothing is held"
        );
        // The mean over tracked frames alone falls when the hard half is lost.
        naive_best_gain = naive_best_gain.min(full.ate_rmse - half.ate_rmse);
        worst_deficit = worst_deficit.max(full.ate_rmse - half.ate_with_lost_at_last_pose);
    }
    bites("l07 gain by losing", naive_best_gain, 0.0);
    println!("l07: largest gain that is left {worst_deficit:.3e}, tolerance 0");
    assert!(
        worst_deficit <= 0.0,
        "with lost frames held, losing never improves"
    );
}

#[test]
fn hc_l07_lost_frames_stay_at_the_last_position() {
    // Along x by 1 m a frame; frames 3 and 4 and the first one are lost.
    let zigzag = |k: u32| DVec3::new(f64::from(k), f64::from(k % 2), f64::from(k % 3));
    let reference: Vec<DVec3> = (0..16).map(zigzag).collect();
    let lost = [0, 3, 4];
    let estimate: Vec<Option<DVec3>> = (0..16_usize)
        .map(|k| (!lost.contains(&k)).then(|| reference[k]))
        .collect();
    let error = trajectory_error(&reference, &estimate).expect("13 frames");
    assert_eq!(error.count, 13);
    assert!((error.tracked_fraction - 13.0 / 16.0).abs() < 1e-15);
    let square = (reference[0] - reference[1]).length_squared()
        + (reference[3] - reference[2]).length_squared()
        + (reference[4] - reference[2]).length_squared();
    holds("l07 tracked", error.ate_rmse, 1e-13);
    let held = (error.ate_with_lost_at_last_pose - (square / 16.0).sqrt()).abs();
    holds("l07 held", held, 1e-13);

    let few: Vec<Option<DVec3>> = (0..16).map(|k| (k < 9).then(|| zigzag(k))).collect();
    assert_eq!(
        trajectory_error(&reference, &few),
        Err(AlignmentError::TooFew { count: 9 })
    );
    let mut bad = estimate.clone();
    bad[5] = Some(DVec3::NAN);
    assert_eq!(
        trajectory_error(&reference, &bad),
        Err(AlignmentError::NotFinite { index: 5 })
    );
    assert_eq!(
        trajectory_error(&reference, &estimate[1..]),
        Err(AlignmentError::Length {
            reference: 16,
            estimate: 15
        })
    );
}

#[test]
fn singular_values_of_known_matrices() {
    let mut rng = generator(517);
    let (mut worst_shape, mut worst_values, mut worst_again) = (0.0, 0.0, 0.0);
    let largest = |m: DMat3| m.to_cols_array().into_iter().map(f64::abs).fold(0.0, worse);
    let known = [
        DVec3::ONE,
        DVec3::new(1.0, 1.0, -1.0),
        DVec3::new(2.0, 1.0, 0.0),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(1.0, 1e-12, 1e-15),
        DVec3::new(1.0, 1e-160, -1e-200),
        DVec3::new(5.0, 3.0, 3.0),
    ];
    for round in 0..2000 {
        let values = known.get(round % 10).copied().unwrap_or_else(|| {
            let [a, b, c] = std::array::from_fn(|_| uniform(&mut rng, 0.0, 3.0));
            DVec3::new(a + b + c, b + c, if round % 2 == 0 { c } else { -c })
        });
        let (left, right) = (
            random_pose(&mut rng).matrix(),
            random_pose(&mut rng).matrix(),
        );
        let size = 10.0_f64.powf(uniform(&mut rng, -150.0, 150.0));
        let matrix = left * DMat3::from_diagonal(values) * right.transpose() * size;
        let svd = signed_svd(matrix);
        for m in [svd.left, svd.right] {
            worst_shape = worse(worst_shape, largest(m.transpose() * m - DMat3::IDENTITY));
            worst_shape = worse(worst_shape, (m.determinant() - 1.0).abs());
        }
        worst_values = worse(
            worst_values,
            (svd.values / size - values).abs().max_element() / values.x,
        );
        let again = svd.left * DMat3::from_diagonal(svd.values) * svd.right.transpose();
        worst_again = worse(worst_again, largest(again - matrix) / (size * values.x));
        assert!(svd.values.x >= svd.values.y && svd.values.y >= svd.values.z.abs());
    }
    holds("svd rotations", worst_shape, 1e-14);
    holds("svd values", worst_values, 1e-14);
    holds("svd product", worst_again, 1e-14);
    assert_eq!(signed_svd(DMat3::ZERO).values, DVec3::ZERO);
}
