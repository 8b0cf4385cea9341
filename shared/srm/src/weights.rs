//! The weights of one reweighting round: of every row, and of every pair of neighbouring texels.

use crate::problem::{Problem, Rgb};
use crate::rows::{Row, luminance};

/// Weights of one round of iteratively reweighted least squares.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Weight of every row, a channel.
    pub rows: Vec<[f32; 3]>,
    /// Weight of the smoothness between every texel and its right and its lower neighbour, row-major.
    pub edges: Vec<[f32; 2]>,
}

/// Weight of each channel of a row given what the model predicts: Cauchy-like in luminance, and zero for
/// a clipped channel whose prediction reaches the observation (a lower bound is then met; H10).
pub fn row_weights(row: &Row, predicted: Rgb, residual_scale: f64) -> [f32; 3] {
    let mut residual = [0.0; 3];
    let mut binding = [true; 3];
    for c in 0..3 {
        residual[c] = f64::from(row.observed[c]) - predicted[c];
        if row.clipped & (1 << c) != 0 && residual[c] <= 0.0 {
            binding[c] = false;
            residual[c] = 0.0;
        }
    }
    let weight = f64::from(row.weight) * falloff(luminance(residual), residual_scale);
    binding.map(|binds| if binds { weight as f32 } else { 0.0 })
}

/// 1/√(1 + (x/scale)²): least squares near zero, least absolute values far out.
fn falloff(x: f64, scale: f64) -> f64 {
    let scaled = x / scale;
    1.0 / (1.0 + scaled * scaled).sqrt()
}

impl Problem {
    /// The weights of the first round: every row as it came, every edge alike.
    pub fn first_weights(&self) -> Weights {
        Weights {
            rows: self.map_rows(|_, row| [row.weight; 3]),
            edges: vec![[1.0; 2]; self.panorama().texel_count()],
        }
    }

    /// The weights of the next round. Rows beyond `residual_scale` and steps between texels beyond
    /// `edge_scale` (both linear luminance) lose weight, so that neither an outlier nor a lamp beside a
    /// dark wall pulls its neighbours.
    pub fn reweighted(&self, unknowns: &[Rgb], residual_scale: f64, edge_scale: f64) -> Weights {
        let rows =
            self.map_rows(|_, row| row_weights(row, self.predict(row, unknowns), residual_scale));
        let specular = &unknowns[self.vertex_count()..];
        let edges = (0..self.panorama().texel_count())
            .map(|texel| {
                self.neighbours(texel).map(|other| {
                    let Some(other) = other else { return 0.0 };
                    let step = luminance(specular[texel]) - luminance(specular[other]);
                    falloff(step, edge_scale) as f32
                })
            })
            .collect();
        Weights { rows, edges }
    }
}
