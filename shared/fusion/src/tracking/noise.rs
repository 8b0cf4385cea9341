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
