//! Offline refinement of camera poses.
//!
//! [`keyframes`] which frames see the same surface · [`loops`] motions between them, measured and verified ·
//! [`pose_graph`] the path that fits them all · [`rounds`] each frame against all others, shape and look together ·
//! [`judge`] whether that was better, by residual optical flow and by depth.
//!
//! The result is used only where it is better than its start.

mod align;
mod envelope;
mod flow;
mod frames;
mod judge;
mod keyframes;
mod loops;
mod pose_graph;
mod rounds;
mod spread;

use fusion::{Volume, VolumeConfig};
use geometry::{DVec3, Pose};
use sequence::Recording;
use serde::{Deserialize, Serialize};

use self::frames::FrameLoader;
pub use self::judge::Judgement;
pub(crate) use self::spread::transferred;

/// A frame with the pose that refinement starts from.
#[derive(Clone, Copy, Debug)]
pub struct StartFrame {
    /// Index in the recording.
    pub index: usize,
    /// World from depth camera.
    pub world_from_camera: Pose,
    /// Upper triangle by rows of the covariance of rotation (radians) and translation (metres), camera axes.
    pub covariance: Option<[f32; 21]>,
    /// Whether the camera was lost since the start frame before: the way between them is not known.
    pub follows_lost: bool,
}

/// What refinement did, part of `poses/summary.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefinementSummary {
    /// Whether the refined poses are used; else the start stands.
    pub is_used: bool,
    /// Why, one sentence.
    pub reason: String,
    /// The start, on frames that its model does not hold.
    pub before: Option<Judgement>,
    /// The refined poses, judged alike.
    pub after: Option<Judgement>,
    /// Keyframes of the graph.
    pub keyframe_count: usize,
    /// Pairs of keyframes that were aligned.
    pub tried_loop_count: usize,
    /// Of these, alignments that stood up.
    pub verified_loop_count: usize,
    /// Of these, contradicted by the others.
    pub refused_loop_count: usize,
    /// Rounds of all frames against the whole.
    pub rounds: Vec<RoundSummary>,
    /// Frames that took no part, because their depth repeats the frame before; they got the corrections of their
    /// neighbours.
    pub repeated_frame_count: usize,
    /// Median distance between start and refined camera, millimetres.
    pub shift_mm: f64,
    /// Largest distance between them, millimetres.
    pub largest_shift_mm: f64,
}

/// One round of all frames against the whole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoundSummary {
    /// Voxel edge, millimetres.
    pub voxel_mm: f64,
    /// Median correction, millimetres.
    pub shift_mm: f64,
    /// Median correction, degrees.
    pub turn_deg: f64,
    /// Frames that kept their pose.
    pub kept_count: usize,
}

/// Poses and what led to them.
#[derive(Clone, Debug)]
pub struct Refinement {
    /// World from depth camera, one for each start frame: refined, or the start's where that stands.
    pub poses: Vec<Pose>,
    /// What was done.
    pub summary: RefinementSummary,
}

/// A frame that takes part.
#[derive(Clone, Copy, Debug)]
struct ActiveFrame {
    index: usize,
    world_from_camera: Pose,
    covariance: Option<[f32; 21]>,
    /// Whether the camera was lost since the frame before.
    follows_lost: bool,
}

/// Fewest frames that say something about each other.
const FEWEST_FRAMES: usize = 3;
/// Bytes that a volume may hold.
const MEMORY_LIMIT_BYTES: usize = 3 << 30;
/// Edge of the finest voxels in pixels at the median depth: finer shows no more of the photographs.
const FINEST_VOXEL_PIXELS: f64 = 2.0;
/// Bounds of the finest voxels, metres.
const FINEST_VOXEL: [f32; 2] = [0.0025, 0.008];
/// Voxels of the rounds, in finest ones.
const ROUND_VOXELS: [f32; 3] = [1.6, 1.3, 1.0];
/// Most rounds of one size, …
const ROUNDS_PER_SIZE: usize = 3;
/// … which end when the median correction is below this, metres: then finer voxels show more.
const ADVANCE: f64 = 5e-4;
/// Rounds that most paths need.
const USUAL_ROUNDS: usize = 4;
/// Most rounds.
const MOST_ROUNDS: usize = 7;
/// Median correction that ends the rounds, metres and radians.
const SETTLED: [f64; 2] = [1e-4, 1.75e-4];
/// The refined poses must bring the flow down to this share: less is within what the choice of frames makes.
const LEAST_GAIN: f64 = 0.9;
/// Share by which the residual of depth may seem to grow: noise of the frames that are judged.
const RESIDUAL_SLACK: f64 = 1.01;
/// Without flow the residual of depth must come down to this share.
const LEAST_RESIDUAL_GAIN: f64 = 0.99;

/// Refines the poses of `frames`, in the order of the recording. `progress(done, of)` counts passes over the frames.
///
/// # Errors
/// When a frame cannot be read, or the volume cannot be made.
pub fn refine(
    recording: &Recording,
    frames: &[StartFrame],
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<Refinement> {
    let start: Vec<Pose> = frames.iter().map(|frame| frame.world_from_camera).collect();
    let loader = FrameLoader::new(recording)?;
    let active = active_frames(&loader, frames);
    let mut summary = RefinementSummary {
        is_used: false,
        reason: String::new(),
        before: None,
        after: None,
        keyframe_count: 0,
        tried_loop_count: 0,
        verified_loop_count: 0,
        refused_loop_count: 0,
        rounds: Vec::new(),
        repeated_frame_count: frames.len() - active.len(),
        shift_mm: 0.0,
        largest_shift_mm: 0.0,
    };
    if active.len() < FEWEST_FRAMES {
        summary.reason = format!(
            "only {} frames with depth of their own: nothing to compare them with",
            active.len()
        );
        return Ok(Refinement {
            poses: start,
            summary,
        });
    }
    let Some(volume) = volume_of(recording, &loader, &active)? else {
        summary.reason = "the frames hold no depth".to_owned();
        return Ok(Refinement {
            poses: start,
            summary,
        });
    };
    let refined = moved(&loader, &active, &volume, &mut summary, progress)?;
    let before = judge::judge(&loader, &active, &volume, &mut |_| {})?;
    let after = judge::judge(&loader, &refined, &volume, &mut |_| {})?;
    (summary.is_used, summary.reason) = verdict(&before, &after);
    summary.before = Some(before);
    summary.after = Some(after);
    let corrected = spread::corrected(&active, &refined, frames);
    let mut shifts: Vec<f64> = start
        .iter()
        .zip(&corrected)
        .map(|(start, pose)| 1e3 * (start.translation() - pose.translation()).length())
        .collect();
    summary.largest_shift_mm = shifts.iter().copied().fold(0.0, f64::max);
    summary.shift_mm = geometry::robust::median(&mut shifts).unwrap_or(0.0);
    let poses = if summary.is_used { corrected } else { start };
    Ok(Refinement { poses, summary })
}

/// The frames whose depth is their own.
fn active_frames(loader: &FrameLoader<'_>, frames: &[StartFrame]) -> Vec<ActiveFrame> {
    let mut active = Vec::new();
    let mut follows_lost = false;
    for frame in frames {
        follows_lost |= frame.follows_lost;
        if !loader.depth_is_repeat(frame.index) {
            active.push(ActiveFrame {
                index: frame.index,
                world_from_camera: frame.world_from_camera,
                covariance: frame.covariance,
                follows_lost,
            });
            follows_lost = false;
        }
    }
    active
}

/// Finest volume for the recording's depth; `None` without depth.
fn volume_of(
    recording: &Recording,
    loader: &FrameLoader<'_>,
    frames: &[ActiveFrame],
) -> anyhow::Result<Option<VolumeConfig>> {
    let step = frames.len().div_ceil(8);
    let indices: Vec<usize> = frames
        .iter()
        .step_by(step)
        .map(|frame| frame.index)
        .collect();
    let depths = loader.map(&indices, |_, frame| {
        let known = frame.depth.pixels().iter().step_by(37);
        let known = known.filter(|z| imaging::is_measured(**z));
        Ok(known.map(|&z| f64::from(z)).collect::<Vec<f64>>())
    })?;
    let Some(median) = geometry::robust::median(&mut depths.concat()) else {
        return Ok(None);
    };
    let range = recording.depth_camera().depth_range.clone();
    let pixel = median / loader.depth_camera.focal().x;
    let [least, largest] = FINEST_VOXEL;
    let mean = frames
        .iter()
        .map(|f| f.world_from_camera.translation())
        .sum::<DVec3>();
    Ok(Some(VolumeConfig {
        voxel_size: ((FINEST_VOXEL_PIXELS * pixel) as f32).clamp(least, largest),
        min_depth: *range.start(),
        max_depth: *range.end(),
        memory_limit_bytes: MEMORY_LIMIT_BYTES,
        origin: mean / frames.len() as f64,
        ..VolumeConfig::default()
    }))
}

/// Graph and rounds.
fn moved(
    loader: &FrameLoader<'_>,
    active: &[ActiveFrame],
    volume: &VolumeConfig,
    summary: &mut RefinementSummary,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<Vec<ActiveFrame>> {
    let of = (1 + USUAL_ROUNDS) * active.len();
    let coarse = VolumeConfig {
        voxel_size: ROUND_VOXELS[0] * volume.voxel_size,
        ..volume.clone()
    };
    let graph = loops::build(loader, active, &coarse, &mut |done, count| {
        progress(active.len() * done / count.max(1), of);
    })?;
    let start: Vec<Pose> = graph
        .positions
        .iter()
        .map(|&p| active[p].world_from_camera)
        .collect();
    let mut solved = pose_graph::solve(&start, &graph.edges);
    rounds::regauge(&start, &mut solved.poses);
    summary.keyframe_count = graph.positions.len();
    summary.tried_loop_count = graph.tried_count;
    summary.verified_loop_count = graph.edges.iter().filter(|edge| edge.is_loop).count();
    summary.refused_loop_count = solved.refused_count;
    let mut frames = spread::between_keyframes(active, &graph.positions, &solved.poses);
    settle(
        loader,
        &mut frames,
        volume,
        &mut summary.rounds,
        &mut |done| {
            progress((active.len() + done).min(of), of);
        },
    )?;
    Ok(frames)
}

/// Rounds from coarse to fine voxels, until nothing moves.
fn settle(
    loader: &FrameLoader<'_>,
    frames: &mut [ActiveFrame],
    volume: &VolumeConfig,
    rounds: &mut Vec<RoundSummary>,
    progress: &mut dyn FnMut(usize),
) -> anyhow::Result<()> {
    let (mut size, mut of_size) = (0, 0);
    for number in 0..MOST_ROUNDS {
        let config = VolumeConfig {
            voxel_size: ROUND_VOXELS[size] * volume.voxel_size,
            ..volume.clone()
        };
        let count = frames.len();
        let round = rounds::round(loader, frames, &config, &mut |done| {
            progress(number * count + done);
        })?;
        rounds.push(RoundSummary {
            voxel_mm: f64::from(config.voxel_size) * 1e3,
            shift_mm: 1e3 * round.shift,
            turn_deg: round.turn.to_degrees(),
            kept_count: round.kept_count,
        });
        of_size += 1;
        let is_finest = size + 1 == ROUND_VOXELS.len();
        let [shift, turn] = SETTLED;
        if is_finest && round.shift < shift && round.turn < turn {
            break;
        }
        if !is_finest && (round.shift < ADVANCE || of_size == ROUNDS_PER_SIZE) {
            (size, of_size) = (size + 1, 0);
        }
    }
    Ok(())
}

/// Whether the refined poses are better, and the sentence that says so.
fn verdict(before: &Judgement, after: &Judgement) -> (bool, String) {
    let residuals = (before.depth_residual_mm, after.depth_residual_mm);
    let (Some(residual_before), Some(residual_after)) = residuals else {
        return (
            false,
            "no depth lies on the fused surface: the start stands".to_owned(),
        );
    };
    let depth = format!("depth residual {residual_before:.3} to {residual_after:.3} mm");
    if let (Some(flow_before), Some(flow_after)) = (before.flow_px, after.flow_px) {
        let flow = format!("residual flow {flow_before:.3} to {flow_after:.3} pixels");
        let is_better = flow_after <= LEAST_GAIN * flow_before;
        let is_held = residual_after <= RESIDUAL_SLACK * residual_before;
        return match (is_better, is_held) {
            (true, true) => (true, format!("{flow}, {depth}: the refined poses are used")),
            (false, _) => (
                false,
                format!("{flow}, {depth}: not down by a tenth, so the start stands"),
            ),
            (true, false) => (
                false,
                format!("{flow}, but {depth}: depth fits worse, so the start stands"),
            ),
        };
    }
    let flow = match (before.flow_px, after.flow_px) {
        (None, Some(flow)) => {
            format!("residual flow not measurable before, {flow:.3} pixels after")
        }
        (Some(flow), _) => {
            let sentence = format!(
                "residual flow {flow:.3} pixels before and not measurable after: the start stands"
            );
            return (false, sentence);
        }
        (None, None) => "no texture to measure flow by".to_owned(),
    };
    if residual_after <= LEAST_RESIDUAL_GAIN * residual_before {
        (true, format!("{depth}, {flow}: the refined poses are used"))
    } else {
        (false, format!("{depth}, {flow}: the start stands"))
    }
}

/// Fuses frames at their poses, with colour where their photograph is their own.
fn fuse(
    loader: &FrameLoader<'_>,
    frames: &[ActiveFrame],
    config: VolumeConfig,
    progress: &mut dyn FnMut(usize),
) -> anyhow::Result<Volume> {
    let mut volume = Volume::new(config)?;
    let camera = loader.depth_camera;
    let indices: Vec<usize> = frames.iter().map(|frame| frame.index).collect();
    loader.for_each(&indices, |position, frame| {
        let pose = &frames[position].world_from_camera;
        match &frame.photograph {
            Some(photograph) => volume.integrate_colored(
                frame.depth.pixels(),
                &photograph.registered,
                &camera,
                pose,
            )?,
            None => volume.integrate(frame.depth.pixels(), &camera, pose)?,
        };
        progress(position + 1);
        Ok(())
    })?;
    Ok(volume)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(flow_px: Option<f64>, residual: f64) -> Judgement {
        Judgement {
            flow_px,
            depth_residual_mm: Some(residual),
            frame_count: 10,
            patch_count: 100,
        }
    }

    #[test]
    fn only_what_is_better_as_a_whole_is_used() {
        let used = |before, after| verdict(&before, &after).0;
        assert!(used(judged(Some(0.6), 1.0), judged(Some(0.4), 1.0)));
        assert!(!used(judged(Some(0.4), 1.0), judged(Some(0.4), 0.5)));
        assert!(!used(judged(Some(0.6), 1.0), judged(Some(0.4), 1.1)));
        assert!(!used(judged(Some(0.6), 1.0), judged(None, 0.5)));
        assert!(used(judged(None, 4.0), judged(Some(0.3), 1.0)));
        assert!(!used(judged(None, 1.0), judged(None, 1.0)));
        assert!(used(judged(None, 1.0), judged(None, 0.9)));
    }
}
