//! `glint train`: the stages one after the other, each with its outputs, cost and event.

mod explain;
mod outputs;

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Context as _;
use effects::{Counters, Effect, EffectRequests, EffectsFile, Habit, Verdict};
use sequence::Recording;
use serde::{Deserialize, Serialize};
use serde_json::json;

pub use self::explain::explain;
use self::outputs::{write_colors, write_geometry, write_linear};
use crate::budget::Pacer;
use crate::clock::{Cost, Stopwatch};
use crate::effects::{self as called, Decided, EFFECTS_FILE, EffectPlan};
use crate::progress::Progress;
use crate::run_folder::{Manifest, RunFolder};
use crate::stages::Refusal;
use crate::stages::diffuse::{VertexColors, vertex_colors};
use crate::stages::geometry::{self, Geometry};
use crate::stages::linear::{self, DiffuseOrder, LinearSettings, SRM_HEIGHT};
use crate::stages::object::{DominantPlane, ObjectParts, Segment, WorldBox, find_object};
use crate::stages::observe::{ColorView, FrameObservations, Observations, Surface, observe};
use crate::stages::poses::{self, Posed, PosedFrame, REFINED};
use crate::tradeoff::machine::rss_peak_mb;

/// Every key of a training run, `config.toml`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// The recording.
    pub recording: PathBuf,
    /// Profile.
    pub profile: String,
    /// Pose set.
    pub poses: String,
    /// Voxel edge of the mesh, millimetres.
    pub voxel_mm: f64,
    /// Every how many pixels in x and y give a row.
    pub pixel_stride: u32,
    /// Rows of the specular map, which is twice as wide.
    #[serde(default = "usual_map_height")]
    pub map_height: u32,
    /// Every how many training frames one is used.
    #[serde(default = "every_frame")]
    pub frame_stride: u32,
    /// Treatment of D.
    pub diffuse: DiffuseOrder,
    /// Box that holds the object, world metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_box: Option<WorldBox>,
    /// Effects asked for, as typed; the rest is decided by what the recording shows.
    #[serde(default)]
    pub effects: EffectRequests,
    /// Seed of the random plane search.
    pub seed: u64,
    /// Worker threads.
    pub threads: usize,
}

fn usual_map_height() -> u32 {
    SRM_HEIGHT
}

fn every_frame() -> u32 {
    1
}

/// What was left out and what remained, `geometry/object.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ObjectSummary {
    /// Planes that were left out.
    pub planes: Vec<DominantPlane>,
    /// Segments of the object.
    pub segments: Vec<Segment>,
}

/// The end of a training run.
#[derive(Clone, Debug, Serialize)]
pub struct TrainSummary {
    /// Sentence about what was found.
    pub sentence: String,
    /// Whether anything shiny was found.
    pub found_specular: bool,
    /// Training frames used.
    pub frames: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Pixels of the object that reflect, from which rows are made.
    pub pixels: usize,
    /// Rows of the linear stage.
    pub rows: usize,
    /// Share of texels claimed.
    pub claimed_fraction: f64,
    /// Verdict on every effect.
    pub effects: BTreeMap<Effect, Verdict>,
    /// What was computed for effects.
    pub counters: Counters,
    /// Cost of the whole run.
    pub cost: Cost,
    /// Largest resident memory, mebibytes.
    pub rss_peak_mb: f64,
}

/// Name of the mesh inside a run folder: world positions, smoothed normals, segments.
pub const MESH_FILE: &str = "geometry/mesh.ply";
/// Name of D's mesh of the linear stage.
pub const LINEAR_DIFFUSE_FILE: &str = "linear/diffuse.ply";
/// Name of the median colours: what diffuse alone says, and the radiance of a first bounce.
pub const MEDIAN_FILE: &str = "diffuse/median.ply";
/// Name of the specular map.
pub const SRM_FILE: &str = "linear/srm0.exr";
/// Name of its confidence.
pub const CONFIDENCE_FILE: &str = "linear/confidence.exr";
/// Name of what was computed for effects.
pub const COUNTERS_FILE: &str = "linear/counters.json";

struct Stages<'a> {
    folder: &'a RunFolder,
    progress: &'a Progress,
    costs: BTreeMap<String, Cost>,
}

impl Stages<'_> {
    fn run<T>(
        &mut self,
        name: &str,
        work: impl FnOnce(&Progress) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        crate::interrupt::check()?;
        let watch = Stopwatch::start();
        self.progress.stage(name);
        let result = work(self.progress).with_context(|| format!("stage {name}"))?;
        let cost = watch.cost();
        self.folder
            .log(&json!({"event": "stage", "stage": name, "cost": cost}))?;
        tracing::info!(
            "{name}: {:.1} s wall, {:.1} core-seconds",
            cost.wall_s,
            cost.core_s
        );
        // A stage that ran again on refined poses counts with all it took.
        let sum = self.costs.entry(name.to_owned()).or_default();
        sum.wall_s += cost.wall_s;
        sum.core_s += cost.core_s;
        Ok(result)
    }
}

/// Trains in profile `draft` into `folder`. Reads training frames only. Verdicts of a run that was in the folder
/// before stand where this one's evidence leaves them open.
///
/// # Errors
/// When recording or folder cannot be used, and where a stage refuses its input.
pub fn train(
    config: &TrainConfig,
    folder: &RunFolder,
    progress: &Progress,
) -> anyhow::Result<TrainSummary> {
    train_paced(config, folder, None, progress)
}

/// Refuses a recording of infrared, and of colours that this version does not know.
///
/// # Errors
/// One sentence.
pub fn require_colors(recording: &Recording) -> anyhow::Result<()> {
    let layout = recording.color_camera().layout();
    layout.with_context(|| format!("{} cannot be trained on", recording.path().display()))?;
    Ok(())
}

/// As [`train`], with settings that give way where a budget asks for it.
///
/// # Errors
/// As [`train`].
pub fn train_paced(
    config: &TrainConfig,
    folder: &RunFolder,
    pacer: Option<&Pacer>,
    progress: &Progress,
) -> anyhow::Result<TrainSummary> {
    let whole = Stopwatch::start();
    let recording = Recording::open(&config.recording)?;
    require_colors(&recording)?;
    let previous = called::previous_file(folder);
    folder.write("config.toml", toml::to_string(config)?.as_bytes())?;
    let mut stages = Stages {
        folder,
        progress,
        costs: BTreeMap::new(),
    };
    let Called {
        frames,
        ground,
        decided,
        is_refined,
    } = call(config, &recording, previous.as_ref(), pacer, &mut stages)?;
    if is_refined && config.poses != REFINED {
        let resolved = TrainConfig {
            poses: REFINED.to_owned(),
            ..config.clone()
        };
        folder.write("config.toml", toml::to_string(&resolved)?.as_bytes())?;
    }
    folder.write_json(EFFECTS_FILE, &decided.file)?;
    for record in &decided.file.effects {
        tracing::info!("{}", effects::explain::line(record));
    }
    for warning in &decided.file.warnings {
        tracing::warn!("{warning}");
    }

    let Ground {
        surface,
        normal_sigma,
        triangle_count,
    } = ground;
    let stride = config.pixel_stride;
    let stride = pacer.map_or(stride, |pacer| pacer.before_diffuse(stride));
    let (observations, colors) = stages.run("diffuse", |progress| {
        look(
            stride,
            &recording,
            &decided.plan,
            (&surface, &normal_sigma),
            &frames,
            folder,
            progress,
        )
    })?;
    let mut settings = LinearSettings {
        diffuse: config.diffuse,
        map_height: config.map_height,
        row_step: 1,
        rounds: None,
    };
    let pixel_count = observations.iter().map(|frame| frame.pixels.len()).sum();
    if let Some(pacer) = pacer {
        settings = pacer.before_linear(settings, pixel_count);
    }
    let linear = stages.run("linear", |_| {
        let linear = linear::solve(&surface, &observations, &colors, &settings, &decided.plan)?;
        write_linear(folder, &surface, &linear)?;
        Ok(linear)
    })?;
    let mut counters = linear.counters.clone();
    for frame in &observations {
        counters += &frame.counters;
    }
    folder.write_json(COUNTERS_FILE, &counters)?;

    let cost = whole.cost();
    folder.write_json(
        "manifest.json",
        &Manifest {
            glint_version: env!("CARGO_PKG_VERSION").to_owned(),
            recording: config.recording.clone(),
            recording_hash: recording.content_hash().to_string(),
            profile: config.profile.clone(),
            newest_stage: "linear".to_owned(),
            stages: stages.costs,
            threads: config.threads,
        },
    )?;
    Ok(TrainSummary {
        sentence: linear.summary.sentence.clone(),
        found_specular: linear.summary.found_specular,
        frames: frames.len(),
        triangles: triangle_count,
        pixels: pixel_count,
        rows: linear.summary.row_count,
        claimed_fraction: linear.summary.claimed_fraction,
        effects: verdicts(&decided.file),
        counters,
        cost,
        rss_peak_mb: rss_peak_mb(),
    })
}

fn verdicts(file: &EffectsFile) -> BTreeMap<Effect, Verdict> {
    let records = file.effects.iter();
    records.map(|record| (record.id, record.verdict)).collect()
}

/// The surface that everything else stands on.
struct Ground {
    surface: Surface,
    normal_sigma: Vec<f32>,
    triangle_count: usize,
}

/// What the recording calls for, and what it was found out on.
struct Called {
    frames: Vec<PosedFrame>,
    ground: Ground,
    decided: Decided,
    is_refined: bool,
}

/// Poses, geometry and verdicts; once more on refined poses where those are called for.
fn call(
    config: &TrainConfig,
    recording: &Recording,
    previous: Option<&EffectsFile>,
    pacer: Option<&Pacer>,
    stages: &mut Stages<'_>,
) -> anyhow::Result<Called> {
    let folder = stages.folder;
    let wish = config.effects.of(Effect::PoseRefinement);
    let is_asked = wish == effects::Request::On || config.poses == REFINED;
    let mut requests = config.effects.clone();
    if is_asked {
        requests = format!("{requests},+pose-refinement")
            .trim_matches(',')
            .parse()?;
    }
    let posed = |stages: &mut Stages<'_>, refines: bool| {
        stages.run("poses", |progress| {
            let posed = poses::run(recording, &config.poses, refines, folder, progress)?;
            Ok(Posed {
                frames: poses::every_nth(posed.frames, config.frame_stride)?,
                ..posed
            })
        })
    };
    let deciding = |stages: &mut Stages<'_>, ground: &Ground, posed: &Posed| {
        let requests =
            pacer.map_or_else(|| requests.clone(), |pacer| pacer.before_effects(&requests));
        stages.run("effects", |_| {
            let request = called::Request {
                requests: &requests,
                habit: Habit::Cheap,
                previous,
                refinement: posed.refinement.as_ref(),
                compares: true,
                stride: config.pixel_stride,
                seed: config.seed,
            };
            called::decide(recording, &ground.surface, &posed.frames, &request)
        })
    };
    let first = posed(stages, is_asked)?;
    let built = ground(config, recording, &first.frames, stages);
    let is_open = wish == effects::Request::Auto && !is_asked;
    let (ground_of_first, decided) = match built {
        Err(error) if is_open && fits_badly(&error) => (None, None),
        built => {
            let built = built?;
            let decided = deciding(stages, &built, &first)?;
            (Some(built), Some(decided))
        }
    };
    if let (Some(ground), Some(decided)) = (ground_of_first, decided) {
        if !(decided.wants_refinement && is_open) {
            let is_refined = first.refinement.is_some();
            return Ok(Called {
                frames: first.frames,
                ground,
                decided,
                is_refined,
            });
        }
        let second = posed(stages, true)?;
        match &second.refinement {
            Some(summary) if !summary.is_used => {
                return Ok(Called {
                    frames: first.frames,
                    ground,
                    decided: decided.without_refinement(summary),
                    is_refined: false,
                });
            }
            _ => return on_refined(config, recording, second, stages, &deciding),
        }
    }
    let second = posed(stages, true)?;
    on_refined(config, recording, second, stages, &deciding)
}

/// Geometry and verdicts on refined poses.
fn on_refined(
    config: &TrainConfig,
    recording: &Recording,
    posed: Posed,
    stages: &mut Stages<'_>,
    deciding: &dyn Fn(&mut Stages<'_>, &Ground, &Posed) -> anyhow::Result<Decided>,
) -> anyhow::Result<Called> {
    let ground = ground(config, recording, &posed.frames, stages)?;
    let decided = deciding(stages, &ground, &posed)?;
    Ok(Called {
        frames: posed.frames,
        ground,
        decided,
        is_refined: true,
    })
}

fn fits_badly(error: &anyhow::Error) -> bool {
    matches!(
        error.downcast_ref::<Refusal>(),
        Some(Refusal::PosesDoNotFit { .. })
    )
}

/// Stage `geometry`: the surface of the frames, cut into what is the object and what is not.
fn ground(
    config: &TrainConfig,
    recording: &Recording,
    frames: &[PosedFrame],
    stages: &mut Stages<'_>,
) -> anyhow::Result<Ground> {
    let folder = stages.folder;
    let voxel_size = (config.voxel_mm * 1e-3) as f32;
    stages.run("geometry", |progress| {
        let geometry = geometry::build(recording, frames, voxel_size, &mut |done, of| {
            progress.step(done, of);
        })?;
        let parts = find_object(&geometry.mesh, config.object_box.as_ref(), config.seed);
        write_geometry(folder, &geometry, &parts)?;
        note_repeats("depth", geometry.summary.repeated_frame_count);
        surface_of(geometry, parts, voxel_size)
    })
}

fn surface_of(geometry: Geometry, parts: ObjectParts, voxel_size: f32) -> anyhow::Result<Ground> {
    Ok(Ground {
        surface: Surface::fused(geometry.mesh, parts.vertex_segment, voxel_size)?,
        normal_sigma: geometry.normal_sigma,
        triangle_count: geometry.summary.triangle_count,
    })
}

/// Stage `diffuse`: pixels and colours of the training frames.
fn look(
    stride: u32,
    recording: &Recording,
    plan: &EffectPlan,
    (surface, normal_sigma): (&Surface, &[f32]),
    frames: &[PosedFrame],
    folder: &RunFolder,
    progress: &Progress,
) -> anyhow::Result<(Vec<FrameObservations>, VertexColors)> {
    let Observations {
        frames: observations,
        repeated_frame_count,
    } = observe(
        recording,
        &ColorView::with_effects(recording, plan.computed),
        surface,
        normal_sigma,
        frames,
        &plan.pixel_rules(stride),
        &|done, of| progress.step(done, of),
    )?;
    let colors = vertex_colors(surface, &observations);
    write_colors(folder, surface, &colors)?;
    note_repeats("colour", repeated_frame_count);
    folder.write_json(
        "diffuse/summary.json",
        &json!({
            "frame_count": observations.len(),
            "repeated_frame_count": repeated_frame_count,
        }),
    )?;
    Ok((observations, colors))
}

/// Says how many frames were left out as repeats.
fn note_repeats(stream: &str, count: usize) {
    if count > 0 {
        tracing::info!("{count} frames left out: their {stream} repeats the frame before");
    }
}
