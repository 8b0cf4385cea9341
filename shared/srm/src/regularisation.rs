//! What is asked of D and S beyond the rows: S smooth and small, D near its prior.

use crate::problem::{Problem, Rgb};

/// Strengths of the regularisers, in units of rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regularisation {
    /// Smoothness of neighbouring texels (srm-feasibility section 2: 0.02).
    pub smoothness: f64,
    /// Pull of S to zero, pseudo-observations a texel of a map of up to 126 rows (0.002). A texel of a
    /// finer map sees fewer rows, and is pulled less by as much.
    pub specular_to_zero: f64,
    /// Pull of D to its prior, pseudo-observations a vertex.
    pub diffuse_to_prior: f64,
}

/// Rows of the map for which the pull of S is stated. Smoothness needs no such thing: in two dimensions the sum of
/// squared steps does not depend on the texels' size.
const STATED_HEIGHT: u32 = 126;

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

    /// Pull of one texel to zero.
    fn texel_pull(&self, regularisation: &Regularisation) -> f64 {
        let finer = f64::from(STATED_HEIGHT) / f64::from(self.panorama().height());
        regularisation.specular_to_zero * finer.min(1.0).powi(2)
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
        let pull = self.texel_pull(regularisation);
        for index in 0..self.panorama().texel_count() {
            if !self.covered()[index] {
                continue;
            }
            for c in 0..3 {
                result[n + index][c] += pull * x[n + index][c];
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
        let pull = self.texel_pull(regularisation);
        for index in 0..self.panorama().texel_count() {
            if !self.covered()[index] {
                continue;
            }
            diagonal[n + index] = diagonal[n + index].map(|v| v + pull);
            for (other, weight) in self.edges(index, edge_weights).into_iter().flatten() {
                let added = regularisation.smoothness * weight;
                diagonal[n + index] = diagonal[n + index].map(|v| v + added);
                diagonal[n + other] = diagonal[n + other].map(|v| v + added);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::{Row, Rows};
    use geometry::PanoramaSize;

    /// What all texels of a covered map are pulled to zero with, together.
    fn diagonal_of_s(height: u32) -> f64 {
        let panorama = PanoramaSize::from_height(height).unwrap();
        let count = panorama.texel_count() as u32;
        let rows: Rows = (0..count)
            .map(|texel| Row {
                vertices: [0; 3],
                barycentric: [1.0, 0.0, 0.0],
                texels: [texel; 4],
                taps: [0.3, 0.0, 0.0, 0.0],
                observed: [0.2; 3],
                known: [0.0; 3],
                weight: 1.0,
                clipped: 0,
                frame: 0,
                segment: 1,
            })
            .collect();
        let problem = Problem::new(rows, 1, panorama).unwrap();
        let only_zero = Regularisation {
            smoothness: 0.0,
            specular_to_zero: 1.0,
            diffuse_to_prior: 0.0,
        };
        let edges = vec![[1.0; 2]; panorama.texel_count()];
        let mut diagonal = vec![[0.0; 3]; problem.unknown_count()];
        problem.add_regularisation_diagonal(&only_zero, &edges, &mut diagonal);
        let mut applied = vec![[0.0; 3]; problem.unknown_count()];
        let ones = vec![[1.0; 3]; problem.unknown_count()];
        problem.add_regularisation(&only_zero, &edges, &ones, &mut applied);
        assert_eq!(diagonal, applied);
        diagonal[1..].iter().map(|v| v[0]).sum()
    }

    #[test]
    fn a_finer_map_is_pulled_to_zero_as_a_whole_like_a_coarse_one() {
        const TOLERANCE: f64 = 1e-9;
        let stated = diagonal_of_s(STATED_HEIGHT);
        for height in [2 * STATED_HEIGHT, 3 * STATED_HEIGHT] {
            let ratio = diagonal_of_s(height) / stated;
            assert!((ratio - 1.0).abs() < TOLERANCE, "{height}: {ratio}");
        }
        assert!(diagonal_of_s(8) < stated);
    }
}
