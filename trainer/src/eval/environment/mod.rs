//! The environment score, exactly as srm-feasibility.md section 1 and effects-and-tradeoffs.md C1 define it.
//!
//! Map: `grid` brings maps to 128 x 64 · `lobe` makes the truth that a surface reflects · `score` compares ·
//! `nulls` are maps without detail · `bars` is the finest resolved bar.

mod bars;
mod grid;
mod lobe;
mod nulls;
mod score;
#[cfg(test)]
mod tests;

use std::path::Path;

use anyhow::Context as _;
use geometry::{DQuat, rotation};
use imaging::{ConfidenceMap, LinearImage, read_channel_exr, read_confidence_exr, read_rgb_exr};
use serde::{Deserialize, Serialize};

pub use bars::{BarKind, BarScore, BarWidth};
pub use nulls::{NullScore, NullVerdict};
pub use score::Score;

use grid::{Grid, block_mean, grid_map, grid_scalar, grid_size, turned};
use score::{Domain, hemisphere_weight, log_square_sectors, score, within_sigma};

/// The environment's figures.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EnvironmentMetrics {
    /// GGX width of the lobe that the truth was blurred with.
    pub truth_alpha: f64,
    /// Angle by which the map was turned into the axes of the poses `source`, degrees: the alignment of the
    /// trajectory it was trained from. Absent where it was trained from `source`, or the recording has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_rotation_deg: Option<f64>,
    /// Correlation over claimed texels, against the lobe.
    pub env_corr: f64,
    /// Logarithmic error over claimed texels.
    pub env_log_rmse: f64,
    /// Share of the reach that is claimed.
    pub coverage: f64,
    /// Share of the upper hemisphere that is claimed.
    pub coverage_hemisphere: f64,
    /// Correlation over the whole reach.
    pub env_corr_reach: f64,
    /// Logarithmic error over the whole reach.
    pub env_log_rmse_reach: f64,
    /// Scale over the whole reach.
    pub scale_reach: f64,
    /// Squared logarithmic error of each tenth of longitude over the reach, from the first column on, weighted so
    /// that their mean is the square of `env_log_rmse_reach`; 0 where nothing is in reach.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub env_log_square_sectors: Vec<f64>,
    /// Correlation a channel over the whole reach, one scale a channel.
    pub env_corr_rgb: [f64; 3],
    /// Against the truth without blur, whole reach, for information.
    pub sharp: Score,
    /// A constant map, whole reach.
    pub constant: Score,
    /// The true lobe map turned by 90 degrees in yaw, whole reach.
    pub turned: Score,
    /// Share of claimed texels whose truth lies within 1.64 σ.
    pub within_sigma_fraction: f64,
    /// Maps that show no detail, beside the map.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nulls: Vec<NullScore>,
    /// The map against the best null over claimed texels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<NullVerdict>,
    /// The map against the best null over the whole reach.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict_reach: Option<NullVerdict>,
    /// Width of the finest bars that are resolved in longitude, degrees; absent without `bars.json`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub env_bar_deg_h: Option<BarWidth>,
    /// Width of the finest bars that are resolved in latitude, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub env_bar_deg_v: Option<BarWidth>,
    /// Every group of bars.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bars: Vec<BarScore>,
}

/// Parts of longitude whose errors are given one by one.
const SECTOR_COUNT: usize = 10;

/// Scores `srm` with `confidence` against the `truth` folder of a plain folder. `truth_from_map` turns the map's
/// directions into those of the truth, where they differ.
pub fn evaluate(
    srm: &Path,
    confidence: &Path,
    truth: &Path,
    truth_from_map: Option<DQuat>,
    alpha: f64,
    fixed_scale: Option<f64>,
) -> anyhow::Result<EnvironmentMetrics> {
    let estimate = Estimate::read(srm, confidence)?;
    let on_grid = estimate.on_grid(truth_from_map);
    let size = grid_size();
    let (environment, _) = read_rgb_exr(&truth.join("environment.exr"))
        .with_context(|| format!("no readable truth in {}", truth.display()))?;
    let reach = read_channel_exr(&truth.join("reach.exr"), None)
        .context("reading the reach of the truth")?;
    let reach = grid_scalar(&reach, size);
    let lobe = lobe::lobe_map(&environment, size, alpha);
    let claimed = Domain::new(size, &reach, &on_grid.confidence);
    let whole = Domain::new(size, &reach, &vec![1.0; size.texel_count()]);
    let score = |domain: &Domain, map: &Grid, truth: &Grid| score(domain, map, truth, fixed_scale);
    let on_claimed = score(&claimed, &on_grid.map, &lobe);
    let on_reach = score(&whole, &on_grid.map, &lobe);
    let null_maps = nulls::null_maps(&environment, &lobe, size);
    let nulls = nulls::null_scores(&null_maps, &lobe, size, &claimed, &whole, fixed_scale);
    let bars = bars::judge(&estimate.view(truth_from_map, on_claimed.scale), truth)?;
    let of_channel = |channel: usize| {
        let only = |grid: &Grid| grid.iter().map(|v| [v[channel]; 3]).collect::<Grid>();
        score(&whole, &only(&on_grid.map), &only(&lobe)).corr
    };
    Ok(EnvironmentMetrics {
        truth_alpha: alpha,
        map_rotation_deg: truth_from_map.map(|q| rotation::log(q).length().to_degrees()),
        env_corr: on_claimed.corr,
        env_log_rmse: on_claimed.log_rmse,
        coverage: on_claimed.coverage,
        coverage_hemisphere: claimed.weight / hemisphere_weight(size),
        env_corr_reach: on_reach.corr,
        env_log_rmse_reach: on_reach.log_rmse,
        scale_reach: on_reach.scale,
        env_log_square_sectors: log_square_sectors(
            &whole,
            &on_grid.map,
            &lobe,
            on_reach.scale,
            size,
            SECTOR_COUNT,
        ),
        env_corr_rgb: [0, 1, 2].map(of_channel),
        sharp: score(&whole, &on_grid.map, &block_mean(&environment, size)),
        constant: nulls[nulls::CONSTANT].reach,
        turned: nulls[nulls::TURNED].reach,
        within_sigma_fraction: within_sigma(&claimed, &on_grid, &lobe, on_claimed.scale),
        verdict: nulls::verdict_claimed(on_claimed.corr, &nulls),
        verdict_reach: nulls::verdict_reach(on_reach.corr, &nulls),
        nulls,
        env_bar_deg_h: bars::finest(&bars, BarKind::Horizontal),
        env_bar_deg_v: bars::finest(&bars, BarKind::Vertical),
        bars,
    })
}

/// The map that is judged, in its own axes.
struct Estimate {
    map: LinearImage,
    confidence: ConfidenceMap,
}

/// The map on the grid, in the axes of the truth.
struct OnGrid {
    map: Grid,
    sigma: Grid,
    confidence: Vec<f64>,
}

impl Estimate {
    fn read(srm: &Path, confidence: &Path) -> anyhow::Result<Self> {
        let (map, _) = read_rgb_exr(srm)?;
        let confidence = read_confidence_exr(confidence)?;
        Ok(Self { map, confidence })
    }

    fn on_grid(&self, truth_from_map: Option<DQuat>) -> OnGrid {
        let turn =
            |map: &LinearImage| truth_from_map.map_or_else(|| map.clone(), |q| turned(map, q));
        let turned_confidence = turn(&self.confidence.confidence.map(|c| [c; 3])).map(|c| c[0]);
        // Where nothing was seen sigma is infinite, which has no mean.
        let sigma = self
            .confidence
            .sigma
            .map(|s| s.map(|v| if v.is_finite() { v } else { 10.0 }));
        let (map, confidence) = grid_map(&turn(&self.map), &turned_confidence, grid_size());
        let (sigma, _) = grid_map(&turn(&sigma), &turned_confidence, grid_size());
        OnGrid {
            map,
            sigma,
            confidence,
        }
    }

    fn view(&self, truth_from_map: Option<DQuat>, scale: f64) -> bars::MapView<'_> {
        bars::MapView {
            map: &self.map,
            confidence: &self.confidence.confidence,
            truth_from_map: truth_from_map.unwrap_or(DQuat::IDENTITY),
            scale,
        }
    }
}
