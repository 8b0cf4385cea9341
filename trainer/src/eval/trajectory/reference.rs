//! Where the camera was: the set `source` of the recording, or a TUM file.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use geometry::Pose;
use geometry::rotation::interpolate;
use sequence::Recording;
use sequence::pairing::pair_by_time;

use super::FEWEST_FRAMES;
use super::frames::EstimatedFrame;
use crate::import::rig::PoseCamera;
use crate::import::trajectory::tum_lines;

/// Farthest stamps that are associated, nanoseconds.
const WIDEST_ASSOCIATION_NANOS: i64 = 10_000_000;
/// Stamps this near are the same: microseconds are the usual last digit of a TUM file, nanoseconds.
const SAME_STAMP_NANOS: i64 = 1_000;
/// Poses of a set further apart are not interpolated, nanoseconds.
const WIDEST_GAP_NANOS: i64 = 100_000_000;

/// The reference of `--trajectory`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrajectoryReference {
    /// The recording's own set `source`.
    Source,
    /// A TUM file, world from the camera named.
    File(PathBuf, PoseCamera),
}

impl std::fmt::Display for TrajectoryReference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Source => f.write_str("the poses `source`"),
            Self::File(path, _) => write!(f, "{}", path.display()),
        }
    }
}

/// A reference in memory: world from depth camera.
#[derive(Clone, Debug)]
pub struct ReferencePath {
    /// By rising times of the reference's clock, nanoseconds.
    poses: Vec<(i64, Pose)>,
    /// Poses of the recording's own pairs, one each.
    of_pairs: Option<Vec<Option<Pose>>>,
}

impl ReferencePath {
    /// Reads a reference for `recording`. Rotations are made orthonormal; lines that say `nan` are left out.
    ///
    /// # Errors
    /// When there is none, it is no TUM file, or it has fewer than 10 poses.
    pub fn read(recording: &Recording, reference: &TrajectoryReference) -> anyhow::Result<Self> {
        let path = match reference {
            TrajectoryReference::Source => {
                let poses = recording.poses("source").with_context(|| {
                    format!(
                        "{} has no poses named `source`: give a TUM file with --trajectory",
                        recording.path().display()
                    )
                })?;
                let mut timed: Vec<(i64, Pose)> = poses
                    .iter()
                    .enumerate()
                    .filter_map(|(index, pose)| Some((recording.time_nanos(index), (*pose)?)))
                    .collect();
                timed.sort_by_key(|(nanos, _)| *nanos);
                Self {
                    poses: timed,
                    of_pairs: Some(poses.to_vec()),
                }
            }
            TrajectoryReference::File(path, camera) => {
                let mut timed = Vec::new();
                for line in tum_lines(path)? {
                    let (nanos, pose, _) = line.pose(path)?;
                    let Some(pose) = pose else { continue };
                    let world_from_depth = match camera {
                        PoseCamera::Depth => pose,
                        PoseCamera::Color => pose * recording.color_from_depth(),
                    };
                    timed.push((nanos, world_from_depth));
                }
                timed.sort_by_key(|(nanos, _)| *nanos);
                timed.dedup_by_key(|(nanos, _)| *nanos);
                Self {
                    poses: timed,
                    of_pairs: None,
                }
            }
        };
        if path.poses.len() < FEWEST_FRAMES {
            bail!(
                "{reference}: {} poses are too few to judge a path, at least {FEWEST_FRAMES} are needed",
                path.poses.len()
            );
        }
        Ok(path)
    }

    /// The poses by rising times.
    pub fn poses(&self) -> &[(i64, Pose)] {
        &self.poses
    }

    /// Whether the stamps are not those of the frames: fewer than half of the frames have a stamp of their own.
    pub fn has_own_clock(&self, frames: &[EstimatedFrame]) -> bool {
        if self.of_pairs.is_some() {
            return false;
        }
        let is_stamped = |frame: &&EstimatedFrame| {
            let least = frame.nanos.saturating_sub(SAME_STAMP_NANOS);
            let greatest = frame.nanos.saturating_add(SAME_STAMP_NANOS);
            let after = self.poses.partition_point(|(nanos, _)| *nanos < least);
            self.poses
                .get(after)
                .is_some_and(|(nanos, _)| *nanos <= greatest)
        };
        2 * frames.iter().filter(is_stamped).count() < frames.len()
    }

    /// The reference pose of every frame, where there is one. A file is associated by the nearest stamp within
    /// 10 ms, one to one; the set `source` by its frames, or, with an offset, between two of its poses at most
    /// 100 ms apart. `offset_nanos` is reference time less frame time.
    pub fn of_frames(&self, frames: &[EstimatedFrame], offset_nanos: i64) -> Vec<Option<Pose>> {
        match &self.of_pairs {
            Some(of_pairs) if offset_nanos == 0 => of_pairs.clone(),
            Some(_) => frames
                .iter()
                .map(|frame| self.between(frame.nanos.saturating_add(offset_nanos)))
                .collect(),
            None => self.associated(frames, offset_nanos),
        }
    }

    fn between(&self, nanos: i64) -> Option<Pose> {
        let after = self.poses.partition_point(|(time, _)| *time < nanos);
        let next = *self.poses.get(after)?;
        if next.0 == nanos {
            return Some(next.1);
        }
        let previous = *self.poses.get(after.checked_sub(1)?)?;
        interpolate(previous, next, nanos, WIDEST_GAP_NANOS)
    }

    fn associated(&self, frames: &[EstimatedFrame], offset_nanos: i64) -> Vec<Option<Pose>> {
        let reference: Vec<i64> = self.poses.iter().map(|(nanos, _)| *nanos).collect();
        let wanted: Vec<i64> = frames
            .iter()
            .map(|frame| frame.nanos.saturating_add(offset_nanos))
            .collect();
        let mut poses = vec![None; frames.len()];
        // The same question as depth and colour of a camera: nearest, one to one, never crossing.
        for pair in pair_by_time(&wanted, &reference, WIDEST_ASSOCIATION_NANOS).pairs {
            poses[pair.depth] = Some(self.poses[pair.color].1);
        }
        poses
    }
}
