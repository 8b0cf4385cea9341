//! Hard cases E01, E05, E06: rays along axes, at edges, and rounded vertices.

use glam::{Vec3, Vec3A};
use obvhs::rt_triangle::RtCompressedTriangle;
use rand::RngExt as _;
use rand_pcg::Pcg64;
use raytrace::{Level, Ray, Scene};

use crate::meshes::{Mesh, brute_force, cuboid, icosphere};
use crate::rows::{bites, generator, holds, scaled_count, uniform, unit_vector};

/// Corners, edge and face middles and the centre of a box: all 27.
fn box_points(least: Vec3, greatest: Vec3) -> impl Iterator<Item = Vec3> {
    (0..27).map(move |index| {
        let pick = |axis: usize, place: i32| match place % 3 {
            0 => least[axis],
            1 => 0.5 * (least[axis] + greatest[axis]),
            _ => greatest[axis],
        };
        Vec3::new(pick(0, index), pick(1, index / 3), pick(2, index / 9))
    })
}

/// ±x, ±y, ±z, the zeros of either sign.
fn axis_directions() -> impl Iterator<Item = Vec3> {
    (0..12).map(|index| {
        let zero = if index < 6 { 0.0 } else { -0.0 };
        let mut direction = Vec3::splat(zero);
        direction[index % 3] = if index % 6 < 3 { 1.0 } else { -1.0 };
        direction
    })
}

/// The textbook slab test with the minimum of SSE, which returns its second operand for NaN.
fn naive_enters_box(least: Vec3, greatest: Vec3, origin: Vec3, direction: Vec3) -> bool {
    let sse_min = |a: f32, b: f32| if a < b { a } else { b };
    let sse_max = |a: f32, b: f32| if a > b { a } else { b };
    let (mut entry, mut exit) = (0.0, f32::INFINITY);
    for axis in 0..3 {
        let inverse = 1.0 / direction[axis];
        let t0 = (least[axis] - origin[axis]) * inverse;
        let t1 = (greatest[axis] - origin[axis]) * inverse;
        entry = sse_max(sse_min(t0, t1), entry);
        exit = sse_min(sse_max(t0, t1), exit);
    }
    entry <= exit
}

#[test]
fn hc_e01_axis_parallel_rays() {
    let (least, greatest) = (Vec3::ZERO, Vec3::ONE);
    let listed = cuboid(least, greatest);
    let mut lost = 0;
    for origin in box_points(least, greatest) {
        for direction in axis_directions() {
            let hits = brute_force(&listed, origin, direction).is_some();
            lost += u32::from(hits && !naive_enters_box(least, greatest, origin, direction));
        }
    }
    bites("e01 lost boxes", f64::from(lost), 0.0);

    let mut rng = generator(501);
    let mut different = 0;
    for round in 0..40 {
        // Coordinates in eighths: all arithmetic of axis-parallel rays is exact.
        let eighths = |rng: &mut Pcg64, low: i32, high: i32| {
            Vec3::from_array(std::array::from_fn(|_| {
                rng.random_range(low..high) as f32 / 8.0
            }))
        };
        let (least, greatest) = if round == 0 {
            (least, greatest)
        } else {
            let least = eighths(&mut rng, -80, 80);
            (least, least + eighths(&mut rng, 2, 40))
        };
        let mut mesh = cuboid(least, greatest);
        mesh.append(&cuboid(least - Vec3::ONE, greatest + Vec3::ONE));
        for level in [Level::Scalar, Level::detect()] {
            let scene = Scene::new(&mesh.positions, &mesh.triangles)
                .expect("valid")
                .with_level(level);
            for origin in box_points(least, greatest)
                .chain(box_points(least - Vec3::ONE, greatest + Vec3::ONE))
            {
                for direction in axis_directions() {
                    let hit = scene.closest(&Ray::new(origin, direction));
                    let same = match (hit, brute_force(&mesh, origin, direction)) {
                        // One division and one product, each rounded.
                        (Some(hit), Some(t)) => (f64::from(hit.t) - t).abs() <= 2e-7 * t,
                        (hit, expected) => hit.is_none() && expected.is_none(),
                    };
                    different += u32::from(!same);
                }
            }
        }
    }
    holds("e01 hits unlike brute force", f64::from(different), 0.0);
}

/// A point on an edge (or a corner, one time in four) of a random triangle.
fn point_on_edge(mesh: &Mesh, rng: &mut Pcg64) -> Vec3 {
    let corners = mesh.corners(rng.random_range(0..mesh.triangles.len() as u32));
    let first = rng.random_range(0..3);
    let (a, b) = (corners[first], corners[(first + 1) % 3]);
    let share = if rng.random_range(0..4) == 0 {
        0.0
    } else {
        uniform(rng, 0.0, 1.0)
    };
    a.as_dvec3().lerp(b.as_dvec3(), share).as_vec3()
}

/// Rays from inside a ball of `reach` around `center` at edges of the mesh.
fn rays_at_edges(mesh: &Mesh, center: Vec3, reach: f32, count: usize, rng: &mut Pcg64) -> Vec<Ray> {
    (0..count)
        .map(|_| {
            let origin = center + unit_vector(rng) * reach * uniform(rng, 0.0, 1.0) as f32;
            Ray::new(origin, point_on_edge(mesh, rng) - origin)
        })
        .collect()
}

fn escaped_count(scene: &Scene, rays: &[Ray]) -> usize {
    let mut blocked = vec![false; rays.len()];
    scene.blocked_batch(rays, &mut blocked);
    blocked.iter().filter(|blocked| !**blocked).count()
}

/// Möller and Trumbore's test, f32.
fn naive_hits(mesh: &Mesh, ray: &Ray) -> bool {
    mesh.triangles.iter().any(|triangle| {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
        let (e1, e2, s) = (b - a, c - a, ray.origin - a);
        let p = ray.direction.cross(e2);
        let q = s.cross(e1);
        let inverse = 1.0 / e1.dot(p);
        let (u, v, t) = (
            s.dot(p) * inverse,
            ray.direction.dot(q) * inverse,
            e2.dot(q) * inverse,
        );
        u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0
    })
}

#[test]
fn hc_e05_watertight_edges() {
    let mut rng = generator(505);
    let center = Vec3::new(0.3, -0.2, 1.1);
    // Edges of about 4 mm at 1280 triangles.
    let small = icosphere(3, 0.03, center);
    let rays = rays_at_edges(&small, center, 0.02, 2000, &mut rng);
    let lost = rays.iter().filter(|ray| !naive_hits(&small, ray)).count();
    bites("e05 share lost", lost as f64 / rays.len() as f64, 0.0);

    let count = scaled_count(250_000);
    let mut escaped = 0;
    for (level, radius) in [(3, 0.03), (5, 0.1), (2, 5.0), (0, 1.0)] {
        let mesh = icosphere(level, radius, center);
        let scene = Scene::new(&mesh.positions, &mesh.triangles).expect("valid indices");
        let rays = rays_at_edges(&mesh, center, 0.7 * radius, count, &mut rng);
        escaped += escaped_count(&scene, &rays);
    }
    println!("e05: {} rays", 4 * count);
    holds("e05 escaped rays", escaped as f64, 0.0);
}

/// A closed room of long triangles with a ball of small ones.
fn wall_and_sphere() -> (Mesh, Vec3) {
    let room = cuboid(Vec3::new(-1.03, -0.97, -1.21), Vec3::new(1.01, 1.13, 0.89));
    // Split once, so that there are edges within walls.
    let mut mesh = Mesh::default();
    for triangle in 0..room.triangles.len() as u32 {
        let [a, b, c] = room.corners(triangle);
        let middle = (a + b + c) / 3.0;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([a, b, c, middle]);
        mesh.triangles
            .extend([[0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|t: [u32; 3]| t.map(|v| v + first)));
    }
    let center = Vec3::new(0.11, 0.07, -0.05);
    mesh.append(&icosphere(3, 0.1, center));
    (mesh, center)
}

#[test]
fn hc_e06_compressed_triangles_leak() {
    let mut rng = generator(506);
    let (mesh, center) = wall_and_sphere();
    // The same watertight test on vertices rounded as obvhs stores them.
    let mut rounded = Mesh::default();
    for triangle in 0..mesh.triangles.len() as u32 {
        let [a, b, c] = mesh.corners(triangle).map(Vec3A::from);
        let first = rounded.positions.len() as u32;
        rounded.positions.extend(
            RtCompressedTriangle::new(a, b, c)
                .vertices()
                .map(Vec3::from),
        );
        rounded.triangles.push([first, first + 1, first + 2]);
    }
    let naive = Scene::new(&rounded.positions, &rounded.triangles).expect("valid indices");
    let shipped = Scene::new(&mesh.positions, &mesh.triangles).expect("valid indices");
    let walls = Mesh {
        positions: mesh.positions.clone(),
        triangles: mesh.triangles[..36].to_vec(),
    };
    let mut rays = rays_at_edges(&walls, Vec3::ZERO, 0.5, scaled_count(100_000), &mut rng);
    rays.extend(rays_at_edges(
        &mesh,
        center,
        0.07,
        scaled_count(100_000),
        &mut rng,
    ));
    bites("e06 escaped rays", escaped_count(&naive, &rays) as f64, 0.0);
    holds(
        "e06 escaped rays",
        escaped_count(&shipped, &rays) as f64,
        0.0,
    );
}
