//! How reflectance rises towards grazing angles (Schlick 1994).

use serde::{Deserialize, Serialize};

/// Reflectance of a segment over that at its mean angle: (1 + κ (1 − cos α)⁵) / mean.
///
/// The mean is over what the segment shows, so that the common gain keeps its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FresnelFit {
    /// κ = (1 − R₀)/R₀: 24 for plastic, 0.1 for polished metal.
    pub kappa: f64,
    /// Mean of 1 + κ (1 − cos α)⁵ over the segment.
    pub mean: f64,
}

/// Largest κ: R₀ = 0.02, less than any solid or liquid reflects.
pub(super) const LARGEST_KAPPA: f64 = 49.0;

/// (1 − cos α)⁵ for a cosine of any value (hard-cases I08).
pub(super) fn rise(cosine: f64) -> f64 {
    let x = 1.0 - cosine.clamp(0.0, 1.0);
    let square = x * x;
    square * square * x
}

impl FresnelFit {
    /// The factor of a pixel.
    pub fn factor(&self, cosine: f32) -> f32 {
        ((1.0 + self.kappa * rise(f64::from(cosine))) / self.mean) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rise_stays_in_range_for_any_cosine() {
        for cosine in [-1.0, -0.2, 0.0, 0.5, 1.0, 1.000_001] {
            assert!((0.0..=1.0).contains(&rise(cosine)), "{cosine}");
        }
        assert!((rise(0.5) - 0.03125).abs() < 1e-12);
        let plastic = FresnelFit {
            kappa: 24.0,
            mean: 1.0,
        };
        assert!((plastic.factor(0.0) - 25.0).abs() < 1e-5);
    }
}
