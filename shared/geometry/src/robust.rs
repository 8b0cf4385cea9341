//! Robust statistics: medians, quantiles, weighted medians, scale from the median absolute deviation.

/// Scale of the median absolute deviation to the standard deviation of a normal distribution.
pub const MAD_TO_SIGMA: f64 = 1.4826;

/// The `q`-quantile, q in [0, 1], linear between order statistics. `values` are sorted, NaN among them
/// are removed; `None` when nothing is left.
pub fn quantile(values: &mut Vec<f64>, q: f64) -> Option<f64> {
    values.retain(|v| !v.is_nan());
    if values.is_empty() {
        return None;
    }
    values.sort_unstable_by(f64::total_cmp);
    let position = q.clamp(0.0, 1.0) * (values.len() - 1) as f64;
    let low = position.floor() as usize;
    let high = (low + 1).min(values.len() - 1);
    let fraction = position - position.floor();
    if fraction == 0.0 {
        // An infinite neighbour times a weight of 0 is NaN.
        return Some(values[low]);
    }
    Some(values[low] * (1.0 - fraction) + values[high] * fraction)
}

/// The median of `values`, which are sorted; NaN among them are removed; `None` when nothing is left.
pub fn median(values: &mut Vec<f64>) -> Option<f64> {
    quantile(values, 0.5)
}

/// The weighted median of `(value, weight)` pairs: the smallest value at which half of the weight is
/// reached. Pairs with a NaN value, or a NaN or non-positive weight, are removed, the others sorted; `None`
/// when nothing is left.
pub fn weighted_median(pairs: &mut Vec<(f64, f64)>) -> Option<f64> {
    pairs.retain(|(value, weight)| !value.is_nan() && *weight > 0.0);
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = pairs.iter().map(|(_, weight)| weight).sum();
    let mut reached = 0.0;
    for &(value, weight) in pairs.iter() {
        reached += weight;
        if reached >= 0.5 * total {
            return Some(value);
        }
    }
    None
}

/// Robust scale: 1.4826 · median |value − median|, never below `floor` (hard-cases C07).
/// `None` when `values` holds no number.
pub fn mad_sigma(values: &[f64], floor: f64) -> Option<f64> {
    let center = median(&mut values.to_vec())?;
    let mut deviations: Vec<f64> = values.iter().map(|v| (v - center).abs()).collect();
    Some((MAD_TO_SIGMA * median(&mut deviations)?).max(floor))
}
