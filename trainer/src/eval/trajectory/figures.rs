//! The errors of one stretch of a path.

use std::ops::Range;

use anyhow::Context as _;
use geometry::rotation;
use geometry::trajectory::{
    PoseAlignment, RelativeError, Spread, pairs_by_distance, pairs_by_time, relative_error,
};
use geometry::{Pose, robust};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::frames::{EstimatedFrame, Tracked};

/// An accepted pose further off is wrong, metres.
const WRONG_METRES: f64 = 0.05;
/// An accepted pose turned further is wrong, degrees.
const WRONG_DEGREES: f64 = 5.0;
/// Time of the relative error, nanoseconds.
const STEP_NANOS: i64 = 1_000_000_000;
/// Path length of the relative error, metres.
const STEP_METRES: f64 = 0.1;

/// Errors over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Root mean square.
    pub rmse: f64,
    /// Median.
    pub median: f64,
    /// Largest.
    pub max: f64,
}

impl Errors {
    fn of(errors: &[f64]) -> anyhow::Result<Self> {
        let Spread { rmse, median, max } =
            Spread::of(errors).context("an error is not a number")?;
        Ok(Self { rmse, median, max })
    }
}

/// Error of the motion over a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RelativeFigures {
    /// Translation, metres, root mean square.
    pub translation_m: f64,
    /// Rotation, degrees, root mean square.
    pub rotation_deg: f64,
    /// Pairs of frames.
    pub pairs: usize,
}

impl From<RelativeError> for RelativeFigures {
    fn from(error: RelativeError) -> Self {
        Self {
            translation_m: error.translation_rmse,
            rotation_deg: error.rotation_rmse.to_degrees(),
            pairs: error.count,
        }
    }
}

/// The figures of one stretch of a path. Counts are of pairs of the recording.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PathFigures {
    /// First frame and the one after the last; absent for the whole path.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<[usize; 2]>,
    /// Frames offered to tracking: all but repeats of which the set says nothing.
    pub frame_count: usize,
    /// Of these, with state OK.
    pub ok_count: usize,
    /// Of these, with state WEAK.
    pub weak_count: usize,
    /// Of these, lost.
    pub lost_count: usize,
    /// Of these, tracked in another map than the largest.
    pub other_map_count: usize,
    /// Of these, not in the set.
    pub absent_count: usize,
    /// Frames with a reference pose, tracked or not.
    pub referenced_count: usize,
    /// Tracked frames with a reference pose: those that are compared.
    pub compared_count: usize,
    /// OK and WEAK by frames offered.
    pub tracked_fraction: f64,
    /// Distance on tracked frames after alignment, metres.
    pub ate: Errors,
    /// The same over all frames with a reference pose, those without a pose at the last one, metres.
    pub ate_with_lost: Errors,
    /// Distance on tracked frames with the first pose laid on the reference's, metres.
    pub ate_first_pose: Errors,
    /// The same alignment as that of the whole path, root mean square, metres; for a range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ate_in_whole_m: Option<f64>,
    /// Angle on tracked frames after alignment, degrees.
    pub rotation_deg: Errors,
    /// Motion over 1 s; absent where no two frames are so far apart.
    pub rpe_1s: Option<RelativeFigures>,
    /// Motion over 0.1 m of path; absent where the path is shorter.
    pub rpe_10cm: Option<RelativeFigures>,
    /// OK frames wrong by more than 5 cm or 5 degrees.
    pub wrong_accepted: usize,
    /// What the positions determine of the alignment: point, line, full.
    pub rank: String,
    /// Whether the rotation of the alignment is that of the orientations.
    pub is_by_orientation: bool,
    /// Angle of the alignment, degrees.
    pub alignment_angle_deg: f64,
    /// Angle between the alignments by positions and by orientations, degrees.
    pub disagreement_deg: Option<f64>,
}

/// The figures of the frames in `range` with a given alignment.
pub(super) fn figures(
    frames: &[EstimatedFrame],
    reference: &[Option<Pose>],
    range: Range<usize>,
    alignment: &PoseAlignment,
) -> anyhow::Result<PathFigures> {
    let offered: Vec<(&EstimatedFrame, Option<Pose>)> = frames[range.clone()]
        .iter()
        .zip(reference[range].iter().copied())
        .filter(|(frame, _)| !(frame.is_repeat && frame.tracked == Tracked::Absent))
        .collect();
    let count = |wanted: fn(&Tracked) -> bool| {
        let tracked = offered.iter().map(|(frame, _)| &frame.tracked);
        tracked.filter(|tracked| wanted(tracked)).count()
    };
    let compared: Vec<Compared> = offered
        .iter()
        .filter_map(|(frame, reference)| {
            Some(Compared {
                nanos: frame.nanos,
                reference: (*reference)?,
                estimate: frame.tracked.pose()?,
                is_ok: matches!(frame.tracked, Tracked::Ok(_)),
            })
        })
        .collect();
    let (ok_count, weak_count) = (
        count(|tracked| matches!(tracked, Tracked::Ok(_))),
        count(|tracked| matches!(tracked, Tracked::Weak(_))),
    );
    let world = alignment.reference_from_estimate;
    let distances: Vec<f64> = compared
        .iter()
        .map(|frame| frame.distance(&world))
        .collect();
    let angles: Vec<f64> = compared
        .iter()
        .map(|frame| frame.angle_deg(&world))
        .collect();
    let first = compared.first().context("no frame can be compared")?;
    let first_pose = first.reference * first.estimate.inverse();
    let from_first: Vec<f64> = compared.iter().map(|f| f.distance(&first_pose)).collect();
    let wrong = compared.iter().zip(&distances).zip(&angles);
    let wrong = wrong.filter(|((frame, distance), angle)| {
        frame.is_ok && (**distance > WRONG_METRES || **angle > WRONG_DEGREES)
    });
    Ok(PathFigures {
        range: None,
        frame_count: offered.len(),
        ok_count,
        weak_count,
        lost_count: count(|tracked| *tracked == Tracked::Lost),
        other_map_count: count(|tracked| *tracked == Tracked::OtherMap),
        absent_count: count(|tracked| *tracked == Tracked::Absent),
        referenced_count: offered.iter().filter(|(_, r)| r.is_some()).count(),
        compared_count: compared.len(),
        tracked_fraction: (ok_count + weak_count) as f64 / offered.len() as f64,
        ate: Errors::of(&distances)?,
        ate_with_lost: Errors::of(&distances_with_lost(&offered, &first.estimate, &world))?,
        ate_first_pose: Errors::of(&from_first)?,
        ate_in_whole_m: None,
        rotation_deg: Errors::of(&angles)?,
        rpe_1s: relative(&compared, |frames| {
            let nanos: Vec<i64> = frames.iter().map(|frame| frame.nanos).collect();
            pairs_by_time(&nanos, STEP_NANOS, half_period_nanos(&nanos))
        }),
        rpe_10cm: relative(&compared, |frames| {
            let path: Vec<Pose> = frames.iter().map(|frame| frame.reference).collect();
            pairs_by_distance(&path, STEP_METRES)
        }),
        wrong_accepted: wrong.count(),
        rank: alignment.rank.to_string(),
        is_by_orientation: alignment.is_by_orientation,
        alignment_angle_deg: rotation::log(world.rotation()).length().to_degrees(),
        disagreement_deg: alignment.disagreement.map(f64::to_degrees),
    })
}

/// A tracked frame with its reference.
struct Compared {
    nanos: i64,
    reference: Pose,
    estimate: Pose,
    is_ok: bool,
}

impl Compared {
    fn distance(&self, reference_from_estimate: &Pose) -> f64 {
        let aligned = reference_from_estimate.transform_point(self.estimate.translation());
        (self.reference.translation() - aligned).length()
    }

    fn angle_deg(&self, reference_from_estimate: &Pose) -> f64 {
        let aligned = *reference_from_estimate * self.estimate;
        let difference = self.reference.inverse() * aligned;
        rotation::log(difference.rotation()).length().to_degrees()
    }
}

/// Distances of all frames that have a reference pose; a frame without a pose stays where the last one was,
/// before the first at the first.
fn distances_with_lost(
    offered: &[(&EstimatedFrame, Option<Pose>)],
    first: &Pose,
    reference_from_estimate: &Pose,
) -> Vec<f64> {
    let mut held = *first;
    let mut distances = Vec::with_capacity(offered.len());
    for (frame, reference) in offered {
        held = frame.tracked.pose().unwrap_or(held);
        if let Some(reference) = reference {
            let aligned = reference_from_estimate.transform_point(held.translation());
            distances.push((reference.translation() - aligned).length());
        }
    }
    distances
}

fn relative(
    compared: &[Compared],
    pairs: impl Fn(&[Compared]) -> Vec<(usize, usize)>,
) -> Option<RelativeFigures> {
    let reference: Vec<Pose> = compared.iter().map(|frame| frame.reference).collect();
    let estimate: Vec<Pose> = compared.iter().map(|frame| frame.estimate).collect();
    relative_error(&reference, &estimate, &pairs(compared)).map(Into::into)
}

/// Half of the median distance in time, nanoseconds.
fn half_period_nanos(nanos: &[i64]) -> i64 {
    let steps = nanos
        .windows(2)
        .map(|pair| pair[1].abs_diff(pair[0]) as f64);
    let period = robust::median(&mut steps.collect()).unwrap_or(0.0);
    (0.5 * period).ceil() as i64
}

impl PathFigures {
    /// The keys of the summary event.
    pub(super) fn summary(&self) -> Map<String, Value> {
        let value = json!({
            "ate_m": self.ate.rmse,
            "ate_median_m": self.ate.median,
            "ate_max_m": self.ate.max,
            "ate_with_lost_m": self.ate_with_lost.rmse,
            "ate_first_pose_m": self.ate_first_pose.rmse,
            "rotation_error_deg": self.rotation_deg.rmse,
            "rpe_1s_m": self.rpe_1s.map(|rpe| rpe.translation_m),
            "rpe_1s_deg": self.rpe_1s.map(|rpe| rpe.rotation_deg),
            "rpe_10cm_m": self.rpe_10cm.map(|rpe| rpe.translation_m),
            "rpe_10cm_deg": self.rpe_10cm.map(|rpe| rpe.rotation_deg),
            "tracked_fraction": self.tracked_fraction,
            "ok_fraction": self.ok_count as f64 / self.frame_count as f64,
            "wrong_accepted": self.wrong_accepted,
            "frames_offered": self.frame_count,
            "frames_compared": self.compared_count,
            "alignment_rank": self.rank,
            "alignment_angle_deg": self.alignment_angle_deg,
        });
        let Value::Object(mut keys) = value else {
            return Map::new();
        };
        if let Some(range) = self.range {
            keys.insert("range".into(), json!(range));
        }
        if let Some(ate) = self.ate_in_whole_m {
            keys.insert("ate_in_whole_m".into(), json!(ate));
        }
        keys
    }
}

impl std::fmt::Display for PathFigures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.range {
            Some([start, end]) => write!(f, "frames {start}..{end}: ")?,
            None => write!(f, "all frames: ")?,
        }
        writeln!(
            f,
            "{} offered, {} OK, {} weak, {} lost, {} in other maps, {} not in the set; {:.1} % tracked, {} compared",
            self.frame_count,
            self.ok_count,
            self.weak_count,
            self.lost_count,
            self.other_map_count,
            self.absent_count,
            100.0 * self.tracked_fraction,
            self.compared_count
        )?;
        writeln!(
            f,
            "  ATE {:.1} mm (median {:.1}, max {:.1}); lost frames at their last pose {:.1}; first pose laid on the reference {:.1}{}",
            1e3 * self.ate.rmse,
            1e3 * self.ate.median,
            1e3 * self.ate.max,
            1e3 * self.ate_with_lost.rmse,
            1e3 * self.ate_first_pose.rmse,
            self.ate_in_whole_m.map_or_else(String::new, |ate| format!(
                "; aligned with the whole path {:.1}",
                1e3 * ate
            ))
        )?;
        let relative = |rpe: Option<RelativeFigures>| match rpe {
            Some(rpe) => format!(
                "{:.1} mm, {:.2} degrees ({} pairs)",
                1e3 * rpe.translation_m,
                rpe.rotation_deg,
                rpe.pairs
            ),
            None => "none".to_owned(),
        };
        writeln!(
            f,
            "  RPE over 1 s {}; over 0.1 m {}",
            relative(self.rpe_1s),
            relative(self.rpe_10cm)
        )?;
        write!(
            f,
            "  OK frames wrong by more than 5 cm or 5 degrees: {}; alignment turns by {:.2} degrees, rank {}{}",
            self.wrong_accepted,
            self.alignment_angle_deg,
            self.rank,
            if self.is_by_orientation {
                " (rotation by the orientations)"
            } else {
                ""
            }
        )
    }
}
