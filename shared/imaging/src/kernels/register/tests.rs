use geometry::{DQuat, DVec3, Distortion, Intrinsics, Pose};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::super::Level;
use super::{NearestCells, ProjectedRow, Projection, Seen, project_row, sample_row};
use crate::linear_pixel::LinearPixel;

const DISTORTION: Distortion = Distortion {
    k1: 0.12,
    k2: -0.25,
    p1: 0.001,
    p2: -0.002,
    k3: 0.05,
};

fn cameras(width: u32, distortion: Distortion) -> (Intrinsics, Intrinsics, Pose) {
    let f = 0.9 * f64::from(width);
    let center = 0.5 * f64::from(width);
    let depth = Intrinsics::pinhole(width, 48, f, f, center, 24.0).unwrap();
    let color = Intrinsics::new(64, 48, 55.0, 56.0, 31.0, 24.5, distortion).unwrap();
    let rotation = DQuat::from_scaled_axis(DVec3::new(0.01, -0.02, 0.015));
    let color_from_depth = Pose::new(rotation, DVec3::new(0.025, -0.002, 0.001)).unwrap();
    (depth, color, color_from_depth)
}

fn depth_row(width: u32, rng: &mut Pcg64) -> Vec<f32> {
    let odd = [0.0, f32::NAN, f32::INFINITY, -1.0, 1e-40, f32::MAX, -0.0];
    (0..width)
        .map(|_| {
            if rng.random_range(0..8) == 0 {
                odd[rng.random_range(0..odd.len())]
            } else {
                0.4 + 3.0 * rng.random::<f32>()
            }
        })
        .collect()
}

#[test]
fn projection_is_that_of_the_cameras() {
    let mut rng = Pcg64::seed_from_u64(21);
    for distortion in [Distortion::NONE, DISTORTION] {
        let (depth, color, color_from_depth) = cameras(64, distortion);
        let projection = Projection::new(&depth, &color, &color_from_depth);
        let mut seen_count = 0;
        for v in 0..48 {
            let row = depth_row(64, &mut rng);
            let mut projected = ProjectedRow::new(64);
            project_row(Level::detect(), &projection, v, &row, &mut projected);
            for (u, &z) in row.iter().enumerate() {
                let pixel = geometry::DVec2::new(u as f64, v as f64);
                let ray = depth.camera_from_pixel(pixel).unwrap();
                let is_measured = crate::is_measured(z);
                let point = color_from_depth.transform_point(f64::from(z) * ray);
                let expected = is_measured
                    .then(|| color.pixel_from_camera(point))
                    .flatten();
                let inside = expected.filter(|&pixel| color.contains(pixel).is_some());
                let inverse_depth = projected.inverse_depth[u];
                let Some(inside) = inside else {
                    let edge = expected.map_or(1.0, |p| {
                        let to = |at: f64, end: f64| (at + 0.5).abs().min((at - end + 0.5).abs());
                        to(p.x, 64.0).min(to(p.y, 48.0))
                    });
                    assert!(inverse_depth == 0.0 || edge < 1e-3, "({u}, {v}) at {z}");
                    continue;
                };
                if inverse_depth > 0.0 {
                    seen_count += 1;
                    assert!((f64::from(projected.x[u]) - inside.x).abs() < 1e-3);
                    assert!((f64::from(projected.y[u]) - inside.y).abs() < 1e-3);
                    assert!((f64::from(inverse_depth) * point.z - 1.0).abs() < 1e-5);
                }
            }
        }
        assert!(seen_count > 1500, "{seen_count}");
    }
}

#[test]
fn vector_rows_equal_their_scalar_twins() {
    if !Level::Avx2.is_usable() {
        println!("skipped: this machine has no AVX2");
        return;
    }
    let mut rng = Pcg64::seed_from_u64(22);
    let color: Vec<LinearPixel> = (0..64 * 48)
        .map(|_| {
            let [r, g, b]: [u16; 3] = rng.random();
            let flags = [1, 1, 1, 1, 1, 1, 1, 1, 1, 3, 0][rng.random_range(0..11)];
            LinearPixel([r, g, b, flags])
        })
        .collect();
    for width in (1..=33).chain([64]) {
        for distortion in [Distortion::NONE, DISTORTION] {
            let (depth, camera, color_from_depth) = cameras(width, distortion);
            let projection = Projection::new(&depth, &camera, &color_from_depth);
            let rows: Vec<Vec<f32>> = (0..8).map(|_| depth_row(width, &mut rng)).collect();
            let made = |level| {
                let mut projected = vec![ProjectedRow::new(width as usize); rows.len()];
                let mut cells = NearestCells::new(64, 48, 2);
                for (v, (row, projected)) in rows.iter().zip(&mut projected).enumerate() {
                    project_row(level, &projection, 6 * v, row, projected);
                    cells.enter(level, projected);
                }
                let seen = Seen {
                    color: &color,
                    width: 64,
                    height: 48,
                    hiding: Some((&cells, [0.1, 0.05])),
                };
                let mut pixels = vec![LinearPixel([5; 4]); width as usize * rows.len()];
                for (row, pixels) in projected.iter().zip(pixels.chunks_mut(width as usize)) {
                    sample_row(level, &seen, row, pixels);
                }
                pixels
            };
            assert_eq!(made(Level::Scalar), made(Level::Avx2), "{width} columns");
        }
    }
}
