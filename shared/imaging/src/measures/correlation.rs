//! Weighted correlation, logarithmic error and the score of an environment map.

use geometry::robust::weighted_median;

/// Darkest value told apart by the logarithmic error, shares of the white level (hard-cases L04).
const DARKEST: f64 = 0.01;

/// Truth between these bounds decides the one scale of a map.
const SCALE_RANGE: std::ops::Range<f64> = 0.02..0.9;

/// A variance below this share of the squared mean is rounding, not variation (hard-cases L02).
const SMALLEST_RELATIVE_VARIANCE: f64 = 1e-12;

/// Weighted Pearson correlation of `(a, b, weight)`, two passes in f64.
///
/// `None` when it is undefined: no positive weight, a value that is not finite, or a side that is constant
/// (variance below 1e-12 · mean², hard-cases L02). Pairs with a weight that is not positive are left out.
pub fn weighted_pearson(pairs: &[(f64, f64, f64)]) -> Option<f64> {
    let used = || pairs.iter().filter(|(_, _, weight)| *weight > 0.0);
    let total: f64 = used().map(|(_, _, w)| w).sum();
    if !total.is_finite() || total <= 0.0 {
        return None;
    }
    let mean_a: f64 = used().map(|(a, _, w)| w * a).sum::<f64>() / total;
    let mean_b: f64 = used().map(|(_, b, w)| w * b).sum::<f64>() / total;
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b, weight) in used() {
        let (da, db) = (a - mean_a, b - mean_b);
        aa += weight * da * da;
        bb += weight * db * db;
        ab += weight * da * db;
    }
    let varies = |sum: f64, mean: f64| {
        let variance = sum / total;
        variance.is_finite()
            && variance > 0.0
            && variance >= SMALLEST_RELATIVE_VARIANCE * mean * mean
    };
    // Rounding can carry |r| past 1 by an ulp; the clamp keeps a NaN, which the checks before exclude.
    (varies(aa, mean_a) && varies(bb, mean_b))
        .then(|| (ab / (aa.sqrt() * bb.sqrt())).clamp(-1.0, 1.0))
}

/// Weighted root mean square of ln max(a, 0.01) − ln max(b, 0.01) over `(a, b, weight)`, both clipped to
/// [0, 1] (1 = white level). `None` when there is no positive weight or a value is NaN.
pub fn log_rmse(pairs: &[(f64, f64, f64)]) -> Option<f64> {
    let (mut sum, mut total) = (0.0, 0.0);
    for (a, b, weight) in pairs.iter().filter(|(_, _, weight)| *weight > 0.0) {
        let difference = log_of(*a) - log_of(*b);
        sum += weight * difference * difference;
        total += weight;
    }
    let square = sum / total;
    square.is_finite().then(|| square.sqrt())
}

/// ln of a value clipped to [0.01, 1]. `clamp` keeps NaN, so it reaches the sum and is noticed.
fn log_of(value: f64) -> f64 {
    value.clamp(DARKEST, 1.0).ln()
}

/// One texel of a map beside its truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSample {
    /// The estimate, in any unit.
    pub estimate: f64,
    /// The truth, 1 = white level.
    pub truth: f64,
    /// Weight, cos lat for a texel of a panorama.
    pub weight: f64,
}

/// How well a map agrees with its truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapScore {
    /// exp(weighted median of ln(truth / estimate)) over truth in (0.02, 0.9) and positive estimates; `None`
    /// where there is no such texel (a black map): then the other figures are those of scale 1.
    pub scale: Option<f64>,
    /// Correlation of the clipped values; `None` when undefined.
    pub corr: Option<f64>,
    /// [`log_rmse`] of the scaled estimate.
    pub log_rmse: f64,
    /// Correlation of the logarithms; `None` when undefined.
    pub log_corr: Option<f64>,
}

/// The score of srm-feasibility.md section 1, items 6 to 8: one scale, then everything clipped to [0, 1].
/// Negative estimates count as 0. `None` without a positive weight, or when a value is not finite.
pub fn map_score(samples: &[MapSample]) -> Option<MapScore> {
    if samples
        .iter()
        .any(|s| !(s.estimate.is_finite() && s.truth.is_finite() && s.weight.is_finite()))
    {
        return None;
    }
    let mut ratios: Vec<(f64, f64)> = samples
        .iter()
        .filter(|s| s.truth > SCALE_RANGE.start && s.truth < SCALE_RANGE.end && s.estimate > 0.0)
        .map(|s| ((s.truth / s.estimate).ln(), s.weight))
        .collect();
    let scale = weighted_median(&mut ratios).map(f64::exp);
    let factor = scale.unwrap_or(1.0);
    let clipped: Vec<(f64, f64, f64)> = samples
        .iter()
        .map(|s| {
            (
                (factor * s.estimate).clamp(0.0, 1.0),
                s.truth.clamp(0.0, 1.0),
                s.weight,
            )
        })
        .collect();
    let logarithms: Vec<(f64, f64, f64)> = clipped
        .iter()
        .map(|&(a, b, weight)| (log_of(a), log_of(b), weight))
        .collect();
    Some(MapScore {
        scale,
        corr: weighted_pearson(&clipped),
        log_rmse: log_rmse(&clipped)?,
        log_corr: weighted_pearson(&logarithms),
    })
}
