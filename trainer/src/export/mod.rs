//! `glint export`: a recording's frames and path, a run's mesh and map, in files that other programs read.
//!
//! `tum`, `seven_scenes` and `folder` (with `frames_json`) layouts of images, each with a `readme` and a rig
//! file, so that [`crate::import`] reads them back · `ply_points` one pair as coloured points · `files` frames
//! and `pairs` as image files · `poses` which poses · `target_folder` all or nothing.
//!
//! A frame that is damaged is left out, and named in [`ExportReport::missing`]: the program ends with code 3.

mod files;
mod folder;
mod frames_json;
mod pairs;
mod ply_points;
pub(crate) mod poses;
mod readme;
mod seven_scenes;
pub(crate) mod target_folder;
mod tum;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use clap::ValueEnum;
use sequence::Recording;

use crate::run_folder::{RunFolder, write_atomically};
use crate::stages::poses::{PosedFrame, tum_text};
use crate::train::{LINEAR_DIFFUSE_FILE, SRM_FILE};

use files::{ColorForm, FrameFiles, damages};
use poses::ExportPoses;
use target_folder::TargetFolder;

/// Called as `progress(done, of)`.
pub type OnProgress<'a> = &'a mut dyn FnMut(usize, usize);

/// What an export makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportTarget {
    /// Camera path of a recording, TUM text (world from depth camera).
    TumTrajectory,
    /// Frames of a recording as a TUM RGB-D folder: rgb/, depth/, their lists, associations, path.
    Tum,
    /// Pairs of a recording as a 7-Scenes folder: colour, depth and pose of each.
    #[value(name = "7scenes")]
    SevenScenes,
    /// Frames of a recording as images, and all else that it holds as JSON.
    Folder,
    /// One pair of a recording as coloured points, or the mesh of a run with colours (sRGB and linear) and
    /// segments; binary PLY.
    Ply,
    /// Specular map of a run, OpenEXR.
    Exr,
}

/// What to export.
#[derive(Clone, Debug)]
pub struct ExportOptions {
    /// A recording (a file) or a run (a folder).
    pub input: PathBuf,
    /// What to make.
    pub target: ExportTarget,
    /// File or folder to write.
    pub output: PathBuf,
    /// Pose set; `source`, if there is one, when absent.
    pub poses: Option<String>,
    /// Pair that becomes points; the middle one when absent.
    pub frame: Option<usize>,
}

/// What an export did.
#[derive(Clone, Debug)]
pub struct ExportReport {
    /// In words.
    pub text: String,
    /// What the recording should hold and could not be read, a line each.
    pub missing: Vec<String>,
}

/// Part of a recording is lost: what could be done was done, and this is what was not.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{} of the recording could not be read", counted(missing.len(), "part"))]
pub struct LostData {
    /// A line each.
    pub missing: Vec<String>,
}

/// Pose set that is exported when none is named.
const DEFAULT_POSES: &str = "source";

/// Exports. A folder is complete or not there; one that is not empty is never touched.
pub fn export(options: &ExportOptions, progress: OnProgress) -> anyhow::Result<ExportReport> {
    let (input, output) = (options.input.as_path(), options.output.as_path());
    let is_points = options.target == ExportTarget::Ply && !input.is_dir();
    ensure!(
        options.frame.is_none() || is_points,
        "--frame chooses the pair for --to ply of a recording; leave it out here"
    );
    let text = match (options.target, input.is_dir()) {
        (ExportTarget::Ply, true) => copy(input, LINEAR_DIFFUSE_FILE, output)?,
        (ExportTarget::Exr, true) => copy(input, SRM_FILE, output)?,
        (ExportTarget::Exr, false) => bail!(
            "maps are exported from a run folder: {} is none",
            input.display()
        ),
        (_, true) => bail!(
            "frames and trajectories are exported from a recording: {} is a folder",
            input.display()
        ),
        (_, false) => return export_recording(options, progress),
    };
    Ok(ExportReport {
        text,
        missing: Vec::new(),
    })
}

fn export_recording(options: &ExportOptions, progress: OnProgress) -> anyhow::Result<ExportReport> {
    let recording = Recording::open(&options.input)?;
    match options.target {
        ExportTarget::Ply => return ply_points::export(&recording, options),
        ExportTarget::TumTrajectory => return trajectory(&recording, options),
        _ => {}
    }
    let poses = ExportPoses::choose(&recording, options.poses.as_deref())?;
    let color_form = match options.target {
        ExportTarget::Tum | ExportTarget::SevenScenes => ColorForm::Developed,
        _ => ColorForm::AsSent,
    };
    let files = FrameFiles::new(&recording, color_form)?;
    let part = TargetFolder::begin(&options.output)?;
    let written = match options.target {
        ExportTarget::Tum => tum::write(&files, &poses, &part, progress)?,
        ExportTarget::SevenScenes => seven_scenes::write(&files, &poses, &part, progress)?,
        _ => folder::write(&files, &poses, &part, progress)?,
    };
    part.finish()?;
    let mut missing = damages(&recording);
    missing.extend(written.missing);
    let mut text = format!("{} to {}", written.sentence, options.output.display());
    for note in poses.notes() {
        text.push_str(&format!("\nnote: {note}"));
    }
    Ok(ExportReport { text, missing })
}

/// What a layout wrote.
pub(crate) struct Written {
    /// Counts, in words.
    pub(crate) sentence: String,
    /// Frames that could not be read, a line each.
    pub(crate) missing: Vec<String>,
}

fn trajectory(recording: &Recording, options: &ExportOptions) -> anyhow::Result<ExportReport> {
    let name = options.poses.as_deref().unwrap_or(DEFAULT_POSES);
    let poses = ExportPoses::choose(recording, Some(name))?;
    let frames: Vec<PosedFrame> = (0..recording.frame_count())
        .filter_map(|index| {
            Some(PosedFrame {
                index,
                world_from_camera: poses.of_pair(index)?,
            })
        })
        .collect();
    write_atomically(&options.output, tum_text(recording, &frames).as_bytes())?;
    let mut text = format!(
        "{} poses (world from depth camera, metres) to {}",
        frames.len(),
        options.output.display()
    );
    for note in poses.notes() {
        text.push_str(&format!("\nnote: {note}"));
    }
    Ok(ExportReport {
        text,
        missing: damages(recording),
    })
}

fn copy(run: &Path, name: &str, output: &Path) -> anyhow::Result<String> {
    let folder = RunFolder::open(run)?;
    let bytes =
        std::fs::read(folder.path(name)).with_context(|| format!("the run has no {name}"))?;
    write_atomically(output, &bytes)?;
    Ok(format!(
        "{} bytes of {name} to {}",
        bytes.len(),
        output.display()
    ))
}

/// "1 pair", "2 pairs".
pub(crate) fn counted(count: usize, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {what}{plural}")
}
