//! The vector kernel against its specification.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;

/// Eight blocks that touch, with a field that saturates in places and was not observed in others.
fn blocks(rng: &mut Pcg64) -> Vec<Block> {
    (0..8)
        .map(|_| {
            let mut block = Block::EMPTY;
            for voxel in 0..BLOCK_VOXELS {
                if rng.random_bool(0.97) {
                    block.tsdf[voxel] = rng.random_range(-1.0..1.1_f32).min(1.0);
                    block.weight[voxel] = rng.random_range(0.0..4.0);
                }
            }
            block
        })
        .collect()
}

#[test]
fn levels_agree_bit_for_bit_at_every_place_of_a_block() {
    let mut rng = Pcg64::seed_from_u64(4);
    let (mut known, mut unknown) = (0, 0);
    for round in 0..4 {
        let blocks = blocks(&mut rng);
        let points: Vec<Neighbourhood<'_>> = (0..BLOCK_VOXELS)
            .map(|place| Neighbourhood {
                blocks: std::array::from_fn(|part| &blocks[part]),
                first: [
                    place % BLOCK_EDGE,
                    place / BLOCK_EDGE % BLOCK_EDGE,
                    place / (BLOCK_EDGE * BLOCK_EDGE),
                ],
                // The ends of a cell too.
                share: Vec3A::from_array(std::array::from_fn(|_| match rng.random_range(0..8) {
                    0 => 0.0,
                    1 => 1.0,
                    _ => rng.random_range(0.0..1.0),
                })),
            })
            .collect();
        let min_weight = [f32::MIN_POSITIVE, 0.05, 0.5, 1.0][round];
        let [scalar, vector] = [Level::Scalar, Level::detect()].map(|level| {
            let mut samples = vec![FieldSample::NONE; points.len()];
            sample_fields(level, &points, min_weight, &mut samples);
            samples
        });
        for (one, other) in scalar.iter().zip(&vector) {
            let bits = |s: &FieldSample| {
                let [x, y, z] = s.gradient.to_array();
                [s.tsdf, s.weight, x, y, z].map(f32::to_bits)
            };
            assert_eq!(bits(one), bits(other), "{one:?} and {other:?}");
        }
        known += scalar.iter().filter(|s| s.weight > 0.0).count();
        unknown += scalar.iter().filter(|s| s.weight == 0.0).count();
    }
    assert!(known > 100 && unknown > 100, "{known} and {unknown}");
}

#[test]
fn a_plane_has_its_own_slope_everywhere() {
    let normal = Vec3A::new(0.02, -0.03, 0.05);
    let at = |p: Vec3A| normal.dot(p) - 0.1;
    let blocks: Vec<Block> = (0..8)
        .map(|part: usize| {
            let mut block = Block::EMPTY;
            for voxel in 0..BLOCK_VOXELS {
                let place = [voxel % 8, voxel / 8 % 8, voxel / 64];
                let point: [f32; 3] =
                    std::array::from_fn(|axis| (place[axis] + 8 * (part >> axis & 1)) as f32);
                block.tsdf[voxel] = at(Vec3A::from_array(point));
                block.weight[voxel] = 2.0;
            }
            block
        })
        .collect();
    for place in 0..BLOCK_VOXELS {
        let first = [place % 8, place / 8 % 8, place / 64];
        let share = Vec3A::new(0.25, 0.5, 0.875);
        let point = Neighbourhood {
            blocks: std::array::from_fn(|part| &blocks[part]),
            first,
            share,
        };
        let mut sample = [FieldSample::NONE];
        sample_fields(Level::detect(), &[point], 1.0, &mut sample);
        let [sample] = sample;
        let true_value = at(Vec3A::from_array(first.map(|c| (c + 1) as f32)) + share);
        // Rounding of values up to 1.
        assert!((sample.tsdf - true_value).abs() < 1e-6, "at {first:?}");
        assert!((sample.gradient - normal).length() < 1e-6, "at {first:?}");
        assert_eq!(sample.weight, 2.0);
    }
}
