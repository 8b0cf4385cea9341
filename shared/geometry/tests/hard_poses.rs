//! Hard cases A01 to A09: rotations, rigid transforms, interpolation.

mod rows;
mod sampling;

use geometry::rotation::{
    self, exp, exp_coefficient_b, exp_coefficient_c, exp_twist, interpolate, log, log_coefficient,
    log_twist, slerp, try_exp_twist,
};
use geometry::{DMat3, DQuat, DVec3, Pose, PoseError};
use glam::{Mat3, Mat4, Quat, Vec3};
use rows::{bites, holds, worse};
use sampling::{generator, uniform, unit_vector};
use std::f64::consts::PI;

/// The axis of rows A02 and A03.
fn listed_axis() -> DVec3 {
    DVec3::new(1.0, 2.0, 3.0) / 14.0_f64.sqrt()
}

/// Rodrigues' formula in f64, with 1 − cos as 2 sin²(θ/2); the reference, independent of the crate.
fn rodrigues(axis: DVec3, angle: f64) -> DMat3 {
    let k = DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    );
    let half = (angle * 0.5).sin();
    DMat3::IDENTITY + k * angle.sin() + k * k * (2.0 * half * half)
}

/// Largest absolute entry of a difference.
fn largest_entry(difference: DMat3) -> f64 {
    difference
        .to_cols_array()
        .into_iter()
        .map(f64::abs)
        .fold(0.0, worse)
}

/// Sum of (−1)^k θ^2k / (2k + first)!, the series of B (first = 2) and C (first = 3).
fn alternating_series(angle: f64, first: u32) -> f64 {
    let mut term = 1.0 / f64::from((1..=first).product::<u32>());
    let mut sum = term;
    for k in 1..20 {
        let n = f64::from(first + 2 * k);
        term *= -angle * angle / (n * (n - 1.0));
        sum += term;
    }
    sum
}

/// Relative tolerance of the coefficients, row A01.
const COEFFICIENT_TOLERANCE: f64 = 5e-7;

#[test]
fn hc_a01_exp_coefficients_near_zero() {
    let naive_b = |t: f32| f64::from((1.0 - t.cos()) / (t * t));
    let naive_c = |t: f32| f64::from((t - t.sin()) / (t * t * t));
    let relative = |value: f64, truth: f64| ((value - truth) / truth).abs();
    for angle in [1e-2_f32, 1e-3, 1e-4] {
        let angle64 = f64::from(angle);
        bites(
            "a01 B",
            relative(naive_b(angle), alternating_series(angle64, 2)),
            COEFFICIENT_TOLERANCE,
        );
        bites(
            "a01 C",
            relative(naive_c(angle), alternating_series(angle64, 3)),
            COEFFICIENT_TOLERANCE,
        );
    }

    let mut rng = generator(101);
    let listed = (1..=8)
        .map(|k| 10.0_f64.powi(-k))
        .chain([0.0, 1.0 - 1e-12, 1.0, 2.0]);
    let random: Vec<f64> = (0..2000)
        .map(|_| 10.0_f64.powf(uniform(&mut rng, -9.0, 0.4)))
        .collect();
    let mut worst = 0.0;
    for angle in listed.chain(random) {
        worst = worse(
            worst,
            relative(exp_coefficient_b(angle), alternating_series(angle, 2)),
        );
        worst = worse(
            worst,
            relative(exp_coefficient_c(angle), alternating_series(angle, 3)),
        );
    }
    holds("a01", worst, COEFFICIENT_TOLERANCE);
    assert_eq!(exp(DVec3::ZERO), DQuat::IDENTITY);
    assert_eq!(exp_twist(DVec3::ZERO, DVec3::ZERO), Pose::IDENTITY);
}

/// The logarithm by acos of the trace and the antisymmetric part, f32.
fn naive_log(m: Mat3) -> DVec3 {
    let angle = ((m.x_axis.x + m.y_axis.y + m.z_axis.z - 1.0) * 0.5).acos();
    let antisymmetric = Vec3::new(
        m.y_axis.z - m.z_axis.y,
        m.z_axis.x - m.x_axis.z,
        m.x_axis.y - m.y_axis.x,
    );
    (antisymmetric * (angle / (2.0 * angle.sin()))).as_dvec3()
}

/// The shipped way from a matrix rounded to f32 to its rotation vector.
fn log_of_rounded(m: DMat3) -> DVec3 {
    log(rotation::from_matrix(m.as_mat3().as_dmat3()))
}

#[test]
fn hc_a02_log_near_zero() {
    // f32 rounds the entries sin θ·a to 6e-8 relative: 6e-10 rad at 1e-2.
    let tolerance = 1e-9;
    let naive_error = |axis: DVec3, angle: f64| {
        (naive_log(rodrigues(axis, angle).as_mat3()) - axis * angle).length()
    };
    for angle in [3e-4, 1e-4, 1e-12] {
        bites("a02", naive_error(listed_axis(), angle), tolerance);
    }
    // At 1e-3 the quotient θ/sin θ hides the wrong angle from the vector; the angle itself is off 2.3 %.
    let entries = rodrigues(listed_axis(), 1e-3).as_mat3().to_cols_array();
    let angle = ((entries[0] + entries[4] + entries[8] - 1.0) * 0.5).acos();
    bites("a02 angle", (f64::from(angle) - 1e-3).abs(), tolerance);

    let mut worst = 0.0;
    for angle in [1e-2, 1e-3, 3e-4, 1e-4, 1e-12, 0.0] {
        let truth = listed_axis() * angle;
        worst = worse(
            worst,
            (log_of_rounded(rodrigues(listed_axis(), angle)) - truth).length(),
        );
        worst = worse(worst, (log(exp(truth)) - truth).length());
    }
    let mut rng = generator(102);
    for _ in 0..2000 {
        let truth = unit_vector(&mut rng) * 10.0_f64.powf(uniform(&mut rng, -12.0, -2.0));
        let m = rodrigues(truth.normalize(), truth.length());
        worst = worse(worst, (log_of_rounded(m) - truth).length());
    }
    holds("a02", worst, tolerance);
}

#[test]
fn hc_a03_log_near_pi() {
    let tolerance = 1e-6;
    for below in [1e-2, 1e-3, 1e-4] {
        let m = rodrigues(listed_axis(), PI - below).as_mat3();
        bites(
            "a03",
            (naive_log(m) - listed_axis() * (PI - below)).length(),
            tolerance,
        );
    }
    let mut worst = 0.0;
    for exponent in 2..=6 {
        let angle = PI - 10.0_f64.powi(-exponent);
        let m = rodrigues(listed_axis(), angle);
        worst = worse(worst, (log_of_rounded(m) - listed_axis() * angle).length());
    }
    let mut rng = generator(103);
    for _ in 0..2000 {
        // Nearer to π than 1e-6 the f32 matrix no longer says on which side it is (row A04).
        let truth = unit_vector(&mut rng) * (PI - 10.0_f64.powf(uniform(&mut rng, -6.0, -1.0)));
        let m = rodrigues(truth.normalize(), truth.length());
        worst = worse(worst, (log_of_rounded(m) - truth).length());
    }
    holds("a03", worst, tolerance);
}

#[test]
fn hc_a04_exactly_pi_gives_the_rotation_back() {
    let half_turn = |axis: DVec3| {
        DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * 2.0 - DMat3::IDENTITY
    };
    // The antisymmetric part is zero there: the twin returns 0 or NaN, never a half turn.
    let naive = naive_log(half_turn(DVec3::X).as_mat3());
    let naive_error = largest_entry(rodrigues(DVec3::X, naive.length()) - half_turn(DVec3::X));
    bites("a04", naive_error, 2e-6);

    let mut rng = generator(104);
    let axes = [
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        DVec3::NEG_X,
        DVec3::NEG_Y,
        DVec3::NEG_Z,
    ];
    let random: Vec<DVec3> = (0..10_000).map(|_| unit_vector(&mut rng)).collect();
    let (mut worst_f64, mut worst_f32) = (0.0, 0.0);
    for axis in axes.into_iter().chain(random) {
        let m = half_turn(axis);
        let again = DMat3::from_quat(exp(log(rotation::from_matrix(m))));
        worst_f64 = worse(worst_f64, largest_entry(again - m));
        let again = DMat3::from_quat(exp(log_of_rounded(m)));
        worst_f32 = worse(worst_f32, largest_entry(again - m));
    }
    holds("a04 f64", worst_f64, 1e-13);
    holds("a04 f32", worst_f32, 2e-6);
}

#[test]
fn hc_a05_a_million_compositions_do_not_drift() {
    let count = 1_000_000;
    let angle = 0.01;
    let naive_step = Quat::from_axis_angle(listed_axis().as_vec3().normalize(), angle as f32);
    let naive = (0..count).fold(Quat::IDENTITY, |all, _| all * naive_step);
    bites("a05 length", (f64::from(naive.length()) - 1.0).abs(), 1e-14);
    bites(
        "a05 scaled points",
        f64::from((naive * Vec3::X).length() - 1.0).abs(),
        1e-4,
    );

    let step = Pose::from_axis_angle(listed_axis(), angle);
    let all = (0..count).fold(Pose::IDENTITY, |all, _| all * step);
    holds("a05 length", (all.rotation().length() - 1.0).abs(), 1e-14);
    holds(
        "a05 determinant",
        (all.matrix().determinant() - 1.0).abs(),
        1e-12,
    );
    let expected = rodrigues(
        listed_axis(),
        (f64::from(count) * angle).rem_euclid(2.0 * PI),
    );
    let off = log(rotation::from_matrix(expected.transpose() * all.matrix())).length();
    holds("a05 angle", off, 1e-9);

    let mut rng = generator(105);
    let mut all = Pose::IDENTITY;
    let mut worst = 0.0;
    for _ in 0..10_000 {
        let axis = unit_vector(&mut rng);
        all = all * Pose::from_axis_angle(axis, uniform(&mut rng, -3.0, 3.0));
        worst = worse(worst, (all.rotation().length() - 1.0).abs());
    }
    holds("a05 random steps", worst, 1e-14);
}

#[test]
fn hc_a06_inverse_and_scale() {
    let tolerance = 1e-12;
    let far = DVec3::new(3000.0, -2000.0, 1000.0);
    let rigid = Mat4::from_rotation_translation(exp(listed_axis()).as_quat(), far.as_vec3());
    let naive = rigid * rigid.inverse() - Mat4::IDENTITY;
    bites(
        "a06 f32 4x4",
        f64::from(naive.w_axis.truncate().length()),
        tolerance * far.length(),
    );

    // The transpose is no inverse of a matrix with 1 % scale, and nothing says so.
    let scaled = rodrigues(listed_axis(), 1.0) * 1.01;
    bites(
        "a06 scale",
        largest_entry(scaled.transpose() * scaled - DMat3::IDENTITY),
        tolerance,
    );
    assert!(matches!(
        Pose::from_matrix(scaled, far),
        Err(PoseError::NotRigid { .. })
    ));
    let mirrored = rodrigues(listed_axis(), 1.0) * DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
    assert_eq!(Pose::from_matrix(mirrored, far), Err(PoseError::Mirrored));

    let mut rng = generator(106);
    let (mut worst_rotation, mut worst_translation, mut worst_rounded) = (0.0, 0.0, 0.0);
    for _ in 0..2000 {
        let truth = rodrigues(unit_vector(&mut rng), uniform(&mut rng, 0.0, PI));
        let translation = unit_vector(&mut rng) * 3700.0;
        let pose = Pose::from_matrix(truth, translation).expect("a rotation");
        for both in [pose * pose.inverse(), pose.inverse() * pose] {
            worst_rotation = worse(
                worst_rotation,
                largest_entry(both.matrix() - DMat3::IDENTITY),
            );
            worst_translation = worse(worst_translation, both.translation().length() / 3700.0);
        }
        // A matrix printed with few digits is projected, not refused.
        let rounded =
            DMat3::from_cols_array(&truth.to_cols_array().map(|v| (v * 1e4).round() / 1e4));
        let pose = Pose::from_matrix(rounded, translation).expect("rounding is not a scale");
        worst_rounded = worse(
            worst_rounded,
            geometry::pose::orthogonality_error(pose.matrix()),
        );
    }
    holds("a06 rotation", worst_rotation, tolerance);
    holds("a06 translation per metre", worst_translation, tolerance);
    holds("a06 projected", worst_rounded, tolerance);
}

/// The angle between two rotations by the chord, which is exact near 0.
fn angle_apart(a: DQuat, b: DQuat) -> f64 {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    4.0 * (0.5 * (a - b).length()).min(1.0).asin()
}

#[test]
fn hc_a07_slerp_at_its_edges() {
    let naive = |a: Quat, b: Quat, at: f32| {
        let angle = a.dot(b).acos();
        a * (((1.0 - at) * angle).sin() / angle.sin()) + b * ((at * angle).sin() / angle.sin())
    };
    let q = Quat::from_axis_angle(listed_axis().as_vec3().normalize(), 0.3);
    bites(
        "a07 with itself",
        f64::from(naive(q, q * 1.000_000_1, 0.5).length() - 1.0).abs(),
        1e-15,
    );
    let turned = Quat::from_axis_angle(listed_axis().as_vec3().normalize(), 0.4);
    let long_way = naive(q, -turned, 0.5).as_dquat();
    bites(
        "a07 long way",
        (angle_apart(q.as_dquat(), long_way) - 0.05).abs(),
        1e-12,
    );

    let mut rng = generator(107);
    let (mut worst_length, mut worst_middle, mut worst_pace) = (0.0, 0.0, 0.0);
    let listed = [
        0.0,
        1e-15,
        1e-9,
        2e-3 - 1e-9,
        2e-3 + 1e-9,
        1.0,
        PI - 1e-9,
        PI,
    ];
    for round in 0..3000 {
        let angle = listed
            .get(round)
            .copied()
            .unwrap_or_else(|| uniform(&mut rng, 0.0, PI));
        let a = exp(unit_vector(&mut rng) * uniform(&mut rng, 0.0, PI));
        let b = a * exp(unit_vector(&mut rng) * angle);
        for b in [b, -b] {
            let middle = slerp(a, b, 0.5);
            worst_length = worse(worst_length, (middle.length() - 1.0).abs());
            let unequal = angle_apart(a, middle) - angle_apart(middle, b);
            worst_middle = worse(worst_middle, unequal.abs());
            let third = angle_apart(a, slerp(a, b, 1.0 / 3.0));
            worst_pace = worse(worst_pace, (third - angle_apart(a, b) / 3.0).abs());
        }
    }
    holds("a07 length", worst_length, 1e-15);
    holds("a07 middle", worst_middle, 1e-12);
    // Normalised lerp by a third of φ is off by φ³/81; at the switch φ is 1e-3, the rotation twice that.
    holds("a07 pace", worst_pace, 2.5e-11);
    let q = exp(listed_axis());
    assert!(
        (slerp(q, -q, 0.3) - q).length() < 1e-15,
        "q and -q are one rotation"
    );
}

#[test]
fn hc_a08_no_pose_where_there_is_none() {
    let max_gap = 100_000_000;
    let naive = |(t0, a): (i64, DVec3), (t1, b): (i64, DVec3), t: i64| {
        a.lerp(b, (t - t0) as f64 / (t1 - t0) as f64)
    };
    bites(
        "a08 duplicate",
        naive((5, DVec3::ZERO), (5, DVec3::X), 5).x,
        1.0,
    );
    bites(
        "a08 outside",
        naive((0, DVec3::ZERO), (10, DVec3::X), 1000).x,
        1.0,
    );

    let a = Pose::IDENTITY;
    let b = Pose::from_translation(DVec3::X) * Pose::from_axis_angle(DVec3::Y, 0.2);
    let second = 1_000_000_000;
    assert_eq!(
        interpolate((5, a), (5, b), 5, max_gap),
        None,
        "duplicate stamps"
    );
    assert_eq!(
        interpolate((10, a), (5, b), 7, max_gap),
        None,
        "stamps that run backwards"
    );
    assert_eq!(
        interpolate((0, a), (100, b), -1, max_gap),
        None,
        "1 ns before"
    );
    assert_eq!(
        interpolate((0, a), (100, b), 101, max_gap),
        None,
        "1 ns after"
    );
    assert_eq!(
        interpolate((0, a), (second, b), second / 2, max_gap),
        None,
        "a gap of 1 s"
    );
    assert_eq!(
        interpolate((0, a), (max_gap + 1, b), 7, max_gap),
        None,
        "one past the gap"
    );
    assert_eq!(
        interpolate((i64::MIN, a), (i64::MAX, b), 0, i64::MAX),
        None,
        "times that overflow"
    );
    assert_eq!(interpolate((0, a), (max_gap, b), 0, max_gap), Some(a));

    let mut rng = generator(108);
    let start = 1_700_000_000_000_000_000;
    let mut worst = 0.0;
    for _ in 0..2000 {
        let at = uniform(&mut rng, 0.0, 1e8).round() as i64;
        let pose =
            interpolate((start, a), (start + max_gap, b), start + at, max_gap).expect("inside");
        let fraction = at as f64 / 1e8;
        worst = worse(worst, (pose.translation() - DVec3::X * fraction).length());
        worst = worse(
            worst,
            (log(pose.rotation()) - DVec3::Y * (0.2 * fraction)).length(),
        );
    }
    holds("a08", worst, 1e-14);
}

#[test]
fn hc_a09_log_of_a_twist() {
    let tolerance = 1e-6;
    // Σ |B₂ₖ| θ^(2k−2)/(2k)!, converges below 2π; the reference, evaluated with 200 terms through
    // ζ(2k): |B₂ₖ|/(2k)! = 2 ζ(2k)/(2π)^2k.
    let series = |angle: f64| {
        let ratio = (angle / (2.0 * PI)).powi(2);
        let mut power = 1.0;
        let mut sum = 0.0;
        for k in 1..200 {
            let zeta = match k {
                1 => PI * PI / 6.0,
                2 => PI.powi(4) / 90.0,
                k => (1..40).map(|n| f64::from(n).powi(-2 * k)).sum(),
            };
            sum += 2.0 * zeta * power;
            power *= ratio;
        }
        sum / (4.0 * PI * PI)
    };
    let naive = |t: f32| f64::from(1.0 / (t * t) - (1.0 + t.cos()) / (2.0 * t * t.sin()));
    let half_angle = |t: f32| f64::from((1.0 - t * 0.5 / (t * 0.5).tan()) / (t * t));
    for angle in [1e-2_f32, 1e-3, 1e-4] {
        let truth = series(f64::from(angle));
        bites(
            "a09 textbook",
            ((naive(angle) - truth) / truth).abs(),
            tolerance,
        );
    }
    let truth = series(1e-3);
    bites(
        "a09 half angle",
        ((half_angle(1e-3) - truth) / truth).abs(),
        tolerance,
    );

    let mut rng = generator(109);
    let mut worst = 0.0;
    let listed = [
        0.0,
        1e-8,
        1e-4,
        1e-2,
        0.1,
        0.5 - 1e-12,
        0.5,
        1.0,
        2.0,
        PI - 1e-6,
        PI,
    ];
    let random: Vec<f64> = (0..1000).map(|_| uniform(&mut rng, 0.0, PI)).collect();
    for angle in listed.into_iter().chain(random) {
        worst = worse(
            worst,
            ((log_coefficient(angle) - series(angle)) / series(angle)).abs(),
        );
        assert_eq!(
            log_coefficient(-angle),
            log_coefficient(angle),
            "the coefficient is even"
        );
    }
    holds("a09 coefficient", worst, tolerance);

    let (mut worst_rotation, mut worst_velocity, mut worst_pose) = (0.0, 0.0, 0.0);
    for round in 0..3000 {
        let angle = match round {
            0 => 0.0,
            1 => 1e-8,
            2 => PI - 1e-6,
            _ => uniform(&mut rng, 0.0, PI - 1e-6),
        };
        let rotation_vector = unit_vector(&mut rng) * angle;
        let velocity = unit_vector(&mut rng) * uniform(&mut rng, 0.0, 10.0);
        let (w, v) = log_twist(&exp_twist(rotation_vector, velocity));
        worst_rotation = worse(worst_rotation, (w - rotation_vector).length());
        worst_velocity = worse(worst_velocity, (v - velocity).length());
        // From π to 2π the vector comes back as its complement, the pose as itself.
        let beyond = unit_vector(&mut rng) * uniform(&mut rng, PI, 2.0 * PI - 1e-6);
        let pose = exp_twist(beyond, velocity);
        let (w, v) = log_twist(&pose);
        assert!(
            w.length() <= PI + 1e-15,
            "the angle of a logarithm is at most pi"
        );
        let again = exp_twist(w, v);
        worst_pose = worse(worst_pose, largest_entry(again.matrix() - pose.matrix()));
        worst_pose = worse(
            worst_pose,
            (again.translation() - pose.translation()).length(),
        );
    }
    holds("a09 rotation", worst_rotation, 1e-12);
    holds("a09 velocity", worst_velocity, 1e-11);
    holds("a09 pose", worst_pose, 1e-12);
}

#[test]
fn hc_a09_a_twist_that_is_not_finite_is_no_pose() {
    for (w, v) in [
        (DVec3::NAN, DVec3::X),
        (DVec3::X, DVec3::NAN),
        (DVec3::X, DVec3::INFINITY),
    ] {
        assert_eq!(try_exp_twist(w, v), None);
    }
    let (w, v) = (DVec3::new(0.1, -0.2, 0.3), DVec3::X);
    assert_eq!(try_exp_twist(w, v), Some(exp_twist(w, v)));
}

#[test]
fn hc_a06_quaternions_of_any_length() {
    let turn = exp(listed_axis());
    // The squared length of the first is infinite and of the second 1e-16.
    for scale in [1e200, 1e-8, -3.0] {
        let pose = Pose::new(turn * scale, DVec3::X).expect("a quaternion with a length");
        holds("a06 length", (pose.rotation().length() - 1.0).abs(), 1e-15);
        holds("a06 turn", angle_apart(pose.rotation(), turn), 1e-15);
    }
    assert_eq!(
        Pose::new(turn * 1e-12, DVec3::X),
        Err(PoseError::ZeroQuaternion)
    );
    assert_eq!(
        Pose::new(turn * f64::NAN, DVec3::X),
        Err(PoseError::NotFinite)
    );
    assert_eq!(Pose::new(turn, DVec3::NAN), Err(PoseError::NotFinite));
    assert_eq!(
        Pose::from_matrix(DMat3::NAN, DVec3::X),
        Err(PoseError::NotFinite)
    );
    let axis = listed_axis() * 1e-200;
    holds(
        "a06 tiny axis",
        angle_apart(Pose::from_axis_angle(axis, 1.0).rotation(), turn),
        1e-15,
    );
}
