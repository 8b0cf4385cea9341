//! Rows G02 to G06: the robust minimum over views.

use fusion::{RobustMinimum, Sample, robust_minimum};
use rand_pcg::Pcg64;

use crate::rows::{bites, holds};
use crate::sampling::{generator, normal, uniform};

const SIGMA: f64 = 0.01;
const DIFFUSE: f64 = 0.3;

fn grey(level: f64) -> Sample {
    Sample {
        linear: [level as f32; 3],
        saturated: false,
        frame: 0,
    }
}

/// A view of the catalogue's texel: noise, and in 30 % of the views a highlight of mean 0.3.
fn view(rng: &mut Pcg64) -> Sample {
    let highlight = if uniform(rng, 0.0, 1.0) < 0.3 {
        -0.3 * (1.0 - uniform(rng, 0.0, 1.0)).ln()
    } else {
        0.0
    };
    grey(DIFFUSE + highlight + SIGMA * normal(rng))
}

fn estimate(samples: &[Sample]) -> RobustMinimum {
    robust_minimum(samples, SIGMA as f32)
}

/// Mean of (value − truth) over `trials` texels, in σ.
fn bias(trials: usize, mut value: impl FnMut() -> f64) -> f64 {
    (0..trials).map(|_| value() - DIFFUSE).sum::<f64>() / trials as f64 / SIGMA
}

fn least(samples: &[Sample]) -> f64 {
    samples
        .iter()
        .map(Sample::luminance)
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn hc_g02_few_samples_carry_little_confidence() {
    // Naive: the minimum of one view is the answer, and nothing says that it is a highlight.
    let naive_confidence = 1.0;
    bites("G02", naive_confidence, 1.0 / 5.0);

    let nothing = estimate(&[]);
    assert_eq!(
        (nothing.count, nothing.confidence),
        (0, 0.0),
        "a hole says so"
    );
    let mut rng = generator(202);
    let mut worst = 0.0_f64;
    for trial in 0..2000 {
        let count = 1 + trial % 4;
        let samples: Vec<Sample> = (0..count).map(|_| view(&mut rng)).collect();
        let minimum = estimate(&samples);
        assert_eq!(minimum.count as usize, count);
        worst = worst.max(f64::from(minimum.confidence) - count as f64 / 5.0);
        if count == 1 {
            // One view is its own best guess: there is no minimum to correct for.
            let error = f64::from(minimum.value[0]) - samples[0].luminance();
            assert!(error.abs() < 0.1 * SIGMA, "a lone sample moved by {error}");
        }
    }
    holds("G02", worst, 1e-6);
}

#[test]
fn hc_g03_bias_does_not_grow_with_the_number_of_views() {
    const TOLERANCE: f64 = 0.2;
    let mut rng = generator(203);
    let mut texel = |count: usize| (0..count).map(|_| view(&mut rng)).collect::<Vec<_>>();
    let naive = [10, 1000].map(|count| bias(60, || least(&texel(count))));
    bites("G03", (naive[1] - naive[0]).abs(), TOLERANCE);

    let mut worst = 0.0_f64;
    for count in [10, 30, 100, 300, 1000] {
        let trials = (40_000 / count).max(100);
        let bias = bias(trials, || f64::from(estimate(&texel(count)).value[1]));
        println!("G03: {count} views, bias {bias:.3} σ");
        worst = worst.max(bias.abs());
    }
    holds("G03", worst, TOLERANCE);
}

#[test]
fn hc_g04_saturated_samples_are_no_values() {
    const TOLERANCE: f64 = 0.3;
    const CLIP: f64 = 1.0;
    let mut rng = generator(204);
    // 60 % of the views are clipped highlights.
    let mut texel = |count: usize| -> Vec<Sample> {
        (0..count)
            .map(|n| match n % 5 {
                0..3 => Sample {
                    saturated: true,
                    ..grey(CLIP)
                },
                _ => grey(DIFFUSE + SIGMA * normal(&mut rng)),
            })
            .collect()
    };
    // Naive: the median takes the clipped value as a value.
    let naive = bias(1, || {
        let mut levels: Vec<f64> = texel(50).iter().map(Sample::luminance).collect();
        levels.sort_by(f64::total_cmp);
        levels[25]
    });
    bites("G04", naive, TOLERANCE);
    let found = bias(1000, || {
        let minimum = estimate(&texel(50));
        assert!(!minimum.lower_bound);
        f64::from(minimum.value[0])
    });
    holds("G04", found.abs(), TOLERANCE);

    for clipped in [1, 2, 10, 1000] {
        let samples = vec![
            Sample {
                saturated: true,
                ..grey(CLIP)
            };
            clipped
        ];
        let minimum = estimate(&samples);
        assert!(
            minimum.lower_bound && minimum.confidence <= 0.5,
            "{clipped} clipped samples"
        );
    }
}

#[test]
fn hc_g05_dark_outliers_do_not_win() {
    let mut rng = generator(205);
    // A share of the views lies 0.1 too low: a shadow, or the surface beside the object.
    let mut texel = |dark: f64| -> Vec<Sample> {
        (0..100)
            .map(|_| match uniform(&mut rng, 0.0, 1.0) < dark {
                true => grey(DIFFUSE - 0.1 + SIGMA * normal(&mut rng)),
                false => view(&mut rng),
            })
            .collect()
    };
    const AT_5_PERCENT: f64 = 0.4;
    bites(
        "G05 5 %",
        bias(200, || least(&texel(0.05))).abs(),
        AT_5_PERCENT,
    );
    let found = bias(1000, || f64::from(estimate(&texel(0.05)).value[0]));
    holds("G05 5 %", found.abs(), AT_5_PERCENT);

    // With 20 % each texel is right on its own or says that it is in doubt.
    const AT_20_PERCENT: f64 = 0.5;
    bites(
        "G05 20 %",
        bias(200, || least(&texel(0.2))).abs(),
        AT_20_PERCENT,
    );
    let (mut silent, mut right) = (Vec::new(), 0);
    for _ in 0..1000 {
        let minimum = estimate(&texel(0.2));
        let error = (f64::from(minimum.value[0]) - DIFFUSE) / SIGMA;
        right += usize::from(error.abs() <= 1.0);
        if !minimum.ambiguous && minimum.confidence >= 1.0 {
            silent.push(error);
        }
    }
    let mean = silent.iter().sum::<f64>() / silent.len().max(1) as f64;
    println!(
        "G05 20 %: {} of 1000 unflagged, {right} within 1 σ",
        silent.len()
    );
    holds("G05 20 %", mean.abs(), AT_20_PERCENT);
}

#[test]
fn hc_g06_channels_come_from_the_same_views() {
    const TOLERANCE_DEG: f64 = 1.0;
    const COLOR: [f64; 3] = [0.4, 0.25, 0.1];
    let hue = |[r, g, b]: [f64; 3]| {
        (3.0_f64.sqrt() * (g - b))
            .atan2(2.0 * r - g - b)
            .to_degrees()
    };
    let truth = hue(COLOR);
    // Without sensor noise: shading and blue highlights only, so that each view has one of two hues.
    let mut rng = generator(206);
    let mut texel = || -> Vec<Sample> {
        let (mut samples, mut dark_red) = (Vec::new(), true);
        for _ in 0..40 {
            let is_highlight = uniform(&mut rng, 0.0, 1.0) < 0.4;
            let blue = if is_highlight {
                uniform(&mut rng, 0.3, 0.6)
            } else {
                0.0
            };
            // Half of the highlights fall on a neighbour with less red, and are brighter all the same.
            let red = if dark_red && is_highlight { 0.7 } else { 1.0 };
            dark_red = !dark_red;
            let level = 1.0 + 0.01 * normal(&mut rng);
            let linear = [
                COLOR[0] * red * level,
                COLOR[1] * level + 0.3 * blue,
                COLOR[2] * level + blue,
            ];
            samples.push(Sample {
                linear: linear.map(|c| c as f32),
                saturated: false,
                frame: 0,
            });
        }
        samples
    };
    let naive = |samples: &[Sample]| {
        let channel = |n: usize| {
            samples
                .iter()
                .map(|s| f64::from(s.linear[n]))
                .fold(1.0, f64::min)
        };
        [channel(0), channel(1), channel(2)]
    };
    bites("G06", (hue(naive(&texel())) - truth).abs(), TOLERANCE_DEG);
    let errors = (0..1000).map(|_| {
        let samples = texel();
        let minimum = robust_minimum(&samples, 0.003);
        (hue(minimum.value.map(f64::from)) - truth).abs()
    });
    holds("G06", errors.fold(0.0, f64::max), TOLERANCE_DEG);
}
