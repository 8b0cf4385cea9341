//! What is asked of D and S beyond the rows: S smooth and small, D near its prior.

use crate::problem::{Problem, Rgb};

/// Strengths of the regularisers, in units of rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regularisation {
    /// Smoothness of neighbouring texels (srm-feasibility section 2: 0.02).
    pub smoothness: f64,
    /// Pull of S to zero (0.002).
    pub specular_to_zero: f64,
    /// Pull of D to its prior, pseudo-observations a vertex.
    pub diffuse_to_prior: f64,
}

/// Longitude edges weigh at most this: towards the poles 1/cos lat grows without bound.
const LARGEST_LONGITUDE_WEIGHT: f64 = 20.0;

impl Problem {
    /// The covered right and lower neighbours of a covered texel; columns wrap, rows end at the poles.
    pub(crate) fn neighbours(&self, index: usize) -> [Option<usize>; 2] {
        let (width, height) = (
            self.panorama().width() as usize,
            self.panorama().height() as usize,
        );
        let (row, column) = (index / width, index % width);
        let right = row * width + (column + 1) % width;
        let below = index + width;
        let covered = self.covered();
        [
            (covered[index] && covered[right]).then_some(right),
            (covered[index] && row + 1 < height && covered[below]).then_some(below),
        ]
    }

    /// Neighbours with the strength of their edge: in longitude 1/cos lat (1/√cos lat before squaring).
    pub(crate) fn edges(
        &self,
        index: usize,
        edge_weights: &[[f32; 2]],
    ) -> [Option<(usize, f64)>; 2] {
        let row = index / self.panorama().width() as usize;
        let longitude =
            (1.0 / self.panorama().latitude(row as u32).cos()).min(LARGEST_LONGITUDE_WEIGHT);
        let [right, below] = self.neighbours(index);
        let [right_weight, below_weight] = edge_weights[index].map(f64::from);
        [
            right.map(|other| (other, longitude * right_weight)),
            below.map(|other| (other, below_weight)),
        ]
    }

    /// Adds the Hessian of the regularisers times x.
    pub fn add_regularisation(
        &self,
        regularisation: &Regularisation,
        edge_weights: &[[f32; 2]],
        x: &[Rgb],
        result: &mut [Rgb],
    ) {
        let n = self.vertex_count();
        for (target, value) in result[..n].iter_mut().zip(&x[..n]) {
            for c in 0..3 {
                target[c] += regularisation.diffuse_to_prior * value[c];
            }
        }
        for index in 0..self.panorama().texel_count() {
            if !self.covered()[index] {
                continue;
            }
            for c in 0..3 {
                result[n + index][c] += regularisation.specular_to_zero * x[n + index][c];
            }
            for (other, weight) in self.edges(index, edge_weights).into_iter().flatten() {
                for c in 0..3 {
                    let pull =
                        regularisation.smoothness * weight * (x[n + index][c] - x[n + other][c]);
                    result[n + index][c] += pull;
                    result[n + other][c] -= pull;
                }
            }
        }
    }

    /// Diagonal of the regularisers' Hessian, added to `diagonal`.
    pub fn add_regularisation_diagonal(
        &self,
        regularisation: &Regularisation,
        edge_weights: &[[f32; 2]],
        diagonal: &mut [Rgb],
    ) {
        let n = self.vertex_count();
        for value in &mut diagonal[..n] {
            *value = value.map(|v| v + regularisation.diffuse_to_prior);
        }
        for index in 0..self.panorama().texel_count() {
            if !self.covered()[index] {
                continue;
            }
            diagonal[n + index] = diagonal[n + index].map(|v| v + regularisation.specular_to_zero);
            for (other, weight) in self.edges(index, edge_weights).into_iter().flatten() {
                let added = regularisation.smoothness * weight;
                diagonal[n + index] = diagonal[n + index].map(|v| v + added);
                diagonal[n + other] = diagonal[n + other].map(|v| v + added);
            }
        }
    }
}
