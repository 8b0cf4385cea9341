//! SO(3) and SE(3) exponential, logarithm and interpolation, stable at small angles and near π.

use crate::pose::Pose;
use glam::{DMat3, DQuat, DVec3};

/// Below this angle the series are used; their truncation error there is under 1e-16 relative.
const SMALL_ANGLE: f64 = 1e-2;

/// `sin(x)/x`, 1 at 0.
fn sinc(x: f64) -> f64 {
    if x.abs() < SMALL_ANGLE {
        let x2 = x * x;
        1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0))
    } else {
        x.sin() / x
    }
}

/// The rotation by `‖rotation_vector‖` radians about `rotation_vector`; finite and shorter than 1e150.
pub fn exp(rotation_vector: DVec3) -> DQuat {
    let half = rotation_vector.length() * 0.5;
    let vector = rotation_vector * (0.5 * sinc(half));
    DQuat::from_xyzw(vector.x, vector.y, vector.z, half.cos())
}

/// The rotation vector of a unit quaternion: angle in [0, π] times axis (hard-cases A02, A03).
///
/// At exactly π the sign of the axis is free (A04).
pub fn log(rotation: DQuat) -> DVec3 {
    let rotation = if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    };
    let vector = DVec3::new(rotation.x, rotation.y, rotation.z);
    let length = vector.length();
    if length < 1e-3 {
        let w = rotation.w;
        return vector * (2.0 / w * (1.0 - length * length / (3.0 * w * w)));
    }
    vector * (2.0 * length.atan2(rotation.w) / length)
}

/// The unit quaternion of a rotation matrix, by the largest of trace and diagonal (Shepperd 1978), `w ≥ 0`.
pub fn from_matrix(m: DMat3) -> DQuat {
    let (xx, yy, zz) = (m.x_axis.x, m.y_axis.y, m.z_axis.z);
    let trace = xx + yy + zz;
    let q = if trace >= xx && trace >= yy && trace >= zz {
        DQuat::from_xyzw(
            m.y_axis.z - m.z_axis.y,
            m.z_axis.x - m.x_axis.z,
            m.x_axis.y - m.y_axis.x,
            1.0 + trace,
        )
    } else if xx >= yy && xx >= zz {
        DQuat::from_xyzw(
            1.0 + xx - yy - zz,
            m.x_axis.y + m.y_axis.x,
            m.x_axis.z + m.z_axis.x,
            m.y_axis.z - m.z_axis.y,
        )
    } else if yy >= zz {
        DQuat::from_xyzw(
            m.x_axis.y + m.y_axis.x,
            1.0 - xx + yy - zz,
            m.y_axis.z + m.z_axis.y,
            m.z_axis.x - m.x_axis.z,
        )
    } else {
        DQuat::from_xyzw(
            m.x_axis.z + m.z_axis.x,
            m.y_axis.z + m.z_axis.y,
            1.0 - xx - yy + zz,
            m.x_axis.y - m.y_axis.x,
        )
    };
    let q = q / q.length();
    if q.w < 0.0 { -q } else { q }
}

/// Spherical interpolation from `a` (at 0) to `b` (at 1) along the shorter way (hard-cases A07).
pub fn slerp(a: DQuat, b: DQuat, at: f64) -> DQuat {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    let angle = 2.0 * (a - b).length().atan2((a + b).length());
    let blended = if angle < 1e-3 {
        a * (1.0 - at) + b * at
    } else {
        (a * ((1.0 - at) * angle).sin() + b * (at * angle).sin()) / angle.sin()
    };
    blended / blended.length()
}

/// The pose at `time` between two timed poses, or `None` outside them, for equal times, or when they are
/// farther apart than `largest_gap_nanos` (hard-cases A08).
pub fn interpolate(
    (time_a, a): (i64, Pose),
    (time_b, b): (i64, Pose),
    time: i64,
    largest_gap_nanos: i64,
) -> Option<Pose> {
    let gap = time_b.checked_sub(time_a)?;
    if gap <= 0 || gap > largest_gap_nanos || time < time_a || time > time_b {
        return None;
    }
    let at = (time - time_a) as f64 / gap as f64;
    let rotation = slerp(a.rotation(), b.rotation(), at);
    Pose::new(rotation, a.translation().lerp(b.translation(), at)).ok()
}

/// The matrix of the cross product: `skew(a) b = a × b`.
fn skew(a: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, a.z, -a.y),
        DVec3::new(-a.z, 0.0, a.x),
        DVec3::new(a.y, -a.x, 0.0),
    )
}

/// `(1 − cos θ)/θ²`, stable at 0 (hard-cases A01).
pub fn exp_coefficient_b(angle: f64) -> f64 {
    let half = sinc(angle * 0.5);
    0.5 * half * half
}

/// `(θ − sin θ)/θ³`, stable at 0 (hard-cases A01).
pub fn exp_coefficient_c(angle: f64) -> f64 {
    let angle2 = angle * angle;
    if angle.abs() < 1.0 {
        let mut term = 1.0 / 6.0;
        let mut sum = term;
        for k in 1..9 {
            let k = f64::from(k);
            term *= -angle2 / ((2.0 * k + 2.0) * (2.0 * k + 3.0));
            sum += term;
        }
        sum
    } else {
        (angle - angle.sin()) / (angle2 * angle)
    }
}

/// `(1 − (θ/2) cot(θ/2))/θ²` for |θ| < 2π, stable at 0 (hard-cases A09); infinite at 2π itself.
pub fn log_coefficient(angle: f64) -> f64 {
    if angle.abs() < 0.5 {
        let a2 = angle * angle;
        1.0 / 12.0
            + a2 * (1.0 / 720.0
                + a2 * (1.0 / 30_240.0 + a2 * (1.0 / 1_209_600.0 + a2 * (1.0 / 47_900_160.0))))
    } else {
        let half = angle * 0.5;
        (1.0 - half * half.cos() / half.sin()) / (angle * angle)
    }
}

/// SE(3) exponential of a twist (rotation vector in radians, velocity in metres).
///
/// A twist that is not finite gives the identity; a step out of a solver, which may be that, goes through
/// [`try_exp_twist`].
pub fn exp_twist(rotation_vector: DVec3, velocity: DVec3) -> Pose {
    try_exp_twist(rotation_vector, velocity).unwrap_or(Pose::IDENTITY)
}

/// SE(3) exponential of a twist, or `None` when the twist is not finite: no step is not a step of zero.
pub fn try_exp_twist(rotation_vector: DVec3, velocity: DVec3) -> Option<Pose> {
    let angle = rotation_vector.length();
    let w = skew(rotation_vector);
    let v = DMat3::IDENTITY + w * exp_coefficient_b(angle) + w * w * exp_coefficient_c(angle);
    Pose::new(exp(rotation_vector), v * velocity).ok()
}

/// SE(3) logarithm: `(rotation vector in radians, velocity in metres)` with [`exp_twist`] of it the pose.
pub fn log_twist(pose: &Pose) -> (DVec3, DVec3) {
    let rotation_vector = log(pose.rotation());
    let w = skew(rotation_vector);
    let v_inverse = DMat3::IDENTITY - w * 0.5 + w * w * log_coefficient(rotation_vector.length());
    (rotation_vector, v_inverse * pose.translation())
}
