//! `glint eval`: its flags, and what they ask to be measured.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::Args;
use geometry::Pose;
use sequence::Recording;

use super::{Summary, parse_range};
use crate::clock::Stopwatch;
use crate::eval::mesh::{self, MeshMetrics, SAMPLE_COUNT, Sightings, read_mesh};
use crate::eval::trajectory::{
    self, JudgedPath, TrajectoryOptions, TrajectoryReference, estimated_frames, frames_to_source,
    posed_frames,
};
use crate::eval::{self, Metrics};
use crate::import::rig::PoseCamera;
use crate::progress::Progress;
use crate::report;
use crate::run_folder::RunFolder;
use crate::stages::poses::{REFINED, poses_of_run};
use crate::train::{CONFIDENCE_FILE, MESH_FILE, SRM_FILE, TrainConfig};

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint eval run --truth captures/two-cans/truth --truth-alpha 0.02\n  glint eval kitchen.glint --trajectory source --poses live --range 0..122 --range 122..300"
)]
pub(super) struct EvalArgs {
    /// The run folder, or a recording (with --trajectory).
    input: PathBuf,
    /// Folder with environment.exr and reach.exr; `masks` beside it or in it gives the object's masks.
    #[arg(long)]
    truth: Option<PathBuf>,
    /// GGX width of the lobe that dominates the map.
    #[arg(long, default_value_t = 0.02)]
    truth_alpha: f64,
    /// Fix the scale between map and truth instead of fitting it.
    #[arg(long)]
    truth_scale: Option<f64>,
    /// Judge the camera path: a TUM file (timestamp tx ty tz qx qy qz qw), or `source` for the recording's own.
    #[arg(long, value_name = "REF")]
    trajectory: Option<PathBuf>,
    /// Camera that the poses of a TUM file are of.
    #[arg(long, value_enum, default_value = "depth")]
    trajectory_camera: TrajectoryCamera,
    /// Pose set that is judged; `live` when absent. A run is judged by the poses it was trained from.
    #[arg(long)]
    poses: Option<String>,
    /// Fit the time between the clocks of path and reference; done unasked where the reference has stamps of
    /// its own.
    #[arg(long, requires = "trajectory")]
    fit_offset: bool,
    /// Judge frames A..B (B excluded, counted from 0) on their own as well; may be repeated.
    #[arg(long = "range", value_parser = parse_range, requires = "trajectory")]
    ranges: Vec<Range<usize>>,
    /// Judge the shape: a PLY mesh in the world of the reference path.
    #[arg(long, value_name = "REF")]
    mesh: Option<PathBuf>,
    /// Mesh of a recording that has no run, in the world of its poses, as `glintd record --mesh` writes it.
    #[arg(long, requires = "mesh", value_name = "PLY")]
    estimated_mesh: Option<PathBuf>,
}

/// The camera of a TUM file's poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum TrajectoryCamera {
    /// The depth camera.
    Depth,
    /// The colour camera.
    Color,
}

impl EvalArgs {
    fn trajectory_options(&self, poses: &str) -> Option<TrajectoryOptions> {
        let reference = self.trajectory.as_ref()?;
        let camera = match self.trajectory_camera {
            TrajectoryCamera::Depth => PoseCamera::Depth,
            TrajectoryCamera::Color => PoseCamera::Color,
        };
        Some(TrajectoryOptions {
            reference: if reference.as_os_str() == "source" {
                TrajectoryReference::Source
            } else {
                TrajectoryReference::File(reference.clone(), camera)
            },
            poses: poses.to_owned(),
            fit_offset: self.fit_offset,
            ranges: self.ranges.clone(),
        })
    }
}

pub(super) fn run(args: &EvalArgs, progress: &Progress) -> anyhow::Result<Summary> {
    if !(args.truth_alpha > 0.0 && args.truth_alpha <= 1.0) {
        bail!(
            "--truth-alpha {} is no GGX width: give a value above 0 and up to 1",
            args.truth_alpha
        );
    }
    let metrics = if args.input.is_file() {
        of_recording(args, progress)?
    } else {
        of_run(args, progress)?
    };
    Ok(Summary::whole(
        report::metrics_text(&metrics),
        report::metrics_summary(&metrics),
    ))
}

/// A recording has a camera path only.
fn of_recording(args: &EvalArgs, progress: &Progress) -> anyhow::Result<Metrics> {
    if args.truth.is_some() {
        bail!(
            "{} is a recording: --truth judges a run folder, make one with `glint train`",
            args.input.display()
        );
    }
    let poses = args.poses.as_deref().unwrap_or("live");
    let Some(options) = args.trajectory_options(poses) else {
        bail!(
            "{} is a recording: give --trajectory with a TUM file or `source`, or a run folder instead",
            args.input.display()
        );
    };
    if args.mesh.is_some() && args.estimated_mesh.is_none() {
        bail!(
            "a recording has no mesh: give one with --estimated-mesh beside --mesh, or a run folder instead"
        );
    }
    let watch = Stopwatch::start();
    let recording = Recording::open(&args.input)?;
    progress.stage("eval");
    let judged = trajectory::evaluate(&recording, &options)?;
    let mesh = match (&args.mesh, &args.estimated_mesh) {
        (Some(reference), Some(estimate)) => {
            let frame = MeshFrame::of_path(&judged);
            Some(frame.compare(&recording, estimate, reference, progress)?)
        }
        _ => None,
    };
    Ok(Metrics {
        trajectory: Some(judged.metrics),
        mesh,
        cost: watch.cost(),
        ..Metrics::default()
    })
}

fn of_run(args: &EvalArgs, progress: &Progress) -> anyhow::Result<Metrics> {
    if args.estimated_mesh.is_some() {
        bail!("a run has a mesh of its own: leave --estimated-mesh out");
    }
    let watch = Stopwatch::start();
    let folder = RunFolder::open(&args.input)?;
    let config: TrainConfig =
        toml::from_str(&std::fs::read_to_string(folder.path("config.toml"))?)?;
    if let Some(poses) = args.poses.as_ref().filter(|poses| **poses != config.poses) {
        bail!(
            "the run was trained from the poses `{}`: give the recording to judge its poses `{poses}`",
            config.poses
        );
    }
    let recording = Recording::open(&config.recording)?;
    let mut metrics = Metrics::default();
    // What the run was trained from may have a world of its own.
    let frames = if config.poses == REFINED {
        posed_frames(&recording, &poses_of_run(&folder, &recording, REFINED)?)
    } else {
        estimated_frames(&recording, &config.poses)?
    };
    let to_source = if config.poses == "source" {
        None
    } else {
        frames_to_source(&recording, &frames, &config.poses)?
    };
    if let Some(truth) = &args.truth {
        metrics.environment = Some(eval::environment::evaluate(
            &folder.path(SRM_FILE),
            &folder.path(CONFIDENCE_FILE),
            truth,
            to_source.map(|found| found.reference_from_estimate.rotation()),
            args.truth_alpha,
            args.truth_scale,
        )?);
    }
    progress.stage("eval");
    let judged = match args.trajectory_options(&config.poses) {
        Some(options) => Some(trajectory::evaluate_frames(&recording, &frames, &options)?),
        None => None,
    };
    if let Some(reference) = &args.mesh {
        let frame = match &judged {
            Some(judged) => MeshFrame::of_path(judged),
            None => MeshFrame {
                reference_from_estimate: to_source
                    .map_or(Pose::IDENTITY, |found| found.reference_from_estimate),
                alignment: match (&to_source, config.poses.as_str()) {
                    (Some(_), _) => "the trajectory to the poses `source`",
                    (None, "source") => "nothing: it was made from the poses `source`",
                    (None, _) => "nothing: the recording has no poses `source`",
                },
                reference: recording.poses("source").unwrap_or_default().to_vec(),
            },
        };
        let estimate = folder.path(MESH_FILE);
        metrics.mesh = Some(frame.compare(&recording, &estimate, reference, progress)?);
    }
    metrics.trajectory = judged.map(|judged| judged.metrics);
    photographs(args, &folder, &config, &recording, &mut metrics, progress)?;
    metrics.cost = watch.cost();
    folder.write_json("metrics.json", &metrics)?;
    Ok(metrics)
}

/// The held-out photographs of a run.
fn photographs(
    args: &EvalArgs,
    folder: &RunFolder,
    config: &TrainConfig,
    recording: &Recording,
    metrics: &mut Metrics,
    progress: &Progress,
) -> anyhow::Result<()> {
    let masks = args.truth.as_ref().and_then(|truth| {
        [truth.join("masks"), truth.join("../masks")]
            .into_iter()
            .find(|folder| folder.is_dir())
    });
    let model = eval::model::Model::load(folder)?;
    let judged = eval::views::evaluate_at(
        recording,
        &model,
        &poses_of_run(folder, recording, &config.poses)?,
        masks.as_deref(),
        &|done, of| progress.step(done, of),
    )?;
    if let Some((composition, strips)) = judged {
        report::write_strips(folder, &strips)?;
        metrics.composition = Some(composition);
    }
    Ok(())
}

/// How a mesh is moved to its reference, and where the camera stood there.
struct MeshFrame {
    reference_from_estimate: Pose,
    alignment: &'static str,
    /// World from depth camera of every pair, in the world of the reference.
    reference: Vec<Option<Pose>>,
}

impl MeshFrame {
    fn of_path(judged: &JudgedPath) -> Self {
        Self {
            reference_from_estimate: judged.alignment.reference_from_estimate,
            alignment: "the trajectory",
            reference: judged.reference.clone(),
        }
    }

    fn compare(
        &self,
        recording: &Recording,
        estimate: &Path,
        reference: &Path,
        progress: &Progress,
    ) -> anyhow::Result<MeshMetrics> {
        let train = recording.split().train.iter();
        let world_from_depth: Vec<Pose> = train
            .filter_map(|&index| self.reference.get(index as usize).copied().flatten())
            .collect();
        let sightings = Sightings {
            camera: recording.depth_camera(),
            world_from_depth,
        };
        let sightings = (!sightings.world_from_depth.is_empty()).then_some(&sightings);
        mesh::compare(
            &read_mesh(estimate)?,
            &read_mesh(reference)?,
            &self.reference_from_estimate,
            self.alignment,
            sightings,
            SAMPLE_COUNT,
            &|done, of| progress.step(done, of),
        )
        .with_context(|| {
            format!(
                "{} cannot be compared with {}",
                estimate.display(),
                reference.display()
            )
        })
    }
}
