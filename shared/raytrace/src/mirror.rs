//! Reflected view rays: where they start and what they meet first.

use geometry::direction::reflect;
use glam::Vec3;

use crate::ray::{Hit, Ray};
use crate::scene::Scene;

/// Start of a mirrored ray above a fused surface, voxels (hard-cases E04).
const FUSED_OFFSET_VOXELS: f32 = 0.5;
/// Hits closer than this are the surface's own noise, voxels (hard-cases E04).
const FUSED_LEAST_VOXELS: f32 = 1.5;
/// Sine above the facet plane that a reflection below it is lifted to.
const LIFTED_SINE: f32 = 0.02;
/// Offset from an exact surface, units in the last place (hard-cases E03; Wächter and Binder 2019).
const EXACT_OFFSET_ULP: f32 = 256.0;
/// Below this coordinate, metres, ulps shrink faster than the error of a hit does.
const EXACT_NEAR_ZERO: f32 = 1.0 / 32.0;
/// Offset there, metres.
const EXACT_OFFSET_NEAR_ZERO: f32 = 1.0 / 65536.0;

/// How mirrored rays leave a surface without meeting it at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorQuery {
    offset: Offset,
    least: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Offset {
    /// Metres along the geometric normal.
    Metres(f32),
    /// [`EXACT_OFFSET_ULP`] units in the last place along the geometric normal.
    Ulp,
}

/// A mirrored view ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflection {
    /// Unit direction in which the surface looks: the reflection about the shading normal, lifted above the
    /// facet.
    pub direction: Vec3,
    /// What it meets first; t counts metres from the start of the ray.
    pub first_bounce: Option<Hit>,
}

impl MirrorQuery {
    /// For a mesh fused at `voxel_size` metres: its facets are noisy, so rays start half a voxel off and
    /// ignore 1.5 voxels.
    pub fn for_fused(voxel_size: f32) -> Self {
        Self {
            offset: Offset::Metres(FUSED_OFFSET_VOXELS * voxel_size),
            least: FUSED_LEAST_VOXELS * voxel_size,
        }
    }

    /// For a mesh whose facets are the surface: rays start 256 ulp off, contact within 0.1 mm is found.
    /// Coordinates should count from a near origin: 256 ulp are 31 µm at 1 m and 0.25 m at 10 km.
    pub fn for_exact() -> Self {
        Self {
            offset: Offset::Ulp,
            least: 0.0,
        }
    }

    /// Where a mirrored ray starts that leaves `position` towards the side of `geometric_normal` (unit).
    pub fn start(&self, position: Vec3, geometric_normal: Vec3) -> Vec3 {
        match self.offset {
            Offset::Metres(metres) => position + geometric_normal * metres,
            Offset::Ulp => offset_by_ulp(position, geometric_normal),
        }
    }

    /// The reflection of `outgoing` (unit, from the surface to the eye) about `shading_normal` (unit, on the
    /// eye's side) at `position`, and what it meets. `geometric_normal` (unit, of the facet) may point to
    /// either side. A reflection that falls below the facet is lifted just above it: it would meet the facet
    /// itself at once.
    pub fn reflect(
        &self,
        scene: &Scene,
        position: Vec3,
        geometric_normal: Vec3,
        shading_normal: Vec3,
        outgoing: Vec3,
    ) -> Reflection {
        let ray = self.ray(position, geometric_normal, shading_normal, outgoing);
        Reflection {
            direction: ray.direction,
            first_bounce: scene.closest(&ray),
        }
    }

    /// The ray that [`MirrorQuery::reflect`] follows.
    pub fn ray(
        &self,
        position: Vec3,
        geometric_normal: Vec3,
        shading_normal: Vec3,
        outgoing: Vec3,
    ) -> Ray {
        let facing = if geometric_normal.dot(outgoing) < 0.0 {
            -geometric_normal
        } else {
            geometric_normal
        };
        Ray {
            origin: self.start(position, facing),
            direction: lifted(reflect(outgoing, shading_normal), facing),
            least: self.least,
            greatest: f32::INFINITY,
        }
    }
}

/// `direction` (unit), or where it falls below the plane of `normal` (unit) the nearest one just above.
fn lifted(direction: Vec3, normal: Vec3) -> Vec3 {
    let sine = direction.dot(normal);
    if sine >= LIFTED_SINE {
        return direction;
    }
    if direction == Vec3::ZERO {
        // A normal or an eye without direction: nothing to lift, and nothing is met.
        return direction;
    }
    let within = direction - normal * sine;
    match within.try_normalize() {
        Some(within) => within * (1.0 - LIFTED_SINE * LIFTED_SINE).sqrt() + normal * LIFTED_SINE,
        // Straight into the facet: no side is nearer than another.
        None => normal,
    }
}

/// `position` moved by 256 ulp of each coordinate along `normal`, by integer steps of the bit pattern.
fn offset_by_ulp(position: Vec3, normal: Vec3) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|axis| {
        let (p, n) = (position[axis], normal[axis]);
        if p.abs() < EXACT_NEAR_ZERO {
            return p + n * EXACT_OFFSET_NEAR_ZERO;
        }
        // Saturating cast: a normal is at most 1 long, and NaN becomes no step.
        let steps = (EXACT_OFFSET_ULP * n) as i32;
        let bits = p.to_bits().cast_signed();
        let moved = bits.wrapping_add(if p < 0.0 { -steps } else { steps });
        f32::from_bits(moved.cast_unsigned())
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two walls that meet at a right angle along y: the floor z = 0 and the wall x = 1.
    fn corner() -> Scene {
        let positions = [
            Vec3::new(-5.0, -5.0, 0.0),
            Vec3::new(1.0, -5.0, 0.0),
            Vec3::new(1.0, 5.0, 0.0),
            Vec3::new(-5.0, 5.0, 0.0),
            Vec3::new(1.0, -5.0, 5.0),
            Vec3::new(1.0, 5.0, 5.0),
        ];
        Scene::new(&positions, &[[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
            .expect("valid indices")
    }

    #[test]
    fn a_mirror_on_the_floor_sees_the_wall() {
        let outgoing = Vec3::new(-1.0, 0.0, 1.0).normalize();
        for query in [MirrorQuery::for_fused(0.002), MirrorQuery::for_exact()] {
            for geometric_normal in [Vec3::Z, -Vec3::Z] {
                let reflection =
                    query.reflect(&corner(), Vec3::ZERO, geometric_normal, Vec3::Z, outgoing);
                assert!(
                    (reflection.direction - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-6
                );
                let hit = reflection.first_bounce.expect("the wall stands there");
                assert!(hit.triangle >= 2);
                assert!((hit.t - 2.0_f32.sqrt()).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_mirror_facing_away_from_the_wall_sees_nothing() {
        let outgoing = Vec3::new(1.0, 0.0, 1.0).normalize();
        let reflection =
            MirrorQuery::for_exact().reflect(&corner(), Vec3::ZERO, Vec3::Z, Vec3::Z, outgoing);
        assert_eq!(reflection.first_bounce, None);
    }

    #[test]
    fn a_reflection_below_the_facet_is_lifted() {
        // The shading normal leans so far that the mirror direction points into the floor.
        let shading_normal = Vec3::new(-0.8, 0.0, 0.6);
        let outgoing = Vec3::new(0.0, 0.0, 1.0);
        let ray = MirrorQuery::for_fused(0.002).ray(Vec3::ZERO, Vec3::Z, shading_normal, outgoing);
        assert!((ray.direction.length() - 1.0).abs() < 1e-6);
        assert!((ray.direction.z - LIFTED_SINE).abs() < 1e-6);
        assert!(ray.direction.x < -0.99, "the azimuth stays");
    }

    #[test]
    fn a_normal_without_direction_meets_nothing() {
        for bad in [Vec3::ZERO, Vec3::NAN] {
            let query = MirrorQuery::for_fused(0.002);
            let reflection = query.reflect(&corner(), Vec3::ZERO, Vec3::Z, bad, Vec3::Z);
            assert_eq!(
                (reflection.direction, reflection.first_bounce),
                (Vec3::ZERO, None)
            );
        }
    }
}
