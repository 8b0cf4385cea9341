use geometry::{DVec3, Distortion};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;

fn camera() -> Intrinsics {
    Intrinsics::pinhole(160, 120, 140.0, 141.0, 79.3, 60.1).expect("a camera")
}

/// Small triangles before a wall, all in front of the camera.
fn mesh() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut rng = Pcg64::seed_from_u64(7);
    let mut positions = vec![
        Vec3::new(-4.0, -4.0, 3.0),
        Vec3::new(4.0, -4.0, 3.5),
        Vec3::new(4.0, 4.0, 3.0),
        Vec3::new(-4.0, 4.0, 2.5),
    ];
    let mut triangles = vec![[0, 1, 2], [0, 2, 3]];
    for index in 0..300 {
        let mut random = || rng.random::<f32>() * 2.0 - 1.0;
        let center = Vec3::new(random(), random(), 1.5 + 0.5 * random());
        for _ in 0..3 {
            positions.push(center + Vec3::new(random(), random(), random()) * 0.15);
        }
        triangles.push([4 + 3 * index, 5 + 3 * index, 6 + 3 * index]);
    }
    (positions, triangles)
}

fn pose() -> Pose {
    Pose::from_translation(DVec3::new(0.1, -0.05, -0.2))
        * Pose::from_axis_angle(DVec3::new(1.0, 2.0, 3.0), 0.1)
}

#[test]
fn rasterising_and_tracing_agree() {
    let (positions, triangles) = mesh();
    let scene = Scene::new(&positions, &triangles).expect("valid indices");
    let drawn = visibility_buffer(&scene, &positions, &triangles, &camera(), &pose());
    let traced = traced(&scene, &camera(), &pose());
    let mut different = 0;
    for index in 0..drawn.triangle.len() {
        if drawn.triangle[index] != traced.triangle[index] {
            different += 1;
            continue;
        }
        assert!((drawn.depth[index] - traced.depth[index]).abs() < 1e-5);
        assert!((drawn.u[index] - traced.u[index]).abs() < 1e-3);
        assert!((drawn.v[index] - traced.v[index]).abs() < 1e-3);
    }
    assert!(
        different * 1000 < drawn.triangle.len(),
        "{different} pixels differ"
    );
}

#[test]
fn depth_is_along_the_axis_and_weights_are_perspective_correct() {
    let (positions, triangles) = mesh();
    let buffer = rasterise(&positions, &triangles, &camera(), &pose());
    let camera_from_mesh = pose().inverse();
    for y in 0..buffer.height {
        for x in 0..buffer.width {
            let index = (y * buffer.width + x) as usize;
            let triangle = buffer.triangle[index];
            assert_ne!(triangle, NO_TRIANGLE, "the wall fills the view");
            let [a, b, c] = triangles[triangle as usize].map(|v| positions[v as usize]);
            let (u, v) = (buffer.u[index], buffer.v[index]);
            let point =
                camera_from_mesh.transform_point((a * (1.0 - u - v) + b * u + c * v).as_dvec3());
            let pixel = camera()
                .pixel_from_camera(point)
                .expect("in front of the camera");
            assert!((pixel - DVec2::new(f64::from(x), f64::from(y))).length() < 0.01);
            assert!((point.z - f64::from(buffer.depth[index])).abs() < 1e-5);
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let (positions, triangles) = mesh();
    let scene = Scene::new(&positions, &triangles).expect("valid indices");
    let with_threads = |count| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .expect("a pool");
        pool.install(|| visibility_buffer(&scene, &positions, &triangles, &camera(), &pose()))
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn a_distorted_camera_sees_where_it_projects() {
    let (positions, triangles) = mesh();
    let distortion = Distortion {
        k1: -0.2,
        k2: 0.05,
        p1: 1e-3,
        p2: -1e-3,
        k3: 0.0,
    };
    let camera = Intrinsics::new(160, 120, 140.0, 140.0, 79.5, 59.5, distortion).expect("a camera");
    let scene = Scene::new(&positions, &triangles).expect("valid indices");
    let buffer = visibility_buffer(&scene, &positions, &triangles, &camera, &pose());
    assert_eq!(buffer, rasterise(&positions, &triangles, &camera, &pose()));
    for index in (0..buffer.triangle.len()).step_by(7) {
        let [a, b, c] = triangles[buffer.triangle[index] as usize].map(|v| positions[v as usize]);
        let (u, v) = (buffer.u[index], buffer.v[index]);
        let point = pose()
            .inverse()
            .transform_point((a * (1.0 - u - v) + b * u + c * v).as_dvec3());
        let pixel = camera
            .pixel_from_camera(point)
            .expect("in front of the camera");
        let expected = DVec2::new((index % 160) as f64, (index / 160) as f64);
        assert!((pixel - expected).length() < 0.01, "{pixel} {expected}");
    }
}

#[test]
fn nothing_is_seen_of_an_empty_or_broken_mesh() {
    let nan = [Vec3::NAN, Vec3::X, Vec3::Y];
    for (positions, triangles) in [
        (&[][..], &[][..]),
        (&nan[..], &[[0, 1, 2]][..]),
        (&nan[..], &[[7, 8, 9]][..]),
        (&nan[..], &[[1, 1, 1]][..]),
    ] {
        let buffer = rasterise(positions, triangles, &camera(), &pose());
        assert!(buffer.triangle.iter().all(|&t| t == NO_TRIANGLE));
        assert!(buffer.depth.iter().all(|&z| z == 0.0));
    }
}
