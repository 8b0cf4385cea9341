//! Unit directions: angles, bases, mirror reflection, normals under linear maps.

use glam::{DMat3, DVec3, Vec3};

/// The angle between two directions of any nonzero length, radians, exact at 0 and π (hard-cases A10).
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    let (a, b) = (a.normalize_or_zero(), b.normalize_or_zero());
    2.0 * (a - b).length().atan2((a + b).length())
}

/// The mirror direction of `outgoing` (surface to eye) about `normal`: `2(n·o)n − o`, unit
/// (Park 2020 section 3.1 with ω = −outgoing; hard-cases A15).
///
/// Both inputs are normalised first: an interpolated normal is shorter than 1. A zero normal gives zero.
pub fn reflect(outgoing: Vec3, normal: Vec3) -> Vec3 {
    let normal = normal.normalize_or_zero();
    let outgoing = outgoing.normalize_or_zero();
    (normal * (2.0 * normal.dot(outgoing)) - outgoing).normalize_or_zero()
}

/// Two unit vectors that complete unit `normal` to a right-handed basis (Duff et al. 2017; hard-cases A11).
pub fn basis(normal: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    (
        Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
        Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
    )
}

/// The rotation `world_from_camera` of a camera (x right, y down, z forward) that looks along `forward`
/// with `down` as near as may be to the image's down; another down is taken where the two are parallel.
///
/// `None` when `forward` has no length.
pub fn look_along(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let z = forward.try_normalize()?;
    let down = down.normalize_or_zero();
    let right = [down, DVec3::Y, DVec3::Z, DVec3::X]
        .into_iter()
        .map(|candidate| candidate.cross(z))
        .find(|right| right.length() >= 1e-3)?
        .normalize();
    Some(DMat3::from_cols(right, z.cross(right), z))
}

/// A normal under the linear map `linear`: `M⁻ᵀ n`, unit, or `None` when the map is singular.
/// When the determinant is negative the winding of the triangles must be flipped too (hard-cases A16).
pub fn transform_normal(linear: DMat3, normal: DVec3) -> Option<DVec3> {
    if linear.determinant().abs() < 1e-300 {
        return None;
    }
    (linear.inverse().transpose() * normal).try_normalize()
}
