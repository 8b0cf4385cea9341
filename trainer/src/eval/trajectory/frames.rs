//! What tracking said of every pair of a recording.

use anyhow::bail;
use geometry::Pose;
use sequence::{PoseState, Recording};

/// What a pose set says of a pair; poses are world from depth camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tracked {
    /// All axes observed.
    Ok(Pose),
    /// Some axes kept their prediction.
    Weak(Pose),
    /// The camera was lost.
    Lost,
    /// Tracked in another world than most frames.
    OtherMap,
    /// The set says nothing of the pair.
    Absent,
}

impl Tracked {
    /// The pose, where the frame counts as tracked.
    pub fn pose(&self) -> Option<Pose> {
        match self {
            Self::Ok(pose) | Self::Weak(pose) => Some(*pose),
            Self::Lost | Self::OtherMap | Self::Absent => None,
        }
    }
}

/// A pair of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatedFrame {
    /// Device time of its depth, nanoseconds.
    pub nanos: i64,
    /// Its depth repeats the frame before, so that there was nothing to track.
    pub is_repeat: bool,
    /// What the set says.
    pub tracked: Tracked,
}

/// All pairs of `recording` with what the set `name` says of them.
///
/// # Errors
/// When there is no such set.
pub fn estimated_frames(recording: &Recording, name: &str) -> anyhow::Result<Vec<EstimatedFrame>> {
    let sets = &recording.contents().pose_sets;
    let Some(set) = sets.iter().find(|set| set.head.name == name) else {
        let names: Vec<&str> = sets.iter().map(|set| set.head.name.as_str()).collect();
        bail!(
            "{} has no poses named `{name}`; it has {}",
            recording.path().display(),
            if names.is_empty() {
                "none".to_owned()
            } else {
                names.join(", ")
            }
        );
    };
    let largest_map = set.largest_map();
    let is_color = set.head.stream == recording.description().color_id;
    let color_from_depth = recording.color_from_depth();
    let tracked = |index: usize| -> anyhow::Result<Tracked> {
        let place = if is_color {
            recording.color_place(index)?
        } else {
            recording.depth_place(index)?
        };
        let found = set
            .poses
            .binary_search_by_key(&place.label.number, |pose| pose.number);
        let Ok(found) = found else {
            return Ok(Tracked::Absent);
        };
        let stored = &set.poses[found];
        let world_from_depth = if is_color {
            stored.world_from_camera * color_from_depth
        } else {
            stored.world_from_camera
        };
        let is_elsewhere = Some(stored.map) != largest_map;
        Ok(match stored.state {
            PoseState::Lost => Tracked::Lost,
            PoseState::Ok | PoseState::Weak(_) if is_elsewhere => Tracked::OtherMap,
            PoseState::Ok => Tracked::Ok(world_from_depth),
            PoseState::Weak(_) => Tracked::Weak(world_from_depth),
        })
    };
    (0..recording.frame_count())
        .map(|index| {
            Ok(EstimatedFrame {
                nanos: recording.time_nanos(index),
                is_repeat: recording.depth_is_repeat(index),
                tracked: tracked(index)?,
            })
        })
        .collect()
}

/// All pairs of `recording` with poses that are in no set of it: world from depth camera, one a pair, `None` as
/// [`Tracked::Absent`].
pub fn posed_frames(recording: &Recording, poses: &[Option<Pose>]) -> Vec<EstimatedFrame> {
    poses
        .iter()
        .take(recording.frame_count())
        .enumerate()
        .map(|(index, pose)| EstimatedFrame {
            nanos: recording.time_nanos(index),
            is_repeat: recording.depth_is_repeat(index),
            tracked: pose.map_or(Tracked::Absent, Tracked::Ok),
        })
        .collect()
}
