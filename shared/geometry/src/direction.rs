//! Unit directions: angles, bases, mirror reflection, normals under linear maps.

use glam::{DMat3, DVec3, Vec3};
use std::f64::consts::FRAC_PI_2;

/// The unit vector along `v` of any length, `None` for zero and for what is not finite.
///
/// Scaled by the largest component first: the square of a length below 1e-162 or above 1e154 is 0 or infinite.
pub(crate) fn unit(v: DVec3) -> Option<DVec3> {
    let largest = v.abs().max_element();
    if !v.is_finite() || largest == 0.0 {
        return None;
    }
    let scaled = v / largest;
    Some(scaled / scaled.length())
}

/// The angle between two directions of any nonzero length, radians, exact at 0 and π (hard-cases A10).
///
/// A vector of length zero stands at π/2 to everything; NaN where a component is not finite.
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    let (Some(u), Some(v)) = (unit(a), unit(b)) else {
        return if a.is_finite() && b.is_finite() {
            FRAC_PI_2
        } else {
            f64::NAN
        };
    };
    2.0 * (u - v).length().atan2((u + v).length())
}

/// The mirror direction of `outgoing` (surface to eye) about `normal`: `2(n·o)n − o`, unit
/// (Park 2020 section 3.1 with ω = −outgoing; hard-cases A15).
///
/// Both inputs are normalised first: an interpolated normal is shorter than 1. The result is zero where an
/// input has no direction: length below 1e-19 or above 1e19, or not finite.
pub fn reflect(outgoing: Vec3, normal: Vec3) -> Vec3 {
    let normal = normal.normalize_or_zero();
    if normal == Vec3::ZERO {
        return Vec3::ZERO;
    }
    let outgoing = outgoing.normalize_or_zero();
    (normal * (2.0 * normal.dot(outgoing)) - outgoing).normalize_or_zero()
}

/// Two unit vectors that complete unit `normal` to a right-handed basis (Duff et al. 2017; hard-cases A11).
pub fn basis(normal: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    (
        Vec3::new(
            1.0 + sign * normal.x * normal.x * a,
            sign * b,
            -sign * normal.x,
        ),
        Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
    )
}

/// The rotation `world_from_camera` of a camera (x right, y down, z forward) that looks along `forward`
/// with `down` as near as may be to the image's down; another down is taken where the two are parallel.
///
/// `None` when `forward` has no length or is not finite; such a `down` counts as parallel.
pub fn look_along(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let z = unit(forward)?;
    let down = unit(down).unwrap_or(DVec3::ZERO);
    let right = [down, DVec3::Y, DVec3::Z, DVec3::X]
        .into_iter()
        .map(|candidate| candidate.cross(z))
        .find(|right| right.length() >= 1e-3)?
        .normalize();
    Some(DMat3::from_cols(right, z.cross(right), z))
}

/// Smallest volume of the parallelepiped of the unit columns at which a map counts as regular.
///
/// Rounding leaves 1e-17 of a volume that is zero; a uniform or axis-wise scale leaves 1, however thin.
const SMALLEST_VOLUME: f64 = 1e-12;

/// A normal under the linear map `linear`: `M⁻ᵀ n`, unit, or `None` when the map is singular.
/// When the determinant is negative the winding of the triangles must be flipped too (hard-cases A16).
pub fn transform_normal(linear: DMat3, normal: DVec3) -> Option<DVec3> {
    // In cofactors, M⁻ᵀ = cof M / det M: only the sign of the determinant matters to a direction, and a
    // map to millimetres or kilometres does not under- or overflow.
    let largest = linear
        .to_cols_array()
        .into_iter()
        .map(f64::abs)
        .fold(0.0, f64::max);
    let [a, b, c] = [linear.x_axis, linear.y_axis, linear.z_axis].map(|column| column / largest);
    let determinant = a.dot(b.cross(c));
    let volume = determinant / (a.length() * b.length() * c.length());
    if volume.is_nan() || volume.abs() < SMALLEST_VOLUME {
        return None;
    }
    let cofactors = b.cross(c) * normal.x + c.cross(a) * normal.y + a.cross(b) * normal.z;
    unit(cofactors * determinant.signum())
}
