//! Row D07: a plate of 5 mm, seen from both sides.

use fusion::{Mesh, MeshConfig, Volume, VolumeConfig, extract_mesh};
use geometry::{DMat3, DVec3};

use crate::rows::{bites, holds, worse};
use crate::sampling::{generator, unit_vector};
use crate::scenes::{camera, cuboid, look_at, render};

const HALF_THICKNESS: f64 = 0.0025;
/// Half extents of the middle part that is measured, away from the rim.
const MEASURED: f64 = 0.05;

/// Thickness that the plain average of front and back observations leaves, on a line of voxels.
fn naive_thickness(voxel: f64, truncation: f64) -> f64 {
    let average = |s: f64| {
        let seen = [-HALF_THICKNESS - s, s - HALF_THICKNESS].map(|d: f64| d.min(truncation));
        let used: Vec<f64> = seen.into_iter().filter(|&d| d >= -truncation).collect();
        used.iter().sum::<f64>() / used.len() as f64
    };
    let inside = (-100..100)
        .filter(|&n| average(f64::from(n) * voxel) < 0.0)
        .count();
    inside as f64 * voxel
}

/// The plate across the third column of `axes`, fused from both sides in turn.
fn scan(axes: DMat3, voxel_size: f32) -> Mesh {
    let camera = camera(160);
    let config = VolumeConfig {
        voxel_size,
        ..VolumeConfig::default()
    };
    let mut volume = Volume::new(config).expect("a usable config");
    let plate = cuboid(axes, DVec3::new(0.1, 0.1, HALF_THICKNESS));
    for _ in 0..4 {
        for side in [1.0, -1.0] {
            for (x, y) in [(0.0, 0.0), (0.2, 0.1), (-0.2, 0.1), (0.05, -0.25)] {
                let pose = look_at(axes * DVec3::new(x, y, 0.45 * side), DVec3::ZERO);
                let depth = render(&camera, &pose, &plate);
                volume
                    .integrate(&depth, &camera, &pose)
                    .expect("one value per pixel");
            }
        }
    }
    extract_mesh(&volume, &MeshConfig::default())
}

#[test]
fn hc_d07_a_thin_plate_keeps_both_faces() {
    let mut rng = generator(7);
    for voxel in [0.002, 0.004] {
        let naive = (naive_thickness(voxel, 6.0 * voxel) - 2.0 * HALF_THICKNESS).abs();
        bites("D07, voxels", naive / voxel, 1.0);

        let mut worst = 0.0;
        let mut measured = 0;
        for attitude in 0..6 {
            let axes = match attitude {
                0 => DMat3::IDENTITY,
                _ => {
                    let z = unit_vector(&mut rng);
                    let x = z.cross(unit_vector(&mut rng)).normalize();
                    DMat3::from_cols(x, z.cross(x), z)
                }
            };
            let mesh = scan(axes, voxel as f32);
            let mut faces = [(0.0, 0.0); 2];
            for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
                let place = axes.transpose() * position.as_dvec3();
                let facing = axes.col(2).dot(normal.as_dvec3());
                if place.truncate().abs().max_element() > MEASURED || facing.abs() < 0.7 {
                    continue;
                }
                let face = &mut faces[usize::from(facing < 0.0)];
                *face = (face.0 + place.z * facing.signum(), face.1 + 1.0);
            }
            for (sum, count) in faces {
                assert!(
                    count > 300.0,
                    "voxel {voxel}, attitude {attitude}: a face has {count} vertices"
                );
                measured += count as usize;
                worst = worse(worst, (sum / count - HALF_THICKNESS).abs());
            }
            let thickness = faces[0].0 / faces[0].1 + faces[1].0 / faces[1].1;
            worst = worse(worst, (thickness - 2.0 * HALF_THICKNESS).abs());
        }
        assert!(measured > 1000);
        holds("D07, voxels", worst / voxel, 1.0);
    }
}
