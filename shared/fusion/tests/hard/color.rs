//! Row D03: what a voxel's colour does over many frames.

use fusion::Level;
use fusion::kernels::integrate::{
    Block, BlockView, ColorBlock, ColorView, Conflicts, DepthView, UpdateRule, integrate_block,
};
use imaging::LinearPixel;

use crate::rows::{bites, holds, worse};
use crate::sampling::{generator, normal, uniform};

const VOXELS: usize = 512;
/// An 8-bit code in linear radiance.
const CODE: f64 = 1.0 / 255.0;

/// All 512 voxels on the surface at z = 1 m, voxel n at pixel n of an image of one row.
const EACH_ITS_PIXEL: BlockView = BlockView {
    start: [0.0, 0.0, 1.0],
    step: [[1.0, 0.0, 0.0], [8.0, 0.0, 0.0], [64.0, 0.0, 0.0]],
    to_camera: [0.0, 0.0, -1.0],
    farthest: f32::INFINITY,
    nearest: f32::NEG_INFINITY,
    is_inside: true,
};

/// Observes one pixel per voxel with weight `weight`.
fn observe(color: &mut ColorBlock, pixels: &[LinearPixel], weight: f32) {
    let rule = UpdateRule {
        truncation: 1.0,
        weight_at_one_metre: weight,
        weight_cap: 128.0,
        conflict: f32::INFINITY,
        conflict_at_one_metre: f32::INFINITY,
    };
    let image = DepthView {
        depth: &[1.0; VOXELS],
        width: VOXELS,
        height: 1,
    };
    let colors = ColorView { pixels, reach: 0.5 };
    let (mut block, mut conflicts) = (Block::EMPTY, Conflicts::NONE);
    integrate_block(
        Level::detect(),
        &mut block,
        Some((color, colors)),
        None,
        image,
        &EACH_ITS_PIXEL,
        &rule,
        &mut conflicts,
    );
}

fn gray(radiance: f64) -> LinearPixel {
    LinearPixel::from_radiance([radiance as f32; 3], false)
}

fn red(color: &ColorBlock, voxel: usize) -> f64 {
    color
        .radiance(voxel)
        .map_or(f64::NAN, |(radiance, _)| f64::from(radiance[0]))
}

#[test]
fn hc_d03_an_average_of_colour_never_stalls() {
    // Naive: 8-bit codes, weight 255, rounded: 200 never moves towards 100.
    let mut naive = 200_u8;
    for _ in 0..10_000 {
        naive = ((255.0 * f64::from(naive) + 100.0) / 256.0).round() as u8;
    }
    bites("D03", f64::from(naive.abs_diff(100)) * CODE, CODE);

    // A long history of one radiance, then another, for a thousand pairs of them and weights.
    let mut rng = generator(103);
    let mut worst = 0.0;
    for weight in [1.0, 0.3, 0.1] {
        let mut color = ColorBlock::EMPTY;
        for radiance in [(200.0, 100.0), (0.0, 4.0), (1.0, 0.0)].map(|(a, b)| [a * CODE, b * CODE])
        {
            let pairs: Vec<[f64; 2]> = (0..VOXELS)
                .map(|voxel| match voxel {
                    0 => radiance,
                    _ => [uniform(&mut rng, 0.0, 3.9), uniform(&mut rng, 0.0, 1.0)],
                })
                .collect();
            for part in 0..2 {
                let pixels: Vec<LinearPixel> = pairs.iter().map(|pair| gray(pair[part])).collect();
                // The share is the weight over 32 of it at the cap: e⁻⁹ of the difference is left.
                for _ in 0..(300.0 / weight) as usize {
                    observe(&mut color, &pixels, weight);
                }
            }
            for (voxel, pair) in pairs.iter().enumerate() {
                worst = worse(worst, (red(&color, voxel) - pair[1]).abs());
            }
        }
    }
    holds("D03", worst, CODE);
}

#[test]
fn hc_d03_noise_leaves_the_mean_of_colour() {
    const FRAMES: usize = 3000;
    let mut rng = generator(1103);
    // Naive: 8-bit codes, truncated, fall below the mean.
    let mut naive = 100_u8;
    for _ in 0..FRAMES {
        let seen = (100.0 + 5.0 * normal(&mut rng)).round();
        naive = ((64.0 * f64::from(naive) + seen) / 65.0) as u8;
    }
    bites("D03, mean", f64::from(naive.abs_diff(100)) * CODE, CODE);

    // The mean over the 512 voxels and the last frames: what is left is bias.
    let mut color = ColorBlock::EMPTY;
    let (mut sum, mut count) = (0.0, 0.0);
    for frame in 0..FRAMES {
        let pixels: Vec<LinearPixel> = (0..VOXELS)
            .map(|_| gray(CODE * (100.0 + 5.0 * normal(&mut rng))))
            .collect();
        observe(&mut color, &pixels, 1.0);
        if frame > 1000 {
            sum += (0..VOXELS).map(|voxel| red(&color, voxel)).sum::<f64>();
            count += VOXELS as f64;
        }
    }
    holds("D03, mean", (sum / count - 100.0 * CODE).abs(), CODE);
}

#[test]
fn saturated_samples_lose_against_others() {
    let mut color = ColorBlock::EMPTY;
    let saturated = vec![LinearPixel::from_radiance([1.0; 3], true); VOXELS];
    let plain = vec![gray(0.25); VOXELS];
    let invalid = vec![LinearPixel::INVALID; VOXELS];
    observe(&mut color, &invalid, 1.0);
    assert_eq!(color.radiance(7), None);
    observe(&mut color, &saturated, 1.0);
    assert_eq!(color.radiance(7), Some(([1.0; 3], true)), "a lower bound");
    observe(&mut color, &plain, 1.0);
    assert_eq!(color.radiance(7), Some(([0.25; 3], false)), "replaced");
    for _ in 0..100 {
        observe(&mut color, &saturated, 1.0);
    }
    assert_eq!(color.radiance(7), Some(([0.25; 3], false)), "ignored");
}
