//! How far a depth can be trusted.

/// Standard deviation of a depth: √(`floor`² + (`per_square_metre` · z²)²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthNoise {
    /// At depth 0, metres.
    pub floor: f32,
    /// Growth with the square of the depth, 1/metres.
    pub per_square_metre: f32,
}

impl Default for DepthNoise {
    /// A PrimeSense sensor: one disparity step is 2.89e-3 z² metres (hard-cases B02), its rounding has
    /// σ = step/√12, the pattern adds as much again; 1 mm of calibration.
    fn default() -> Self {
        Self {
            floor: 0.001,
            per_square_metre: 1.2e-3,
        }
    }
}

impl DepthNoise {
    /// 1/σ² at a depth in metres.
    #[inline]
    pub fn weight(&self, depth: f32) -> f32 {
        let spread = self.per_square_metre * depth * depth;
        1.0 / (self.floor * self.floor + spread * spread)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Focal length and baseline of a PrimeSense sensor, pixels and metres; disparity comes in eighths.
    const FOCAL: f64 = 575.0;
    const BASELINE: f64 = 0.075;

    /// Root mean square error of depths that were rounded to eighths of disparity, metres.
    fn rounding_error(depth: f64) -> f64 {
        let samples = 4000;
        let square: f64 = (0..samples)
            .map(|sample| {
                let exact = depth * (1.0 + 0.02 * (f64::from(sample) / f64::from(samples) - 0.5));
                let disparity = (8.0 * FOCAL * BASELINE / exact).round() / 8.0;
                (FOCAL * BASELINE / disparity - exact).powi(2)
            })
            .sum();
        (square / f64::from(samples)).sqrt()
    }

    #[test]
    fn hc_b02_the_weight_follows_the_step_of_the_sensor() {
        let noise = DepthNoise {
            floor: 0.0,
            ..DepthNoise::default()
        };
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        let (mut naive_least, mut naive_most) = (f64::INFINITY, 0.0_f64);
        for step in 0..=1000 {
            let depth = 0.5 + 3.5 * f64::from(step) / 1000.0;
            let error = rounding_error(depth);
            // Errors over their standard deviation by the weight: the same at every depth.
            let share = error * f64::from(noise.weight(depth as f32)).sqrt();
            (least, most) = (least.min(share), most.max(share));
            // One weight for all depths.
            (naive_least, naive_most) = (naive_least.min(error), naive_most.max(error));
        }
        println!(
            "B02: share of rounding in the noise {least:.2} to {most:.2}, unweighted {:.0} times apart",
            naive_most / naive_least
        );
        assert!(naive_most / naive_least > 30.0);
        assert!(most / least < 1.6 && most < 1.0, "{least} {most}");
    }
}
