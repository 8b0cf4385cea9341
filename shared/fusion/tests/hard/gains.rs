//! Row G08: exposures that differ a little between frames.

use fusion::{Sample, frame_gains, robust_minimum};
use rand_pcg::Pcg64;

use crate::rows::{bites, holds, worse};
use crate::sampling::{generator, normal, uniform};

const FRAMES: usize = 60;
const SIGMA: f64 = 0.004;

struct Scene {
    gains: Vec<f64>,
    levels: Vec<f64>,
    points: Vec<Vec<Sample>>,
}

/// Points of random grey, a third of them shiny, seen in frames whose gains differ by ±2 %.
fn scene(rng: &mut Pcg64) -> Scene {
    let gains: Vec<f64> = (0..FRAMES).map(|_| uniform(rng, 0.98, 1.02)).collect();
    let levels: Vec<f64> = (0..300).map(|_| uniform(rng, 0.15, 0.6)).collect();
    let points = levels
        .iter()
        .enumerate()
        .map(|(point, &level)| {
            (0..FRAMES)
                .filter(|frame| (frame + point) % 3 > 0)
                .map(|frame| {
                    let is_highlight = point % 3 == 0 && uniform(rng, 0.0, 1.0) < 0.4;
                    let shine = if is_highlight {
                        uniform(rng, 0.05, 0.5)
                    } else {
                        0.0
                    };
                    let seen = gains[frame] * (level + shine) + SIGMA * normal(rng);
                    Sample {
                        linear: [seen as f32; 3],
                        saturated: false,
                        frame: frame as u32,
                    }
                })
                .collect()
        })
        .collect();
    Scene {
        gains,
        levels,
        points,
    }
}

#[test]
fn hc_g08_gains_are_found_before_the_minimum() {
    const TOLERANCE: f64 = 0.005;
    let mut rng = generator(208);
    let first = scene(&mut rng);
    let naive: f64 = first
        .points
        .iter()
        .zip(&first.levels)
        .map(|(samples, level)| {
            let least = samples
                .iter()
                .map(Sample::luminance)
                .fold(f64::INFINITY, f64::min);
            least / level - 1.0
        })
        .sum();
    bites("G08", naive.abs() / first.levels.len() as f64, TOLERANCE);

    let (mut worst, mut worst_gain) = (0.0, 0.0);
    for _ in 0..4 {
        let Scene {
            gains,
            levels,
            points,
        } = scene(&mut rng);
        let found = frame_gains(&points, FRAMES, SIGMA as f32);
        // The common level is free: the mean over frames is compared as one.
        let common = found.iter().zip(&gains).map(|(f, g)| f / g).sum::<f64>() / FRAMES as f64;
        for (found, gain) in found.iter().zip(&gains) {
            worst_gain = worse(worst_gain, (found / gain / common - 1.0).abs());
        }
        let bias: f64 = points
            .iter()
            .zip(&levels)
            .map(|(samples, level)| {
                let corrected: Vec<Sample> = samples
                    .iter()
                    .map(|s| {
                        let gain = found[s.frame as usize] / common;
                        let linear = s.linear.map(|c| (f64::from(c) / gain) as f32);
                        Sample { linear, ..*s }
                    })
                    .collect();
                f64::from(robust_minimum(&corrected, SIGMA as f32).value[0]) / level - 1.0
            })
            .sum::<f64>()
            / levels.len() as f64;
        worst = worse(worst, bias.abs());
    }
    holds("G08 gains", worst_gain, TOLERANCE);
    holds("G08", worst, TOLERANCE);
}

#[test]
fn hc_g08_frames_that_nothing_speaks_for_keep_gain_one() {
    let lone = vec![vec![Sample {
        linear: [0.5; 3],
        saturated: false,
        frame: 0,
    }]];
    for points in [vec![], lone, vec![vec![]]] {
        assert_eq!(frame_gains(&points, 3, 0.01), vec![1.0; 3]);
    }
}
