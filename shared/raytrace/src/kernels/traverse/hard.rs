//! Hard case E02: boxes must not lose what their triangles would catch.

use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;
use crate::tree::Triangle;

/// A lattice surface: 2 · 6 · 6 triangles with corners on a bumpy sheet around `center`.
fn sheet(center: Vec3) -> Vec<Triangle> {
    let point = |i: usize, j: usize| {
        let (x, y) = (i as f32 / 6.0 - 0.5, j as f32 / 6.0 - 0.5);
        center + Vec3::new(x, y, 0.1 * (9.0 * x).sin() * (7.0 * y).cos())
    };
    let mut triangles = Vec::new();
    for i in 0..6 {
        for j in 0..6 {
            let [a, b, c, d] = [
                point(i, j),
                point(i + 1, j),
                point(i + 1, j + 1),
                point(i, j + 1),
            ];
            for vertices in [[a, b, c], [a, c, d]] {
                let index = triangles.len() as u32;
                triangles.push(Triangle { vertices, index });
            }
        }
    }
    triangles
}

/// A ray at a random edge or corner.
fn ray_at_edge(triangles: &[Triangle], center: Vec3, rng: &mut Pcg64) -> Ray {
    let corners = triangles[rng.random_range(0..triangles.len())].vertices;
    let share = if rng.random::<bool>() {
        0.0
    } else {
        rng.random::<f32>()
    };
    let aim = corners[0].lerp(corners[1], share);
    let random = |rng: &mut Pcg64| {
        Vec3::from_array(std::array::from_fn(|_| rng.random::<f32>() * 4.0 - 2.0))
    };
    let origin = match rng.random_range(0..3) {
        // From afar, along an axis, from within the sheet's own box.
        0 => center + random(rng),
        1 => aim - Vec3::from_array(std::array::from_fn(|k| if k == 2 { 1.0 } else { 0.0 })),
        _ => center + random(rng) * 0.1,
    };
    Ray::new(origin, aim - origin)
}

/// Whether the slab test without margin misses the exact box of a triangle.
fn naive_misses_box(triangle: &Triangle, ray: &Ray) -> bool {
    let [a, b, c] = triangle.vertices;
    let inverse = ray.direction.recip();
    let (t0, t1) = (
        (a.min(b).min(c) - ray.origin) * inverse,
        (a.max(b).max(c) - ray.origin) * inverse,
    );
    t0.min(t1).max_element() > t0.max(t1).min_element()
}

#[test]
fn hc_e02_boxes_lose_no_hit() {
    let mut rng = Pcg64::seed_from_u64(502);
    let count = if cfg!(debug_assertions) {
        100_000
    } else {
        1_000_000
    };
    let (mut naive_lost, mut different) = (0, 0);
    for center in [
        Vec3::ZERO,
        Vec3::new(1.3, -0.4, 2.1),
        Vec3::new(90.0, 40.0, -70.0),
        Vec3::splat(0.01),
    ] {
        let triangles = sheet(center);
        let tree = Tree::new(&triangles);
        let rays: Vec<Ray> = (0..count / 4)
            .map(|_| ray_at_edge(&triangles, center, &mut rng))
            .collect();
        let mut by_force = vec![Hit::MISS; rays.len()];
        scalar::trace_by_force(&tree, &rays, &mut by_force);
        naive_lost += rays
            .iter()
            .zip(&by_force)
            .filter(|(ray, hit)| {
                hit.is_hit() && naive_misses_box(&triangles[hit.triangle as usize], ray)
            })
            .count();
        for level in [Level::Scalar, Level::detect()] {
            let mut hits = vec![Hit::MISS; rays.len()];
            trace(level, &tree, Wanted::Closest, &rays, &mut hits);
            different += hits.iter().zip(&by_force).filter(|(a, b)| a != b).count();
        }
    }
    println!("e02: naive error {naive_lost}, tolerance 0");
    assert!(naive_lost > 0, "e02: the naive form passes");
    println!("e02: worst error {different}, tolerance 0 ({count} rays)");
    assert_eq!(different, 0, "hits that boxes lost or changed");
}
