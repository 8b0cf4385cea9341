//! Quantile regression with a rounded corner.
//!
//! Minimises Σ c(r) h(r) over the luminance m, r = luminance − m, with c = 1 − q below and q above
//! (q = 0.1) and the Huber function h of width δ = σ/2: r²/2δ inside, |r| − δ/2 outside. This is what
//! reweighted least squares with w = c(r)/max(|r|, δ) tends to; the same weights at the minimum average the
//! channels, so the hue is that of real samples (hard-cases G06).

#[cfg(test)]
mod tests;

/// Quantile that the estimate follows; above the share of dark outliers, below that of matte views.
const QUANTILE: f64 = 0.1;
/// Bias of the estimate in σ, the same for 5 to 1000 views (hard-cases, preamble of G). Re-derive it when
/// the quantile or δ change.
const BIAS_IN_SIGMA: f64 = 0.88;
/// Width of the bracket that ends the solve, in σ.
const LEAST_CHANGE_IN_SIGMA: f64 = 1e-5;
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
    let correction = BIAS_IN_SIGMA * sigma.min(spread_near(&luminances, minimum, sigma));
    RobustMinimum {
        value: shared_weight_mean(&used, minimum, sigma).map(|c| (c + correction) as f32),
        count: used.len() as u32,
        confidence: (doubt * (support as f64 / ENOUGH_SUPPORT as f64).min(1.0)) as f32,
        lower_bound,
        ambiguous,
        rejected_fraction: (samples.len() - used.len()) as f32 / samples.len() as f32,
    }
}

/// The minimiser of the cost over sorted luminances; the middle of them where the cost is flat (one of ten
/// samples below, nine above: 0.9 pulls each way).
///
/// The cost is convex, so its slope changes sign once, within δ of the 10 % quantile. Both ends of the
/// stretch without slope are bisected: nothing depends on a start, and nothing can oscillate (G01, G07).
fn quantile_fit(sorted: &[f64], sigma: f64) -> f64 {
    let delta = 0.5 * sigma;
    // With k samples below and the others above, the pull is 0.1 n − k: positive at `low`, negative at `high`.
    let share = QUANTILE * sorted.len() as f64;
    let last = sorted.len() - 1;
    let low = sorted[((share - 1e-9).ceil() as usize).saturating_sub(1)] - delta;
    let high = sorted[((share + 1e-9).floor() as usize).min(last)] + delta;
    // Sums of 0.9 and 0.1 that cancel leave rounding.
    let flat = 1e-9 * sorted.len() as f64;
    let end_where = |is_before: &dyn Fn(f64) -> bool| {
        let (mut before, mut after) = (low, high);
        while after - before > LEAST_CHANGE_IN_SIGMA * sigma {
            let middle = 0.5 * (before + after);
            // Neighbouring numbers: far from 0 their distance is all there is.
            if middle <= before || middle >= after {
                break;
            }
            if is_before(pull(sorted, middle, delta)) {
                before = middle;
            } else {
                after = middle;
            }
        }
        0.5 * (before + after)
    };
    0.5 * (end_where(&|pull| pull > flat) + end_where(&|pull| pull >= -flat))
}

/// Minus the slope of the cost at `minimum`: positive where samples pull upwards.
fn pull(luminances: &[f64], minimum: f64, delta: f64) -> f64 {
    luminances
        .iter()
        .map(|luminance| luminance - minimum)
        .map(|residual| sample_weight(residual, delta) * residual)
        .sum()
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

/// Distance between the outermost samples within 4σ of `minimum`. The bias that is added back never
/// exceeds it: equal samples have no noise to correct, and a lone one has no minimum (G01, G02).
fn spread_near(sorted: &[f64], minimum: f64, sigma: f64) -> f64 {
    let reach = OUTLIER_IN_SIGMA * sigma;
    let first = sorted.partition_point(|&l| l < minimum - reach);
    let end = sorted.partition_point(|&l| l <= minimum + reach);
    match sorted[first..end] {
        [lowest, .., highest] => highest - lowest,
        _ => 0.0,
    }
}

/// Whether some window of ±2σ, wholly more than 4σ above `minimum`, holds more than `support` samples and
/// at least a third of all.
fn has_larger_group_above(sorted: &[f64], minimum: f64, support: usize, sigma: f64) -> bool {
    let first = sorted.partition_point(|&l| l < minimum + OUTLIER_IN_SIGMA * sigma);
    let above = &sorted[first..];
    let needed = (support + 1)
        .max(ENOUGH_SUPPORT)
        .max(sorted.len().div_ceil(3));
    (0..above.len()).any(|low| {
        let high = above.partition_point(|&l| l <= above[low] + 4.0 * sigma);
        high - low >= needed
    })
}
