//! Residual optical flow: how far a photograph is displaced against what the fused colour shows from its pose.
//!
//! Patches of the picture are aligned by Lucas-Kanade with gain and offset of their own; those without texture, across
//! edges of depth, with saturation, or that do not look alike afterwards (a wandering highlight) say nothing.

use fusion::ModelView;
use imaging::Image;

use super::frames::between;

/// Half side of a patch, half-size pixels.
const REACH: usize = 7;
/// Distance of patches.
const SPACING: usize = 9;
/// Most steps.
const STEPS: usize = 12;
/// Largest displacement that is followed, half-size pixels.
const LARGEST: f64 = 5.0;
/// Step that ends the search.
const LEAST_STEP: f64 = 3e-3;
/// Least correlation of picture and photograph after alignment.
const LEAST_LIKENESS: f64 = 0.9;
/// Largest standard deviation of a displacement in its worst direction, half-size pixels.
const LARGEST_SIGMA: f64 = 0.06;
/// Jump of depth from pixel to pixel that is an edge: a surface 80 degrees aslant makes 2.2 % at half of VGA.
const EDGE_SHARE: f32 = 0.025;
/// Fewest patches that say something of a frame.
pub(super) const FEWEST_PATCHES: usize = 12;
/// Full-size pixels per half-size pixel.
const FULL_SIZE: f64 = 2.0;

/// Length of the displacement at each patch that says something, full-size pixels, in scan order.
///
/// `view`: the model from the pose of the colour camera, its luminance beside `photograph` of the same size.
pub(super) fn displacements(view: &ModelView, photograph: &Image<f32>) -> Vec<f64> {
    let (width, height) = (view.width(), view.height());
    let mut lengths = Vec::new();
    let margin = REACH + 1;
    for y in (margin..height.saturating_sub(margin)).step_by(SPACING) {
        for x in (margin..width.saturating_sub(margin)).step_by(SPACING) {
            if let Some(patch) = Patch::of(view, x, y)
                && let Some([dx, dy]) = patch.follow(photograph)
            {
                lengths.push(FULL_SIZE * dx.hypot(dy));
            }
        }
    }
    lengths
}

/// A piece of the picture, its gradients, and their sums.
struct Patch {
    center: [f64; 2],
    value: Vec<f64>,
    gradient: Vec<[f64; 2]>,
}

impl Patch {
    /// `None` where a pixel shows no surface or no colour, or depth jumps.
    fn of(view: &ModelView, x: usize, y: usize) -> Option<Self> {
        let grey = |x: usize, y: usize| f64::from(view.at(x, y).grey);
        let count = (2 * REACH + 1) * (2 * REACH + 1);
        let mut patch = Self {
            center: [x as f64, y as f64],
            value: Vec::with_capacity(count),
            gradient: Vec::with_capacity(count),
        };
        for row in y - REACH - 1..=y + REACH + 1 {
            for column in x - REACH - 1..=x + REACH + 1 {
                let surfel = view.at(column, row);
                if !(surfel.is_surface() && surfel.grey > 0.0) {
                    return None;
                }
                let z = surfel.position[2];
                let jumps = |other: f32| (other - z).abs() > EDGE_SHARE * z;
                if column > x - REACH - 1 && jumps(view.at(column - 1, row).position[2])
                    || row > y - REACH - 1 && jumps(view.at(column, row - 1).position[2])
                {
                    return None;
                }
            }
        }
        for row in y - REACH..=y + REACH {
            for column in x - REACH..=x + REACH {
                patch.value.push(grey(column, row));
                patch.gradient.push([
                    0.5 * (grey(column + 1, row) - grey(column - 1, row)),
                    0.5 * (grey(column, row + 1) - grey(column, row - 1)),
                ]);
            }
        }
        Some(patch)
    }

    /// Where the patch is in the photograph, from where the picture shows it.
    fn follow(&self, photograph: &Image<f32>) -> Option<[f64; 2]> {
        let count = self.value.len() as f64;
        let mean = self.value.iter().sum::<f64>() / count;
        let variance: f64 = self.value.iter().map(|v| (v - mean) * (v - mean)).sum();
        let mut at = [0.0, 0.0];
        let mut seen = Vec::with_capacity(self.value.len());
        for _ in 0..STEPS {
            self.sample(photograph, at, &mut seen)?;
            let seen_mean = seen.iter().sum::<f64>() / count;
            let covariance: f64 = self
                .value
                .iter()
                .zip(&seen)
                .map(|(v, s)| (v - mean) * (s - seen_mean))
                .sum();
            let gain = covariance / variance.max(f64::MIN_POSITIVE);
            if !(gain > 0.0) {
                return None;
            }
            // The picture's gradient stands for the photograph's: it has less noise.
            let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
            let (mut xr, mut yr, mut square) = (0.0, 0.0, 0.0);
            for ((value, [gx, gy]), seen) in self.value.iter().zip(&self.gradient).zip(&seen) {
                let residual = (seen - seen_mean) - gain * (value - mean);
                let (gx, gy) = (gain * gx, gain * gy);
                xx += gx * gx;
                xy += gx * gy;
                yy += gy * gy;
                xr += gx * residual;
                yr += gy * residual;
                square += residual * residual;
            }
            let determinant = xx * yy - xy * xy;
            let half_trace = 0.5 * (xx + yy);
            let least = half_trace - (half_trace * half_trace - determinant).max(0.0).sqrt();
            if !(least > 0.0) {
                return None;
            }
            let step = [
                -(yy * xr - xy * yr) / determinant,
                -(xx * yr - xy * xr) / determinant,
            ];
            at = [at[0] + step[0], at[1] + step[1]];
            if !(at[0].hypot(at[1]) <= LARGEST) {
                return None;
            }
            if step[0].hypot(step[1]) < LEAST_STEP {
                let seen_variance: f64 = seen.iter().map(|s| (s - seen_mean).powi(2)).sum();
                let likeness = covariance / (variance * seen_variance).sqrt();
                let sigma = (square / (count - 4.0) / least).sqrt();
                return (likeness >= LEAST_LIKENESS && sigma <= LARGEST_SIGMA).then_some(at);
            }
        }
        None
    }

    fn sample(&self, photograph: &Image<f32>, at: [f64; 2], seen: &mut Vec<f64>) -> Option<()> {
        seen.clear();
        let side = 2 * REACH + 1;
        for place in 0..side * side {
            let column = (place % side) as f64 - REACH as f64;
            let row = (place / side) as f64 - REACH as f64;
            let place = glam::DVec2::new(
                self.center[0] + column + at[0],
                self.center[1] + row + at[1],
            );
            seen.push(f64::from(between(photograph, place)?));
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fusion::Surfel;
    use geometry::{Intrinsics, Pose};

    fn texture(x: f64, y: f64) -> f64 {
        0.4 + 0.15 * (0.55 * x + 0.2 * y).sin() + 0.12 * (0.5 * y - 0.3 * x).cos()
    }

    fn wall(shade: impl Fn(f64, f64) -> f64) -> ModelView {
        let camera = Intrinsics::pinhole(160, 120, 140.0, 140.0, 79.5, 59.5).unwrap();
        let mut view = ModelView::new(&camera, &Pose::IDENTITY);
        for (place, surfel) in view.surfels.iter_mut().enumerate() {
            let (x, y) = ((place % 160) as f64, (place / 160) as f64);
            *surfel = Surfel {
                position: [0.0, 0.0, 1.0],
                grey: shade(x, y) as f32,
                normal: [0.0, 0.0, -1.0],
                weight: 1.0,
            };
        }
        view
    }

    fn photograph(shade: impl Fn(f64, f64) -> f64) -> Image<f32> {
        Image::from_fn(160, 120, |x, y| shade(x.into(), y.into()) as f32)
    }

    #[test]
    fn a_shifted_photograph_is_displaced_by_its_shift() {
        let view = wall(texture);
        let image = photograph(|x, y| 1.3 * texture(x - 0.6, y + 0.35) + 0.02);
        let lengths = displacements(&view, &image);
        let expected = FULL_SIZE * 0.6_f64.hypot(0.35);
        assert!(lengths.len() > 100, "{}", lengths.len());
        for length in lengths {
            assert!((length - expected).abs() < 0.06, "{length} for {expected}");
        }
    }

    #[test]
    fn what_has_no_texture_or_is_something_else_says_nothing() {
        assert!(displacements(&wall(|_, _| 0.5), &photograph(|_, _| 0.5)).is_empty());
        let stripes = wall(|x, _| 0.4 + 0.2 * (0.5 * x).sin());
        let image = photograph(|x, _| 0.4 + 0.2 * (0.5 * x).sin());
        assert!(displacements(&stripes, &image).is_empty(), "stripes slide");
        let other = photograph(|x, y| 0.4 + 0.2 * (0.3 * x * 0.11 * y).sin());
        assert!(displacements(&wall(texture), &other).len() < 3);
        let dark = photograph(|_, _| 0.0);
        assert!(displacements(&wall(texture), &dark).is_empty());
    }
}
