//! Which directions of motion the data observe, and the step along those.

use geometry::{SymmetricEigen, symmetric_eigen};

/// Normal equations of a small motion: H x = −b.
///
/// x = (ω R, t): rotation about the centre in radians times the root mean square radius R, and translation;
/// both in metres, so that eigenvalues of both kinds compare (hard-cases C02).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalEquations {
    /// Σ J Jᵀ, each term over its variance.
    pub hessian: [[f64; 6]; 6],
    /// Σ J r.
    pub gradient: [f64; 6],
}

impl NormalEquations {
    /// No data.
    pub const ZERO: Self = Self {
        hessian: [[0.0; 6]; 6],
        gradient: [0.0; 6],
    };

    /// From an upper triangle by rows whose rotations are in radians, `radius` in metres (above 0).
    pub fn from_triangle(triangle: &[f64; 21], gradient: &[f64; 6], radius: f64) -> Self {
        let scale = |axis: usize| if axis < 3 { 1.0 / radius } else { 1.0 };
        let mut equations = Self::ZERO;
        let mut entries = triangle.iter();
        for row in 0..6 {
            for (column, entry) in (row..6).zip(&mut entries) {
                let scaled = entry * scale(row) * scale(column);
                equations.hessian[row][column] = scaled;
                equations.hessian[column][row] = scaled;
            }
        }
        equations.gradient = std::array::from_fn(|row| gradient[row] * scale(row));
        equations
    }

    /// Adds `other` in the directions that `self` observes badly: along an eigenvector of `self` with the share λ
    /// of the largest eigenvalue, `other` counts 1 − λ / 2 `knee`, and nothing from λ = 2 `knee` on
    /// ([`NormalEquations::has_open`]).
    ///
    /// With B = V diag(√share) Vᵀ the sum is that of the two energies when `other` is asked about B x.
    pub fn blend(&self, other: &Self, knee: f64) -> Self {
        let eigen = symmetric_eigen(&self.hessian);
        let largest = eigen.values[0];
        let shares = eigen.values.map(|value| {
            let ratio = if largest > 0.0 {
                value.max(0.0) / largest
            } else {
                0.0
            };
            (1.0 - 0.5 * ratio / knee).max(0.0).sqrt()
        });
        let blend = from_eigen(&eigen.vectors, &shares);
        let mut sum = *self;
        let half = product(&blend, &other.hessian);
        let full = product(&half, &blend);
        for row in 0..6 {
            for column in 0..6 {
                sum.hessian[row][column] += full[row][column];
                sum.gradient[row] += blend[row][column] * other.gradient[column];
            }
        }
        sum
    }

    /// Whether [`NormalEquations::blend`] with the same `knee` would add anything: whether a direction has an
    /// eigenvalue below 2 `knee` of the largest.
    pub fn has_open(&self, knee: f64) -> bool {
        let values = symmetric_eigen(&self.hessian).values;
        // NaN and nothing at all are open.
        !(values[5] >= 2.0 * knee * values[0] && values[0] > 0.0)
    }

    /// The step along the observed directions (hard-cases C01): those whose eigenvalue is above `threshold` of the
    /// largest. The others keep what they have.
    pub fn solve(&self, threshold: f64) -> Solution {
        let eigen = symmetric_eigen(&self.hessian);
        let least = threshold * eigen.values[0];
        let mut step = [0.0; 6];
        let mut rank = 0;
        for (value, vector) in eigen.values.iter().zip(&eigen.vectors) {
            // NaN fails.
            if !(*value > least && *value > 0.0) {
                break;
            }
            rank += 1;
            let along = -dot(vector, &self.gradient) / value;
            for (sum, v) in step.iter_mut().zip(vector) {
                *sum += along * v;
            }
        }
        Solution { step, rank, eigen }
    }
}

/// A step, and what it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// (ω R, t), metres.
    pub step: [f64; 6],
    /// Number of observed directions.
    pub rank: usize,
    /// Directions of motion, best observed first; those from `rank` on are not observed.
    pub eigen: SymmetricEigen<6>,
}

impl Solution {
    /// Axes that take part in an unobserved direction: bits 0 to 2 rotation about x, y, z, bits 3 to 5
    /// translation. An axis takes part with more than [`LEAST_PART`] of a direction's square length.
    pub fn weak_axes(&self) -> u8 {
        let mut part = [0.0; 6];
        for vector in &self.eigen.vectors[self.rank..] {
            for (sum, v) in part.iter_mut().zip(vector) {
                *sum += v * v;
            }
        }
        (0..6)
            .filter(|&axis| part[axis] > LEAST_PART)
            .fold(0, |bits, axis| bits | 1 << axis)
    }
}

/// Least share of a direction that makes an axis weak: a sixth would be all axes alike.
pub const LEAST_PART: f64 = 0.2;

fn from_eigen(vectors: &[[f64; 6]; 6], values: &[f64; 6]) -> [[f64; 6]; 6] {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            (0..6)
                .map(|k| values[k] * vectors[k][row] * vectors[k][column])
                .sum()
        })
    })
}

fn product(a: &[[f64; 6]; 6], b: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| (0..6).map(|k| a[row][k] * b[k][column]).sum())
    })
}

fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
