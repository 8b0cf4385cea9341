//! The vector kernel against its specification.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::{IcpStep, IcpSums, ModelPixels, PointTile, TILE_POINTS, sum_tile};
use crate::kernels::Level;
use crate::model_view::Surfel;

/// Sums of 8 lanes in f32 against f64, relative to the largest entry: rounding of at most 128 terms.
const TOLERANCE: f64 = 1e-6;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

fn model(random: &mut Pcg64Mcg) -> Vec<Surfel> {
    (0..WIDTH * HEIGHT)
        .map(|pixel| {
            if random.random_bool(0.1) {
                return Surfel::NONE;
            }
            let z = 1.5 + random.random_range(-0.02..0.02);
            let (u, v) = ((pixel % WIDTH) as f32, (pixel / WIDTH) as f32);
            let tilt = [
                random.random_range(-0.5..0.5),
                random.random_range(-0.5..0.5),
                -1.0f32,
            ];
            let length = tilt.iter().map(|t| t * t).sum::<f32>().sqrt();
            Surfel {
                position: [(u - 31.5) / 60.0 * z, (v - 23.5) / 60.0 * z, z],
                grey: 0.5,
                normal: tilt.map(|t| t / length),
                weight: 3.0,
            }
        })
        .collect()
}

fn points(random: &mut Pcg64Mcg, count: usize) -> [Vec<f32>; 4] {
    let mut columns: [Vec<f32>; 4] = Default::default();
    for _ in 0..count {
        let z = 1.5 + random.random_range(-0.05..0.05);
        // Some lie outside the view, some behind it, some are no numbers.
        let z = match random.random_range(0..50) {
            0 => -z,
            1 => f32::NAN,
            2 => 0.0,
            3 => f32::INFINITY,
            _ => z,
        };
        let values = [
            random.random_range(-1.0..1.0) * z,
            random.random_range(-0.6..0.6) * z,
            z,
            random.random_range(1e3..1e6),
        ];
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
    }
    columns
}

fn step(random: &mut Pcg64Mcg) -> IcpStep {
    let angle: f32 = random.random_range(-0.05..0.05);
    let (sine, cosine) = angle.sin_cos();
    IcpStep {
        rotation: [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.01, random.random_range(-0.01..0.01), -0.005],
        center: [0.1, 0.0, 1.5],
        largest_distance: 0.05,
        robust_scale: 3.0,
    }
}

fn sums(level: Level, columns: &[Vec<f32>; 4], surfels: &[Surfel], step: &IcpStep) -> IcpSums {
    let tile = PointTile {
        x: &columns[0],
        y: &columns[1],
        z: &columns[2],
        weight: &columns[3],
    };
    let model = ModelPixels {
        surfels,
        width: WIDTH,
        height: HEIGHT,
        focal: [60.0; 2],
        center: [31.5, 23.5],
    };
    sum_tile(level, tile, model, step)
}

#[test]
fn both_levels_give_the_same_sums_for_every_length() {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let surfels = model(&mut random);
    for count in (0..=33).chain([TILE_POINTS - 1, TILE_POINTS]) {
        let columns = points(&mut random, count);
        let step = step(&mut random);
        let scalar = sums(Level::Scalar, &columns, &surfels, &step);
        let vector = sums(Level::detect(), &columns, &surfels, &step);
        assert_eq!(scalar.met_count, vector.met_count, "{count} points");
        assert_eq!(scalar.pair_count, vector.pair_count);
        let largest = scalar
            .hessian
            .iter()
            .fold(1e-30, |l: f64, h| l.max(h.abs()));
        for (one, other) in scalar.hessian.iter().zip(&vector.hessian) {
            assert!(((one - other) / largest).abs() < TOLERANCE, "{one} {other}");
        }
        for (one, other) in scalar.gradient.iter().zip(&vector.gradient) {
            assert!(((one - other) / largest).abs() < TOLERANCE, "{one} {other}");
        }
        let counts = f64::from(scalar.pair_count.max(1));
        assert!((scalar.cost - vector.cost).abs() < TOLERANCE * counts);
        assert_eq!(scalar.inlier_count, vector.inlier_count);
    }
}

#[test]
fn a_point_that_cannot_be_paired_adds_nothing() {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    let surfels = model(&mut random);
    let step = step(&mut random);
    for z in [f32::NAN, f32::INFINITY, -1.5, 0.0, 1e-39, f32::NEG_INFINITY] {
        let columns = [vec![0.0; 9], vec![0.0; 9], vec![z; 9], vec![1e4; 9]];
        for level in [Level::Scalar, Level::detect()] {
            assert_eq!(sums(level, &columns, &surfels, &step), IcpSums::ZERO, "{z}");
        }
    }
}
