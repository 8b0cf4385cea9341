//! Poses from measured motions between them: robust Gauss-Newton on SE(3) in f64.
//!
//! Minimises Σ ρ(eᵀ Ω e), e = log(Z⁻¹ Tᵢ⁻¹ Tⱼ) of edges i → j with measured motion Z. ρ is Geman-McClure for edges
//! between places that were recognised; its scale begins where no edge is an outlier and shrinks (graduated
//! non-convexity, Yang et al. 2020), so that a drift of many deviations is still closed, and an edge that the others
//! contradict ends with no weight. The first pose stands.

use geometry::{DVec3, Pose, rotation};
use glam::DMat3;

use super::envelope::Envelope;

/// A measured motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    /// Node that the motion is seen from …
    pub(super) from: usize,
    /// … and the node that is seen.
    pub(super) to: usize,
    /// Axes of `from` from axes of `to`.
    pub(super) from_from_to: Pose,
    /// Information about rotation (radians) and translation (metres) of `to` in its own axes.
    pub(super) information: [[f64; 6]; 6],
    /// Whether it may be wrong: then the others decide.
    pub(super) is_loop: bool,
}

/// Squared deviations at which a loop edge has lost three quarters of its weight: 6 are expected.
const OUTLIER_SQUARE: f64 = 40.0;
/// Factor by which the scale shrinks from step to step.
const SHRINK: f64 = 0.5;
/// Most steps.
const STEPS: usize = 40;
/// Step below which the solution stands, radians and metres.
const LEAST_STEP: f64 = 1e-8;
/// Weight below which an edge counts as refused.
const REFUSED_WEIGHT: f64 = 0.05;

/// What the solution is.
#[derive(Clone, Debug)]
pub(super) struct Solved {
    /// World from camera of the nodes.
    pub(super) poses: Vec<Pose>,
    /// Loop edges that the others contradict.
    pub(super) refused_count: usize,
}

/// Solves for the poses of the nodes from `start`.
pub(super) fn solve(start: &[Pose], edges: &[Edge]) -> Solved {
    let mut poses = start.to_vec();
    let loops = edges.iter().filter(|edge| edge.is_loop);
    let worst = loops
        .map(|edge| square(edge, &error(edge, &poses)))
        .fold(0.0, f64::max);
    let mut scale = worst.max(OUTLIER_SQUARE);
    for _ in 0..STEPS {
        let Some(steps) = step(&poses, edges, scale) else {
            break;
        };
        let mut length = 0.0_f64;
        for (pose, step) in poses.iter_mut().skip(1).zip(steps.chunks_exact(6)) {
            let turn = DVec3::new(step[0], step[1], step[2]);
            let shift = DVec3::new(step[3], step[4], step[5]);
            length = length.max(turn.length()).max(shift.length());
            if let Some(motion) = rotation::try_exp_twist(turn, shift) {
                *pose = *pose * motion;
            }
        }
        if length < LEAST_STEP && scale <= OUTLIER_SQUARE {
            break;
        }
        scale = (scale * SHRINK).max(OUTLIER_SQUARE);
    }
    let refused = |edge: &&Edge| {
        edge.is_loop && weight(square(edge, &error(edge, &poses)), OUTLIER_SQUARE) < REFUSED_WEIGHT
    };
    Solved {
        refused_count: edges.iter().filter(refused).count(),
        poses,
    }
}

/// Geman-McClure.
fn weight(square: f64, scale: f64) -> f64 {
    let share = scale / (scale + square);
    share * share
}

fn error(edge: &Edge, poses: &[Pose]) -> [f64; 6] {
    let found = poses[edge.from].inverse() * poses[edge.to];
    let (turn, shift) = rotation::log_twist(&(edge.from_from_to.inverse() * found));
    [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
}

fn square(edge: &Edge, error: &[f64; 6]) -> f64 {
    let weighted = product(&edge.information, error);
    error.iter().zip(weighted).map(|(a, b)| a * b).sum()
}

/// Steps of all nodes but the first, six numbers each; `None` where the graph does not determine them.
fn step(poses: &[Pose], edges: &[Edge], scale: f64) -> Option<Vec<f64>> {
    let count = poses.len().checked_sub(1).filter(|count| *count > 0)?;
    let pairs = edges
        .iter()
        .filter(|edge| edge.from > 0 && edge.to > 0)
        .map(|edge| (edge.from - 1, edge.to - 1));
    let mut matrix = Envelope::new(count, pairs);
    let mut gradient = vec![0.0; 6 * count];
    for edge in edges {
        let error = error(edge, poses);
        let weight = if edge.is_loop {
            weight(square(edge, &error), scale)
        } else {
            1.0
        };
        let information = edge.information.map(|row| row.map(|entry| entry * weight));
        // e(ξ) = e + ξ_to − Ad(to⁻¹ from) ξ_from, for small e.
        let adjoint = adjoint(&(poses[edge.to].inverse() * poses[edge.from]));
        let pulled = product(&information, &error);
        let through = matrix_product(&information, &adjoint);
        if let Some(to) = edge.to.checked_sub(1) {
            matrix.add(to, to, &information);
            for (sum, value) in gradient[6 * to..].iter_mut().zip(pulled) {
                *sum += value;
            }
        }
        if let Some(from) = edge.from.checked_sub(1) {
            let transposed = transpose(&adjoint);
            matrix.add(from, from, &matrix_product(&transposed, &through));
            for (sum, value) in gradient[6 * from..]
                .iter_mut()
                .zip(product(&transposed, &pulled))
            {
                *sum -= value;
            }
            if let Some(to) = edge.to.checked_sub(1) {
                matrix.add(to, from, &through.map(|row| row.map(|entry| -entry)));
            }
        }
    }
    for value in &mut gradient {
        *value = -*value;
    }
    matrix.solve(gradient)
}

/// Adjoint of a motion on (rotation, translation).
fn adjoint(pose: &Pose) -> [[f64; 6]; 6] {
    let rotation = pose.matrix();
    let t = pose.translation();
    let skew = DMat3::from_cols(
        DVec3::new(0.0, t.z, -t.y),
        DVec3::new(-t.z, 0.0, t.x),
        DVec3::new(t.y, -t.x, 0.0),
    );
    let lower = skew * rotation;
    let mut result = [[0.0; 6]; 6];
    for row in 0..3 {
        for column in 0..3 {
            result[row][column] = rotation.col(column)[row];
            result[3 + row][3 + column] = rotation.col(column)[row];
            result[3 + row][column] = lower.col(column)[row];
        }
    }
    result
}

fn product(matrix: &[[f64; 6]; 6], vector: &[f64; 6]) -> [f64; 6] {
    matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

fn matrix_product(a: &[[f64; 6]; 6], b: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| (0..6).map(|k| a[row][k] * b[k][column]).sum())
    })
}

fn transpose(matrix: &[[f64; 6]; 6]) -> [[f64; 6]; 6] {
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[column][row]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn information(sigma: f64) -> [[f64; 6]; 6] {
        std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                if row == column {
                    1.0 / (sigma * sigma)
                } else {
                    0.0
                }
            })
        })
    }

    /// A closed ring of poses that look inwards.
    fn ring(count: usize) -> Vec<Pose> {
        (0..count)
            .map(|index| {
                let angle = std::f64::consts::TAU * index as f64 / count as f64;
                Pose::from_axis_angle(DVec3::Y, angle)
                    * Pose::from_translation(DVec3::new(0.0, 0.1 * angle.sin(), -1.0))
            })
            .collect()
    }

    fn edge(truth: &[Pose], from: usize, to: usize, sigma: f64, is_loop: bool) -> Edge {
        Edge {
            from,
            to,
            from_from_to: truth[from].inverse() * truth[to],
            information: information(sigma),
            is_loop,
        }
    }

    /// The ring with a drift of 1 mm and a milliradian a step, its sequential edges and a closing one.
    fn drifted(truth: &[Pose]) -> (Vec<Pose>, Vec<Edge>) {
        let drift = rotation::exp_twist(DVec3::new(0.0, 1e-3, 5e-4), DVec3::new(1e-3, 0.0, -1e-3));
        let mut start = vec![truth[0]];
        let mut edges = Vec::new();
        for index in 1..truth.len() {
            let motion = truth[index - 1].inverse() * truth[index] * drift;
            start.push(start[index - 1] * motion);
            edges.push(Edge {
                from_from_to: motion,
                ..edge(truth, index - 1, index, 2e-3, false)
            });
        }
        (start, edges)
    }

    fn worst(truth: &[Pose], found: &[Pose]) -> f64 {
        truth
            .iter()
            .zip(found)
            .map(|(t, f)| (t.translation() - f.translation()).length())
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_closed_loop_takes_most_of_a_drift_away() {
        let truth = ring(40);
        let (start, mut edges) = drifted(&truth);
        for (from, to) in [(0, 39), (0, 20), (10, 30), (1, 38)] {
            edges.push(edge(&truth, from, to, 1e-3, true));
        }
        let solved = solve(&start, &edges);
        let (before, after) = (worst(&truth, &start), worst(&truth, &solved.poses));
        println!("drift {before:.4} m, after {after:.4} m");
        assert!(before > 0.03 && after < before / 5.0);
        assert_eq!(solved.refused_count, 0);
    }

    #[test]
    fn a_wrong_loop_is_refused_by_the_right_ones() {
        let truth = ring(40);
        let (start, mut edges) = drifted(&truth);
        for (from, to) in [(0, 39), (0, 20), (10, 30), (1, 38), (5, 25), (15, 35)] {
            edges.push(edge(&truth, from, to, 1e-3, true));
        }
        let right = solve(&start, &edges);
        let mut wrong = edge(&truth, 3, 33, 1e-3, true);
        wrong.from_from_to = wrong.from_from_to * Pose::from_translation(DVec3::new(0.3, 0.0, 0.1));
        edges.push(wrong);
        let solved = solve(&start, &edges);
        assert_eq!(solved.refused_count, 1);
        let moved = worst(&right.poses, &solved.poses);
        println!("moved by {moved:.5} m");
        assert!(moved < 1e-3, "{moved}");
    }

    #[test]
    fn no_edge_moves_nothing() {
        let truth = ring(5);
        let solved = solve(&truth, &[]);
        assert_eq!(solved.poses, truth);
        assert_eq!(solve(&[], &[]).poses, Vec::<Pose>::new());
        assert_eq!(solve(&truth[..1], &[]).poses, truth[..1]);
    }
}
