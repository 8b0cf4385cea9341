//! Which poses an export writes.

use anyhow::bail;
use geometry::Pose;
use sequence::contents::StoredPoses;
use sequence::{PoseState, Recording};

use crate::import::rig::PoseCamera;

use super::{DEFAULT_POSES, counted};

/// The poses of one set that share a world.
pub(crate) struct ExportPoses<'a> {
    recording: &'a Recording,
    set: Option<&'a StoredPoses>,
    /// The world.
    map: u32,
    /// Why there are fewer poses than one may expect.
    notes: Vec<String>,
}

impl<'a> ExportPoses<'a> {
    /// The set `name`, which must be there, or the default one, which may be missing.
    pub(crate) fn choose(recording: &'a Recording, name: Option<&str>) -> anyhow::Result<Self> {
        let sets = &recording.contents().pose_sets;
        let wanted = name.unwrap_or(DEFAULT_POSES);
        let set = sets.iter().find(|set| set.head.name == wanted);
        let mut notes = Vec::new();
        if set.is_none() {
            let names: Vec<&str> = sets.iter().map(|set| set.head.name.as_str()).collect();
            let sentence = format!(
                "{} has no poses named `{wanted}`; it has {}",
                recording.path().display(),
                if names.is_empty() {
                    "none".to_owned()
                } else {
                    names.join(", ")
                }
            );
            if name.is_some() {
                bail!("{sentence}");
            }
            notes.push(format!("no poses are exported: {sentence}"));
        }
        let map = set.and_then(StoredPoses::largest_map).unwrap_or(0);
        let other_count = set.map_or(0, |set| usable(set).filter(|other| *other != map).count());
        if other_count > 0 {
            notes.push(format!(
                "{} of other maps than number {map} left out: they are in other worlds",
                counted(other_count, "pose")
            ));
        }
        Ok(Self {
            recording,
            set,
            map,
            notes,
        })
    }

    /// Name of the set, where there is one.
    pub(crate) fn name(&self) -> Option<&str> {
        self.set.map(|set| set.head.name.as_str())
    }

    /// What a user should know.
    pub(crate) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The camera that the stored poses are of.
    pub(crate) fn camera(&self) -> PoseCamera {
        let color_id = self.recording.description().color_id;
        match self.set {
            Some(set) if set.head.stream == color_id => PoseCamera::Color,
            _ => PoseCamera::Depth,
        }
    }

    /// The stored pose of frame `number` of the stream of [`ExportPoses::camera`]: world from that camera.
    pub(crate) fn of_frame(&self, number: u64) -> Option<Pose> {
        let poses = &self.set?.poses;
        let found = poses
            .binary_search_by_key(&number, |pose| pose.number)
            .ok()?;
        let pose = &poses[found];
        let is_known = pose.state != PoseState::Lost && pose.map == self.map;
        is_known.then_some(pose.world_from_camera)
    }

    /// World from depth camera of a pair.
    pub(crate) fn of_pair(&self, index: usize) -> Option<Pose> {
        match self.camera() {
            PoseCamera::Depth => {
                self.of_frame(self.recording.depth_place(index).ok()?.label.number)
            }
            PoseCamera::Color => {
                let pose = self.of_frame(self.recording.color_place(index).ok()?.label.number)?;
                Some(pose * self.recording.color_from_depth())
            }
        }
    }
}

/// Maps of the poses that are not lost.
fn usable(set: &StoredPoses) -> impl Iterator<Item = u32> {
    let poses = set
        .poses
        .iter()
        .filter(|pose| pose.state != PoseState::Lost);
    poses.map(|pose| pose.map)
}

/// A line of a TUM trajectory, every number to its last bit. Without a pose it says `nan`.
pub(crate) fn tum_line(nanos: i64, pose: Option<Pose>) -> String {
    let mut line = seconds(nanos);
    let numbers = pose.map_or([f64::NAN; 7], |pose| {
        let (t, q) = (pose.translation(), pose.rotation());
        [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
    });
    for number in numbers {
        line.push_str(&if number.is_nan() {
            " nan".to_owned()
        } else {
            format!(" {number}")
        });
    }
    line.push('\n');
    line
}

/// Seconds with nine decimals: exact.
pub(crate) fn seconds(nanos: i64) -> String {
    let sign = if nanos < 0 { "-" } else { "" };
    let nanos = nanos.unsigned_abs();
    format!(
        "{sign}{}.{:09}",
        nanos / 1_000_000_000,
        nanos % 1_000_000_000
    )
}
