//! Rows D06 and D14: where the band ends, and where observation ends.

use std::collections::HashMap;

use fusion::{FusionError, Mesh, MeshConfig, Volume, VolumeConfig, extract_mesh};
use geometry::{DVec3, Intrinsics, Pose};

use crate::rows::{bites, holds};
use crate::sampling::{generator, uniform, unit_vector};
use crate::scenes::{camera, look_at, plane, render, sphere};

const VOXEL: f64 = 0.004;

/// Cells that a plane through a cube of voxels crosses but that lack an observed corner, because the corner
/// lies more than `truncation` behind the plane.
fn naive_holes(normal: DVec3, truncation: f64) -> usize {
    let distance = |v: [i32; 3]| DVec3::from_array(v.map(f64::from)).dot(normal) * VOXEL;
    let mut holes = 0;
    for cell in 0..16_i32.pow(3) {
        let at = [cell % 16 - 8, cell / 16 % 16 - 8, cell / 256 - 8];
        let corner = |n: i32| distance([at[0] + (n & 1), at[1] + (n >> 1 & 1), at[2] + (n >> 2)]);
        let is_crossed = (0..8).any(|n| corner(n) < 0.0) && (0..8).any(|n| corner(n) >= 0.0);
        let is_complete = (0..8).all(|n| corner(n) >= -truncation);
        holes += usize::from(is_crossed && !is_complete);
    }
    holes
}

/// Border edges of the mesh that lie well inside the image.
fn holes(mesh: &Mesh, camera: &Intrinsics, pose: &Pose) -> usize {
    let mut uses = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *uses.entry((from.min(to), from.max(to))).or_insert(0) += 1;
        }
    }
    let is_inside = |vertex: u32| {
        let point = pose
            .inverse()
            .transform_point(mesh.world_position(vertex as usize));
        // The frontier wavers by a few voxels.
        let margin = 6.0 * VOXEL / point.z * camera.focal().x;
        let (width, height) = (f64::from(camera.width()), f64::from(camera.height()));
        camera.pixel_from_camera(point).is_some_and(|p| {
            p.min_element() > margin && p.x < width - margin && p.y < height - margin
        })
    };
    uses.into_iter()
        .filter(|&((a, b), count)| count == 1 && is_inside(a) && is_inside(b))
        .count()
}

#[test]
fn hc_d06_the_band_has_no_holes() {
    let normal = DVec3::new(1.0, 2.0, 3.0).normalize();
    bites("D06", naive_holes(normal, VOXEL) as f64, 0.0);

    // Too small a truncation is refused, not obeyed.
    for truncation_voxels in [1.0, 1.8, 3.99, f32::NAN] {
        let config = VolumeConfig {
            truncation_voxels,
            ..VolumeConfig::default()
        };
        assert!(matches!(
            Volume::new(config),
            Err(FusionError::Truncation { .. })
        ));
    }
    // Twice the truncation beyond the thinnest part is said by the config.
    let config = VolumeConfig::default();
    assert!(config.sides_interact(1.9 * config.truncation()));
    assert!(!config.sides_interact(2.1 * config.truncation()));

    // Pixels smaller than voxels: a coarser image has gaps of its own at a slant.
    let camera = camera(320);
    let mut rng = generator(6);
    let (mut found, mut vertices) = (0, 0);
    for scene in 0..24 {
        // In every attitude to the voxels. Distance is measured along the view, so a slant of θ shortens the
        // band by cos θ: up to 60 degrees at the default, 45 at the least.
        let pose = look_at(0.5 * unit_vector(&mut rng), DVec3::ZERO);
        let forward = pose.transform_vector(DVec3::Z);
        let (truncation_voxels, steepest) = if scene % 2 == 0 {
            (4.0, 45.0)
        } else {
            (6.0, 60.0)
        };
        let slant = uniform(&mut rng, 0.0, steepest).to_radians();
        let across = forward.cross(unit_vector(&mut rng)).normalize();
        let wall = plane(DVec3::ZERO, slant.sin() * across - slant.cos() * forward);
        let depth: Vec<f32> = render(&camera, &pose, wall);
        let mut volume = Volume::new(VolumeConfig {
            truncation_voxels,
            max_depth: 1.0,
            ..VolumeConfig::default()
        })
        .expect("a usable config");
        for _ in 0..2 {
            volume
                .integrate(&depth, &camera, &pose)
                .expect("one value per pixel");
        }
        let mesh = extract_mesh(&volume, &MeshConfig { min_weight: 1.0 });
        let near: Vec<f32> = depth
            .iter()
            .map(|&d| if d < 1.0 { d } else { 0.0 })
            .collect();
        let is_whole = near.iter().all(|&d| d > 0.0);
        vertices += mesh.positions.len();
        found += if is_whole {
            holes(&mesh, &camera, &pose)
        } else {
            0
        };
    }
    assert!(vertices > 1000, "{vertices} vertices");
    holds("D06", found as f64, 0.0);
}

#[test]
fn hc_d14_nothing_is_built_beyond_the_frontier() {
    const RADIUS: f64 = 0.12;
    // The farthest that a vertex may lie behind the visible cap, in voxels.
    const TOLERANCE: f64 = 2.0;
    // Naive: along the axis through the ball an unobserved voxel reads as free, so the band's end is a wall.
    let field = |depth_in_ball: f64| {
        if depth_in_ball > 6.0 * VOXEL {
            1.0
        } else {
            (-depth_in_ball / (6.0 * VOXEL)).min(1.0)
        }
    };
    let wall = (0..60)
        .map(|n| f64::from(n) * VOXEL)
        .find(|&d| field(d) < 0.0 && field(d + VOXEL) >= 0.0)
        .unwrap_or(0.0);
    // The cap ends at the horizon, R²/d from the centre; the wall is behind it where the ball is seen last.
    let naive_beyond = wall / VOXEL;
    bites("D14", naive_beyond, TOLERANCE);

    let camera = camera(160);
    let mut rng = generator(114);
    let (mut worst, mut vertices) = (0.0_f64, 0);
    for _ in 0..6 {
        let toward = unit_vector(&mut rng);
        let distance = uniform(&mut rng, 0.45, 0.6);
        let pose = look_at(distance * toward, DVec3::ZERO);
        let depth = render(&camera, &pose, sphere(DVec3::ZERO, RADIUS));
        let mut volume = Volume::new(VolumeConfig::default()).expect("a usable config");
        for _ in 0..3 {
            volume
                .integrate(&depth, &camera, &pose)
                .expect("one value per pixel");
        }
        let mesh = extract_mesh(&volume, &MeshConfig::default());
        vertices += mesh.positions.len();
        for position in &mesh.positions {
            let point = position.as_dvec3();
            let beyond = RADIUS * RADIUS / distance - point.dot(toward);
            worst = worst.max(beyond / VOXEL);
        }
    }
    assert!(vertices > 1000, "{vertices} vertices");
    holds("D14", worst, TOLERANCE);
}
