//! Brown–Conrady distortion of normalised image coordinates, forward and back.

use glam::DVec2;

/// Brown–Conrady distortion: radial k1, k2, k3 and tangential p1, p2, on normalised coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
}

/// Newton step and residual at which a solution stands, relative to the distorted radius above 1.
const SETTLED: f64 = 1e-10;

impl Distortion {
    /// No distortion.
    pub const NONE: Self = Self {
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };

    /// Whether every coefficient is zero.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// The factor on the radius, from the squared radius.
    fn radial(&self, r2: f64) -> f64 {
        1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
    }

    /// The derivative of the distorted radius by the undistorted one, from the squared radius.
    fn radial_slope(&self, r2: f64) -> f64 {
        1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3))
    }

    /// Distorted normalised coordinates of undistorted ones.
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = self.radial(r2);
        DVec2::new(
            p.x * radial + 2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y,
        )
    }

    /// The undistorted radius at which the radial map folds: first positive root of
    /// 1 + 3k₁r² + 5k₂r⁴ + 7k₃r⁶, infinite where there is none (hard-cases A13).
    pub fn fold_radius(&self) -> f64 {
        // Between its critical points a cubic in r² is monotone: the first end below zero brackets the root.
        let mut low = 0.0;
        for high in positive_roots(21.0 * self.k3, 10.0 * self.k2, 3.0 * self.k1) {
            if self.radial_slope(high) <= 0.0 {
                return self.fold_between(low, high);
            }
            low = high;
        }
        let leading = [self.k3, self.k2, self.k1]
            .into_iter()
            .find(|k| *k != 0.0)
            .unwrap_or(0.0);
        if leading >= 0.0 {
            return f64::INFINITY;
        }
        let mut high = low.max(1.0);
        while self.radial_slope(high) > 0.0 {
            high *= 2.0;
        }
        if high.is_finite() {
            self.fold_between(low, high)
        } else {
            f64::INFINITY
        }
    }

    /// The fold radius from two squared radii with a positive slope at `low` and none at `high`.
    fn fold_between(&self, mut low: f64, mut high: f64) -> f64 {
        // 200 halvings reach neighbouring doubles from [0, 1] down to 1e-44.
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if self.radial_slope(middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        low.sqrt()
    }

    /// Undistorted coordinates of distorted ones by Newton iteration, or `None` beyond `fold_radius`
    /// (as [`Distortion::fold_radius`] gives it) or where Newton does not converge.
    pub fn undistort(&self, distorted: DVec2, fold_radius: f64) -> Option<DVec2> {
        if !distorted.is_finite() {
            return None;
        }
        let distance = distorted.length();
        if self.is_none() || distance == 0.0 {
            return Some(distorted);
        }
        // Few steps from the distorted point do inside an ordinary image (70 ns a pixel on one core of
        // the build machine, 215 ns by the bracket), but not towards the fold.
        self.solve(distorted, distorted, fold_radius, 8)
            .or_else(|| {
                // The radial part alone is monotone up to the fold, so its root is bracketed; the tangential
                // part is small and left to the iteration in two dimensions.
                let start = distorted * (self.undistorted_radius(distance, fold_radius) / distance);
                self.solve(distorted, start, fold_radius, 50)
            })
    }

    /// At most `steps` Newton steps from `start` to what distorts to `distorted` inside the fold.
    fn solve(&self, distorted: DVec2, start: DVec2, fold_radius: f64, steps: u32) -> Option<DVec2> {
        let scale = distorted.length().max(1.0);
        let mut p = start;
        for _ in 0..steps {
            let error = self.distort(p) - distorted;
            let r2 = p.length_squared();
            let radial = self.radial(r2);
            let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3));
            let xx = radial + p.x * p.x * slope + 2.0 * self.p1 * p.y + 6.0 * self.p2 * p.x;
            let yy = radial + p.y * p.y * slope + 6.0 * self.p1 * p.y + 2.0 * self.p2 * p.x;
            let xy = p.x * p.y * slope + 2.0 * self.p1 * p.x + 2.0 * self.p2 * p.y;
            let determinant = xx * yy - xy * xy;
            if determinant.abs() < 1e-12 {
                return None;
            }
            let step =
                DVec2::new(yy * error.x - xy * error.y, xx * error.y - xy * error.x) / determinant;
            // Half steps keep the iterate on this side of the fold.
            let mut part = 1.0;
            while (p - step * part).length() >= fold_radius && part > 1e-3 {
                part *= 0.5;
            }
            p -= step * part;
            // The next step would be about the square of this one. A small residual alone says little
            // near the fold, where the map is flat.
            if step.length() < SETTLED * scale {
                let residual = (self.distort(p) - distorted).length();
                return (residual < SETTLED * scale && p.length() < fold_radius).then_some(p);
            }
        }
        None
    }

    /// The undistorted radius of a distorted one without the tangential part, by Newton steps inside a
    /// bracket; just below the fold where the radius lies beyond it.
    fn undistorted_radius(&self, distorted: f64, fold_radius: f64) -> f64 {
        let error = |r: f64| r * self.radial(r * r) - distorted;
        let (mut low, mut high) = (0.0, fold_radius);
        if high.is_infinite() {
            high = distorted.max(1.0);
            while error(high) < 0.0 {
                high *= 2.0;
            }
        } else if error(high) <= 0.0 {
            return 0.999 * fold_radius;
        }
        let mut r = distorted.min(0.5 * high);
        for _ in 0..100 {
            let e = error(r);
            if e > 0.0 {
                high = r;
            } else {
                low = r;
            }
            let newton = r - e / self.radial_slope(r * r);
            let next = if newton > low && newton < high {
                newton
            } else {
                0.5 * (low + high)
            };
            if (next - r).abs() <= 2.0 * f64::EPSILON * r {
                return next;
            }
            r = next;
        }
        r
    }
}

/// The positive roots of `a s² + b s + c`, ascending, without cancellation; also where `a` or `b` is 0.
fn positive_roots(a: f64, b: f64, c: f64) -> impl Iterator<Item = f64> {
    let q = -0.5 * (b + (b * b - 4.0 * a * c).sqrt().copysign(b));
    let (first, second) = (q / a, c / q);
    let roots = [first.min(second), first.max(second)];
    // A division by zero or a negative discriminant leaves what is no root.
    roots.into_iter().filter(|s| *s > 0.0 && s.is_finite())
}
