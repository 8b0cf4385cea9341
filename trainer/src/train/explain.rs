//! Verdicts on effects without a training.

use effects::{EffectsFile, Habit};
use sequence::Recording;

use super::{TrainConfig, surface_of};
use crate::effects as called;
use crate::progress::Progress;
use crate::stages::geometry;
use crate::stages::object::find_object;
use crate::stages::poses::{self, PosedFrame};

/// What `--explain --dry-run` says: verdicts by survey and bounds on a coarse surface; nothing is written.
///
/// # Errors
/// As training, before its first solve.
pub fn explain(config: &TrainConfig, progress: &Progress) -> anyhow::Result<EffectsFile> {
    let recording = Recording::open(&config.recording)?;
    let set = poses::start_set(&recording, &config.poses)?;
    let frames = poses::training_frames(&recording, set)?;
    progress.stage("geometry");
    let voxel_size = (DRY_RUN_VOXELS * config.voxel_mm * 1e-3) as f32;
    let some = every_nth(&frames, DRY_RUN_FRAMES);
    let geometry = geometry::build(&recording, &some, voxel_size, &mut |done, of| {
        progress.step(done, of);
    })?;
    let parts = find_object(&geometry.mesh, config.object_box.as_ref(), config.seed);
    let ground = surface_of(geometry, parts, voxel_size)?;
    progress.stage("effects");
    let request = called::Request {
        requests: &config.effects,
        habit: Habit::Cheap,
        previous: None,
        refinement: None,
        compares: false,
        stride: config.pixel_stride,
        seed: config.seed,
    };
    Ok(called::decide(&recording, &ground.surface, &frames, &request)?.file)
}

/// Voxels of a dry run over those of training.
const DRY_RUN_VOXELS: f64 = 2.0;
/// Frames that its surface is made from.
const DRY_RUN_FRAMES: usize = 60;

fn every_nth(frames: &[PosedFrame], count: usize) -> Vec<PosedFrame> {
    let step = frames.len().div_ceil(count).max(1);
    frames.iter().step_by(step).copied().collect()
}
