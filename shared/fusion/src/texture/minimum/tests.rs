//! Hard cases G01 and G07: the descent itself.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;

const SIGMA: f64 = 0.01;

fn grey(level: f64) -> Sample {
    Sample {
        linear: [level as f32; 3],
        saturated: false,
        frame: 0,
    }
}

fn report(id: &str, worst: f64, tolerance: f64) {
    println!("{id}: worst error {worst:.3e}, tolerance {tolerance:.1e}");
    assert!(worst <= tolerance, "{id}: {worst:e} > {tolerance:e}");
}

/// A random sorted set: clusters, highlights, outliers, repeated values.
fn random_set(rng: &mut Pcg64) -> Vec<f64> {
    let count = rng.random_range(1..=20);
    let (center, steps) = (rng.random_range(0.05..0.8), rng.random_range(1..200));
    let mut set: Vec<f64> = (0..count)
        .map(|_| {
            let noise: f64 = (0..4).map(|_| rng.random_range(-1.0..1.0)).sum::<f64>() * SIGMA;
            let shine = match rng.random_range(0..10) {
                0..3 => rng.random_range(0.0..0.5),
                3 => -rng.random_range(0.0..0.2),
                _ => 0.0,
            };
            // Codes of a sensor repeat.
            let step = 1e-3 * f64::from(steps);
            ((center + noise + shine) / step).round() * step
        })
        .collect();
    set.sort_by(f64::total_cmp);
    set
}

const MOST_ITERATIONS: usize = 20;

fn total_cost(luminances: &[f64], minimum: f64, delta: f64) -> f64 {
    let cost = |residual: f64| {
        let size = residual.abs();
        let huber = if size < delta {
            size * size / (2.0 * delta)
        } else {
            size - 0.5 * delta
        };
        side(residual) * huber
    };
    luminances
        .iter()
        .map(|luminance| cost(luminance - minimum))
        .sum()
}

/// Textbook reweighting with weights 1/|r| over a tiny floor.
fn naive_irls(samples: &[f64], start: f64, floor: f64) -> f64 {
    let mut minimum = start;
    for _ in 0..MOST_ITERATIONS {
        let weight = |sample: f64| side(sample - minimum) / (sample - minimum).abs().max(floor);
        let total: f64 = samples.iter().map(|&s| weight(s)).sum();
        minimum = samples.iter().map(|&s| weight(s) * s).sum::<f64>() / total;
    }
    minimum
}

#[test]
fn hc_g01_the_answer_does_not_depend_on_the_start() {
    const TOLERANCE_IN_SIGMA: f64 = 0.1;
    let equal = [0.3; 10];
    let error = (naive_irls(&equal, 0.3, 0.0) - 0.3).abs();
    assert!(error.is_nan(), "without a floor equal samples are 0/0");
    let spread: Vec<f64> = (0..10).map(|n| 0.3 + 0.02 * f64::from(n)).collect();
    let frozen = naive_irls(&spread, spread[9], 1e-30) - naive_irls(&spread, spread[0], 1e-30);
    println!(
        "G01: naive error {:.3e} σ, tolerance {TOLERANCE_IN_SIGMA}",
        frozen / SIGMA
    );
    assert!(
        frozen > TOLERANCE_IN_SIGMA * SIGMA,
        "frozen where it started"
    );

    let value = robust_minimum(&equal.map(grey), SIGMA as f32).value[0];
    report(
        "G01 equal samples, σ",
        (f64::from(value) - 0.3).abs() / SIGMA,
        TOLERANCE_IN_SIGMA,
    );

    // There is no start; what a start would change is where on a flat stretch, or short of the minimum, the
    // answer lies. Reference: the middle of all points whose cost is least, on a fine grid.
    let mut rng = Pcg64::seed_from_u64(201);
    let mut worst = 0.0_f64;
    for round in 0..1000 {
        let set = if round == 0 {
            spread.clone()
        } else {
            random_set(&mut rng)
        };
        let (low, high) = (set[0] - SIGMA, set[set.len() - 1] + SIGMA);
        let points = ((high - low) / (0.02 * SIGMA)).ceil() as usize;
        let grid: Vec<(f64, f64)> = (0..=points)
            .map(|n| low + (high - low) * n as f64 / points as f64)
            .map(|m| (m, total_cost(&set, m, 0.5 * SIGMA)))
            .collect();
        let least = grid.iter().map(|g| g.1).fold(f64::INFINITY, f64::min);
        let best: Vec<f64> = grid
            .iter()
            .filter(|g| g.1 <= least + 1e-9)
            .map(|g| g.0)
            .collect();
        let middle = 0.5 * (best[0] + best[best.len() - 1]);
        worst = worst.max((quantile_fit(&set, SIGMA) - middle).abs() / SIGMA);
    }
    report("G01 any start, σ", worst, TOLERANCE_IN_SIGMA);
}

#[test]
fn hc_g07_no_step_lowers_the_cost_of_the_answer() {
    const TOLERANCE: f64 = 1e-12;
    let mut rng = Pcg64::seed_from_u64(207);
    let delta = 0.5 * SIGMA;
    // Naive: full steps of the quantile weights without halving; the weight jumps with the sign of r.
    let mut naive = 0.0_f64;
    for _ in 0..2000 {
        let set = random_set(&mut rng);
        let mut minimum = set[set.len() / 2];
        for _ in 0..MOST_ITERATIONS {
            let before = total_cost(&set, minimum, delta);
            let weight = |s: f64| side(s - minimum) / (s - minimum).abs().max(1e-9);
            let total: f64 = set.iter().map(|&s| weight(s)).sum();
            minimum = set.iter().map(|&s| weight(s) * s).sum::<f64>() / total;
            naive = naive.max(total_cost(&set, minimum, delta) - before);
        }
    }
    println!("G07: naive error {naive:.3e}, tolerance {TOLERANCE:.1e}");
    assert!(naive > TOLERANCE, "the naive cost rises");

    let mut worst = 0.0_f64;
    for round in 0..100_000 {
        let set = match round {
            0 => vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            _ => random_set(&mut rng),
        };
        let answer = quantile_fit(&set, SIGMA);
        let cost = total_cost(&set, answer, delta);
        // The bracket is 1e-5 σ wide, and near a minimum the cost is flat: an error of second order.
        for step in [-1.0, -0.1, -1e-3, 1e-3, 0.1, 1.0] {
            worst = worst.max(cost - total_cost(&set, answer + step * SIGMA, delta));
        }
    }
    report("G07", worst, TOLERANCE);
}

#[test]
fn hostile_samples_leave_finite_values() {
    let extremes = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -1.0,
        0.0,
        1e-40,
    ];
    for a in extremes {
        for b in extremes {
            for sigma in [0.01, 0.0, -1.0, f32::NAN, f32::MAX] {
                let mut samples = vec![grey(0.3); 3];
                samples.extend([a, b].map(|c| Sample {
                    linear: [c, 0.3, b],
                    ..grey(0.3)
                }));
                let minimum = robust_minimum(&samples, sigma);
                let is_number = minimum.value.iter().all(|c| !c.is_nan());
                assert!(is_number, "{a} {b} σ {sigma}: {minimum:?}");
                assert!((0.0..=1.0).contains(&minimum.confidence));
                assert!((0.0..=1.0).contains(&minimum.rejected_fraction));
            }
        }
    }
}
