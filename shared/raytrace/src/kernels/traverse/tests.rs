//! The walk against brute force in f64, and its levels against each other.

use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;
use crate::tree::Triangle;

fn random_vector(rng: &mut Pcg64) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| rng.random::<f32>() * 2.0 - 1.0))
}

/// Triangles of all sizes in a cube.
fn soup(rng: &mut Pcg64, count: u32) -> Vec<Triangle> {
    (0..count)
        .map(|index| {
            let center = random_vector(rng);
            let size = 0.02 + 0.3 * rng.random::<f32>();
            let vertices = std::array::from_fn(|_| center + random_vector(rng) * size);
            Triangle { vertices, index }
        })
        .collect()
}

fn rays(rng: &mut Pcg64, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|round| {
            let origin = random_vector(rng) * 2.0;
            let direction = random_vector(rng);
            let direction = match round % 4 {
                0 => Vec3::from_array(std::array::from_fn(
                    |k| if k == round % 3 { 1.0 } else { 0.0 },
                )),
                1 => direction * 1e-3,
                _ => direction,
            };
            Ray {
                least: if round % 5 == 0 { 0.5 } else { 0.0 },
                greatest: if round % 7 == 0 { 1.5 } else { f32::INFINITY },
                ..Ray::new(origin, direction)
            }
        })
        .collect()
}

/// Nearest t by Cramer's rule in f64.
fn brute_force(triangles: &[Triangle], ray: &Ray) -> Option<(u32, f64)> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut best: Option<(u32, f64)> = None;
    for triangle in triangles {
        let [a, b, c] = triangle.vertices.map(Vec3::as_dvec3);
        let (e1, e2, s) = (b - a, c - a, o - a);
        let determinant = e1.dot(d.cross(e2));
        let u = s.dot(d.cross(e2)) / determinant;
        let v = d.dot(s.cross(e1)) / determinant;
        let t = e2.dot(s.cross(e1)) / determinant;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        if inside
            && t >= f64::from(ray.least)
            && t <= f64::from(ray.greatest)
            && best.is_none_or(|b| t < b.1)
        {
            best = Some((triangle.index, t));
        }
    }
    best
}

#[test]
fn nearest_hits_are_those_of_brute_force() {
    let mut rng = Pcg64::seed_from_u64(1);
    let triangles = soup(&mut rng, 700);
    let tree = Tree::new(&triangles);
    let rays = rays(&mut rng, 3000);
    for level in [Level::Scalar, Level::detect()] {
        let mut hits = vec![Hit::MISS; rays.len()];
        trace(level, &tree, Wanted::Closest, &rays, &mut hits);
        for (ray, hit) in rays.iter().zip(&hits) {
            let expected = brute_force(&triangles, ray);
            assert_eq!(
                hit.is_hit().then_some(hit.triangle),
                expected.map(|e| e.0),
                "{ray:?}"
            );
            let Some((_, t)) = expected else { continue };
            assert!(
                (f64::from(hit.t) - t).abs()
                    <= 1e-5 * t.max(1.0 / f64::from(ray.direction.length()))
            );
            let [a, b, c] = triangles[hit.triangle as usize].vertices;
            let by_weights = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            let by_distance = ray.origin + ray.direction * hit.t;
            assert!(
                (by_weights - by_distance).length() < 3e-5,
                "{by_weights} {by_distance}"
            );
        }
    }
}

#[test]
fn any_hit_agrees_with_the_nearest() {
    let mut rng = Pcg64::seed_from_u64(2);
    let tree = Tree::new(&soup(&mut rng, 700));
    let rays = rays(&mut rng, 3000);
    for level in [Level::Scalar, Level::detect()] {
        let mut nearest = vec![Hit::MISS; rays.len()];
        let mut any = nearest.clone();
        trace(level, &tree, Wanted::Closest, &rays, &mut nearest);
        trace(level, &tree, Wanted::Any, &rays, &mut any);
        for ((ray, nearest), any) in rays.iter().zip(&nearest).zip(&any) {
            assert_eq!(nearest.is_hit(), any.is_hit());
            assert!(!any.is_hit() || (any.t >= nearest.t && any.t <= ray.greatest));
        }
    }
}

#[test]
fn levels_agree_bit_for_bit() {
    let mut rng = Pcg64::seed_from_u64(3);
    for count in (0..=33).chain([500, 3000]) {
        let tree = Tree::new(&soup(&mut rng, count));
        let mut rays = rays(&mut rng, 400);
        let bad = [f32::NAN, f32::INFINITY, f32::MAX, 1e-40, 0.0, -0.0];
        for (round, ray) in rays.iter_mut().take(72).enumerate() {
            let value = bad[round % 6];
            match round / 6 % 4 {
                0 => ray.origin[round / 24] = value,
                1 => ray.direction[round / 24] = value,
                2 => ray.least = value,
                _ => ray.greatest = value,
            }
        }
        for wanted in [Wanted::Closest, Wanted::Any] {
            let mut scalar = vec![Hit::MISS; rays.len()];
            let mut fastest = scalar.clone();
            trace(Level::Scalar, &tree, wanted, &rays, &mut scalar);
            trace(Level::detect(), &tree, wanted, &rays, &mut fastest);
            let bits = |hit: &Hit| {
                (
                    hit.triangle,
                    hit.t.to_bits(),
                    hit.u.to_bits(),
                    hit.v.to_bits(),
                )
            };
            for ((ray, a), b) in rays.iter().zip(&scalar).zip(&fastest) {
                assert_eq!(bits(a), bits(b), "{ray:?}");
                assert!(!a.t.is_nan() && !a.u.is_nan() && !a.v.is_nan());
            }
        }
    }
}

#[test]
fn rays_without_sense_miss() {
    let triangles = [Triangle {
        vertices: [
            Vec3::new(-9.0, -9.0, 1.0),
            Vec3::new(9.0, -9.0, 1.0),
            Vec3::new(0.0, 9.0, 1.0),
        ],
        index: 0,
    }];
    let tree = Tree::new(&triangles);
    let good = Ray::new(Vec3::ZERO, Vec3::Z);
    let nonsense = [
        Ray::new(Vec3::NAN, Vec3::Z),
        Ray::new(Vec3::INFINITY, Vec3::Z),
        Ray::new(Vec3::ZERO, Vec3::ZERO),
        Ray::new(Vec3::ZERO, Vec3::NAN),
        Ray::new(Vec3::ZERO, Vec3::new(f32::NAN, 0.0, 1.0)),
        Ray::new(Vec3::ZERO, Vec3::INFINITY),
        Ray {
            least: f32::NAN,
            ..good
        },
        Ray {
            greatest: f32::NAN,
            ..good
        },
        Ray { least: 1.5, ..good },
        Ray {
            greatest: 0.5,
            ..good
        },
        Ray {
            least: 1.1,
            greatest: 0.9,
            ..good
        },
    ];
    for level in [Level::Scalar, Level::detect()] {
        let mut hits = [Hit::MISS; 12];
        trace(level, &tree, Wanted::Closest, &[good; 1], &mut hits[..1]);
        assert_eq!(hits[0].t, 1.0);
        for ray in nonsense {
            trace(level, &tree, Wanted::Closest, &[ray], &mut hits[..1]);
            assert_eq!(hits[0], Hit::MISS, "{ray:?}");
        }
        let limits = Ray {
            least: 1.0,
            greatest: 1.0,
            ..good
        };
        trace(level, &tree, Wanted::Closest, &[limits], &mut hits[..1]);
        assert!(hits[0].is_hit(), "both limits are included");
    }
}
