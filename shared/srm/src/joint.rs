//! Iteratively reweighted least squares around the bounded solve.

use crate::problem::{Problem, Rgb};
use crate::regularisation::Regularisation;
use crate::rows::{Row, luminance};
use crate::solver::{Quadratic, SolveReport, SolverSettings};
use crate::weights::Weights;

/// What is done with D.
#[derive(Clone, Debug, PartialEq)]
pub enum DiffuseTreatment {
    /// D is solved with S and pulled to zero with this weight (pseudo-observations a vertex).
    PulledToZero {
        /// Weight a vertex.
        weight: f64,
    },
    /// D is solved with S and pulled to given values (the robust minimum, say).
    PulledTo {
        /// Linear radiance a vertex.
        values: Vec<[f32; 3]>,
        /// Weight a vertex.
        weight: f64,
    },
    /// D is given and stays (the paper's order: D first, then S).
    Fixed {
        /// Linear radiance a vertex.
        values: Vec<[f32; 3]>,
    },
    /// D alone explains the rows; S stays black. The rival that S has to beat.
    Alone,
}

/// Everything that decides a joint solve.
#[derive(Clone, Debug, PartialEq)]
pub struct JointSettings {
    /// Treatment of D.
    pub diffuse: DiffuseTreatment,
    /// Smoothness of S.
    pub smoothness: f64,
    /// Pull of S to zero, see [`Regularisation::specular_to_zero`].
    pub specular_to_zero: f64,
    /// Residual at which a row begins to lose weight, linear radiance (IRLS scale).
    pub residual_scale: f64,
    /// Step between neighbouring texels at which their smoothness begins to lose weight, linear luminance
    /// (IRLS scale of the map's edges).
    pub edge_scale: f64,
    /// Reweighting rounds.
    pub rounds: usize,
    /// The bounded solver.
    pub solver: SolverSettings,
}

/// D's pull to zero that the feasibility study found best on its scene; training scans around it.
pub const DEFAULT_DIFFUSE_WEIGHT: f64 = 0.5;

/// D's pull when it explains the rows alone: enough to define vertices that no row sees.
const ALONE_WEIGHT: f64 = 1e-3;

/// Rounds of a refit of D: it starts from a solution and one texel's error no longer moves another.
const REFIT_ROUNDS: usize = 2;

impl Default for JointSettings {
    fn default() -> Self {
        Self {
            diffuse: DiffuseTreatment::PulledToZero {
                weight: DEFAULT_DIFFUSE_WEIGHT,
            },
            smoothness: 0.02,
            specular_to_zero: 0.002,
            residual_scale: 0.03,
            edge_scale: 0.2,
            rounds: 4,
            solver: SolverSettings {
                steps: 60,
                passes: 2,
                tolerance: 1e-4,
            },
        }
    }
}

/// D, S and what they are worth.
#[derive(Clone, Debug)]
pub struct Solution {
    /// D a vertex, linear radiance.
    pub diffuse: Vec<[f32; 3]>,
    /// S a texel, row-major; 0 where no row reaches (see [`Problem::covered`]).
    pub specular: Vec<[f32; 3]>,
    /// The unknowns in full precision, vertices first.
    pub unknowns: Vec<Rgb>,
    /// Final weights of rows and edges.
    pub weights: Weights,
    /// What the last bounded solve did.
    pub report: SolveReport,
    /// Robust residual of the rows that were solved from, luminance (1.4826 · median |r|).
    pub residual_sigma: f64,
}

impl JointSettings {
    /// The regularisers of these settings.
    pub fn regularisation(&self) -> Regularisation {
        let diffuse_to_prior = match &self.diffuse {
            DiffuseTreatment::PulledToZero { weight }
            | DiffuseTreatment::PulledTo { weight, .. } => *weight,
            DiffuseTreatment::Fixed { .. } | DiffuseTreatment::Alone => ALONE_WEIGHT,
        };
        Regularisation {
            smoothness: self.smoothness,
            specular_to_zero: self.specular_to_zero,
            diffuse_to_prior,
        }
    }
}

/// Luminance of what the model leaves unexplained; a met lower bound leaves nothing.
pub fn row_residual(row: &Row, predicted: Rgb) -> f64 {
    let mut residual = [0.0; 3];
    for c in 0..3 {
        residual[c] = f64::from(row.observed[c]) - predicted[c];
        if row.clipped & (1 << c) != 0 {
            residual[c] = residual[c].max(0.0);
        }
    }
    luminance(residual)
}

impl Problem {
    /// Solves for D and S (srm-feasibility section 2). Starts at D = S = 0 unless D is given.
    pub fn solve(&self, settings: &JointSettings) -> Solution {
        self.solve_from(settings, vec![[0.0; 3]; self.unknown_count()])
    }

    /// Solves from a start (`unknowns`: vertices, then texels); negative values are raised to zero.
    pub fn solve_from(&self, settings: &JointSettings, mut unknowns: Vec<Rgb>) -> Solution {
        let n = self.vertex_count();
        unknowns.resize(self.unknown_count(), [0.0; 3]);
        for value in &mut unknowns {
            *value = value.map(|v| if v > 0.0 { v } else { 0.0 });
        }
        let mut held: Vec<bool> = vec![false; n];
        held.extend(self.covered().iter().map(|covered| !covered));
        let mut prior = vec![[0.0; 3]; n];
        match &settings.diffuse {
            DiffuseTreatment::PulledTo { values, .. } => {
                for (aim, value) in prior.iter_mut().zip(values) {
                    *aim = value.map(f64::from);
                }
            }
            DiffuseTreatment::Fixed { values } => {
                for (vertex, value) in values.iter().enumerate().take(n) {
                    unknowns[vertex] = value.map(|v| f64::from(v).max(0.0));
                }
                held[..n].fill(true);
            }
            DiffuseTreatment::Alone => {
                held[n..].fill(true);
                unknowns[n..].fill([0.0; 3]);
            }
            DiffuseTreatment::PulledToZero { .. } => {}
        }
        for (value, &is_held) in unknowns[n..].iter_mut().zip(&held[n..]) {
            if is_held {
                *value = [0.0; 3];
            }
        }
        self.iterate(settings, settings.regularisation(), unknowns, &held, &prior)
    }

    /// D once more with S as it is and D's prior next to nothing. The prior that decides the split darkens
    /// D on purpose; what is left of the rows once S is known belongs to D.
    pub fn refit_diffuse(&self, solution: &Solution, settings: &JointSettings) -> Solution {
        let n = self.vertex_count();
        let mut held = vec![false; n];
        held.resize(self.unknown_count(), true);
        let regularisation = Regularisation {
            diffuse_to_prior: ALONE_WEIGHT,
            ..settings.regularisation()
        };
        let settings = JointSettings {
            rounds: REFIT_ROUNDS,
            ..settings.clone()
        };
        let prior = vec![[0.0; 3]; n];
        self.iterate(
            &settings,
            regularisation,
            solution.unknowns.clone(),
            &held,
            &prior,
        )
    }

    /// Rounds of reweighting around the bounded solve. Unknowns that are `held` keep their value.
    fn iterate(
        &self,
        settings: &JointSettings,
        regularisation: Regularisation,
        mut unknowns: Vec<Rgb>,
        held: &[bool],
        diffuse_prior: &[Rgb],
    ) -> Solution {
        let n = self.vertex_count();
        let mut report = SolveReport::default();
        let mut weights = self.first_weights();
        for round in 0..settings.rounds.max(1) {
            if round > 0 {
                weights = self.reweighted(&unknowns, settings.residual_scale, settings.edge_scale);
            }
            let mut right_side = self.right_side(&weights);
            for (target, aim) in right_side[..n].iter_mut().zip(diffuse_prior) {
                for c in 0..3 {
                    target[c] += regularisation.diffuse_to_prior * aim[c];
                }
            }
            let quadratic = Quadratic {
                problem: self,
                weights: &weights,
                regularisation,
                right_side,
                held,
            };
            let is_last = round + 1 == settings.rounds.max(1);
            report = quadratic.minimise(&mut unknowns, &settings.solver.for_round(is_last));
        }
        let mut residuals: Vec<f64> =
            self.map_rows(|_, row| row_residual(row, self.predict(row, &unknowns)).abs());
        let residual_sigma = geometry::robust::MAD_TO_SIGMA
            * geometry::robust::median(&mut residuals).unwrap_or(0.0);
        Solution {
            diffuse: unknowns[..n].iter().map(|v| v.map(|v| v as f32)).collect(),
            specular: unknowns[n..].iter().map(|v| v.map(|v| v as f32)).collect(),
            weights: self.reweighted(&unknowns, settings.residual_scale, settings.edge_scale),
            unknowns,
            report,
            residual_sigma,
        }
    }
}
