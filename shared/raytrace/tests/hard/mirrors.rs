//! Hard cases E03, E04: mirrored rays and the surface they leave.

use glam::Vec3;
use rand::RngExt as _;
use rand_pcg::Pcg64;
use raytrace::{MirrorQuery, Ray, Scene};

use crate::meshes::{Mesh, icosphere};
use crate::rows::{bites, generator, holds, scaled_count, uniform, unit_vector};

/// A random point of a mesh with its facet's normal and a direction above it.
struct Leaving {
    triangle: u32,
    position: Vec3,
    normal: Vec3,
    outgoing: Vec3,
}

fn leaving(mesh: &Mesh, rng: &mut Pcg64) -> Leaving {
    let triangle = rng.random_range(0..mesh.triangles.len() as u32);
    let (u, v) = (
        uniform(rng, 0.05, 0.45) as f32,
        uniform(rng, 0.05, 0.45) as f32,
    );
    let normal = mesh.normal(triangle);
    let mut outgoing = unit_vector(rng);
    if outgoing.dot(normal) < 0.0 {
        outgoing = -outgoing;
    }
    Leaving {
        triangle,
        position: mesh.point(triangle, u, v),
        normal,
        outgoing,
    }
}

/// Share of mirrored rays that leave a ball of 1 m at `offset` metres from zero along each axis, and meet it
/// again, by `start` (scene, where they leave). Grazing ones are left out: corners rounded at 1e4 m dent the ball.
fn self_hit_share(
    offset: f32,
    count: usize,
    rng: &mut Pcg64,
    start: impl Fn(&Scene, &Leaving) -> Option<Vec3>,
) -> f64 {
    let ball = icosphere(2, 1.0, Vec3::splat(offset));
    let scene = Scene::new(&ball.positions, &ball.triangles).expect("valid indices");
    let hits = (0..count).filter(|_| {
        let leaving = leaving(&ball, rng);
        let direction = geometry::direction::reflect(leaving.outgoing, leaving.normal);
        direction.dot(leaving.normal) > 0.01
            && start(&scene, &leaving)
                .is_some_and(|origin| scene.is_blocked(&Ray::new(origin, direction)))
    });
    hits.count() as f64 / count as f64
}

/// Along the ray to what it hit, and 1 µm back up.
fn naive_start(scene: &Scene, leaving: &Leaving) -> Option<Vec3> {
    let eye = leaving.position + leaving.outgoing * 3.0;
    let hit = scene.closest(&Ray::new(eye, -leaving.outgoing))?;
    (hit.triangle == leaving.triangle)
        .then_some(eye - leaving.outgoing * hit.t + leaving.normal * 1e-6)
}

#[test]
fn hc_e03_no_self_hits_and_contact_kept() {
    let mut rng = generator(503);
    bites(
        "e03 self-hits at 10 m",
        self_hit_share(10.0, 2000, &mut rng, naive_start),
        0.0,
    );
    let query = MirrorQuery::for_exact();
    let mut worst: f64 = 0.0;
    for offset in [0.0, 1.0, 10.0, 100.0, 1e3, 1e4] {
        let count = scaled_count(20_000);
        worst = worst.max(self_hit_share(offset, count, &mut rng, |_, leaving| {
            Some(query.start(leaving.position, leaving.normal))
        }));
    }
    holds("e03 self-hits", worst, 0.0);

    // Two plates 0.1 mm apart, within 1 m of zero: each mirrors the other.
    let lost = |start: &dyn Fn(Vec3, Vec3) -> Vec3, rng: &mut Pcg64| {
        let (mut lost, count) = (0, 2000);
        for _ in 0..count {
            let height = uniform(rng, -1.0, 1.0) as f32;
            let plate = |z: f32| {
                [
                    Vec3::new(-2.0, -2.0, z),
                    Vec3::new(2.0, -2.0, z),
                    Vec3::new(0.0, 3.0, z),
                ]
            };
            let positions: Vec<Vec3> = [plate(height), plate(height + 1e-4)].concat();
            let scene = Scene::new(&positions, &[[0, 1, 2], [3, 4, 5]]).expect("valid indices");
            let position = Vec3::new(
                uniform(rng, -0.5, 0.5) as f32,
                uniform(rng, -0.5, 0.5) as f32,
                height,
            );
            let direction = Vec3::new(0.3, 0.0, 1.0).normalize();
            let hit = scene.closest(&Ray::new(start(position, Vec3::Z), direction));
            lost += u32::from(hit.is_none_or(|hit| hit.triangle != 1));
        }
        f64::from(lost) / f64::from(count)
    };
    bites(
        "e03 contact lost",
        lost(&|p, n| p + n * 1e-3, &mut rng),
        0.0,
    );
    holds(
        "e03 contact lost",
        lost(&|p, n| query.start(p, n), &mut rng),
        0.0,
    );
}

/// A ball of radius 10 cm, triangles of 4 mm, corners moved by noise of `sigma` metres.
fn noisy_ball(sigma: f64, rng: &mut Pcg64) -> Mesh {
    let mut ball = icosphere(5, 0.1, Vec3::ZERO);
    for position in &mut ball.positions {
        // Sum of 12 uniforms: Gaussian to 3 sigma.
        let noise =
            |rng: &mut Pcg64| ((0..12).map(|_| uniform(rng, 0.0, 1.0)).sum::<f64>() - 6.0) * sigma;
        *position += Vec3::new(noise(rng) as f32, noise(rng) as f32, noise(rng) as f32);
    }
    ball
}

/// Share of a noisy ball's pixels (n·v > 0.2, seen from `eye`) whose mirrored ray leaves it, by `sees_out`
/// (scene, position, facet normal, shading normal, outgoing).
fn free_share(
    mesh: &Mesh,
    eye: Vec3,
    count: usize,
    rng: &mut Pcg64,
    sees_out: impl Fn(&Scene, Vec3, Vec3, Vec3, Vec3) -> bool,
) -> f64 {
    let scene = Scene::new(&mesh.positions, &mesh.triangles).expect("valid indices");
    let (mut free, mut seen) = (0, 0);
    while seen < count {
        let aim = unit_vector(rng) * 0.1;
        let Some(hit) = scene.closest(&Ray::new(eye, (aim - eye).normalize())) else {
            continue;
        };
        let position = mesh.point(hit.triangle, hit.u, hit.v);
        // The normals of a smoothed mesh: those of the ball.
        let shading = position.normalize();
        let outgoing = (eye - position).normalize();
        let facet = mesh.normal(hit.triangle);
        if shading.dot(outgoing) > 0.2 && facet.dot(outgoing) > 0.0 {
            seen += 1;
            free += usize::from(sees_out(&scene, position, facet, shading, outgoing));
        }
    }
    free as f64 / count as f64
}

#[test]
fn hc_e04_facets_do_not_hide_themselves() {
    let mut rng = generator(504);
    let naive = |scene: &Scene, position: Vec3, facet: Vec3, shading: Vec3, outgoing: Vec3| {
        let direction = geometry::direction::reflect(outgoing, shading);
        !scene.is_blocked(&Ray::new(position + facet * 1e-5, direction))
    };
    let ball = noisy_ball(1e-3, &mut rng);
    let listed_eye = Vec3::new(0.0, 0.0, -0.6);
    let hidden = 1.0 - free_share(&ball, listed_eye, 4000, &mut rng, naive);
    bites("e04 share hidden", hidden, 0.08);

    // Fused at 4 mm: the size of the triangles.
    let query = MirrorQuery::for_fused(0.004);
    let shipped = |scene: &Scene, position: Vec3, facet: Vec3, shading: Vec3, outgoing: Vec3| {
        query
            .reflect(scene, position, facet, shading, outgoing)
            .first_bounce
            .is_none()
    };
    let mut worst: f64 = 0.0;
    for round in 0..6 {
        let ball = noisy_ball([1e-3, 0.5e-3, 0.2e-3][round % 3], &mut rng);
        let eye = if round == 0 {
            listed_eye
        } else {
            unit_vector(&mut rng) * 0.6
        };
        worst = worst.max(1.0 - free_share(&ball, eye, 4000, &mut rng, shipped));
    }
    holds("e04 share hidden", worst, 0.005);
}
