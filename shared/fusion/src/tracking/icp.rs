//! Frame-to-model alignment: coarse to fine, damped, never worse than its start.

use geometry::{DVec3, Pose, rotation};
use rayon::prelude::*;

use super::equations::{NormalEquations, Solution};
use super::photometric::{GreyFrame, Photometric};
use super::points::{PointGrid, PointPyramid};
use crate::kernels::Level;
use crate::kernels::icp::{IcpStep, IcpSums, ModelPixels, sum_tile};
use crate::model_view::ModelView;

/// Iterations on one size of the live image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IcpPass {
    /// Size: 0 = half, 1 = quarter, 2 = eighth of the full image.
    pub level: usize,
    /// Most evaluations.
    pub iterations: usize,
    /// Largest distance of a pair, metres.
    pub largest_distance: f32,
    /// Scale of Geman-McClure in standard deviations of the sensor (hard-cases C08).
    pub robust_scale: f32,
    /// Whether the photograph counts.
    pub photometric: bool,
}

/// Settings of the alignment.
#[derive(Clone, Debug, PartialEq)]
pub struct IcpConfig {
    /// Passes in their order.
    pub passes: Vec<IcpPass>,
    /// Standard deviation of the model's normals, radians: it fills directions that nothing observes.
    pub normal_sigma: f64,
    /// Share of the largest eigenvalue below which the photometric term counts more than half.
    pub photometric_knee: f64,
    /// Step below which a pass ends, metres at the root mean square radius.
    pub least_step: f64,
}

impl Default for IcpConfig {
    fn default() -> Self {
        let pass = |level, iterations, largest_distance, robust_scale| IcpPass {
            level,
            iterations,
            largest_distance,
            robust_scale,
            photometric: level < 2,
        };
        Self {
            // 10 mm to 2.5 mm at 1 m, where σ is 1.6 mm (hard-cases C08); wider scales drift more (measured).
            passes: vec![
                pass(2, 8, 0.15, 6.0),
                pass(1, 5, 0.08, 3.0),
                pass(0, 4, 0.05, 1.5),
            ],
            normal_sigma: 0.01,
            photometric_knee: 0.01,
            least_step: 2e-5,
        }
    }
}

impl IcpConfig {
    /// Share of the largest eigenvalue from which a direction counts as observed: noise of normals fills the null
    /// space with σ² (hard-cases C01, table).
    pub fn observed_threshold(&self) -> f64 {
        (10.0 * self.normal_sigma * self.normal_sigma).max(1e-5)
    }
}

/// Where an alignment ended.
#[derive(Clone, Copy, Debug)]
pub struct Alignment {
    /// Live camera to view camera.
    pub view_from_live: Pose,
    /// Sums of the last pass at that pose.
    pub sums: IcpSums,
    /// Points of the last pass.
    pub point_count: usize,
    /// Robust cost per point that met the model in the last pass, 0 to 1; one too far from it costs 1.
    pub cost: f64,
    /// The equations at that pose, geometry and photometry.
    pub equations: NormalEquations,
    /// What they observe.
    pub solution: Solution,
    /// Centre of rotation of the equations, view axes, metres.
    pub center: DVec3,
    /// Root mean square radius about it, metres.
    pub radius: f64,
    /// Root mean square photometric residual and count, where the term was used.
    pub photometric: Option<(f64, usize)>,
}

/// Aligns frames with predicted views; holds scratch memory.
#[derive(Debug)]
pub struct Icp {
    config: IcpConfig,
    level: Level,
    tiles: Vec<IcpSums>,
}

/// What one alignment works on.
#[derive(Clone, Copy)]
pub struct IcpInput<'a> {
    /// The live points.
    pub points: &'a PointPyramid,
    /// The model.
    pub view: &'a ModelView,
    /// The live photograph, where it helps.
    pub grey: Option<&'a GreyFrame>,
}

impl Icp {
    /// With the fastest instructions of this machine.
    pub fn new(config: IcpConfig) -> Self {
        Self::with_level(config, Level::detect())
    }

    /// With the given instructions.
    pub fn with_level(config: IcpConfig, level: Level) -> Self {
        Self {
            config,
            level,
            tiles: Vec::new(),
        }
    }

    /// The settings.
    pub fn config(&self) -> &IcpConfig {
        &self.config
    }

    /// Runs passes `range` of the schedule from `start`. `None` without points to work on.
    ///
    /// The result of each pass costs no more than its start (hard-cases C14).
    pub fn align(
        &mut self,
        input: IcpInput<'_>,
        photometric: &mut Photometric,
        start: Pose,
        range: std::ops::Range<usize>,
    ) -> Option<Alignment> {
        let mut pose = start;
        let mut found = None;
        for index in range {
            let pass = *self.config.passes.get(index)?;
            let alignment = self.run_pass(input, photometric, pose, pass)?;
            pose = alignment.view_from_live;
            found = Some(alignment);
        }
        found
    }

    fn run_pass(
        &mut self,
        input: IcpInput<'_>,
        photometric: &mut Photometric,
        start: Pose,
        pass: IcpPass,
    ) -> Option<Alignment> {
        let levels = input.points.levels();
        let level = pass.level.min(levels.len().checked_sub(1)?);
        let points = &levels[level].points;
        let extent = input.points.extent()?;
        let radius = extent.radius.max(1e-3);
        let center = start.transform_point(extent.center);
        let threshold = self.config.observed_threshold();

        let mut best: Option<Alignment> = None;
        let mut pose = start;
        let mut share = 1.0;
        for _ in 0..pass.iterations.max(1) {
            let sums = self.sum(points, input.view, &pose, center, pass);
            // Points that leave the view are no loss; those that meet a surface elsewhere are.
            let met = f64::from(sums.met_count);
            let cost = (sums.cost + met - f64::from(sums.pair_count)) / met.max(1.0);
            if best.as_ref().is_none_or(|best| cost <= best.cost) {
                share = 1.0;
                let mut equations =
                    NormalEquations::from_triangle(&sums.hessian, &sums.gradient, radius);
                let mut measured = None;
                if let Some(grey) = input.grey.filter(|_| pass.photometric)
                    && let Some(term) =
                        photometric.equations(input.view, grey, &pose, center, radius, level)
                {
                    equations = equations.blend(&term.equations, self.config.photometric_knee);
                    measured = Some((term.rms, term.count));
                }
                let solution = equations.solve(threshold);
                best = Some(Alignment {
                    view_from_live: pose,
                    sums,
                    point_count: points.measured_count(),
                    cost,
                    equations,
                    solution,
                    center,
                    radius,
                    photometric: measured,
                });
            } else {
                share *= 0.5;
            }
            let best = best.as_mut()?;
            let step = best.solution.step.map(|s| s * share);
            let length = step.iter().map(|s| s * s).sum::<f64>().sqrt();
            pose = moved(&best.view_from_live, &step, center, radius)?;
            if !(length > self.config.least_step) {
                // Too short to be worth a look, but a camera at rest comes to rest by it (hard-cases C12).
                best.view_from_live = pose;
                break;
            }
        }
        best
    }

    fn sum(
        &mut self,
        points: &PointGrid,
        view: &ModelView,
        pose: &Pose,
        center: DVec3,
        pass: IcpPass,
    ) -> IcpSums {
        let model = ModelPixels::of(view);
        let step = IcpStep::at(pose, center, pass.largest_distance, pass.robust_scale);
        self.tiles.resize(points.tile_count(), IcpSums::ZERO);
        let level = self.level;
        self.tiles
            .par_iter_mut()
            .with_min_len(4)
            .enumerate()
            .for_each(|(index, sums)| *sums = sum_tile(level, points.tile(index), model, &step));
        let mut total = IcpSums::ZERO;
        for tile in &self.tiles {
            total.add(tile);
        }
        total
    }
}

/// `pose` after the small motion `step` = (ω R, t) about `center`; `None` when it is not finite.
pub fn moved(pose: &Pose, step: &[f64; 6], center: DVec3, radius: f64) -> Option<Pose> {
    let turn = DVec3::new(step[0], step[1], step[2]) / radius;
    let shift = DVec3::new(step[3], step[4], step[5]);
    let turned = Pose::new(rotation::exp(turn), DVec3::ZERO).ok()?;
    let about_center = Pose::new(
        turned.rotation(),
        center - turned.transform_vector(center) + shift,
    )
    .ok()?;
    Some(about_center * *pose)
}
