//! Points of a surface, equally many for equal areas.

use glam::{DVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// A point of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Triangle it lies on.
    pub triangle: u32,
    /// Where, in the axes of the mesh, metres.
    pub point: Vec3,
}

/// The corners of a triangle.
pub(super) fn corners(positions: &[Vec3], triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|vertex| positions[vertex as usize].as_dvec3())
}

/// Twice the area along the normal; zero where a corner is not finite.
pub(super) fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    let vector = (b - a).cross(c - a);
    if vector.is_finite() {
        vector
    } else {
        DVec3::ZERO
    }
}

/// `count` points in the order of the triangles: one in each of `count` equal parts of the area, so that the share
/// of any part of the surface is that of its area to one point at each end. Fewer than asked for only where the
/// mesh has no area.
pub(super) fn area_samples(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    count: usize,
    seed: u64,
) -> Vec<SurfacePoint> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let areas: Vec<f64> = triangles
        .iter()
        .map(|triangle| area_vector(corners(positions, *triangle)).length())
        .collect();
    let total: f64 = areas.iter().sum();
    let mut samples = Vec::with_capacity(count);
    if !(total > 0.0) {
        return samples;
    }
    let part = total / count as f64;
    let mut passed = 0.0;
    let mut next = part * rng.random::<f64>();
    for (index, area) in areas.iter().enumerate() {
        passed += area;
        while next < passed && samples.len() < count {
            samples.push(SurfacePoint {
                triangle: index as u32,
                point: random_point(corners(positions, triangles[index]), &mut rng),
            });
            next = part * (samples.len() as f64 + rng.random::<f64>());
        }
    }
    samples
}

/// Uniform on a triangle: the root of one number is the distance from the first corner.
fn random_point([a, b, c]: [DVec3; 3], rng: &mut Pcg64) -> Vec3 {
    let (from_a, along) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
    let opposite = b + (c - b) * along;
    (a + (opposite - a) * from_a).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_by_area() {
        let positions = [
            Vec3::ZERO,
            Vec3::X,
            Vec3::Y,
            Vec3::new(0.0, 0.0, 1.0),
            Vec3::new(3.0, 0.0, 1.0),
            Vec3::new(0.0, 1.0, 1.0),
            Vec3::NAN,
        ];
        let triangles = [[0, 1, 2], [0, 0, 1], [0, 1, 6], [3, 4, 5]];
        let samples = area_samples(&positions, &triangles, 10_000, 1);
        assert_eq!(samples.len(), 10_000);
        let count = |triangle| samples.iter().filter(|s| s.triangle == triangle).count();
        assert!(count(0).abs_diff(2500) <= 1 && count(3).abs_diff(7500) <= 1);
        // The centre of the points is the centre of each triangle.
        let mean = samples.iter().filter(|s| s.triangle == 3);
        let mean = mean.map(|s| s.point.as_dvec3()).sum::<DVec3>() / count(3) as f64;
        assert!((mean - DVec3::new(1.0, 1.0 / 3.0, 1.0)).length() < 0.02);
        assert_eq!(samples, area_samples(&positions, &triangles, 10_000, 1));
        assert!(area_samples(&positions, &[[0, 0, 1]], 10, 1).is_empty());
    }
}
