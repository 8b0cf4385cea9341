//! Hard cases E07, E08: degenerate triangles and bad input to the build.

use glam::Vec3;
use rand::RngExt as _;
use raytrace::{Hit, Ray, Scene, TriangleCounts};

use crate::meshes::{Mesh, icosphere};
use crate::rows::{bites, generator, holds, scaled_count, uniform, unit_vector};

/// A ball with as many degenerate triangles of each kind as a tenth of its own.
fn spoiled(ball: &Mesh) -> (Mesh, TriangleCounts) {
    let mut mesh = ball.clone();
    let share = ball.triangles.len() / 10;
    let mut counts = TriangleCounts {
        kept_count: ball.triangles.len(),
        ..TriangleCounts::default()
    };
    for index in 0..share {
        let [a, b, _] = ball.triangles[index];
        let p = ball.positions[a as usize];
        let extra = mesh.positions.len() as u32;
        match index % 4 {
            // A sliver 1e-9 m high.
            0 => {
                mesh.positions
                    .extend([Vec3::ZERO, Vec3::X * 1e-6, Vec3::Y * 1e-9]);
                mesh.triangles.push([extra, extra + 1, extra + 2]);
                counts.tiny_count += 1;
            }
            // A point.
            1 => {
                mesh.positions.extend([p, p]);
                mesh.triangles.push([a, extra, extra + 1]);
                counts.tiny_count += 1;
            }
            2 => {
                mesh.positions.push(Vec3::new(0.0, f32::NAN, 0.0));
                mesh.triangles.push([a, b, extra]);
                counts.not_finite_count += 1;
            }
            _ => {
                mesh.triangles.push([a, b, a]);
                counts.repeated_vertex_count += 1;
            }
        }
    }
    (mesh, counts)
}

/// Möller and Trumbore's test that rejects what is outside, and so keeps NaN.
fn naive_hit(corners: [Vec3; 3], ray: &Ray) -> Option<f32> {
    let [a, b, c] = corners;
    let (e1, e2, s) = (b - a, c - a, ray.origin - a);
    let p = ray.direction.cross(e2);
    let q = s.cross(e1);
    let inverse = 1.0 / e1.dot(p);
    let (u, v, t) = (
        s.dot(p) * inverse,
        ray.direction.dot(q) * inverse,
        e2.dot(q) * inverse,
    );
    let outside = u < 0.0 || v < 0.0 || u + v > 1.0 || t < ray.least;
    (!outside).then_some(t)
}

#[test]
fn hc_e07_degenerate_triangles() {
    let ball = icosphere(3, 0.5, Vec3::new(0.0, 0.0, 1.0));
    let (mesh, counts) = spoiled(&ball);
    let mut rng = generator(507);
    let rays: Vec<Ray> = (0..scaled_count(20_000))
        .map(|_| Ray::new(unit_vector(&mut rng) * 2.0, unit_vector(&mut rng)))
        .collect();
    let nan_hits = rays.iter().take(200).flat_map(|ray| {
        (0..mesh.triangles.len() as u32)
            .filter(|&t| naive_hit(mesh.corners(t), ray).is_some_and(f32::is_nan))
    });
    bites("e07 NaN hits", nan_hits.count() as f64, 0.0);

    let scene = Scene::new(&mesh.positions, &mesh.triangles).expect("valid indices");
    assert_eq!(scene.counts(), counts);
    let clean = Scene::new(&ball.positions, &ball.triangles).expect("valid indices");
    let mut hits = [vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]];
    scene.closest_batch(&rays, &mut hits[0]);
    clean.closest_batch(&rays, &mut hits[1]);
    let different = hits[0].iter().zip(&hits[1]).filter(|(a, b)| a != b).count();
    assert!(
        hits[0]
            .iter()
            .all(|hit| hit.u.is_finite() && hit.v.is_finite() && !hit.t.is_nan())
    );
    holds("e07 hits unlike the clean mesh", different as f64, 0.0);
}

/// Depth of a tree that splits at the middle of the centroids until 8 are left; stops at 64.
fn naive_depth(centroids: &[f32], depth: u32) -> u32 {
    if centroids.len() <= 8 || depth > 64 {
        return depth;
    }
    let least = centroids.iter().copied().fold(f32::INFINITY, f32::min);
    let greatest = centroids.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let middle = 0.5 * (least + greatest);
    let (left, right): (Vec<f32>, Vec<f32>) = centroids.iter().partition(|&&c| c < middle);
    naive_depth(&left, depth + 1).max(naive_depth(&right, depth + 1))
}

#[test]
fn hc_e08_builds_on_bad_input() {
    bites(
        "e08 depth",
        f64::from(naive_depth(&vec![0.25; 1000], 0)),
        64.0,
    );

    let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let ray = Ray::new(Vec3::new(0.25, 0.25, 1.0), -Vec3::Z);
    let mut wrong = 0;
    for count in [0, 1, 2, 8, 9, 1000, 100_000] {
        let scene = Scene::new(&triangle, &vec![[0, 1, 2]; count]).expect("valid indices");
        let hit = scene.closest(&ray);
        wrong += u32::from(hit.map(|hit| hit.triangle) != (count > 0).then_some(0));
    }
    // Heaps of identical triangles, points in a row, coordinates of all magnitudes.
    let mut rng = generator(508);
    for _ in 0..1000 {
        let heap_count = rng.random_range(1..6_u32);
        let mut mesh = Mesh::default();
        for _ in 0..heap_count {
            let scale = 10.0_f64.powf(uniform(&mut rng, -4.0, 6.0)) as f32;
            let first = mesh.positions.len() as u32;
            let center = Vec3::X * scale;
            mesh.positions
                .extend([center, center + Vec3::X * scale, center + Vec3::Y * scale]);
            let copies = rng.random_range(1..60);
            mesh.triangles
                .extend(vec![[first, first + 1, first + 2]; copies]);
        }
        let scene = Scene::new(&mesh.positions, &mesh.triangles).expect("valid indices");
        let aim = mesh.point(mesh.triangles.len() as u32 - 1, 0.3, 0.3);
        wrong += u32::from(scene.closest(&Ray::new(aim + Vec3::Z, -Vec3::Z)).is_none());
    }
    holds("e08 wrong answers", f64::from(wrong), 0.0);
}
