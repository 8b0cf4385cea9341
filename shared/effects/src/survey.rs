//! What the survey measured: the numbers that all decisions of a run share.

use serde::{Deserialize, Serialize};

/// Codes of the full range: linear radiance times this is compared with thresholds in codes.
pub const CODES: f64 = 255.0;

/// Mean of |x| over σ for a Gaussian, √(2/π): noise as it shows in an L1 error.
pub const L1_OF_SIGMA: f64 = 0.797_884_560_802_865_4;

/// Numbers of the survey, part of `effects.json`. Radiance in codes (255 = white level).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurveyNumbers {
    /// Frames that were looked at.
    pub frames: usize,
    /// Width and height at which they were looked at, pixels.
    pub size: [u32; 2],
    /// Share of their pixels that show the object (Ω).
    pub mask_fraction: f64,
    /// Noise of a pixel, standard deviation, averaged over Ω.
    pub sigma_codes: f64,
    /// The same as mean absolute error, N₀.
    pub n0_codes: f64,
    /// Signed view dependence E_skew.
    pub eskew_codes: f64,
    /// View dependence of tiles E_tile.
    pub etile_codes: f64,
    /// Residual misregistration, pixels of the survey's size.
    pub delta_px: f64,
    /// View dependence that misregistration could fake.
    pub emis_codes: f64,
    /// Share of Ω whose mirrored ray meets the surface again.
    pub p_hit: f64,
    /// Share of Ω that is clipped.
    pub p_saturated: f64,
    /// Correlation time of a frame's error, recorded frames.
    pub tau_frames: f64,
    /// Blocks that the recording is long enough for, 0 when it is too short for an honest probe.
    pub blocks: usize,
    /// Core-seconds that the survey took.
    pub seconds: f64,
    /// Seed.
    pub seed: u64,
}
