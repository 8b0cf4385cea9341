//! The point that a budget buys.

use std::collections::BTreeMap;

use anyhow::{Context as _, bail, ensure};
use effects::{Effect, EffectRequests, Request};

use sequence::Recording;

use super::curve::Curve;
use super::table::{MeasuredPoint, Table};
use super::{SAFETY, bench};
use crate::tradeoff::subject::{DEFAULT_POINT, Setting};
use crate::train::TrainConfig;

/// A recording on a machine, as a plan sees them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Training frames times pixels of a photograph.
    pub scene_size: f64,
    /// Score of the machine now, core-milliseconds.
    pub bench_ms: f64,
}

impl Target {
    /// This recording on this machine as it is now; takes about a second.
    ///
    /// # Errors
    /// When the recording has no training frames.
    pub fn measured(recording: &Recording) -> anyhow::Result<Self> {
        let camera = recording.color_camera().intrinsics;
        let frame_count = recording.split().train.len();
        ensure!(frame_count > 0, "the recording has no training frames");
        let pixels = f64::from(camera.width()) * f64::from(camera.height());
        Ok(Self {
            scene_size: frame_count as f64 * pixels,
            bench_ms: bench::score_ms(),
        })
    }
}

/// What a point would cost and how it errs.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// Name of the point.
    pub name: String,
    /// All levels.
    pub setting: Setting,
    /// Core-seconds.
    pub core_s: f64,
    /// Of these, each stage's.
    pub stages: BTreeMap<&'static str, f64>,
    /// Core-seconds of stage `linear` by the pixels that reflect.
    pub linear_s: Curve,
    /// Error over that of the default, geometric mean over the scenes.
    pub error_ratio: f64,
    /// Whether it is, or may be, on the front of a scene.
    pub is_on_front: bool,
}

impl Planned {
    /// Takes its levels.
    ///
    /// # Errors
    /// When a level is none of its key: the table is of another program.
    pub fn apply(&self, config: &mut TrainConfig) -> anyhow::Result<()> {
        for (knob, level) in &self.setting {
            let wrong = || format!("{knob}={level} of the table is no setting of this program");
            match knob.as_str() {
                "pixel-stride" => config.pixel_stride = level.parse().with_context(wrong)?,
                "voxel-mm" => config.voxel_mm = level.parse().with_context(wrong)?,
                "map-height" => config.map_height = level.parse().with_context(wrong)?,
                "frame-stride" => config.frame_stride = level.parse().with_context(wrong)?,
                // Named poses have decided on refinement; the rest is as the table says.
                "effects" if level == "auto" => {}
                "effects" => {
                    let of_table: EffectRequests = level.parse().with_context(wrong)?;
                    config.effects = with_poses(&of_table, &config.effects)?;
                }
                _ => bail!(wrong()),
            }
        }
        Ok(())
    }
}

/// The requests of a table with what was asked about the poses.
pub(super) fn with_poses(
    of_table: &EffectRequests,
    asked: &EffectRequests,
) -> anyhow::Result<EffectRequests> {
    let sign = match asked.of(Effect::PoseRefinement) {
        Request::On => '+',
        Request::Off => '-',
        _ => return Ok(of_table.clone()),
    };
    Ok(format!("{of_table},{sign}{}", Effect::PoseRefinement).parse()?)
}

/// What was chosen, and all that it was chosen from.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Core-seconds.
    pub budget_s: f64,
    /// The choice.
    pub chosen: Planned,
    /// All points.
    pub points: Vec<Planned>,
}

impl Plan {
    /// The point of a name.
    pub fn point(&self, name: &str) -> Option<&Planned> {
        self.points.iter().find(|point| point.name == name)
    }
}

/// Of the points on a front, the one that errs least and costs at most the budget with its reserve.
///
/// # Errors
/// A sentence that names the cheapest point, where none fits.
pub fn plan(tables: &[Table], target: &Target, budget_s: f64) -> anyhow::Result<Plan> {
    let points = planned(tables, target)?;
    let candidates = || points.iter().filter(|point| point.is_on_front);
    let fits = candidates().filter(|point| SAFETY * point.core_s <= budget_s);
    let chosen = fits.min_by(|a, b| {
        let by_error = a.error_ratio.total_cmp(&b.error_ratio);
        by_error.then(a.core_s.total_cmp(&b.core_s))
    });
    let Some(chosen) = chosen.cloned() else {
        let cheapest = candidates()
            .min_by(|a, b| a.core_s.total_cmp(&b.core_s))
            .context("no point of the tables is on a front")?;
        bail!(
            "{budget_s:.0} core-seconds are not enough: the cheapest setting ({}) takes about {:.0}, {:.0} with its \
             reserve; give --budget {:.0}s or a recording with fewer frames",
            cheapest.name,
            cheapest.core_s,
            SAFETY * cheapest.core_s,
            (SAFETY * cheapest.core_s).ceil()
        );
    };
    Ok(Plan {
        budget_s,
        chosen,
        points,
    })
}

/// Every point that all scenes have, scaled to the target.
fn planned(tables: &[Table], target: &Target) -> anyhow::Result<Vec<Planned>> {
    let (first, _) = tables.split_first().context("there is no table")?;
    ensure!(
        target.scene_size > 0.0 && target.bench_ms > 0.0,
        "nothing to plan for: no training frames, or no clock"
    );
    let mut points = Vec::new();
    for point in &first.points {
        let twins: Option<Vec<(&MeasuredPoint, &MeasuredPoint)>> = tables
            .iter()
            .map(|table| Some((table.point(&point.name)?, table.point(DEFAULT_POINT)?)))
            .collect();
        if let Some(twins) = twins {
            points.push(scaled(point, &twins, target));
        }
    }
    Ok(points)
}

fn scaled(
    point: &MeasuredPoint,
    twins: &[(&MeasuredPoint, &MeasuredPoint)],
    target: &Target,
) -> Planned {
    // Cost now and here, by a size of the scenes.
    let curve = |size: &dyn Fn(&MeasuredPoint) -> f64, cost: &dyn Fn(&MeasuredPoint) -> f64| {
        let twins = twins.iter().map(|(twin, _)| twin);
        Curve::new(twins.map(|twin| (size(twin), cost(twin) * target.bench_ms / twin.bench_ms)))
    };
    let of_stage = |name: &'static str| {
        move |twin: &MeasuredPoint| twin.stages.get(name).copied().unwrap_or(0.0)
    };
    let by_size = |cost: &dyn Fn(&MeasuredPoint) -> f64| {
        curve(&|twin| twin.scene_size, cost).at(target.scene_size)
    };
    let logs = twins.iter().map(|(twin, default)| {
        let ratio = twin.error.max(1e-9) / default.error.max(1e-9);
        ratio.ln()
    });
    Planned {
        name: point.name.clone(),
        setting: point.setting.clone(),
        core_s: by_size(&|twin| twin.core_s),
        stages: (point.stages.keys())
            .map(|name| (*name, by_size(&of_stage(name))))
            .collect(),
        linear_s: curve(&|twin| twin.pixels, &of_stage("linear")),
        error_ratio: (logs.sum::<f64>() / twins.len() as f64).exp(),
        is_on_front: twins.iter().any(|(twin, _)| twin.is_on_front),
    }
}
