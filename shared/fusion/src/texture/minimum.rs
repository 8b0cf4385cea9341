//! Quantile regression by iteratively reweighted least squares.
//!
//! Minimises Σ c(r) h(r) over the luminance m, r = luminance − m, with c = 1 − q below and q above
//! (q = 0.1) and the Huber function h of width δ = σ/2: r²/2δ inside, |r| − δ/2 outside. The weights
//! w = c(r)/max(|r|, δ) are shared by the channels, so the hue is that of real samples (hard-cases G06).

/// Quantile that the estimate follows; above the share of dark outliers, below that of matte views.
const QUANTILE: f64 = 0.1;
/// Bias of the estimate in σ, the same for 5 to 1000 views (hard-cases, preamble of G). Re-derive it when
/// the quantile or δ change.
const BIAS_IN_SIGMA: f64 = 0.88;
/// Iterations and change (in σ) that end the solve.
const MOST_ITERATIONS: usize = 20;
const LEAST_CHANGE_IN_SIGMA: f64 = 1e-4;
/// Unsaturated samples from which saturated ones are dropped.
const ENOUGH_UNSATURATED: usize = 3;
/// Samples that must lie within ±2σ before darker ones can be outliers.
const ENOUGH_SUPPORT: usize = 5;
/// A sample this far below is an outlier, in σ.
const OUTLIER_IN_SIGMA: f64 = 4.0;

/// One view of a surface point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Linear RGB radiance, 1 = white level.
    pub linear: [f32; 3],
    /// Whether a channel was clipped.
    pub saturated: bool,
    /// Index of the frame it comes from.
    pub frame: u32,
}

impl Sample {
    /// Relative luminance (Rec. 709), linear.
    pub fn luminance(&self) -> f64 {
        let [r, g, b] = self.linear.map(f64::from);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }
}

/// The robust minimum of a surface point's views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RobustMinimum {
    /// Linear RGB; 0 when `count` is 0 (a hole).
    pub value: [f32; 3],
    /// Samples that the value rests on.
    pub count: u32,
    /// 0 to 1: samples within 2σ of the value, of five; halved when `lower_bound` or `ambiguous`.
    pub confidence: f32,
    /// Too few unsaturated samples: the true value is at least this.
    pub lower_bound: bool,
    /// A larger, tight group lies more than 4σ above the value: either most views are reflections, or
    /// more views than the quantile are shadowed. The samples cannot tell; the value follows the darker.
    pub ambiguous: bool,
    /// Share of the samples that were left out: not finite, saturated or dark outliers.
    pub rejected_fraction: f32,
}

/// Estimates the diffuse colour from `samples`; `sigma` is the standard deviation of a sample's luminance
/// noise (values below 1e-6 count as 1e-6).
///
/// Saturated samples are dropped when three unsaturated ones exist (G04). Samples more than 4σ below a
/// well supported estimate are dropped as outliers (G05). The bias of the quantile is added back, equally
/// to the channels, which keeps the hue angle.
pub fn robust_minimum(samples: &[Sample], sigma: f32) -> RobustMinimum {
    let sigma = f64::from(sigma).max(1e-6);
    let finite = || {
        samples
            .iter()
            .filter(|s| s.linear.iter().all(|c| c.is_finite()))
    };
    let mut used: Vec<(f64, &Sample)> = finite()
        .filter(|s| !s.saturated)
        .map(|s| (s.luminance(), s))
        .collect();
    let lower_bound = used.len() < ENOUGH_UNSATURATED && finite().any(|s| s.saturated);
    if lower_bound {
        used = finite().map(|s| (s.luminance(), s)).collect();
    }
    if used.is_empty() {
        return RobustMinimum {
            rejected_fraction: if samples.is_empty() { 0.0 } else { 1.0 },
            ..Default::default()
        };
    }
    used.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut luminances: Vec<f64> = used.iter().map(|(luminance, _)| *luminance).collect();
    let mut minimum = quantile_fit(&luminances, sigma);
    let support_of = |luminances: &[f64], m: f64| {
        luminances
            .iter()
            .filter(|l| (*l - m).abs() <= 2.0 * sigma)
            .count()
    };
    let outliers = luminances
        .iter()
        .filter(|l| **l < minimum - OUTLIER_IN_SIGMA * sigma)
        .count();
    if outliers > 0 && support_of(&luminances, minimum) >= ENOUGH_SUPPORT {
        luminances.drain(..outliers);
        used.drain(..outliers);
        minimum = quantile_fit(&luminances, sigma);
    }
    let support = support_of(&luminances, minimum + BIAS_IN_SIGMA * sigma);
    let ambiguous = has_larger_group_above(&luminances, minimum, support, sigma);
    let doubt = if lower_bound || ambiguous { 0.5 } else { 1.0 };
    RobustMinimum {
        value: shared_weight_mean(&used, minimum, sigma)
            .map(|c| (c + BIAS_IN_SIGMA * sigma) as f32),
        count: used.len() as u32,
        confidence: (doubt * (support as f64 / ENOUGH_SUPPORT as f64).min(1.0)) as f32,
        lower_bound,
        ambiguous,
        rejected_fraction: (samples.len() - used.len()) as f32 / samples.len() as f32,
    }
}

/// The minimiser of the cost over sorted luminances, from the 10 % quantile.
fn quantile_fit(sorted: &[f64], sigma: f64) -> f64 {
    let start = sorted[((sorted.len() - 1) as f64 * QUANTILE).round() as usize];
    middle_of_flat(sorted, descend(sorted, sigma, start, |_| {}), sigma)
}

/// Reweighted least squares from `start`. Each step is halved until the cost does not rise, because the
/// weight jumps with the sign of r and a full step can overshoot (G07). `watch` sees each cost.
fn descend(luminances: &[f64], sigma: f64, start: f64, mut watch: impl FnMut(f64)) -> f64 {
    let delta = 0.5 * sigma;
    let mut minimum = start;
    let mut cost = total_cost(luminances, minimum, delta);
    watch(cost);
    for _ in 0..MOST_ITERATIONS {
        let (mut weighted, mut weights) = (0.0, 0.0);
        for &luminance in luminances {
            let weight = sample_weight(luminance - minimum, delta);
            weighted += weight * luminance;
            weights += weight;
        }
        let mut step = weighted / weights - minimum;
        let mut next_cost = total_cost(luminances, minimum + step, delta);
        while next_cost > cost && step.abs() > 1e-12 * sigma {
            step *= 0.5;
            next_cost = total_cost(luminances, minimum + step, delta);
        }
        if next_cost > cost {
            break;
        }
        minimum += step;
        cost = next_cost;
        watch(cost);
        if step.abs() < LEAST_CHANGE_IN_SIGMA * sigma {
            break;
        }
    }
    minimum
}

/// Between two samples the cost can be flat (one of ten below, nine above: 0.9 pulls each way). The middle
/// of the flat stretch does not depend on where the descent came from.
fn middle_of_flat(sorted: &[f64], minimum: f64, sigma: f64) -> f64 {
    let delta = 0.5 * sigma;
    let slope: f64 = sorted
        .iter()
        .map(|l| sample_weight(l - minimum, delta) * (l - minimum))
        .sum();
    let below = sorted.partition_point(|&l| l < minimum);
    let is_flat = slope.abs() < 1e-9 * sorted.len() as f64 && below > 0 && below < sorted.len();
    if !is_flat || sorted[below - 1] + delta > minimum || sorted[below] - delta < minimum {
        return minimum;
    }
    0.5 * ((sorted[below - 1] + delta) + (sorted[below] - delta))
}

fn sample_weight(residual: f64, delta: f64) -> f64 {
    side(residual) / residual.abs().max(delta)
}

fn side(residual: f64) -> f64 {
    if residual < 0.0 {
        1.0 - QUANTILE
    } else {
        QUANTILE
    }
}

fn total_cost(luminances: &[f64], minimum: f64, delta: f64) -> f64 {
    let cost = |residual: f64| {
        let size = residual.abs();
        side(residual)
            * if size < delta {
                size * size / (2.0 * delta)
            } else {
                size - 0.5 * delta
            }
    };
    luminances
        .iter()
        .map(|luminance| cost(luminance - minimum))
        .sum()
}

/// The colour whose luminance is `minimum`: the mean with the final weights.
fn shared_weight_mean(used: &[(f64, &Sample)], minimum: f64, sigma: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut weights = 0.0;
    for (luminance, sample) in used {
        let weight = sample_weight(luminance - minimum, 0.5 * sigma);
        for (total, channel) in sum.iter_mut().zip(sample.linear) {
            *total += weight * f64::from(channel);
        }
        weights += weight;
    }
    sum.map(|total| total / weights)
}

/// Whether some window of ±2σ, wholly more than 4σ above `minimum`, holds more than twice `support`
/// samples and at least half of all.
fn has_larger_group_above(sorted: &[f64], minimum: f64, support: usize, sigma: f64) -> bool {
    let first = sorted.partition_point(|&l| l < minimum + OUTLIER_IN_SIGMA * sigma);
    let above = &sorted[first..];
    let needed = (2 * support + 1)
        .max(ENOUGH_SUPPORT)
        .max(sorted.len().div_ceil(2));
    (0..above.len()).any(|low| {
        let high = above.partition_point(|&l| l <= above[low] + 4.0 * sigma);
        high - low >= needed
    })
}
