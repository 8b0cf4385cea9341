//! The direction that the data do not see: D + c against S − c/gain (hard-cases H02, H03, H13).

use crate::joint::{JointSettings, Solution};
use crate::problem::{Problem, Rgb};
use crate::solver::{Quadratic, SolverSettings};

/// How well the split of a constant between D and S is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffsetCondition {
    /// Standard deviation of the mean of S along the offset direction, white levels, from data and prior.
    pub sigma: f64,
    /// Share of the curvature along the direction that comes from the data rather than from the priors.
    pub data_fraction: f64,
    /// Number of parts of the scene that share no texel: each has an offset of its own.
    pub component_count: usize,
}

/// Above this standard deviation the report says that the offset of S is not observed.
pub const OBSERVED_SIGMA: f64 = 0.05;

/// Below this share of data the direction counts as decided by the prior alone.
pub const OBSERVED_DATA_FRACTION: f64 = 0.5;

impl OffsetCondition {
    /// Whether the data, and not the prior, fix the offset.
    pub fn is_observed(&self) -> bool {
        self.sigma <= OBSERVED_SIGMA && self.data_fraction >= OBSERVED_DATA_FRACTION
    }
}

impl Problem {
    /// The condition of the offset direction at a solution, with residual noise `noise`.
    ///
    /// Solves H z = v for v the unit step of all covered texels with D making up for it as far as it may
    /// (D above zero); the variance of the mean of S is vᵀz · noise².
    pub fn offset_condition(
        &self,
        solution: &Solution,
        settings: &JointSettings,
        noise: f64,
    ) -> OffsetCondition {
        let n = self.vertex_count();
        let regularisation = settings.regularisation();
        let mut held: Vec<bool> = vec![false; n];
        held.extend(self.covered().iter().map(|covered| !covered));
        // Unknowns at their bound cannot follow.
        for (is_held, value) in held.iter_mut().zip(&solution.unknowns) {
            *is_held |= value.iter().all(|&v| v <= 0.0);
        }
        let covered_count = held[n..].iter().filter(|&&h| !h).count().max(1) as f64;
        let mut mean_of_s: Vec<Rgb> = vec![[0.0; 3]; self.unknown_count()];
        for (value, &is_held) in mean_of_s[n..].iter_mut().zip(&held[n..]) {
            if !is_held {
                *value = [1.0 / covered_count; 3];
            }
        }
        let quadratic = Quadratic {
            problem: self,
            weights: &solution.weights,
            regularisation,
            right_side: mean_of_s.clone(),
            held: &held,
        };
        let mut response = vec![[0.0; 3]; self.unknown_count()];
        let steps = SolverSettings {
            steps: 120,
            passes: 1,
            tolerance: 1e-5,
        };
        quadratic.solve_unbounded(&mut response, &steps);
        let variance: f64 = (n..self.unknown_count())
            .map(|i| mean_of_s[i][1] * response[i][1])
            .sum::<f64>()
            * noise
            * noise;
        let mut prior_part = vec![[0.0; 3]; self.unknown_count()];
        self.add_regularisation(
            &regularisation,
            &solution.weights.edges,
            &response,
            &mut prior_part,
        );
        let whole = self.apply(&solution.weights, &regularisation, &response);
        let inner = |a: &[Rgb]| {
            a.iter()
                .zip(&response)
                .map(|(a, b)| a[1] * b[1])
                .sum::<f64>()
        };
        let (prior_curvature, curvature) = (inner(&prior_part), inner(&whole));
        let data_fraction = if curvature > 0.0 {
            (1.0 - prior_curvature / curvature).clamp(0.0, 1.0)
        } else {
            0.0
        };
        OffsetCondition {
            sigma: variance.max(0.0).sqrt(),
            data_fraction,
            component_count: self.component_count(),
        }
    }

    /// Number of connected parts of the graph of vertices and texels that rows span (H13).
    pub fn component_count(&self) -> usize {
        let n = self.vertex_count();
        let mut parent: Vec<u32> = (0..self.unknown_count() as u32).collect();
        let mut seen = vec![false; self.unknown_count()];
        for row in self.rows().iter() {
            let texels = row
                .texels
                .iter()
                .zip(&row.taps)
                .filter(|(_, tap)| **tap > 0.0)
                .map(|(texel, _)| n as u32 + texel);
            let vertices = row
                .vertices
                .iter()
                .zip(&row.barycentric)
                .filter(|(_, b)| **b > 0.0)
                .map(|(v, _)| *v);
            let mut first = None;
            let mut reaches_a_texel = false;
            for unknown in vertices.chain(texels) {
                reaches_a_texel |= unknown as usize >= n;
                let root = find(&mut parent, unknown);
                match first {
                    None => first = Some(root),
                    Some(other) => {
                        let other = find(&mut parent, other);
                        parent[root.max(other) as usize] = root.min(other);
                    }
                }
            }
            if let (Some(root), true) = (first, reaches_a_texel) {
                seen[root as usize] = true;
            }
        }
        let roots: std::collections::BTreeSet<u32> = (0..seen.len())
            .filter(|&i| seen[i])
            .map(|i| find(&mut parent, i as u32))
            .collect();
        roots.len()
    }
}

fn find(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        parent[node as usize] = parent[parent[node as usize] as usize];
        node = parent[node as usize];
    }
    node
}
