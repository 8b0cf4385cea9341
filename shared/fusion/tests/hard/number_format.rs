//! Rows D01, D02, D04, D05: what a voxel's numbers do over many frames. The volume keeps f32 distances and
//! f32 weights with a cap; the rows' tolerances are in quanta of a 16-bit distance, τ/32767.

use fusion::Level;
use fusion::kernels::integrate::{
    Block, BlockView, Conflicts, DepthView, UpdateRule, integrate_block,
};

use crate::rows::{bites, holds, worse};
use crate::sampling::{generator, normal, uniform};

const VOXELS: usize = 512;
/// A quantum of a 16-bit distance, in truncations.
const QUANTUM: f64 = 1.0 / 32767.0;

/// Truncation 1 m, weight 1 at 1 m, no two-sided rule: a frame is a plain observation.
fn rule(weight_cap: f32) -> UpdateRule {
    UpdateRule {
        truncation: 1.0,
        weight_at_one_metre: 1.0,
        weight_cap,
        conflict: f32::INFINITY,
        conflict_at_one_metre: f32::INFINITY,
    }
}

/// All 512 voxels at z = 1 m, voxel n at pixel n of an image of one row.
const EACH_ITS_PIXEL: BlockView = BlockView {
    start: [0.0, 0.0, 1.0],
    step: [[1.0, 0.0, 0.0], [8.0, 0.0, 0.0], [64.0, 0.0, 0.0]],
    to_camera: [0.0, 0.0, -1.0],
    farthest: f32::INFINITY,
    nearest: f32::NEG_INFINITY,
    is_inside: true,
};

/// Only the eight voxels of the first row are within reach, at z = 1 m, voxel n at pixel n.
const FIRST_ROW: BlockView = BlockView {
    step: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 8.0]],
    farthest: 1.5,
    ..EACH_ITS_PIXEL
};

/// Observes `tsdf`, one value per pixel, once.
fn observe(block: &mut Block, tsdf: &[f32], view: &BlockView, rule: &UpdateRule) {
    let depth: Vec<f32> = tsdf.iter().map(|t| 1.0 + t).collect();
    let image = DepthView {
        depth: &depth,
        width: depth.len(),
        height: 1,
    };
    let mut conflicts = Conflicts::NONE;
    integrate_block(
        Level::detect(),
        block,
        None,
        None,
        image,
        view,
        rule,
        &mut conflicts,
    );
}

/// What the kernel reads from a depth of 1 + `tsdf` in f32.
fn as_observed(tsdf: f32) -> f64 {
    f64::from((1.0 + tsdf) - 1.0)
}

#[test]
fn hc_d01_a_running_average_never_stalls() {
    // Naive: 16-bit quanta with rounding stop moving at half a weight.
    let naive = |weight: f64| {
        let mut stored = (0.5 / QUANTUM).round();
        for _ in 0..20_000 {
            stored = (weight * stored / (weight + 1.0)).round();
        }
        stored * QUANTUM
    };
    bites("D01", naive(1000.0), QUANTUM);
    assert!(naive(1000.0) > 0.014, "1.5 % of τ remain");

    // The default cap, and a thousand random starts and goals.
    let rule = rule(128.0);
    let mut rng = generator(101);
    let mut worst = 0.0;
    for round in 0..3 {
        let mut block = Block::EMPTY;
        let mut goals = vec![0.0_f32; VOXELS];
        for (voxel, goal) in goals.iter_mut().enumerate() {
            block.weight[voxel] = rule.weight_cap;
            block.tsdf[voxel] = 0.5;
            if round > 0 {
                block.tsdf[voxel] = uniform(&mut rng, -1.0, 1.0) as f32;
                *goal = uniform(&mut rng, -0.9, 0.9) as f32;
            }
        }
        for _ in 0..3000 {
            observe(&mut block, &goals, &EACH_ITS_PIXEL, &rule);
        }
        for (&stored, &goal) in block.tsdf.iter().zip(&goals) {
            worst = worse(worst, (f64::from(stored) - as_observed(goal)).abs());
        }
    }
    holds("D01", worst, QUANTUM);
}

#[test]
fn hc_d02_noise_leaves_no_bias_of_either_sign() {
    const CAP: f64 = 64.0;
    const FRAMES: usize = 600;
    // Naive: the same noise averaged in 16-bit quanta with truncating casts, against f64.
    let mut rng = generator(102);
    let mut naive = 0.0_f64;
    for sign in [1.0, -1.0] {
        let (mut stored, mut exact, mut weight) = (0_i16, 0.0, 0.0);
        for _ in 0..FRAMES {
            let seen = sign * (0.1 + 0.05 * normal(&mut rng));
            let kept = weight / (weight + 1.0);
            stored = ((kept * f64::from(stored) * QUANTUM + (1.0 - kept) * seen) / QUANTUM) as i16;
            exact = kept * exact + (1.0 - kept) * seen;
            weight = (weight + 1.0).min(CAP);
        }
        naive = naive.max((f64::from(stored) * QUANTUM - exact).abs());
    }
    bites("D02", naive, QUANTUM);

    // Voxels in pairs that see the same noise about +0.1 and −0.1.
    let mut worst = 0.0;
    for _ in 0..4 {
        let mut block = Block::EMPTY;
        let mut exact = vec![0.0; VOXELS];
        let mut weight = 0.0;
        let mut seen = vec![0.0_f32; VOXELS];
        for _ in 0..FRAMES {
            for pair in seen.chunks_exact_mut(2) {
                let value = (0.1 + 0.05 * normal(&mut rng)) as f32;
                pair.copy_from_slice(&[value, -value]);
            }
            observe(&mut block, &seen, &EACH_ITS_PIXEL, &rule(CAP as f32));
            for (exact, &seen) in exact.iter_mut().zip(&seen) {
                *exact += (as_observed(seen) - *exact) / (weight + 1.0);
            }
            weight = (weight + 1.0).min(CAP);
        }
        for (stored, exact) in block.tsdf.chunks_exact(2).zip(exact.chunks_exact(2)) {
            let bias = [0, 1].map(|n| f64::from(stored[n]) - exact[n]);
            worst = worse(worst, bias[0].abs());
            worst = worse(worst, bias[1].abs());
            worst = worse(worst, (bias[0] + bias[1]).abs());
        }
    }
    holds("D02", worst, QUANTUM);
}

#[test]
fn hc_d04_weights_stop_at_the_cap() {
    const CAP: f64 = 128.0;
    let mut rng = generator(104);
    // Naive: an 8-bit weight that wraps forgets the surface every 256 frames.
    let (mut stored, mut exact, mut naive_weight, mut weight) = (0.0, 0.0, 0_u8, 0.0);
    let mut naive = 0.0_f64;
    for _ in 0..1000 {
        let seen = 0.3 + 0.1 * normal(&mut rng);
        stored += (seen - stored) / (f64::from(naive_weight) + 1.0);
        naive_weight = naive_weight.wrapping_add(1);
        exact += (seen - exact) / (weight + 1.0);
        weight = (weight + 1.0_f64).min(CAP);
        naive = naive.max((stored - exact).abs());
    }
    bites("D04", naive, QUANTUM);

    // One row of voxels, a million frames; then a block of them for a while.
    let mut worst = 0.0;
    for (view, voxels, frames) in [(FIRST_ROW, 8, 1_000_000), (EACH_ITS_PIXEL, VOXELS, 500)] {
        let rule = rule(CAP as f32);
        let mut block = Block::EMPTY;
        let mut exact = vec![0.0; voxels];
        let mut weight = 0.0_f64;
        let mut seen = vec![0.0_f32; voxels];
        for frame in 0..frames {
            // Fresh noise every frame would cost more than the test; 64 frames of it repeat.
            if frame % 16 == 0 {
                seen.fill_with(|| (0.3 + 0.1 * normal(&mut rng)) as f32);
            }
            observe(&mut block, &seen, &view, &rule);
            for (exact, &seen) in exact.iter_mut().zip(&seen) {
                *exact += (as_observed(seen) - *exact) / (weight + 1.0);
            }
            weight = (weight + 1.0).min(CAP);
        }
        for (voxel, &exact) in exact.iter().enumerate() {
            assert_eq!(block.weight[voxel], rule.weight_cap, "voxel {voxel}");
            worst = worse(worst, (f64::from(block.tsdf[voxel]) - exact).abs());
        }
    }
    holds("D04", worst, QUANTUM);
}

#[test]
fn hc_d05_a_million_observations_keep_their_mean() {
    const FRAMES: usize = 1_000_000;
    const TOLERANCE: f64 = 1e-5;
    let mut rng = generator(105);
    let noise: Vec<f32> = (0..8192)
        .map(|_| (0.3 + 0.1 * normal(&mut rng)).clamp(-0.9, 0.9) as f32)
        .collect();
    // Voxel n sees the noise from a start of its own.
    let seen = |frame: usize, voxel: usize| noise[(frame + 997 * voxel) % noise.len()];

    let naive_sum: f32 = (0..FRAMES).map(|frame| seen(frame, 0)).sum();
    let exact_sum: f64 = (0..FRAMES).map(|frame| f64::from(seen(frame, 0))).sum();
    let naive = f64::from(naive_sum / FRAMES as f32) - exact_sum / FRAMES as f64;
    bites("D05", naive.abs(), TOLERANCE);

    let mut worst = 0.0;
    for (view, voxels, frames) in [(FIRST_ROW, 8, FRAMES), (EACH_ITS_PIXEL, VOXELS, 2000)] {
        let mut block = Block::EMPTY;
        let mut sums = vec![0.0; voxels];
        let mut values = vec![0.0; voxels];
        for frame in 0..frames {
            for (voxel, value) in values.iter_mut().enumerate() {
                *value = seen(frame, voxel);
                sums[voxel] += as_observed(*value);
            }
            observe(&mut block, &values, &view, &rule(1e6));
        }
        for (&stored, sum) in block.tsdf.iter().zip(&sums) {
            worst = worse(worst, (f64::from(stored) - sum / frames as f64).abs());
        }
    }
    holds("D05", worst, TOLERANCE);
}
