//! Stage `poses`: the camera's path, as the source gave it.

use geometry::Pose;
use sequence::Recording;

use super::Refusal;

/// A frame that training may use.
#[derive(Clone, Copy, Debug)]
pub struct PosedFrame {
    /// Index in the recording.
    pub index: usize,
    /// Pose of the depth camera.
    pub world_from_camera: Pose,
}

/// Fewest posed frames that training accepts.
const FEWEST_FRAMES: usize = 10;

/// The training frames of `recording` with their poses of `set`, in order. Test and unused frames never
/// leave this function.
pub fn training_frames(recording: &Recording, set: &str) -> Result<Vec<PosedFrame>, Refusal> {
    let poses = recording
        .poses(set)
        .ok_or_else(|| Refusal::NoPoses(set.to_owned()))?;
    let frames: Vec<PosedFrame> = recording
        .split()
        .train
        .iter()
        .map(|&index| index as usize)
        .filter_map(|index| {
            let world_from_camera = poses.get(index).copied().flatten()?;
            Some(PosedFrame {
                index,
                world_from_camera,
            })
        })
        .collect();
    if frames.len() < FEWEST_FRAMES {
        return Err(Refusal::TooFewFrames(frames.len()));
    }
    Ok(frames)
}

/// The frames whose image in one stream is no repeat, and how many were left out.
///
/// A repeat says nothing new, but would weigh its image twice (hard-cases B13); and since its image is older than
/// its time, its pose is not that of the image. Where the image that it repeats is held out, leaving it out
/// keeps that image from training.
pub(super) fn without_repeats(
    frames: &[PosedFrame],
    is_repeat: impl Fn(usize) -> bool,
) -> (Vec<PosedFrame>, usize) {
    let new = frames.iter().filter(|frame| !is_repeat(frame.index));
    let new: Vec<PosedFrame> = new.copied().collect();
    let repeated_count = frames.len() - new.len();
    (new, repeated_count)
}

/// Poses as TUM text: `timestamp tx ty tz qx qy qz qw`.
pub fn tum_text(recording: &Recording, frames: &[PosedFrame]) -> String {
    let mut text =
        String::from("# timestamp tx ty tz qx qy qz qw (world from camera; metres, seconds)\n");
    for frame in frames {
        let nanos = recording.time_nanos(frame.index);
        let t = frame.world_from_camera.translation();
        let q = frame.world_from_camera.rotation();
        let sign = if nanos < 0 { "-" } else { "" };
        text.push_str(&format!(
            "{sign}{}.{:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}\n",
            nanos.unsigned_abs() / 1_000_000_000,
            nanos.unsigned_abs() % 1_000_000_000,
            t.x,
            t.y,
            t.z,
            q.x,
            q.y,
            q.z,
            q.w
        ));
    }
    text
}
