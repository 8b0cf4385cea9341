//! Noise of a pixel by its level, from the photographs themselves.

use imaging::Radiance;

/// Second difference along a row, divided by √6: noise with the pixel's σ where the picture is smooth.
#[derive(Clone, Copy, Debug)]
pub struct NoiseSample {
    /// Linear radiance of green.
    pub level: f32,
    /// The difference, linear radiance.
    pub difference: f32,
    /// How much the picture changes across the row: what tells texture from noise.
    pub slope: f32,
}

/// Every how many pixels a sample is taken in x and y: odd, so that both columns of a mosaic take part.
const STEP: usize = 7;
/// Levels at which the noise is told apart.
const LEVELS: usize = 8;
/// Share of the samples of a level, those with the least slope, that tell its noise.
const CALM_SHARE: f64 = 0.3;
/// Median of |x| over σ for a Gaussian.
const MEDIAN_OF_SIGMA: f64 = 0.674_49;
/// Noise is at least that of rounding to 8 bits at mid grey, linear radiance.
const LEAST_SIGMA: f64 = 5e-4;

/// Samples of a photograph.
pub(super) fn noise_samples(radiance: &Radiance) -> Vec<NoiseSample> {
    let (width, height) = (radiance.linear.width(), radiance.linear.height());
    let mut samples = Vec::new();
    let green = |x: u32, y: u32| radiance.linear.at(x, y)[1];
    for y in (1..height.saturating_sub(1)).step_by(STEP) {
        for x in (2..width.saturating_sub(2)).step_by(STEP) {
            let usable =
                |x: u32, y: u32| !radiance.invalid.at(x, y) && !radiance.saturated.at(x, y);
            if !(usable(x - 1, y) && usable(x, y) && usable(x + 1, y)) {
                continue;
            }
            let difference = green(x - 1, y) + green(x + 1, y) - 2.0 * green(x, y);
            samples.push(NoiseSample {
                level: green(x, y),
                difference: difference / 6.0_f32.sqrt(),
                slope: (green(x, y + 1) - green(x, y - 1)).abs(),
            });
        }
    }
    samples
}

/// σ of a pixel at levels in ascending order; straight lines between, constant beyond.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseCurve {
    points: Vec<(f64, f64)>,
}

impl NoiseCurve {
    /// From samples of all views; one level of the least noise without samples.
    pub fn of(mut samples: Vec<NoiseSample>) -> Self {
        samples.retain(|s| s.level.is_finite() && s.difference.is_finite());
        samples.sort_by(|a, b| a.level.total_cmp(&b.level));
        let mut points = Vec::new();
        let size = samples.len().div_ceil(LEVELS).max(1);
        for level in samples.chunks_mut(size) {
            level.sort_by(|a, b| a.slope.total_cmp(&b.slope));
            let calm = (CALM_SHARE * level.len() as f64).ceil() as usize;
            let calm = &level[..calm.min(level.len())];
            let mut lengths: Vec<f64> =
                calm.iter().map(|s| f64::from(s.difference.abs())).collect();
            let mut levels: Vec<f64> = calm.iter().map(|s| f64::from(s.level)).collect();
            let median = geometry::robust::median(&mut lengths).unwrap_or(0.0);
            let at = geometry::robust::median(&mut levels).unwrap_or(0.0);
            points.push((at, (median / MEDIAN_OF_SIGMA).max(LEAST_SIGMA)));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        if points.is_empty() {
            points.push((0.0, LEAST_SIGMA));
        }
        Self { points }
    }

    /// σ at a level, linear radiance.
    pub fn sigma(&self, level: f64) -> f64 {
        let above = self.points.partition_point(|&(at, _)| at < level);
        match (
            above.checked_sub(1).map(|i| self.points[i]),
            self.points.get(above),
        ) {
            (Some((low, a)), Some(&(high, b))) => {
                let share = ((level - low) / (high - low).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                a + share * (b - a)
            }
            (Some((_, sigma)), None) | (None, Some(&(_, sigma))) => sigma,
            (None, None) => LEAST_SIGMA,
        }
    }

    /// Weight of a row whose model errs by `scale` (linear radiance) besides: the inverse of its whole variance, 1
    /// without noise.
    pub fn weight(&self, level: f64, scale: f64) -> f64 {
        let sigma = self.sigma(level);
        scale * scale / (scale * scale + sigma * sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_a_level_is_found_beside_texture() {
        // A third of the picture is texture with a slope; noise grows from 0.004 to 0.02.
        let mut state = 1_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f32 / (1_u64 << 31) as f32
        };
        let samples: Vec<NoiseSample> = (0..40_000)
            .map(|i| {
                let level = uniform();
                // Twelve uniform numbers make a normal one.
                let normal: f32 = (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
                let is_texture = i % 3 == 0;
                NoiseSample {
                    level,
                    difference: normal * (0.004 + 0.016 * level)
                        + if is_texture { 0.1 } else { 0.0 },
                    slope: if is_texture { 0.2 } else { 0.01 * uniform() },
                }
            })
            .collect();
        let curve = NoiseCurve::of(samples);
        for level in [0.1, 0.5, 0.9] {
            let expected = 0.004 + 0.016 * level;
            assert!(
                (curve.sigma(level) / expected - 1.0).abs() < 0.15,
                "{level}: {}",
                curve.sigma(level)
            );
        }
        assert!(curve.weight(0.9, 0.03) < curve.weight(0.1, 0.03));
        assert_eq!(NoiseCurve::of(Vec::new()).sigma(0.5), LEAST_SIGMA);
    }
}
