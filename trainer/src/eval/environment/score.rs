//! What is scored and how (srm-feasibility.md section 1, items 2 to 8).

use geometry::{PanoramaSize, robust};
use imaging::measures;
use serde::{Deserialize, Serialize};

use super::OnGrid;
use super::grid::Grid;

/// Texels with truth in this range set the scale.
const SCALE_RANGE: std::ops::Range<f64> = 0.02..0.9;

/// One score: clipped correlation and logarithmic error at one common scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Weighted Pearson of the clipped luminances; 0 where undefined.
    pub corr: f64,
    /// Root mean square of the difference of natural logarithms.
    pub log_rmse: f64,
    /// Pearson of the logarithms.
    pub log_corr: f64,
    /// The scale that fits the map to the truth.
    pub scale: f64,
    /// Share of the reach's solid angle that was scored.
    pub coverage: f64,
}

/// Texels that are scored, with their weights.
pub(super) struct Domain {
    /// Index and weight of each texel.
    pub(super) texels: Vec<(usize, f64)>,
    pub(super) weight: f64,
    reach_weight: f64,
}

impl Domain {
    /// Item 2: texels of the upper half that are in reach and claimed.
    pub(super) fn new(size: PanoramaSize, reach: &[f64], confidence: &[f64]) -> Self {
        let width = size.width() as usize;
        let mut domain = Self {
            texels: Vec::new(),
            weight: 0.0,
            reach_weight: 0.0,
        };
        for index in 0..size.texel_count() / 2 {
            if reach[index] < 0.5 {
                continue;
            }
            let weight = size.latitude((index / width) as u32).cos();
            domain.reach_weight += weight;
            if confidence[index] >= 0.5 {
                domain.weight += weight;
                domain.texels.push((index, weight));
            }
        }
        domain
    }
}

/// Weight of the whole upper half.
pub(super) fn hemisphere_weight(size: PanoramaSize) -> f64 {
    (0..size.height() / 2)
        .map(|row| size.latitude(row).cos() * f64::from(size.width()))
        .sum()
}

pub(super) fn luminance(value: [f64; 3]) -> f64 {
    srm::rows::luminance(value)
}

/// Items 6 to 8; `fixed_scale` stands in for the fitted one.
pub(super) fn score(domain: &Domain, map: &Grid, truth: &Grid, fixed_scale: Option<f64>) -> Score {
    let coverage = if domain.reach_weight > 0.0 {
        domain.weight / domain.reach_weight
    } else {
        0.0
    };
    let mut ratios = Vec::new();
    for &(index, weight) in &domain.texels {
        let (s, t) = (luminance(map[index]).max(0.0), luminance(truth[index]));
        if SCALE_RANGE.contains(&t) && t > SCALE_RANGE.start && s > 0.0 {
            ratios.push(((t / s).ln(), weight));
        }
    }
    let scale = fixed_scale
        .or_else(|| robust::weighted_median(&mut ratios).map(f64::exp))
        .unwrap_or(1.0);
    let logarithms: Vec<(f64, f64, f64)> = domain
        .texels
        .iter()
        .map(|&(index, weight)| {
            let [a, b] = logarithms(map[index], truth[index], scale);
            (a, b, weight)
        })
        .collect();
    let sum: f64 = domain.weight.max(1e-300);
    let square: f64 = logarithms
        .iter()
        .map(|(a, b, w)| w * (a - b) * (a - b))
        .sum();
    Score {
        corr: clipped_corr(&domain.texels, map, truth, scale),
        log_rmse: (square / sum).sqrt(),
        log_corr: measures::weighted_pearson(&logarithms).unwrap_or(0.0),
        scale,
        coverage,
    }
}

/// Logarithms of the clipped luminances of map and truth.
fn logarithms(map: [f64; 3], truth: [f64; 3], scale: f64) -> [f64; 2] {
    let a = (scale * luminance(map).max(0.0)).clamp(0.0, 1.0);
    let b = luminance(truth).clamp(0.0, 1.0);
    [a.max(0.01).ln(), b.max(0.01).ln()]
}

/// The squared logarithmic error of `count` equal parts of longitude, weighted so that their mean is the square of
/// [`Score::log_rmse`]; 0 where nothing is scored.
pub(super) fn log_square_sectors(
    domain: &Domain,
    map: &Grid,
    truth: &Grid,
    scale: f64,
    size: PanoramaSize,
    count: usize,
) -> Vec<f64> {
    let width = size.width() as usize;
    let mut sectors = vec![0.0; count];
    for &(index, weight) in &domain.texels {
        let [a, b] = logarithms(map[index], truth[index], scale);
        sectors[index % width * count / width] += weight * (a - b) * (a - b);
    }
    let share = count as f64 / domain.weight.max(1e-300);
    sectors.iter().map(|sum| share * sum).collect()
}

/// The correlation of [`score`] over some texels with their weights, at a given scale; 0 where undefined.
pub(super) fn clipped_corr(texels: &[(usize, f64)], map: &Grid, truth: &Grid, scale: f64) -> f64 {
    let pairs: Vec<(f64, f64, f64)> = texels
        .iter()
        .map(|&(index, weight)| {
            let a = (scale * luminance(map[index]).max(0.0)).clamp(0.0, 1.0);
            (a, luminance(truth[index]).clamp(0.0, 1.0), weight)
        })
        .collect();
    measures::weighted_pearson(&pairs).unwrap_or(0.0)
}

/// Share of the claimed solid angle whose truth lies within 1.64 σ of the map.
pub(super) fn within_sigma(domain: &Domain, estimate: &OnGrid, truth: &Grid, scale: f64) -> f64 {
    let (map, sigma) = (&estimate.map, &estimate.sigma);
    let inside: f64 = domain
        .texels
        .iter()
        .filter(|(index, _)| {
            let (s, t) = (scale * luminance(map[*index]), luminance(truth[*index]));
            // Above the white level a capture cannot know: both sides are clipped.
            (s.min(1.0) - t.min(1.0)).abs() <= 1.64 * scale * luminance(sigma[*index])
        })
        .map(|(_, weight)| weight)
        .sum();
    if domain.weight > 0.0 {
        inside / domain.weight
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::environment::grid::grid_size;
    use crate::eval::environment::nulls::turned_quarters;

    #[test]
    fn a_true_map_scores_one_and_scale_does_not_matter() {
        let size = grid_size();
        let truth: Grid = (0..size.texel_count())
            .map(|i| [0.1 + 0.6 * ((i % 128) as f64 / 128.0); 3])
            .collect();
        let ones = vec![1.0; size.texel_count()];
        let domain = Domain::new(size, &ones, &ones);
        let same = score(&domain, &truth, &truth, None);
        assert!(same.corr > 1.0 - 1e-12 && same.log_rmse < 1e-12);
        let brighter: Grid = truth.iter().map(|v| v.map(|v| 7.0 * v)).collect();
        let scaled = score(&domain, &brighter, &truth, None);
        assert!(
            (scaled.corr - same.corr).abs() < 1e-9
                && (scaled.log_rmse - same.log_rmse).abs() < 1e-9
        );
        let turned = score(&domain, &turned_quarters(&truth, size, 1), &truth, None);
        assert!(turned.corr < 0.6);
    }

    #[test]
    fn the_mean_of_the_sectors_is_the_square_of_the_error() {
        let size = grid_size();
        let value = |i: usize| 0.05 + 0.9 * ((i * 37 % 101) as f64 / 101.0);
        let truth: Grid = (0..size.texel_count()).map(|i| [value(i); 3]).collect();
        let map: Grid = (0..size.texel_count()).map(|i| [value(i + 3); 3]).collect();
        let ones = vec![1.0; size.texel_count()];
        // Nothing is in reach on one side: parts without a texel count as without an error.
        let reach: Vec<f64> = (0..size.texel_count())
            .map(|i| if i % 128 < 90 { 1.0 } else { 0.0 })
            .collect();
        let domain = Domain::new(size, &reach, &ones);
        let whole = score(&domain, &map, &truth, None);
        let sectors = log_square_sectors(&domain, &map, &truth, whole.scale, size, 10);
        let mean = sectors.iter().sum::<f64>() / 10.0;
        assert!((mean - whole.log_rmse * whole.log_rmse).abs() < 1e-12);
        assert!(sectors[0] > 0.0 && sectors[9] == 0.0);
    }

    #[test]
    fn a_constant_map_has_no_correlation() {
        let size = grid_size();
        let truth: Grid = (0..size.texel_count())
            .map(|i| [0.1 + (i % 7) as f64 * 0.1; 3])
            .collect();
        let ones = vec![1.0; size.texel_count()];
        let domain = Domain::new(size, &ones, &ones);
        let constant = score(&domain, &vec![[0.3; 3]; size.texel_count()], &truth, None);
        assert_eq!(constant.corr, 0.0);
        assert!(constant.log_rmse > 0.1);
    }
}
