//! Conjugate gradients under the bounds D ≥ 0 and S ≥ 0.
//!
//! Clamping an unconstrained solution is not the constrained one: neighbours keep values that made up for
//! the negative ones (hard-cases H09). So each pass solves on the unknowns that are free, projects, and
//! frees or fixes unknowns by the sign of their gradient, until the KKT conditions hold.

use crate::problem::{Problem, Rgb};
use crate::regularisation::Regularisation;
use crate::weights::Weights;
use rayon::prelude::*;

/// How far to go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolverSettings {
    /// Conjugate gradient steps a pass (srm-feasibility section 2: 60).
    pub steps: usize,
    /// Passes over the active set.
    pub passes: usize,
    /// A pass ends when the preconditioned residual falls below this share of where it began.
    pub tolerance: f64,
}

impl SolverSettings {
    /// What a round deserves: the next round's weights move the aim of all but the last.
    pub(crate) fn for_round(self, is_last: bool) -> Self {
        if is_last {
            self
        } else {
            Self {
                steps: self.steps.div_ceil(2),
                passes: 1,
                ..self
            }
        }
    }
}

/// What a bounded solve did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolveReport {
    /// Conjugate gradient steps over all passes.
    pub step_count: usize,
    /// Passes made.
    pub pass_count: usize,
    /// Norm of the true residual on free unknowns over that of the right side, recomputed at the end.
    pub relative_residual: f64,
    /// The same as the recursion believed it.
    pub recursive_residual: f64,
    /// Largest violation of the KKT conditions, as an update of the unknown (radiance): the projected,
    /// diagonally scaled gradient.
    pub kkt_violation: f64,
}

/// A quadratic: minimise ½xᵀHx − bᵀx over x ≥ 0, with some unknowns held.
pub struct Quadratic<'a> {
    /// The normal equations.
    pub problem: &'a Problem,
    /// Weights of rows and edges.
    pub weights: &'a Weights,
    /// The regularisers.
    pub regularisation: Regularisation,
    /// b: data and prior.
    pub right_side: Vec<Rgb>,
    /// Unknowns that stay as they are (fixed D, texels without a row).
    pub held: &'a [bool],
}

/// Unknowns that one task of a vector operation handles; fixed, so that sums have one order.
const CHUNK: usize = 8192;

fn dot(a: &[Rgb], b: &[Rgb]) -> f64 {
    let parts: Vec<f64> = a
        .par_chunks(CHUNK)
        .zip(b.par_chunks(CHUNK))
        .map(|(a, b)| {
            a.iter()
                .zip(b)
                .map(|(a, b)| a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
                .sum()
        })
        .collect();
    parts.iter().sum()
}

/// `a += scale · b`.
fn add_scaled(a: &mut [Rgb], scale: f64, b: &[Rgb]) {
    a.par_chunks_mut(CHUNK)
        .zip(b.par_chunks(CHUNK))
        .for_each(|(a, b)| {
            for (a, b) in a.iter_mut().zip(b) {
                for c in 0..3 {
                    a[c] += scale * b[c];
                }
            }
        });
}

impl Quadratic<'_> {
    fn apply(&self, x: &[Rgb]) -> Vec<Rgb> {
        self.problem.apply(self.weights, &self.regularisation, x)
    }

    /// b − Hx: minus the gradient.
    fn residual(&self, x: &[Rgb]) -> Vec<Rgb> {
        let mut residual = self.apply(x);
        for (r, b) in residual.iter_mut().zip(&self.right_side) {
            for c in 0..3 {
                r[c] = b[c] - r[c];
            }
        }
        residual
    }

    /// ½xᵀHx − bᵀx, from the residual r = b − Hx.
    fn value(&self, x: &[Rgb], residual: &[Rgb]) -> f64 {
        -0.5 * (dot(x, &self.right_side) + dot(x, residual))
    }

    /// 1/diagonal of H; 0 where the unknown is held or has no equation.
    fn inverse_diagonal(&self) -> Vec<Rgb> {
        let mut diagonal = self.problem.information(self.weights);
        self.problem.add_regularisation_diagonal(
            &self.regularisation,
            &self.weights.edges,
            &mut diagonal,
        );
        for (value, &held) in diagonal.iter_mut().zip(self.held) {
            *value = if held {
                [0.0; 3]
            } else {
                value.map(|d| if d > 1e-12 { 1.0 / d } else { 0.0 })
            };
        }
        diagonal
    }

    /// Minimises from `x` (which must be ≥ 0 where not held), in place.
    pub fn minimise(&self, x: &mut Vec<Rgb>, settings: &SolverSettings) -> SolveReport {
        let inverse_diagonal = self.inverse_diagonal();
        let mut report = SolveReport::default();
        let mut residual = self.residual(x);
        let scale = dot(&self.right_side, &self.right_side).sqrt().max(1e-300);
        for _ in 0..settings.passes {
            let preconditioner = free_preconditioner(x, &residual, &inverse_diagonal);
            let (step, step_count, recursive) =
                self.conjugate_gradients(&residual, &preconditioner, settings);
            report.step_count += step_count;
            report.pass_count += 1;
            report.recursive_residual = recursive / scale;
            let moved = self.projected_step(x, &residual, &step);
            residual = self.residual(x);
            report.kkt_violation = kkt_violation(x, &residual, &inverse_diagonal);
            if !moved || report.kkt_violation < 1e-6 {
                break;
            }
        }
        report.relative_residual = free_norm(x, &residual, &inverse_diagonal) / scale;
        report
    }

    /// Solves H x = b without bounds, in place: for linear questions such as a variance.
    pub fn solve_unbounded(&self, x: &mut [Rgb], settings: &SolverSettings) -> usize {
        let residual = self.residual(x);
        let (step, step_count, _) =
            self.conjugate_gradients(&residual, &self.inverse_diagonal(), settings);
        add_scaled(x, 1.0, &step);
        step_count
    }

    /// Moves `x` along `step` and projects; halves the step while the value does not fall.
    fn projected_step(&self, x: &mut Vec<Rgb>, residual: &[Rgb], step: &[Rgb]) -> bool {
        let before = self.value(x, residual);
        let mut length = 1.0;
        for _ in 0..6 {
            let mut moved = x.clone();
            add_scaled(&mut moved, length, step);
            for (value, &held) in moved.iter_mut().zip(self.held) {
                if !held {
                    *value = value.map(|v| v.max(0.0));
                }
            }
            let after = self.value(&moved, &self.residual(&moved));
            if after <= before {
                *x = moved;
                return true;
            }
            length *= 0.5;
        }
        false
    }

    /// Solves H d = r on the free unknowns; returns d, the steps and the recursion's residual norm.
    fn conjugate_gradients(
        &self,
        right: &[Rgb],
        preconditioner: &[Rgb],
        settings: &SolverSettings,
    ) -> (Vec<Rgb>, usize, f64) {
        let masked = |vector: &[Rgb]| -> Vec<Rgb> {
            vector
                .par_iter()
                .zip(preconditioner)
                .map(|(v, p)| [0, 1, 2].map(|c| if p[c] > 0.0 { v[c] } else { 0.0 }))
                .collect()
        };
        let precondition = |vector: &[Rgb]| -> Vec<Rgb> {
            vector
                .par_iter()
                .zip(preconditioner)
                .map(|(v, p)| [0, 1, 2].map(|c| v[c] * p[c]))
                .collect()
        };
        let mut residual = masked(right);
        let mut solution = vec![[0.0; 3]; right.len()];
        let mut scaled = precondition(&residual);
        let mut direction = scaled.clone();
        let mut energy = dot(&residual, &scaled);
        let goal = energy * settings.tolerance * settings.tolerance;
        let mut count = 0;
        while count < settings.steps && energy > goal && energy > 0.0 {
            let image = masked(&self.apply(&direction));
            let curvature = dot(&direction, &image);
            if !(curvature > 0.0) {
                break;
            }
            let length = energy / curvature;
            add_scaled(&mut solution, length, &direction);
            count += 1;
            if count % 50 == 0 {
                // The recursion drifts away from the truth (H08): recompute.
                let image = self.apply(&solution);
                residual = right
                    .iter()
                    .zip(&image)
                    .map(|(r, h)| [r[0] - h[0], r[1] - h[1], r[2] - h[2]])
                    .collect();
                residual = masked(&residual);
            } else {
                add_scaled(&mut residual, -length, &image);
            }
            scaled = precondition(&residual);
            let next = dot(&residual, &scaled);
            let ratio = next / energy;
            energy = next;
            direction
                .par_iter_mut()
                .zip(&scaled)
                .for_each(|(d, z)| *d = [0, 1, 2].map(|c| z[c] + ratio * d[c]));
        }
        let norm = dot(&residual, &residual).sqrt();
        (solution, count, norm)
    }
}

/// The diagonal scaling on unknowns that may move: not held, and not at zero with the gradient pushing
/// further down.
fn free_preconditioner(x: &[Rgb], residual: &[Rgb], inverse_diagonal: &[Rgb]) -> Vec<Rgb> {
    x.par_iter()
        .zip(residual)
        .zip(inverse_diagonal)
        .map(|((x, r), d)| [0, 1, 2].map(|c| if x[c] > 0.0 || r[c] > 0.0 { d[c] } else { 0.0 }))
        .collect()
}

/// Largest |x − max(0, x + D⁻¹ r)|.
fn kkt_violation(x: &[Rgb], residual: &[Rgb], inverse_diagonal: &[Rgb]) -> f64 {
    let mut worst: f64 = 0.0;
    for ((x, r), d) in x.iter().zip(residual).zip(inverse_diagonal) {
        for c in 0..3 {
            if d[c] > 0.0 {
                worst = worst.max((x[c] - (x[c] + r[c] * d[c]).max(0.0)).abs());
            }
        }
    }
    worst
}

fn free_norm(x: &[Rgb], residual: &[Rgb], inverse_diagonal: &[Rgb]) -> f64 {
    let mut sum = 0.0;
    for ((x, r), d) in x.iter().zip(residual).zip(inverse_diagonal) {
        for c in 0..3 {
            if d[c] > 0.0 && (x[c] > 0.0 || r[c] > 0.0) {
                sum += r[c] * r[c];
            }
        }
    }
    sum.sqrt()
}
