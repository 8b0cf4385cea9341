//! Rows A14 and D11: ten kilometres from the origin.

use fusion::{Mesh, MeshConfig, Volume, VolumeConfig, extract_mesh};
use geometry::{DVec3, Pose};

use crate::rows::{bites, holds, worse};
use crate::sampling::{generator, uniform, unit_vector};
use crate::scenes::{camera, look_at, render, sphere};

const FAR: f64 = 1e4;

/// A ball fused from three sides, everything moved by `offset`.
fn ball_mesh(offset: DVec3) -> Mesh {
    let camera = camera(96);
    let config = VolumeConfig {
        voxel_size: 0.005,
        origin: offset,
        ..VolumeConfig::default()
    };
    let mut volume = Volume::new(config).expect("a usable config");
    for eye in [
        DVec3::new(0.1, 0.2, -0.6),
        DVec3::new(0.6, 0.1, 0.0),
        DVec3::new(0.0, -0.1, 0.7),
    ] {
        // The image is that of the near scene: what is tested is fusion, not this renderer.
        let near = look_at(eye, DVec3::ZERO);
        let depth = render(&camera, &near, sphere(DVec3::ZERO, 0.15));
        let far = Pose::new(near.rotation(), near.translation() + offset).expect("a pose");
        for _ in 0..3 {
            volume
                .integrate(&depth, &camera, &far)
                .expect("one value per pixel");
        }
    }
    extract_mesh(&volume, &MeshConfig::default())
}

/// Largest distance between equal vertices after the offset is taken off again, and of their normals.
fn difference(near: &Mesh, far: &Mesh, offset: DVec3) -> f64 {
    assert_eq!(near.triangles, far.triangles, "the same surface");
    let mut worst = 0.0;
    for vertex in 0..near.positions.len() {
        let moved = far.world_position(vertex) - offset;
        worst = worse(worst, (moved - near.world_position(vertex)).length());
        let turned = near.normals[vertex] - far.normals[vertex];
        worst = worse(worst, f64::from(turned.length()));
    }
    worst
}

#[test]
fn hc_a14_a_far_mesh_equals_the_near_one() {
    const TOLERANCE: f64 = 1e-6;
    // Naive: world coordinates in f32; millimetre steps become 0, 0.98 or 1.95 mm.
    let naive = (0..1000).map(|n| {
        let exact = FAR + f64::from(n) * 1e-3;
        (f64::from(exact as f32) - exact).abs()
    });
    bites("A14", naive.fold(0.0, f64::max), TOLERANCE);

    let near = ball_mesh(DVec3::ZERO);
    assert!(near.positions.len() > 1000, "vertices to compare");
    let mut worst = difference(&near, &ball_mesh(DVec3::splat(FAR)), DVec3::splat(FAR));
    let mut rng = generator(14);
    for _ in 0..4 {
        let offset = uniform(&mut rng, 0.5, 2.0) * FAR * unit_vector(&mut rng);
        worst = worse(worst, difference(&near, &ball_mesh(offset), offset));
    }
    holds("A14", worst, TOLERANCE);
}

#[test]
fn hc_d11_voxels_are_counted_from_an_origin_in_f64() {
    const TOLERANCE: f64 = 1e-5;
    const VOXEL: f32 = 0.004;
    // Naive: the voxel index of a far point from f32.
    let naive = (0..1000).map(|n| {
        let x = FAR + f64::from(n) * 1.7e-3;
        let index = f64::from(x as f32 / VOXEL);
        (index - x / f64::from(VOXEL)).abs() * f64::from(VOXEL)
    });
    bites("D11", naive.fold(0.0, f64::max), TOLERANCE);

    let mut worst = 0.0;
    let near = ball_mesh(DVec3::ZERO);
    for axis in [DVec3::X, DVec3::Y, DVec3::NEG_Z] {
        worst = worse(worst, difference(&near, &ball_mesh(FAR * axis), FAR * axis));
    }
    holds("D11", worst, TOLERANCE);
}
