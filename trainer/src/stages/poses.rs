//! Stage `poses`: the camera's path, as the recording gives it or refined.

use std::collections::BTreeMap;

use anyhow::Context as _;
use geometry::{DVec3, Pose};
use glam::DQuat;
use sequence::{FramePose, PoseState, Recording};
use serde::{Deserialize, Serialize};

use super::Refusal;
use crate::progress::Progress;
use crate::refine::{RefinementSummary, StartFrame, refine, transferred};
use crate::run_folder::RunFolder;

/// A frame that training may use.
#[derive(Clone, Copy, Debug)]
pub struct PosedFrame {
    /// Index in the recording.
    pub index: usize,
    /// Pose of the depth camera.
    pub world_from_camera: Pose,
}

/// What the stage found out, `poses/summary.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PosesSummary {
    /// Pose set that was asked for.
    pub set: String,
    /// Pose set of the recording that the poses are of, or started from.
    pub started_from: String,
    /// Training frames with a pose.
    pub frame_count: usize,
    /// Training frames left out because the camera was lost.
    pub lost_count: usize,
    /// Training frames left out because their pose is in another map than most.
    pub other_map_count: usize,
    /// Training frames left out because the set says nothing of them.
    pub unknown_count: usize,
    /// What refinement did, where it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refinement: Option<RefinementSummary>,
}

/// Name of the set that refinement makes.
pub const REFINED: &str = "refined";
/// Sets that refinement starts from, the first that there is.
const STARTS: [&str; 2] = ["live", "source"];
/// Name of the summary inside a run folder.
pub const SUMMARY_FILE: &str = "poses/summary.json";
/// Name of the refined poses of all frames inside a run folder.
const REFINED_FILE: &str = "poses/refined.json";
/// Fewest posed frames that training accepts.
const FEWEST_FRAMES: usize = 10;

/// A pose in [`REFINED_FILE`].
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredPose {
    frame: usize,
    /// World from depth camera, metres.
    translation: [f64; 3],
    /// x, y, z, w.
    rotation: [f64; 4],
}

/// The set that training starts from when none is named: `source` where there is one, else `live`. Whether it is
/// refined is an effect's verdict.
pub fn default_set(recording: &Recording) -> &'static str {
    if recording.poses("source").is_some() {
        "source"
    } else {
        "live"
    }
}

/// Frames of the stage, and what refinement did where it ran.
pub struct Posed {
    /// Training frames with their poses.
    pub frames: Vec<PosedFrame>,
    /// What refinement did.
    pub refinement: Option<RefinementSummary>,
}

/// The stage: the training frames with their poses of `set`; refined where `set` is [`REFINED`], which starts from the
/// recording's own, or where `refines` asks for it, which starts from `set`. Writes `poses/poses.txt` and
/// `poses/summary.json`.
///
/// # Errors
/// [`Refusal`] without poses to take or to start from, or with too few of them; frames that cannot be read.
pub fn run(
    recording: &Recording,
    set: &str,
    refines: bool,
    folder: &RunFolder,
    progress: &Progress,
) -> anyhow::Result<Posed> {
    let started_from = start_set(recording, set)?;
    let refines = refines || set == REFINED;
    let mut frames = training_frames(recording, started_from)?;
    let made = if refines { REFINED } else { set };
    let mut summary = summary_of(recording, made, started_from, frames.len());
    if refines {
        // A file may list them in another order; neighbours are what is compared.
        frames.sort_by_key(|frame| frame.index);
        let start = start_frames(recording, started_from, &frames)?;
        let refinement = refine(recording, &start, &mut |done, of| progress.step(done, of))?;
        tracing::info!("{}", refinement.summary.reason);
        for (frame, pose) in frames.iter_mut().zip(&refinement.poses) {
            frame.world_from_camera = *pose;
        }
        store_all(folder, recording, started_from, &start, &refinement.poses)?;
        summary.refinement = Some(refinement.summary);
    } else {
        // Those of a run before would be taken for this one's.
        forget_refined(folder)?;
    }
    note_left_out(&summary);
    folder.write("poses/poses.txt", tum_text(recording, &frames).as_bytes())?;
    folder.write_json(SUMMARY_FILE, &summary)?;
    Ok(Posed {
        frames,
        refinement: summary.refinement,
    })
}

/// The set of the recording that training in `set` starts from.
///
/// # Errors
/// [`Refusal::NoStart`] where refinement has nothing to start from.
pub fn start_set<'a>(recording: &Recording, set: &'a str) -> Result<&'a str, Refusal> {
    if set != REFINED {
        return Ok(set);
    }
    let known = STARTS
        .into_iter()
        .find(|set| recording.poses(set).is_some());
    known.ok_or(Refusal::NoStart)
}

fn forget_refined(folder: &RunFolder) -> anyhow::Result<()> {
    match std::fs::remove_file(folder.path(REFINED_FILE)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove the old {REFINED_FILE}"))
        }
        Ok(()) | Err(_) => Ok(()),
    }
}

/// World from depth camera of every frame of the recording as a run used it: those of `set`, or what refinement
/// made of them (held-out frames moved as the training frames around them).
///
/// # Errors
/// When the recording or the run folder has lost them.
pub fn poses_of_run(
    folder: &RunFolder,
    recording: &Recording,
    set: &str,
) -> anyhow::Result<Vec<Option<Pose>>> {
    if set != REFINED && !folder.path(REFINED_FILE).exists() {
        let poses = recording.poses(set);
        let poses = poses.context("the recording has lost its poses since the training")?;
        return Ok(poses.to_vec());
    }
    let stored: Vec<StoredPose> = folder.read_json(REFINED_FILE)?;
    let mut poses = vec![None; recording.frame_count()];
    for stored in stored {
        let [x, y, z, w] = stored.rotation;
        let pose = Pose::new(
            DQuat::from_xyzw(x, y, z, w),
            DVec3::from(stored.translation),
        )
        .with_context(|| format!("{REFINED_FILE} holds no pose for frame {}", stored.frame))?;
        let place = poses.get_mut(stored.frame);
        *place.with_context(|| {
            format!(
                "{REFINED_FILE} names frame {}, which the recording lacks",
                stored.frame
            )
        })? = Some(pose);
    }
    Ok(poses)
}

/// The training frames of `recording` with their poses of `set`, in order. Test and unused frames never
/// leave this function.
pub fn training_frames(recording: &Recording, set: &str) -> Result<Vec<PosedFrame>, Refusal> {
    let poses = recording
        .poses(set)
        .ok_or_else(|| Refusal::NoPoses(set.to_owned()))?;
    let frames = training_frames_at(recording, poses);
    if frames.len() < FEWEST_FRAMES {
        return Err(Refusal::TooFewFrames(frames.len()));
    }
    Ok(frames)
}

/// The training frames of `recording` that have one of `poses` (one a frame of the recording), in order.
pub fn training_frames_at(recording: &Recording, poses: &[Option<Pose>]) -> Vec<PosedFrame> {
    let train = recording.split().train.iter();
    train
        .map(|&index| index as usize)
        .filter_map(|index| {
            let world_from_camera = poses.get(index).copied().flatten()?;
            Some(PosedFrame {
                index,
                world_from_camera,
            })
        })
        .collect()
}

/// Every `stride`th of the training frames, from the first on.
///
/// # Errors
/// When too few remain.
pub fn every_nth(frames: Vec<PosedFrame>, stride: u32) -> Result<Vec<PosedFrame>, Refusal> {
    if stride <= 1 {
        return Ok(frames);
    }
    let some: Vec<PosedFrame> = frames.into_iter().step_by(stride as usize).collect();
    if some.len() < FEWEST_FRAMES {
        return Err(Refusal::TooFewFrames(some.len()));
    }
    Ok(some)
}

/// The stored poses of a set.
fn stored_poses<'a>(recording: &'a Recording, set: &str) -> &'a [FramePose] {
    let sets = &recording.contents().pose_sets;
    let stored = sets.iter().find(|stored| stored.head.name == set);
    stored.map_or(&[], |stored| &stored.poses)
}

/// Number of a frame's depth image, by which stored poses name it.
fn number_of(recording: &Recording, index: usize) -> anyhow::Result<u64> {
    Ok(recording.depth_times(index)?.number)
}

/// Counts the training frames that the set leaves out.
fn summary_of(
    recording: &Recording,
    set: &str,
    started_from: &str,
    frame_count: usize,
) -> PosesSummary {
    let mut summary = PosesSummary {
        set: set.to_owned(),
        started_from: started_from.to_owned(),
        frame_count,
        lost_count: 0,
        other_map_count: 0,
        unknown_count: 0,
        refinement: None,
    };
    let states: BTreeMap<u64, PoseState> = stored_poses(recording, started_from)
        .iter()
        .map(|pose| (pose.number, pose.state))
        .collect();
    let poses = recording.poses(started_from).unwrap_or_default();
    for &index in &recording.split().train {
        let index = index as usize;
        if poses.get(index).copied().flatten().is_some() {
            continue;
        }
        let number = (index < recording.frame_count()).then(|| number_of(recording, index));
        let state = number
            .and_then(Result::ok)
            .and_then(|number| states.get(&number));
        match state {
            Some(PoseState::Lost) => summary.lost_count += 1,
            Some(_) => summary.other_map_count += 1,
            None => summary.unknown_count += 1,
        }
    }
    summary
}

/// Says how many frames were left out, and why.
fn note_left_out(summary: &PosesSummary) {
    for (count, why) in [
        (summary.lost_count, "the camera was lost"),
        (summary.other_map_count, "their pose is in another map"),
        (summary.unknown_count, "the set has no pose of them"),
    ] {
        if count > 0 {
            tracing::info!("{count} frames left out: {why}");
        }
    }
}

/// Frames with the covariances that their set stores.
fn start_frames(
    recording: &Recording,
    set: &str,
    frames: &[PosedFrame],
) -> anyhow::Result<Vec<StartFrame>> {
    let covariances: BTreeMap<u64, [f32; 21]> = stored_poses(recording, set)
        .iter()
        .filter_map(|pose| Some((pose.number, pose.covariance?)))
        .collect();
    let poses = recording.poses(set).unwrap_or_default();
    let mut next = 0;
    frames
        .iter()
        .map(|frame| {
            let number = number_of(recording, frame.index)?;
            let between = poses.get(next..frame.index).unwrap_or_default();
            next = frame.index + 1;
            Ok(StartFrame {
                follows_lost: between.iter().any(Option::is_none),
                index: frame.index,
                world_from_camera: frame.world_from_camera,
                covariance: covariances.get(&number).copied(),
            })
        })
        .collect()
}

/// Stores the poses of all frames: training frames as refined, the others moved as those around them.
fn store_all(
    folder: &RunFolder,
    recording: &Recording,
    started_from: &str,
    start: &[StartFrame],
    refined: &[Pose],
) -> anyhow::Result<()> {
    let known: Vec<(usize, Pose, Pose)> = start
        .iter()
        .zip(refined)
        .map(|(start, refined)| (start.index, start.world_from_camera, *refined))
        .collect();
    let poses = recording.poses(started_from).unwrap_or_default();
    let posed: Vec<(usize, Pose)> = poses
        .iter()
        .enumerate()
        .filter_map(|(index, pose)| Some((index, (*pose)?)))
        .collect();
    let moved = transferred(&known, &posed);
    let stored: Vec<StoredPose> = posed
        .iter()
        .zip(moved)
        .map(|((frame, _), pose)| StoredPose {
            frame: *frame,
            translation: pose.translation().to_array(),
            rotation: pose.rotation().to_array(),
        })
        .collect();
    folder.write_json(REFINED_FILE, &stored)
}

/// The frames whose image in one stream is no repeat, and how many were left out.
///
/// A repeat says nothing new, but would weigh its image twice (hard-cases B13); and since its image is older than
/// its time, its pose is not that of the image. Where the image that it repeats is held out, leaving it out
/// keeps that image from training.
pub(crate) fn without_repeats(
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
