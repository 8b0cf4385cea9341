//! Structural similarity (Wang et al. 2004).

use super::require_within;
use crate::error::ImagingError;
use crate::image::{Image, Mask};

/// Half the width of the 11x11 window.
const REACH: usize = 5;

/// Standard deviation of the window, pixels.
const SIGMA: f64 = 1.5;

/// Stabilising constants K₁ and K₂ of the paper.
const K: [f64; 2] = [0.01, 0.03];

/// How far an encoded value may lie outside [0, 1]: rounding of a renderer, not another scale.
const RANGE_SLACK: f32 = 1e-3;

/// Mean SSIM of the luma (Rec. 709 weights on encoded values) of two views in [0, 1], L = 1.
///
/// Outside the mask both images are filled with the truth; windows are 11x11 with σ = 1.5, lie wholly inside
/// the image, and count when their centre is in the mask. `None` when no window does. Refuses images of
/// different sizes and values outside [0, 1] inside the mask: on another scale the constants would hide
/// every difference (hard-cases L03).
pub fn ssim(
    predicted: &Image<[f32; 3]>,
    truth: &Image<[f32; 3]>,
    mask: Option<&Mask>,
) -> Result<Option<f64>, ImagingError> {
    for (image, masked) in [(predicted, mask), (truth, mask)] {
        if let Some(mask) = masked {
            image.require_same_size(mask)?;
        }
        for y in 0..image.height() {
            for (x, pixel) in image.row(y).iter().enumerate() {
                if masked.is_some_and(|mask| !mask.row(y)[x]) {
                    continue;
                }
                for &value in pixel {
                    require_within(value, x as u32, y, -RANGE_SLACK, 1.0 + RANGE_SLACK)?;
                }
            }
        }
    }
    luma_ssim(&luma(predicted), &luma(truth), mask, 1.0)
}

/// Rec. 709 luma of encoded values.
pub fn luma(encoded: &Image<[f32; 3]>) -> Image<f64> {
    encoded.map(|[r, g, b]| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b))
}

/// Mean SSIM of two one-channel images whose values span `dynamic_range`, as [`ssim`]. The result is in
/// [−1, 1]. Values that are not finite inside a counted window are refused.
pub fn luma_ssim(
    predicted: &Image<f64>,
    truth: &Image<f64>,
    mask: Option<&Mask>,
    dynamic_range: f64,
) -> Result<Option<f64>, ImagingError> {
    predicted.require_same_size(truth)?;
    if let Some(mask) = mask {
        predicted.require_same_size(mask)?;
    }
    if !(dynamic_range.is_finite() && dynamic_range > 0.0) {
        return Err(ImagingError::Parameter {
            name: "dynamic range",
            value: dynamic_range,
            expected: "a finite number above 0",
        });
    }
    let width = predicted.width() as usize;
    let height = predicted.height() as usize;
    if width <= 2 * REACH || height <= 2 * REACH {
        return Ok(None);
    }
    let filled = filled_with_truth(predicted, truth, mask);
    // Variances do not change with the origin. One near the values keeps E[x²] − E[x]² from cancelling;
    // the means get it back.
    let origin = truth
        .pixels()
        .iter()
        .copied()
        .find(|v| v.is_finite())
        .unwrap_or(0.0);
    let moments = window_moments(&filled, truth, origin);
    let constants = K.map(|k| (k * dynamic_range) * (k * dynamic_range));
    let (mut sum, mut count) = (0.0, 0_u64);
    for (index, moments) in moments.iter().enumerate() {
        let (x, y) = (
            index % (width - 2 * REACH) + REACH,
            index / (width - 2 * REACH) + REACH,
        );
        if mask.is_none_or(|mask| mask.at(x as u32, y as u32)) {
            let value = window_ssim(*moments, origin, constants);
            if !value.is_finite() {
                let (x, y) = (x as u32, y as u32);
                return Err(ImagingError::ValueOutOfRange {
                    x,
                    y,
                    value: value as f32,
                    low: -1.0,
                    high: 1.0,
                });
            }
            sum += value;
            count += 1;
        }
    }
    Ok((count > 0).then(|| sum / count as f64))
}

fn filled_with_truth(
    predicted: &Image<f64>,
    truth: &Image<f64>,
    mask: Option<&Mask>,
) -> Image<f64> {
    let Some(mask) = mask else {
        return predicted.clone();
    };
    let mut filled = truth.clone();
    for ((target, &value), &inside) in filled
        .pixels_mut()
        .iter_mut()
        .zip(predicted.pixels())
        .zip(mask.pixels())
    {
        if inside {
            *target = value;
        }
    }
    filled
}

/// Weighted means of a, b, a², b², ab over one window, about the origin.
type Moments = [f64; 5];

/// SSIM = (2μₐμ_b + C₁)(2σ_ab + C₂) / ((μₐ² + μ_b² + C₁)(σₐ² + σ_b² + C₂)).
fn window_ssim([a, b, aa, bb, ab]: Moments, origin: f64, [c1, c2]: [f64; 2]) -> f64 {
    let (mean_a, mean_b) = (a + origin, b + origin);
    // Rounding may leave a variance just below 0.
    let variances = (aa - a * a).max(0.0) + (bb - b * b).max(0.0);
    let covariance = ab - a * b;
    let luminance = (2.0 * mean_a * mean_b + c1) / (mean_a * mean_a + mean_b * mean_b + c1);
    luminance * (2.0 * covariance + c2) / (variances + c2)
}

/// Gaussian-weighted moments of every window that lies inside the image, row by row; separable.
fn window_moments(a: &Image<f64>, b: &Image<f64>, origin: f64) -> Vec<Moments> {
    let weights = window();
    let width = a.width() as usize;
    let inner = width - 2 * REACH;
    let mut along_x: Vec<Vec<Moments>> = Vec::with_capacity(a.height() as usize);
    for y in 0..a.height() {
        let products: Vec<Moments> = a
            .row(y)
            .iter()
            .zip(b.row(y))
            .map(|(&a, &b)| {
                let (a, b) = (a - origin, b - origin);
                [a, b, a * a, b * b, a * b]
            })
            .collect();
        along_x.push(
            (0..inner)
                .map(|x| weighted_sum(&weights, |k| products[x + k]))
                .collect(),
        );
    }
    (0..a.height() as usize - 2 * REACH)
        .flat_map(|y| {
            let along_x = &along_x;
            (0..inner).map(move |x| weighted_sum(&weights, |k| along_x[y + k][x]))
        })
        .collect()
}

fn weighted_sum(weights: &[f64; 2 * REACH + 1], moments: impl Fn(usize) -> Moments) -> Moments {
    let mut sum = [0.0; 5];
    for (k, weight) in weights.iter().enumerate() {
        for (sum, value) in sum.iter_mut().zip(moments(k)) {
            *sum += weight * value;
        }
    }
    sum
}

fn window() -> [f64; 2 * REACH + 1] {
    let gauss: [f64; 2 * REACH + 1] = std::array::from_fn(|k| {
        let distance = k as f64 - REACH as f64;
        (-0.5 * distance * distance / (SIGMA * SIGMA)).exp()
    });
    let total: f64 = gauss.iter().sum();
    gauss.map(|value| value / total)
}
