//! Image error measures, masked, in f64 (effects-and-tradeoffs.md C1 and C2).
//!
//! Views are compared in sRGB-encoded or camera-encoded values in [0, 1] ([`crate::srgb::encoded_from_rgb8`]),
//! maps in linear radiance: the two differ by several dB (hard-cases L13). A mask marks the pixels that count;
//! `None` counts all. An empty set has no measure: `None`, never 0 or NaN.

mod correlation;
mod highlights;
mod structure;
mod summary;
#[cfg(test)]
mod tests;

pub use correlation::{MapSample, MapScore, log_rmse, map_score, weighted_pearson};
pub use highlights::{HighlightEnergy, highlight_energy, highlight_ratio};
pub use structure::{luma, luma_ssim, ssim};
pub use summary::{Better, Summary};

use crate::error::ImagingError;
use crate::image::{Image, Mask};

/// The largest PSNR that is reported, dB: equal images have no finite one, and JSON no infinity
/// (hard-cases L01).
pub const PSNR_CAP: f64 = 100.0;

/// A peak signal to noise ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Psnr {
    /// Decibel, at most [`PSNR_CAP`].
    pub db: f64,
    /// Whether the cap replaced a larger or infinite value.
    pub capped: bool,
}

/// Squared error of one or more images, to be pooled before it becomes dB.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SquaredError {
    /// Sum of squared differences over pixels and channels.
    pub sum: f64,
    /// Number of differences in the sum.
    pub sample_count: u64,
}

impl SquaredError {
    /// Pools with another image's error.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            sample_count: self.sample_count + other.sample_count,
        }
    }

    /// Mean squared error; `None` of nothing.
    pub fn mse(&self) -> Option<f64> {
        (self.sample_count > 0).then(|| self.sum / self.sample_count as f64)
    }

    /// PSNR of the pooled error for values with peak 1; `None` of nothing.
    pub fn psnr(&self) -> Option<Psnr> {
        self.mse().map(capped_psnr)
    }
}

/// Mean absolute difference over the pixels of `mask` and the three channels, in the images' unit.
/// Refuses images of different sizes and values that are not finite inside the mask.
pub fn l1(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<Option<f64>, ImagingError> {
    let (sum, count) = sum_over(predicted, truth, mask, f64::abs)?;
    Ok((count > 0).then(|| sum / count as f64))
}

/// Mean squared difference, as [`l1`].
pub fn mse(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<Option<f64>, ImagingError> {
    Ok(squared_error(predicted, truth, mask)?.mse())
}

/// Squared difference with its count, for pooling over frames, as [`l1`].
pub fn squared_error(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<SquaredError, ImagingError> {
    let (sum, sample_count) =
        sum_over(predicted, truth, mask, |difference| difference * difference)?;
    Ok(SquaredError { sum, sample_count })
}

/// PSNR of one image with values in [0, 1], as [`l1`]. Over several frames pool [`squared_error`] instead:
/// averaging dB favours easy frames.
pub fn psnr(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<Option<Psnr>, ImagingError> {
    Ok(squared_error(predicted, truth, mask)?.psnr())
}

/// 10 log₁₀(1 / `mse`) in dB for values with peak 1, at most [`PSNR_CAP`]; NaN for NaN.
pub fn psnr_from_mse(mse: f64) -> f64 {
    capped_psnr(mse).db
}

fn capped_psnr(mse: f64) -> Psnr {
    let db = -10.0 * mse.log10();
    if db > PSNR_CAP {
        Psnr {
            db: PSNR_CAP,
            capped: true,
        }
    } else {
        Psnr { db, capped: false }
    }
}

fn sum_over(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: Option<&Mask>,
    measure: impl Fn(f64) -> f64,
) -> Result<(f64, u64), ImagingError> {
    predicted.require_same_size(truth)?;
    if let Some(mask) = mask {
        predicted.require_same_size(mask)?;
    }
    let (mut sum, mut count) = (0.0, 0);
    for y in 0..predicted.height() {
        let marks = mask.map(|mask| mask.row(y));
        for (x, (p, t)) in predicted.row(y).iter().zip(truth.row(y)).enumerate() {
            if marks.is_some_and(|marks| !marks[x]) {
                continue;
            }
            for (&p, &t) in p.iter().zip(t) {
                for value in [p, t] {
                    require_within(value, x as u32, y, f32::MIN, f32::MAX)?;
                }
                sum += measure(f64::from(p) - f64::from(t));
                count += 1;
            }
        }
    }
    Ok((sum, count))
}

fn require_within(value: f32, x: u32, y: u32, low: f32, high: f32) -> Result<(), ImagingError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(ImagingError::ValueOutOfRange {
        x,
        y,
        value,
        low,
        high,
    })
}
