//! Fall-off of a lens towards the corners.

use geometry::DVec2;

use crate::error::ImagingError;
use crate::image::Image;

/// Below this factor a pixel is invalid: correction would multiply its noise by more than ten, and a fitted
/// polynomial is close to its zero there (hard-cases B05).
pub const SMALLEST_FACTOR: f64 = 0.1;

/// The share of light that reaches a pixel: 1 in the centre of the lens, less towards the corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vignetting {
    center: DVec2,
    radius: f64,
    a: [f64; 3],
    /// Square of the relative radius where the polynomial first falls below [`SMALLEST_FACTOR`].
    end_r2: f64,
}

impl Vignetting {
    /// A lens without fall-off.
    pub fn none() -> Self {
        Self {
            center: DVec2::ZERO,
            radius: 1.0,
            a: [0.0; 3],
            end_r2: f64::INFINITY,
        }
    }

    /// factor = 1 + a₁r² + a₂r⁴ + a₃r⁶ with r = distance from `center` in pixels / `radius`.
    ///
    /// Beyond the first radius at which the factor falls below [`SMALLEST_FACTOR`] it is 0, even where the
    /// polynomial rises again: no lens does that, the fit just ended. Refuses values that are not finite
    /// and a radius that is not positive.
    pub fn even_polynomial(center: DVec2, radius: f64, a: [f64; 3]) -> Result<Self, ImagingError> {
        if !(radius.is_finite() && radius > 0.0) {
            return Err(ImagingError::Parameter {
                name: "vignetting radius",
                value: radius,
                expected: "above 0",
            });
        }
        for value in [center.x, center.y, a[0], a[1], a[2]] {
            if !value.is_finite() {
                return Err(ImagingError::Parameter {
                    name: "vignetting coefficient",
                    value,
                    expected: "a finite number",
                });
            }
        }
        Ok(Self {
            center,
            radius,
            a,
            end_r2: end_of_fit(a),
        })
    }

    /// Whether every factor is 1.
    pub fn is_none(&self) -> bool {
        self.a == [0.0; 3]
    }

    /// The factor at pixel position (u, v); 0 where the lens passes too little light to be corrected.
    pub fn factor(&self, u: f64, v: f64) -> f64 {
        let r2 = (DVec2::new(u, v) - self.center).length_squared() / (self.radius * self.radius);
        // The comparison is false for NaN too.
        if r2 < self.end_r2 {
            polynomial(self.a, r2)
        } else {
            0.0
        }
    }

    /// The factors at the pixel centres of a `width` x `height` image; 0 = invalid.
    pub fn table(&self, width: u32, height: u32) -> Image<f32> {
        Image::from_fn(width, height, |x, y| {
            self.factor(f64::from(x), f64::from(y)) as f32
        })
    }
}

fn polynomial(a: [f64; 3], r2: f64) -> f64 {
    1.0 + r2 * (a[0] + r2 * (a[1] + r2 * a[2]))
}

/// The first r² at which the polynomial falls below the smallest factor; infinite when it never does.
///
/// Between the stationary points of a cubic it is monotone, so bisection on each piece finds the first root.
fn end_of_fit(a: [f64; 3]) -> f64 {
    let mut ends = stationary_points(a);
    ends.push(f64::MAX.sqrt().sqrt().sqrt());
    let mut low = 0.0;
    for high in ends {
        if polynomial(a, high) < SMALLEST_FACTOR {
            let mut bracket = (low, high);
            // 2^-1100 of any f64 interval is below its resolution; the loop ends when the middle repeats.
            loop {
                let middle = 0.5 * (bracket.0 + bracket.1);
                if middle <= bracket.0 || middle >= bracket.1 {
                    return bracket.1;
                }
                if polynomial(a, middle) < SMALLEST_FACTOR {
                    bracket.1 = middle;
                } else {
                    bracket.0 = middle;
                }
            }
        }
        low = high;
    }
    f64::INFINITY
}

/// Positive roots of a₁ + 2a₂x + 3a₃x², ascending.
fn stationary_points(a: [f64; 3]) -> Vec<f64> {
    let (linear, constant) = (2.0 * a[1], a[0]);
    let square = 3.0 * a[2];
    let discriminant = linear * linear - 4.0 * square * constant;
    let mut roots = Vec::new();
    if discriminant >= 0.0 {
        // The form without cancellation; a vanishing leading coefficient drops one root as infinite.
        let q = -0.5 * (linear + discriminant.sqrt().copysign(linear));
        roots.extend(
            [q / square, constant / q]
                .into_iter()
                .filter(|r| r.is_finite() && *r > 0.0),
        );
    }
    roots.sort_by(f64::total_cmp);
    roots
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_follows_the_polynomial_inside_the_fit() {
        let lens =
            Vignetting::even_polynomial(DVec2::new(319.5, 239.5), 400.0, [-0.52, 0.19, -0.04])
                .unwrap();
        assert_eq!(lens.factor(319.5, 239.5), 1.0);
        assert!((lens.factor(719.5, 239.5) - 0.63).abs() < 1e-12);
        assert!((f64::from(lens.table(640, 480).at(0, 0)) - lens.factor(0.0, 0.0)).abs() < 1e-7);
        assert_eq!(Vignetting::none().factor(1e9, -1e9), 1.0);
    }

    #[test]
    fn a_polynomial_that_rises_again_stays_ended() {
        // 1 − 2r² + r⁴ = (1 − r²)² is 0 at r = 1 and 1 again at r = √2.
        let lens = Vignetting::even_polynomial(DVec2::ZERO, 1.0, [-2.0, 1.0, 0.0]).unwrap();
        assert!(lens.factor(0.5, 0.0) > 0.5);
        assert_eq!(lens.factor(1.0, 0.0), 0.0);
        assert_eq!(lens.factor(2.0_f64.sqrt(), 0.0), 0.0);
        // The first crossing of 0.1: r² = 1 − √0.1.
        assert!((lens.end_r2 - (1.0 - 0.1_f64.sqrt())).abs() < 1e-12);
    }

    #[test]
    fn a_hostile_description_is_refused() {
        assert!(Vignetting::even_polynomial(DVec2::ZERO, 0.0, [0.0; 3]).is_err());
        assert!(Vignetting::even_polynomial(DVec2::ZERO, 1.0, [f64::NAN, 0.0, 0.0]).is_err());
        assert!(
            Vignetting::even_polynomial(DVec2::new(f64::INFINITY, 0.0), 1.0, [0.0; 3]).is_err()
        );
    }
}
