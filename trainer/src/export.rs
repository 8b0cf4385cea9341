//! `glint export`: a recording's path, a run's mesh and map, in files that other programs read.

use std::path::Path;

use anyhow::{Context as _, bail};
use clap::ValueEnum;
use sequence::Recording;

use crate::run_folder::{RunFolder, write_atomically};
use crate::stages::poses::{PosedFrame, tum_text};
use crate::train::{LINEAR_DIFFUSE_FILE, SRM_FILE};

/// What an export makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportTarget {
    /// Camera path of a recording, TUM text (world from depth camera).
    TumTrajectory,
    /// Mesh of a run, binary PLY with colours (sRGB and linear) and segments.
    Ply,
    /// Specular map of a run, OpenEXR.
    Exr,
}

/// Exports from a recording (a file) or a run (a folder); returns what was written, in words.
pub fn export(
    input: &Path,
    target: ExportTarget,
    output: &Path,
    poses: &str,
) -> anyhow::Result<String> {
    match (target, input.is_dir()) {
        (ExportTarget::TumTrajectory, false) => {
            let recording = Recording::open(input)?;
            let set = recording
                .poses(poses)
                .with_context(|| format!("{} has no poses named `{poses}`", input.display()))?;
            let frames: Vec<PosedFrame> = set
                .iter()
                .enumerate()
                .filter_map(|(index, pose)| {
                    Some(PosedFrame {
                        index,
                        world_from_camera: (*pose)?,
                    })
                })
                .collect();
            write_atomically(output, tum_text(&recording, &frames).as_bytes())?;
            Ok(format!(
                "{} poses (world from depth camera, metres) to {}",
                frames.len(),
                output.display()
            ))
        }
        (ExportTarget::Ply, true) => copy(input, LINEAR_DIFFUSE_FILE, output),
        (ExportTarget::Exr, true) => copy(input, SRM_FILE, output),
        (ExportTarget::TumTrajectory, true) => {
            bail!(
                "a trajectory is exported from a recording: {} is a folder",
                input.display()
            )
        }
        (ExportTarget::Ply | ExportTarget::Exr, false) => {
            bail!(
                "meshes and maps are exported from a run folder: {} is none",
                input.display()
            )
        }
    }
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
