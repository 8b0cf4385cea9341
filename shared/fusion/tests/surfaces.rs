//! Whole scans: analytic surfaces, invariances, and input that holds nothing.

#[path = "hard/sampling.rs"]
mod sampling;
#[path = "hard/scenes.rs"]
mod scenes;

use fusion::{
    FusionError, IntegrateStats, Level, Mesh, MeshConfig, Volume, VolumeConfig, extract_mesh,
    normal_noise, rounds_for_voxel, smooth_normals,
};
use geometry::{DMat3, DVec3, Distortion, Intrinsics, Pose};

use sampling::{generator, normal, unit_vector};
use scenes::{camera, cuboid, look_at, plane, render, sphere};

const RADIUS: f64 = 0.1;

/// Eyes about a thing at the origin.
const EYES: [[f64; 3]; 4] = [
    [0.0, 0.1, -0.5],
    [0.5, 0.0, 0.1],
    [-0.1, -0.4, 0.4],
    [-0.4, 0.3, 0.0],
];

/// Fuses what `hit` shows to the usual eyes, all moved by `world_from_scene`.
fn scan(
    volume: &mut Volume,
    camera: &Intrinsics,
    world_from_scene: &Pose,
    hit: impl Fn(DVec3, DVec3) -> Option<f64>,
) {
    for eye in EYES {
        let scene_from_camera = look_at(DVec3::from_array(eye), DVec3::ZERO);
        let depth = render(camera, &scene_from_camera, &hit);
        let pose = *world_from_scene * scene_from_camera;
        for _ in 0..2 {
            volume
                .integrate(&depth, camera, &pose)
                .expect("one value per pixel");
        }
    }
}

fn volume(voxel_size: f32) -> Volume {
    Volume::new(VolumeConfig {
        voxel_size,
        ..VolumeConfig::default()
    })
    .expect("a usable config")
}

fn mesh_of(volume: &Volume) -> Mesh {
    extract_mesh(volume, &MeshConfig::default())
}

#[test]
fn a_plane_is_where_it_was_seen() {
    // Nearest-pixel depth is off by up to half a pixel (0.8 to 1.2 mm) times the slope against the ray.
    const MEAN_TOLERANCE: f64 = 5e-4;
    const WORST_TOLERANCE: f64 = 2e-3;
    const NORMAL_TOLERANCE_DEG: f64 = 2.0;
    let mut rng = generator(1);
    for _ in 0..4 {
        let toward = unit_vector(&mut rng);
        let pose = look_at(0.5 * toward, DVec3::ZERO);
        let across = toward.cross(unit_vector(&mut rng)).normalize();
        let facing = (toward + across * 30.0_f64.to_radians().tan()).normalize();
        let camera = camera(320);
        let depth = render(&camera, &pose, plane(DVec3::ZERO, facing));
        let mut volume = volume(0.004);
        volume
            .integrate(&depth, &camera, &pose)
            .expect("one value per pixel");
        let mesh = mesh_of(&volume);
        assert!(mesh.positions.len() > 5000);
        let errors = || {
            mesh.positions
                .iter()
                .map(|p| p.as_dvec3().dot(facing).abs())
        };
        let mean_error = errors().sum::<f64>() / mesh.positions.len() as f64;
        assert!(mean_error < MEAN_TOLERANCE, "mean error {mean_error} m");
        let worst = errors().fold(0.0, f64::max);
        assert!(worst < WORST_TOLERANCE, "worst error {worst} m");
        assert!(mesh.normals.iter().all(|n| n.as_dvec3().dot(facing) > 0.7));
        let mean = mesh
            .normals
            .iter()
            .map(|n| n.as_dvec3())
            .sum::<DVec3>()
            .normalize();
        assert!(mean.dot(facing) > NORMAL_TOLERANCE_DEG.to_radians().cos());
    }
}

#[test]
fn a_sphere_has_its_radius_and_its_normals() {
    let mut volume = volume(0.004);
    scan(
        &mut volume,
        &camera(320),
        &Pose::IDENTITY,
        sphere(DVec3::ZERO, RADIUS),
    );
    let mut mesh = mesh_of(&volume);
    smooth_normals(&mut mesh, rounds_for_voxel(0.004));
    let errors: Vec<f64> = mesh
        .positions
        .iter()
        .map(|p| f64::from(p.length()) - RADIUS)
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    // Projective distance is too long where the surface is seen at a slant, never too short.
    assert!(mean.abs() < 5e-4, "mean radius error {mean} m");
    let mut angles: Vec<f64> = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .map(|(p, n)| {
            f64::from(p.normalize().cross(*n).length())
                .asin()
                .to_degrees()
        })
        .collect();
    angles.sort_by(f64::total_cmp);
    let median = angles[angles.len() / 2];
    // One frame's pixel steps, 1 mm on a voxel of 4 mm, over four rounds.
    assert!(
        median < 3.5,
        "median angle to the true normal {median} degrees"
    );
    let outward = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .all(|(p, n)| p.dot(*n) > 0.0);
    assert!(outward, "normals point to free space");
}

#[test]
fn many_noisy_frames_average_out() {
    const FRAMES: usize = 40;
    const NOISE: f64 = 0.004;
    let camera = camera(160);
    let pose = look_at(DVec3::new(0.0, 0.0, -0.6), DVec3::ZERO);
    let exact = render(&camera, &pose, plane(DVec3::ZERO, DVec3::NEG_Z));
    let mut rng = generator(2);
    let mut volume = volume(0.004);
    for _ in 0..FRAMES {
        let noisy: Vec<f32> = exact
            .iter()
            .map(|&d| (f64::from(d) + NOISE * normal(&mut rng)) as f32)
            .collect();
        volume
            .integrate(&noisy, &camera, &pose)
            .expect("one value per pixel");
    }
    let mesh = mesh_of(&volume);
    let squares = mesh
        .positions
        .iter()
        .map(|p| f64::from(p.z).powi(2))
        .sum::<f64>();
    let rms = (squares / mesh.positions.len() as f64).sqrt();
    // 4 mm / √40 is 0.63 mm; nothing is gained from neighbours, and nothing may be lost to the two-sided rule.
    assert!(rms < 1.3 * NOISE / (FRAMES as f64).sqrt(), "rms {rms} m");
}

/// Everything that a volume and its mesh hold, as bits.
fn bits(volume: &Volume, mesh: &Mesh) -> Vec<u32> {
    let vertices = mesh
        .positions
        .iter()
        .chain(&mesh.normals)
        .flat_map(geometry::Vec3::to_array);
    let mut bits: Vec<u32> = vertices
        .chain(mesh.weights.iter().copied())
        .map(f32::to_bits)
        .collect();
    bits.extend(mesh.triangles.iter().flatten());
    for n in 0..64_i32.pow(3) {
        let voxel = volume.voxel([n % 64 - 32, n / 64 % 64 - 32, n / 4096 - 32]);
        bits.extend(voxel.map_or([0, 0], |v| [v.tsdf.to_bits(), v.weight.to_bits()]));
    }
    bits
}

#[test]
fn threads_and_instructions_do_not_change_a_bit() {
    let camera = camera(128);
    let run = |threads: usize, level: Level| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| {
            let config = VolumeConfig {
                voxel_size: 0.004,
                ..VolumeConfig::default()
            };
            let mut volume = Volume::with_level(config, level).expect("a usable config");
            scan(
                &mut volume,
                &camera,
                &Pose::IDENTITY,
                sphere(DVec3::ZERO, RADIUS),
            );
            let mut mesh = mesh_of(&volume);
            smooth_normals(&mut mesh, 3);
            bits(&volume, &mesh)
        })
    };
    let reference = run(1, Level::Scalar);
    for (threads, level) in [
        (2, Level::Scalar),
        (1, Level::Avx2),
        (2, Level::Avx2),
        (3, Level::Avx2),
    ] {
        assert!(
            run(threads, level) == reference,
            "{threads} threads, {level:?}"
        );
    }
}

#[test]
fn a_move_by_whole_blocks_moves_the_mesh() {
    let camera = camera(128);
    let fuse = |shift: DVec3| {
        // A power of two, so that the shift is exact in every coordinate.
        let mut volume = volume(1.0 / 256.0);
        scan(
            &mut volume,
            &camera,
            &Pose::from_translation(shift),
            sphere(DVec3::ZERO, RADIUS),
        );
        mesh_of(&volume)
    };
    let (still, shift) = (fuse(DVec3::ZERO), DVec3::new(1.0, -2.0, 0.5));
    let moved = fuse(shift);
    assert_eq!(still.triangles, moved.triangles);
    for vertex in 0..still.positions.len() {
        let back = moved.world_position(vertex) - shift;
        assert!((back - still.world_position(vertex)).length() < 1e-6);
    }
}

#[test]
fn a_turned_scene_has_the_same_surface() {
    let camera = camera(320);
    let turn = Pose::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
    // No multiple of a voxel.
    const HALF: f64 = 0.0813;
    let shares = [Pose::IDENTITY, turn].map(|world_from_scene| {
        let mut volume = volume(0.004);
        let cube = cuboid(DMat3::IDENTITY, DVec3::splat(HALF));
        scan(&mut volume, &camera, &world_from_scene, cube);
        let mesh = mesh_of(&volume);
        let far = mesh.positions.iter().filter(|position| {
            let place = world_from_scene
                .inverse()
                .transform_point(position.as_dvec3());
            (place.abs().max_element() - HALF).abs() > 0.002
        });
        far.count() as f64 / mesh.positions.len() as f64
    });
    println!("share of vertices 2 mm off the cube, before and after the turn: {shares:?}");
    // Faces seen at a grazing angle and edges are off in either attitude; edges more when they follow the grid.
    assert!(shares.iter().all(|&share| share < 0.15));
}

#[test]
fn a_distorted_camera_sees_the_same_plane() {
    let distortion = Distortion {
        k1: 0.12,
        k2: -0.05,
        p1: 1e-3,
        p2: -1e-3,
        k3: 0.0,
    };
    let ideal = camera(160);
    let (f, c) = (ideal.focal(), ideal.center());
    let camera =
        Intrinsics::new(160, 120, f.x, f.y, c.x, c.y, distortion).expect("a usable camera");
    let wall = plane(
        DVec3::new(0.0, 0.0, 0.6),
        DVec3::new(0.3, 0.1, -1.0).normalize(),
    );
    let depth: Vec<f32> = (0..160 * 120)
        .map(|n| {
            let pixel = geometry::DVec2::new(f64::from(n % 160), f64::from(n / 160));
            let ray = camera.camera_from_pixel(pixel).expect("inside the fold");
            wall(DVec3::ZERO, ray / ray.z).unwrap_or(0.0) as f32
        })
        .collect();
    let mut volume = volume(0.004);
    for _ in 0..2 {
        volume
            .integrate(&depth, &camera, &Pose::IDENTITY)
            .expect("one value per pixel");
    }
    let mesh = mesh_of(&volume);
    assert!(mesh.positions.len() > 1000);
    let normal = DVec3::new(0.3, 0.1, -1.0).normalize();
    let worst = mesh
        .positions
        .iter()
        .map(|p| (p.as_dvec3() - DVec3::new(0.0, 0.0, 0.6)).dot(normal).abs())
        .fold(0.0, f64::max);
    // Two roundings to a pixel of 3.7 mm on a slope of 0.32; ignoring the lens would be off by 20 mm.
    assert!(worst < 3e-3, "{worst} m");
}

#[test]
fn images_without_measurement_leave_nothing() {
    let camera = camera(64);
    let mut volume = volume(0.004);
    for bad in [
        0.0,
        -0.0,
        -1.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        1e-40,
        65.535,
        f32::MAX,
    ] {
        let stats = volume.integrate(&[bad; 64 * 48], &camera, &Pose::IDENTITY);
        assert_eq!(stats, Ok(IntegrateStats::default()), "depth {bad}");
    }
    assert_eq!((volume.block_count(), volume.refused_count()), (0, 0));
    assert_eq!(mesh_of(&volume), Mesh::default());
}

#[test]
fn images_of_the_wrong_size_are_refused() {
    let (camera, mut volume) = (camera(64), volume(0.004));
    for got in [0, 1, 64 * 48 - 1, 64 * 48 + 1] {
        let result = volume.integrate(&vec![1.0; got], &camera, &Pose::IDENTITY);
        let expected = FusionError::DepthSize {
            width: 64,
            height: 48,
            expected: 64 * 48,
            got,
        };
        assert_eq!(result, Err(expected));
    }
    assert_eq!(volume.block_count(), 0);
}

#[test]
fn the_smallest_images_are_fused() {
    for (width, height) in [(1, 1), (1, 9), (9, 1), (17, 2)] {
        let f = f64::from(width);
        let camera = Intrinsics::pinhole(width, height, f, f, 0.0, 0.0).expect("a usable camera");
        let depth = vec![0.5; (width * height) as usize];
        let mut volume = volume(0.02);
        for _ in 0..3 {
            volume
                .integrate(&depth, &camera, &Pose::IDENTITY)
                .expect("one value per pixel");
        }
        assert!(volume.block_count() > 0, "{width} x {height}");
    }
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let base = VolumeConfig::default;
    let mut refused = Vec::new();
    for bad in [f32::NAN, 0.0, -1.0, f32::INFINITY, f32::MAX, 1e-30] {
        refused.push(VolumeConfig {
            voxel_size: bad,
            ..base()
        });
        refused.push(VolumeConfig {
            truncation_voxels: bad,
            ..base()
        });
        refused.push(VolumeConfig {
            reference_depth: bad,
            ..base()
        });
        refused.push(VolumeConfig {
            max_depth: bad,
            ..base()
        });
    }
    for bad in [f32::NAN, 0.0, -1.0, f32::INFINITY, f32::MAX] {
        refused.push(VolumeConfig {
            weight_cap: bad,
            ..base()
        });
    }
    for bad in [f32::NAN, -1.0, f32::INFINITY] {
        refused.push(VolumeConfig {
            depth_step: bad,
            ..base()
        });
        refused.push(VolumeConfig {
            min_depth: bad,
            ..base()
        });
    }
    refused.push(VolumeConfig {
        origin: DVec3::new(0.0, f64::NAN, 0.0),
        ..base()
    });
    for config in refused {
        assert!(Volume::new(config.clone()).is_err(), "{config:?}");
    }
    // No byte at all is a budget too.
    let mut volume = Volume::new(VolumeConfig {
        memory_limit_bytes: 0,
        ..base()
    })
    .expect("allowed");
    let stats = volume.integrate(&[1.0; 64 * 48], &camera(64), &Pose::IDENTITY);
    let stats = stats.expect("one value per pixel");
    assert!(stats.blocks_refused > 0 && stats.limit_reached);
    assert_eq!(volume.block_count(), 0);
}

#[test]
fn the_reported_normal_noise_is_the_noise() {
    const SIGMA: f64 = 0.05;
    let camera = camera(320);
    let pose = look_at(DVec3::new(0.0, 0.0, -0.5), DVec3::ZERO);
    let depth = render(&camera, &pose, plane(DVec3::ZERO, DVec3::NEG_Z));
    let mut volume = volume(0.004);
    volume
        .integrate(&depth, &camera, &pose)
        .expect("one value per pixel");
    let mut mesh = mesh_of(&volume);
    let mut rng = generator(3);
    for vertex in &mut mesh.normals {
        let tilt = DVec3::new(SIGMA * normal(&mut rng), SIGMA * normal(&mut rng), -1.0);
        *vertex = tilt.normalize().as_vec3();
    }
    let raw = mesh.normals.clone();
    smooth_normals(&mut mesh, 16);
    let noise = normal_noise(&mesh, &raw);
    assert!(
        (f64::from(noise.median) / SIGMA - 1.0).abs() < 0.1,
        "σ {}",
        noise.median
    );
    let left: f64 = mesh.normals.iter().map(|n| f64::from(n.x).powi(2)).sum();
    let left = (left / mesh.normals.len() as f64).sqrt();
    assert!(left < 0.3 * SIGMA, "smoothing leaves {left}");
    assert_eq!([0.002, 0.004, 0.008].map(rounds_for_voxel), [16, 4, 1]);
}
