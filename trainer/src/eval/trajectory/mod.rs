//! `glint eval --trajectory`: a camera path against a reference (effects-and-tradeoffs C3).
//!
//! Map: `frames` what tracking said of each pair · `reference` where the camera was · `figures` the errors.

mod figures;
mod frames;
mod reference;

use std::fmt::Write as _;
use std::ops::Range;

use anyhow::{Context as _, bail};
use geometry::Pose;
use geometry::alignment::FEWEST_PAIRS;
use geometry::trajectory::{OffsetSearch, PoseAlignment, align_poses, fit_time_offset};
use sequence::Recording;
use serde::{Deserialize, Serialize};

pub use self::figures::{Errors, PathFigures, RelativeFigures};
pub use self::frames::{EstimatedFrame, Tracked, estimated_frames, posed_frames};
pub use self::reference::{ReferencePath, TrajectoryReference};

use self::figures::figures;

/// What `--trajectory` compares.
#[derive(Clone, Debug)]
pub struct TrajectoryOptions {
    /// Where the camera was.
    pub reference: TrajectoryReference,
    /// Pose set of the recording that is judged.
    pub poses: String,
    /// Fit the time between the two clocks even where the reference has none of its own.
    pub fit_offset: bool,
    /// Pairs that are judged on their own beside the whole path, end excluded.
    pub ranges: Vec<Range<usize>>,
}

/// A fitted time between two clocks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedOffset {
    /// Reference time less recording time, seconds.
    pub seconds: f64,
    /// Relative rotation error over 1 s with the offset, degrees.
    pub rotation_deg: f64,
    /// The same without it.
    pub rotation_deg_at_zero: f64,
}

/// Everything `--trajectory` measures, for `metrics.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrajectoryMetrics {
    /// Pose set that was judged.
    pub poses: String,
    /// The reference as it was given.
    pub reference: String,
    /// Time between the clocks, where it was fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_offset: Option<FittedOffset>,
    /// What a reader should know of the comparison.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// All frames.
    pub whole: PathFigures,
    /// The ranges asked for, each aligned on its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<PathFigures>,
}

/// A judged path: its figures, and what else is measured in its frame.
#[derive(Clone, Debug)]
pub struct JudgedPath {
    /// The figures.
    pub metrics: TrajectoryMetrics,
    /// From the world of the judged poses to that of the reference.
    pub alignment: PoseAlignment,
    /// World from depth camera of every pair by the reference, where it has one.
    pub reference: Vec<Option<Pose>>,
}

/// Judges a pose set of `recording`.
///
/// # Errors
/// When there is no such set or reference, when fewer than 10 tracked frames have a reference pose, or when a
/// range lies outside.
pub fn evaluate(recording: &Recording, options: &TrajectoryOptions) -> anyhow::Result<JudgedPath> {
    let frames = estimated_frames(recording, &options.poses)?;
    evaluate_frames(recording, &frames, options)
}

/// As [`evaluate`], with what is known of every pair of the recording; [`TrajectoryOptions::poses`] only names it.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_frames(
    recording: &Recording,
    frames: &[EstimatedFrame],
    options: &TrajectoryOptions,
) -> anyhow::Result<JudgedPath> {
    let path = ReferencePath::read(recording, &options.reference)?;
    let mut notes = Vec::new();
    let time_offset = if options.fit_offset || path.has_own_clock(frames) {
        let found = fitted_offset(&path, frames);
        if found.is_none() {
            notes.push(
                "the time between the clocks could not be fitted: too few frames, or the camera turns too evenly; 0 is used"
                    .to_owned(),
            );
        }
        found
    } else {
        None
    };
    let offset_nanos = time_offset.map_or(0, |(nanos, _)| nanos);
    let reference = path.of_frames(frames, offset_nanos);
    let judge = |range: Range<usize>| -> anyhow::Result<(PathFigures, PoseAlignment)> {
        let alignment = aligned(&frames[range.clone()], &reference[range.clone()])?;
        let figures = figures(frames, &reference, range, &alignment)?;
        Ok((figures, alignment))
    };
    let (whole, alignment) = judge(0..frames.len()).with_context(|| {
        format!(
            "the poses `{}` of {} cannot be judged by {}",
            options.poses,
            recording.path().display(),
            options.reference
        )
    })?;
    if whole.other_map_count > 0 {
        notes.push(format!(
            "{} frames are in other maps than the largest: they count as lost",
            whole.other_map_count
        ));
    }
    let mut segments = Vec::new();
    for range in &options.ranges {
        if range.end > frames.len() {
            bail!(
                "--range {}..{} reaches beyond the {} frames of {}",
                range.start,
                range.end,
                frames.len(),
                recording.path().display()
            );
        }
        let (mut segment, _) = judge(range.clone())
            .with_context(|| format!("frames {}..{} cannot be judged", range.start, range.end))?;
        let in_whole = figures(frames, &reference, range.clone(), &alignment)?;
        segment.range = Some([range.start, range.end]);
        segment.ate_in_whole_m = Some(in_whole.ate.rmse);
        segments.push(segment);
    }
    Ok(JudgedPath {
        metrics: TrajectoryMetrics {
            poses: options.poses.clone(),
            reference: options.reference.to_string(),
            time_offset: time_offset.map(|(_, fitted)| fitted),
            notes,
            whole,
            segments,
        },
        alignment,
        reference,
    })
}

/// From the world of the set `poses` to that of the set `source`: what turns a map trained in the first into
/// the axes of the second. `None` where the recording has no set `source`.
///
/// # Errors
/// When there is no set `poses`, or fewer than 10 frames have both.
pub fn alignment_to_source(
    recording: &Recording,
    poses: &str,
) -> anyhow::Result<Option<PoseAlignment>> {
    if recording.poses("source").is_none() {
        return Ok(None);
    }
    frames_to_source(recording, &estimated_frames(recording, poses)?, poses)
}

/// As [`alignment_to_source`], with what is known of every pair of the recording; `poses` only names it.
///
/// # Errors
/// When fewer than 10 frames have both.
pub fn frames_to_source(
    recording: &Recording,
    frames: &[EstimatedFrame],
    poses: &str,
) -> anyhow::Result<Option<PoseAlignment>> {
    if recording.poses("source").is_none() {
        return Ok(None);
    }
    let path = ReferencePath::read(recording, &TrajectoryReference::Source)?;
    let reference = path.of_frames(frames, 0);
    let alignment = aligned(frames, &reference)
        .with_context(|| format!("the poses `{poses}` cannot be aligned to the poses `source`"))?;
    Ok(Some(alignment))
}

/// The alignment of the tracked frames that have a reference pose.
fn aligned(frames: &[EstimatedFrame], reference: &[Option<Pose>]) -> anyhow::Result<PoseAlignment> {
    let (reference, estimate): (Vec<Pose>, Vec<Pose>) = frames
        .iter()
        .zip(reference)
        .filter_map(|(frame, reference)| Some(((*reference)?, frame.tracked.pose()?)))
        .unzip();
    Ok(align_poses(&reference, &estimate)?)
}

fn fitted_offset(path: &ReferencePath, frames: &[EstimatedFrame]) -> Option<(i64, FittedOffset)> {
    let tracked: Vec<(i64, Pose)> = frames
        .iter()
        .filter_map(|frame| Some((frame.nanos, frame.tracked.pose()?)))
        .collect();
    let found = fit_time_offset(path.poses(), &tracked, &OffsetSearch::default())?;
    let fitted = FittedOffset {
        seconds: found.offset_nanos as f64 * 1e-9,
        rotation_deg: found.rotation_rmse.to_degrees(),
        rotation_deg_at_zero: found.rotation_rmse_at_zero.to_degrees(),
    };
    Some((found.offset_nanos, fitted))
}

/// The figures in words for a terminal.
pub fn text(metrics: &TrajectoryMetrics) -> String {
    let mut text = format!("poses `{}` against {}", metrics.poses, metrics.reference);
    if let Some(offset) = &metrics.time_offset {
        let _ = write!(
            text,
            "\n  clock of the reference {:+.1} ms (rotation error over 1 s {:.2} -> {:.2} degrees)",
            1e3 * offset.seconds,
            offset.rotation_deg_at_zero,
            offset.rotation_deg
        );
    }
    for note in &metrics.notes {
        let _ = write!(text, "\n  note: {note}");
    }
    for figures in std::iter::once(&metrics.whole).chain(&metrics.segments) {
        let _ = write!(text, "\n{figures}");
    }
    text
}

/// The keys of the summary event.
pub fn summary(metrics: &TrajectoryMetrics) -> serde_json::Map<String, serde_json::Value> {
    let mut keys = metrics.whole.summary();
    if let Some(offset) = &metrics.time_offset {
        keys.insert("time_offset_s".into(), offset.seconds.into());
    }
    if !metrics.segments.is_empty() {
        let segments = metrics.segments.iter();
        let segments = segments.map(|segment| serde_json::Value::Object(segment.summary()));
        keys.insert("segments".into(), segments.collect());
    }
    keys.insert("trajectory_notes".into(), metrics.notes.clone().into());
    keys
}

/// Fewest frames that are judged.
pub const FEWEST_FRAMES: usize = FEWEST_PAIRS;
