//! Hard cases E11, E12: rasterised primaries against rays.

use geometry::{DVec2, DVec3, Intrinsics, Pose};
use glam::Vec3;
use rand_pcg::Pcg64;
use raytrace::{NO_TRIANGLE, Ray, Scene, VisibilityBuffer, rasterise, visibility_buffer};

use crate::meshes::{Mesh, icosphere};
use crate::rows::{bites, generator, holds, uniform, unit_vector, worse};

fn camera(width: u32, height: u32, shift: f64) -> Intrinsics {
    let (w, h) = (f64::from(width), f64::from(height));
    Intrinsics::pinhole(
        width,
        height,
        0.9 * w,
        0.9 * w,
        0.5 * w + shift,
        0.5 * h + shift,
    )
    .expect("a camera")
}

/// The ray of a pixel in camera axes, z = 1.
fn pixel_ray(camera: &Intrinsics, index: usize) -> DVec3 {
    let width = camera.width() as usize;
    let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
    camera.camera_from_pixel(pixel).expect("no distortion")
}

/// Depth at the centre pixel by dividing each corner by its z and interpolating on the image.
fn naive_center_depth(camera: &Intrinsics, corners: [DVec3; 3]) -> f64 {
    let pixel = |p: DVec3| DVec2::new(p.x / p.z, p.y / p.z) * camera.focal() + camera.center();
    let [a, b, c] = corners.map(pixel);
    let center = DVec2::new(f64::from(camera.width()), f64::from(camera.height())) * 0.5;
    let area = (b - a).perp_dot(c - a);
    let (u, v) = (
        (center - a).perp_dot(c - a) / area,
        (b - a).perp_dot(center - a) / area,
    );
    let inverse = (1.0 - u - v) / corners[0].z + u / corners[1].z + v / corners[2].z;
    1.0 / inverse
}

/// A triangle with corners before and behind the camera.
fn crossing_triangle(rng: &mut Pcg64) -> [Vec3; 3] {
    let mut corner = |low: f64, high: f64| {
        Vec3::new(
            uniform(rng, -2.0, 2.0) as f32,
            uniform(rng, -2.0, 2.0) as f32,
            uniform(rng, low, high) as f32,
        )
    };
    [corner(0.5, 3.0), corner(-3.0, 1.0), corner(-2.0, -0.01)]
}

#[test]
fn hc_e11_triangles_through_the_camera_plane() {
    let tolerance = 1e-5;
    let camera = camera(32, 24, 0.0);
    // One corner exactly on the plane z = 0: 1/0 and 0 · ∞.
    let listed = [
        DVec3::new(-1.0, 1.0, 2.0),
        DVec3::new(1.0, 1.0, 2.0),
        DVec3::new(0.0, -1.0, 0.0),
    ];
    // The centre ray meets the plane y = z − 1 at z = 1.
    bites(
        "e11 depth",
        (naive_center_depth(&camera, listed) - 1.0).abs(),
        tolerance,
    );

    let mut rng = generator(511);
    let (mut worst, mut traced_worst, mut compared, mut unlike) = (0.0, 0.0, 0_usize, 0_usize);
    for round in 0..3000 {
        let corners = if round == 0 {
            listed.map(DVec3::as_vec3)
        } else {
            crossing_triangle(&mut rng)
        };
        let scene = Scene::new(&corners, &[[0, 1, 2]]).expect("valid indices");
        let buffer = rasterise(&corners, &[[0, 1, 2]], &camera, &Pose::IDENTITY);
        for index in 0..buffer.triangle.len() {
            let ray = pixel_ray(&camera, index);
            let hit = scene.closest(&Ray {
                least: 0.01,
                ..Ray::new(Vec3::ZERO, ray.as_vec3())
            });
            let drawn = [buffer.depth[index], buffer.u[index], buffer.v[index]];
            let is_drawn = buffer.triangle[index] != NO_TRIANGLE;
            assert!(drawn.iter().all(|x| x.is_finite()) && (!is_drawn || drawn[0] >= 0.01));
            let (Some(hit), true) = (hit, is_drawn) else {
                unlike += usize::from(hit.is_some() != is_drawn);
                continue;
            };
            compared += 1;
            let (expected, cosine) = met(corners.map(Vec3::as_dvec3), ray);
            let inside =
                expected[1] >= 0.0 && expected[2] >= 0.0 && expected[1] + expected[2] <= 1.0;
            if inside {
                worst = worse(worst, difference(drawn, expected));
            }
            // f32 keeps depth to ulps of the farthest corner (3 m), less at grazing angles.
            let off = (f64::from(hit.t) - expected[0]).abs();
            traced_worst = worse(traced_worst, off * cosine);
        }
    }
    println!("e11: {compared} pixels compared");
    // Pixels at an edge, 1/256 pixel wide.
    holds(
        "e11 share of pixels unlike",
        unlike as f64 / compared as f64,
        1e-3,
    );
    holds("e11 drawn depth and weights", worst, tolerance);
    holds(
        "e11 traced depth by cosine, metres",
        traced_worst,
        tolerance,
    );
}

/// Depth and weights where a ray from zero meets a plane, in f64, and the cosine of incidence.
fn met([a, b, c]: [DVec3; 3], ray: DVec3) -> ([f64; 3], f64) {
    let (e1, e2) = (b - a, c - a);
    let determinant = e1.dot(ray.cross(e2));
    let u = -a.dot(ray.cross(e2)) / determinant;
    let v = ray.dot((-a).cross(e1)) / determinant;
    let t = e2.dot((-a).cross(e1)) / determinant;
    let cosine = e1.cross(e2).normalize().dot(ray.normalize()).abs();
    ([t, u, v], cosine)
}

/// Largest difference of depth (relative) and weights.
fn difference(found: [f32; 3], expected: [f64; 3]) -> f64 {
    let relative = (f64::from(found[0]) - expected[0]) / expected[0];
    [
        relative,
        f64::from(found[1]) - expected[1],
        f64::from(found[2]) - expected[2],
    ]
    .into_iter()
    .map(f64::abs)
    .fold(0.0, worse)
}

/// A ball before a wall.
fn ball_and_wall() -> Mesh {
    let mut mesh = icosphere(4, 0.25, Vec3::new(0.05, 0.02, 1.2));
    mesh.append(&Mesh {
        positions: vec![
            Vec3::new(-9.0, -9.0, 2.0),
            Vec3::new(9.0, -9.0, 2.0),
            Vec3::new(0.0, 12.0, 2.2),
        ],
        triangles: vec![[0, 1, 2]],
    });
    mesh
}

/// Share of pixels whose triangle differs from the traced one, and how many of them are neither at a jump in
/// depth nor on an edge that both triangles share.
fn disagreement(
    buffer: &VisibilityBuffer,
    scene: &Scene,
    camera: &Intrinsics,
    mesh_from_camera: &Pose,
) -> (f64, usize) {
    let origin = mesh_from_camera.translation().as_vec3();
    let traced: Vec<(u32, f32)> = (0..buffer.triangle.len())
        .map(|index| {
            let direction = mesh_from_camera
                .transform_vector(pixel_ray(camera, index))
                .as_vec3();
            scene
                .closest(&Ray::new(origin, direction))
                .map_or((NO_TRIANGLE, 0.0), |hit| (hit.triangle, hit.t))
        })
        .collect();
    let (width, height) = (i64::from(camera.width()), i64::from(camera.height()));
    let is_jump = |index: usize| {
        let (x, y) = (index as i64 % width, index as i64 / width);
        let depth = traced[index].1;
        (-1..=1).any(|dy| {
            (-1..=1).any(|dx| {
                let (x, y) = ((x + dx).clamp(0, width - 1), (y + dy).clamp(0, height - 1));
                (traced[(y * width + x) as usize].1 - depth).abs() > 0.02 * depth
            })
        })
    };
    let unlike: Vec<usize> = (0..traced.len())
        .filter(|&index| buffer.triangle[index] != traced[index].0)
        .collect();
    let unexplained = unlike
        .iter()
        .filter(|&&index| (buffer.depth[index] - traced[index].1).abs() > 1e-5 && !is_jump(index))
        .count();
    (unlike.len() as f64 / traced.len() as f64, unexplained)
}

#[test]
fn hc_e12_raster_and_rays_agree() {
    let mesh = ball_and_wall();
    let scene = Scene::new(&mesh.positions, &mesh.triangles).expect("valid indices");
    let here = camera(160, 120, 0.0);
    // The other convention of pixel centres: half a pixel.
    let naive = rasterise(
        &mesh.positions,
        &mesh.triangles,
        &camera(160, 120, 0.5),
        &Pose::IDENTITY,
    );
    bites(
        "e12 share unlike",
        disagreement(&naive, &scene, &here, &Pose::IDENTITY).0,
        1e-3,
    );

    let mut rng = generator(512);
    let (mut worst, mut unexplained) = (0.0_f64, 0);
    for round in 0..12 {
        let pose = if round == 0 {
            Pose::IDENTITY
        } else {
            Pose::from_translation(unit_vector(&mut rng).as_dvec3() * 0.3)
                * Pose::from_axis_angle(
                    unit_vector(&mut rng).as_dvec3(),
                    uniform(&mut rng, 0.0, 0.3),
                )
        };
        let buffer = visibility_buffer(&scene, &mesh.positions, &mesh.triangles, &here, &pose);
        let (share, odd) = disagreement(&buffer, &scene, &here, &pose);
        worst = worst.max(share);
        unexplained += odd;
    }
    holds("e12 share unlike", worst, 1e-3);
    holds("e12 unlike away from silhouettes", unexplained as f64, 0.0);
}
