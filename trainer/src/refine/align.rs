//! One frame against a predicted view, shape and look together, from a start that is nearly right.
//!
//! [`fusion::tracking::Icp`] takes a step only where shape agrees better; here the sum of both decides, so that what a
//! photograph knows more sharply than depth is believed.
//!
//! A quarter of the image's size is enough, and better than half: there the noise of a photograph is in its gradients
//! and its residuals alike and pulls towards the grid of its pixels, so that frames of an exact path wander by 0.5 mm
//! from round to round.

use fusion::Level;
use fusion::ModelView;
use fusion::kernels::icp::{IcpStep, IcpSums, ModelPixels, sum_tile};
use fusion::tracking::equations::NormalEquations;
use fusion::tracking::icp::moved;
use fusion::tracking::{GreyFrame, Photometric, PointPyramid};
use geometry::{DVec3, Pose};
use glam::DMat3;

/// Size of frame and photograph: 1 = a quarter.
const LEVEL: usize = 1;
/// Most steps.
const STEPS: usize = 5;
/// Step below which nothing changes any more, metres at the root mean square radius.
const LEAST_STEP: f64 = 1e-5;
/// Share of the largest eigenvalue below which a direction keeps its start.
const LEAST_EIGENVALUE: f64 = 1e-4;
/// Share of what a photograph claims to know that is added to what depth knows. Live tracking asks photographs only
/// where depth is silent and may believe them; here they are weighed against depth everywhere, and believed in full they
/// pull cameras after what looks alike: on mitsuba-dev the residual flow then stays at 0.38 pixels in place of 0.23.
const PHOTOMETRIC_SHARE: f64 = 1.0 / 12.0;

/// How pairs are made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pairing {
    /// Largest distance of a pair, metres.
    pub(super) largest_distance: f32,
    /// Scale of Geman-McClure in standard deviations of depth.
    pub(super) robust_scale: f32,
}

/// Where an alignment ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aligned {
    /// Live depth camera to the view's camera.
    pub(super) view_from_live: Pose,
    /// Information about the motion (rotation in radians, translation in metres) of the live camera in its axes.
    pub(super) information: [[f64; 6]; 6],
    /// Sums at that pose.
    pub(super) sums: IcpSums,
    /// Points of the frame.
    pub(super) point_count: usize,
}

/// Aligns a frame with a view. `None` without points, or where a step is no number.
pub(super) fn align(
    points: &PointPyramid,
    view: &ModelView,
    grey: Option<&GreyFrame>,
    start: &Pose,
    pairing: Pairing,
) -> Option<Aligned> {
    let instructions = Level::detect();
    let level = LEVEL.min(points.levels().len().checked_sub(1)?);
    let extent = points.extent()?;
    let radius = extent.radius.max(1e-3);
    let mut photometric = Photometric::default();
    let mut pose = *start;
    let mut last = None;
    for step in 0..=STEPS {
        let center = pose.transform_point(extent.center);
        let sums = sum(instructions, points, view, &pose, center, level, pairing);
        let mut equations = NormalEquations::from_triangle(&sums.hessian, &sums.gradient, radius);
        let seen =
            grey.and_then(|grey| photometric.equations(view, grey, &pose, center, radius, level));
        if let Some(term) = seen {
            equations = total(equations, &term.equations, PHOTOMETRIC_SHARE);
        }
        let solution = equations.solve(LEAST_EIGENVALUE);
        let length = solution.step.iter().map(|s| s * s).sum::<f64>().sqrt();
        let information = information(&equations, &pose, center, radius);
        last = Some(Aligned {
            view_from_live: pose,
            information,
            sums,
            point_count: points.levels()[level].points.measured_count(),
        });
        // The first evaluation also settles gain and spread of the photograph.
        if step == STEPS || (step > 0 && !(length > LEAST_STEP)) {
            break;
        }
        pose = moved(&pose, &solution.step, center, radius)?;
    }
    last
}

fn sum(
    instructions: Level,
    points: &PointPyramid,
    view: &ModelView,
    pose: &Pose,
    center: DVec3,
    level: usize,
    pairing: Pairing,
) -> IcpSums {
    let grid = &points.levels()[level].points;
    let model = ModelPixels::of(view);
    let step = IcpStep::at(pose, center, pairing.largest_distance, pairing.robust_scale);
    let mut total = IcpSums::ZERO;
    for index in 0..grid.tile_count() {
        total.add(&sum_tile(instructions, grid.tile(index), model, &step));
    }
    total
}

/// `sum` and `share` of `other`.
fn total(mut sum: NormalEquations, other: &NormalEquations, share: f64) -> NormalEquations {
    for row in 0..6 {
        for column in 0..6 {
            sum.hessian[row][column] += share * other.hessian[row][column];
        }
        sum.gradient[row] += share * other.gradient[row];
    }
    sum
}

/// The equations' Hessian about (ω R, t) at `center` in view axes, as information about the rotation and the
/// position of the live camera in its own axes: with ω = A ω', δ = A δ' of the rotation A of `pose`, its position p and
/// the centre c, t = δ − ω × (p − c).
fn information(
    equations: &NormalEquations,
    pose: &Pose,
    center: DVec3,
    radius: f64,
) -> [[f64; 6]; 6] {
    let rotation: DMat3 = pose.matrix();
    let arm = pose.translation() - center;
    let mut columns = [[0.0; 6]; 6];
    for axis in 0..3 {
        let direction = rotation.col(axis);
        let shift = -direction.cross(arm);
        let turn = direction * radius;
        columns[axis] = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        columns[3 + axis] = [0.0, 0.0, 0.0, direction.x, direction.y, direction.z];
    }
    let mut result = [[0.0; 6]; 6];
    for (row, left) in columns.iter().enumerate() {
        let through: [f64; 6] =
            std::array::from_fn(|k| (0..6).map(|i| left[i] * equations.hessian[i][k]).sum());
        for (column, right) in columns.iter().enumerate() {
            result[row][column] = through.iter().zip(right).map(|(a, b)| a * b).sum();
        }
    }
    result
}
