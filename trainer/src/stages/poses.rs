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
