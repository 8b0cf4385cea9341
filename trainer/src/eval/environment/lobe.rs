//! The truth as a surface reflects it, and the truth out of focus.

use geometry::{DVec2, PanoramaSize};
use imaging::LinearImage;
use rayon::prelude::*;

use super::grid::{Grid, block_mean};

/// Rows that the truth is averaged to before the lobe is applied (256 x 128).
const LOBE_HEIGHT: u32 = 128;

/// From this many variances below the peak a blur weighs nothing: e⁻¹⁸ is 1.5e-8.
const BLUR_REACH: f64 = 18.0;

/// Item 5: the truth convolved with the GGX lobe of width `alpha`, over all texels of its 256 x 128 mean. Black in
/// the lower half, which is never scored.
pub(super) fn lobe_map(environment: &LinearImage, size: PanoramaSize, alpha: f64) -> Grid {
    let fine = PanoramaSize::from_height(LOBE_HEIGHT).expect("128 rows make a panorama");
    convolved(environment, fine, size, |cosine| {
        (cosine > 0.0).then(|| lobe_kernel(cosine, alpha))
    })
}

/// The truth blurred by exp((cos θ − 1)/σ²), nearly a Gaussian, of the given full width at half maximum. As
/// [`lobe_map`] in all else.
pub(super) fn blurred_map(environment: &LinearImage, size: PanoramaSize, width_deg: f64) -> Grid {
    // Half of the maximum stands at θ = σ √(2 ln 2).
    let sigma = 0.5 * width_deg.to_radians() / (2.0 * 2.0_f64.ln()).sqrt();
    convolved(environment, size, size, |cosine| {
        let exponent = (cosine - 1.0) / (sigma * sigma);
        (exponent > -BLUR_REACH).then(|| exponent.exp())
    })
}

/// Σ k(cos θ) E dΩ / Σ k dΩ over all texels of the mean of `environment` on `fine`; `None` of the kernel is 0.
fn convolved(
    environment: &LinearImage,
    fine: PanoramaSize,
    size: PanoramaSize,
    kernel: impl Fn(f64) -> Option<f64> + Sync,
) -> Grid {
    let mean = block_mean(environment, fine);
    let direction = |size: PanoramaSize, index: usize| {
        let width = size.width() as usize;
        size.direction_from_texel(DVec2::new((index % width) as f64, (index / width) as f64))
    };
    let sources: Vec<_> = (0..fine.texel_count())
        .map(|index| {
            let row = (index / fine.width() as usize) as u32;
            (direction(fine, index), mean[index], fine.solid_angle(row))
        })
        .collect();
    (0..size.texel_count())
        .into_par_iter()
        .map(|index| {
            if index >= size.texel_count() / 2 {
                return [0.0; 3];
            }
            let axis = direction(size, index);
            let (mut sum, mut weight) = ([0.0; 3], 0.0);
            for (direction, radiance, solid_angle) in &sources {
                let Some(k) = kernel(axis.dot(*direction)) else {
                    continue;
                };
                let k = k * solid_angle;
                weight += k;
                for c in 0..3 {
                    sum[c] += k * radiance[c];
                }
            }
            sum.map(|s| s / weight)
        })
        .collect()
}

/// k = D(θ/2) max(cos θ, 0) with D(x) = 1/(cos⁴x (1 + tan²x/α²)²), from cos θ by the half-angle identities.
fn lobe_kernel(cosine: f64, alpha: f64) -> f64 {
    let cos2_half = 0.5 * (1.0 + cosine);
    let sin2_half = 0.5 * (1.0 - cosine).max(0.0);
    let spread = cos2_half + sin2_half / (alpha * alpha);
    cosine / (spread * spread)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::environment::grid::grid_size;
    use imaging::Image;

    #[test]
    fn the_lobe_kernel_equals_its_definition() {
        for alpha in [0.02, 0.1, 0.5] {
            for theta in [0.0_f64, 0.01, 0.3, 1.2] {
                let x = 0.5 * theta;
                let d = 1.0 / (x.cos().powi(4) * (1.0 + x.tan().powi(2) / (alpha * alpha)).powi(2));
                let expected = d * theta.cos();
                assert!((lobe_kernel(theta.cos(), alpha) / expected - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_blurred_point_has_half_of_its_peak_at_half_the_width() {
        let size = grid_size();
        let center = size.wrap(64, 16) as usize;
        let mut point = Image::new(128, 64, [0.0_f32; 3]);
        *point.at_mut(64, 16) = [1000.0; 3];
        let blurred = blurred_map(&point, size, 20.0);
        let value = |rows: usize| blurred[center - rows * 128][0];
        // A row is 2.8125 degrees: 10 degrees lie between rows 3 and 4.
        let share = (10.0 - 3.0 * 2.8125) / 2.8125;
        let half = value(3) * (1.0 - share) + value(4) * share;
        assert!((half / value(0) - 0.5).abs() < 0.02, "{}", half / value(0));
        let flat = blurred_map(&Image::new(128, 64, [0.4_f32; 3]), size, 20.0);
        assert!(flat[..4096].iter().all(|v| (v[0] - 0.4).abs() < 1e-6));
    }
}
