//! Motions between keyframes, each measured by aligning one frame with the surface around the other.

use fusion::tracking::{
    Gates, Icp, IcpConfig, IcpInput, Photometric, TrackState, keyframes::angle_between,
};
use fusion::{ModelView, Volume, VolumeConfig};
use geometry::{Pose, symmetric_eigen};

use super::align::{Aligned, Pairing, align};
use super::frames::{FrameLoader, LoadedFrame};
use super::keyframes::{Keyframe, Reason, candidates, choose};
use super::pose_graph::Edge;
use super::{ActiveFrame, fuse};

#[cfg(test)]
mod tests;

/// Frames on each side of a keyframe whose depth makes its local surface.
const LOCAL_REACH: usize = 3;
/// What must hold of a frame that its pose says is near.
const OVERLAP_GATES: Gates = Gates {
    least_inliers: 500.0,
    least_agreement: 0.6,
    least_overlap: 0.3,
    largest_shift: 0.15,
    largest_turn: 0.15,
};
/// Systematic error of an alignment, which no number of points averages out: radians and metres.
const FLOOR: [f64; 2] = [4e-4, 3e-4];
/// Error of the start from one frame to the next, where it does not say: radians and metres.
const DRIFT: [f64; 2] = [1e-3, 1e-3];
/// The same across frames whose pose is lost: the camera may have been anywhere.
const GAP: [f64; 2] = [0.1, 0.1];
/// Pairing once coarse alignment is done.
const FINE: Pairing = Pairing {
    largest_distance: 0.02,
    robust_scale: 3.0,
};

/// The graph of keyframes.
pub(super) struct Graph {
    /// Places of the keyframes in the list of frames.
    pub(super) positions: Vec<usize>,
    /// Measured motions between them, numbers of keyframes.
    pub(super) edges: Vec<Edge>,
    /// Pairs that were tried.
    pub(super) tried_count: usize,
}

/// Builds the graph from frames at their start poses.
pub(super) fn build(
    loader: &FrameLoader<'_>,
    frames: &[ActiveFrame],
    volume: &VolumeConfig,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<Graph> {
    let path: Vec<Pose> = frames.iter().map(|frame| frame.world_from_camera).collect();
    let positions = choose(&path);
    let indices: Vec<usize> = positions.iter().map(|&p| frames[p].index).collect();
    let keyframes = loader.map(&indices, |place, frame| {
        Ok(Keyframe::new(positions[place], frame))
    })?;
    let keyframes: Vec<Keyframe> = keyframes.into_iter().flatten().collect();
    let pairs = candidates(&keyframes, &path);
    let mut edges: Vec<Edge> = sequential(frames, &positions);
    for earlier in 0..keyframes.len() {
        let partners: Vec<(usize, Reason)> = pairs
            .iter()
            .filter(|(from, ..)| *from == earlier)
            .map(|&(_, later, reason)| (later, reason))
            .collect();
        progress(earlier, keyframes.len());
        if partners.is_empty() {
            continue;
        }
        let view = local_view(loader, frames, positions[earlier], volume)?;
        let indices: Vec<usize> = partners
            .iter()
            .map(|(later, _)| frames[positions[*later]].index)
            .collect();
        let found = loader.map(&indices, |place, frame| {
            let (later, reason) = partners[place];
            let expected = path[positions[earlier]].inverse() * path[positions[later]];
            Ok(verified(&view, frame, &expected, reason))
        })?;
        for ((later, _), aligned) in partners.iter().zip(found) {
            if let Some(aligned) = aligned {
                edges.push(Edge {
                    from: earlier,
                    to: *later,
                    from_from_to: aligned.view_from_live,
                    information: with_floor(&aligned.information, FLOOR),
                    is_loop: true,
                });
            }
        }
    }
    Ok(Graph {
        positions,
        edges,
        tried_count: pairs.len(),
    })
}

/// The surface around a frame, seen from it.
fn local_view(
    loader: &FrameLoader<'_>,
    frames: &[ActiveFrame],
    position: usize,
    volume: &VolumeConfig,
) -> anyhow::Result<ModelView> {
    let last = (position + LOCAL_REACH + 1).min(frames.len());
    let local = &frames[position.saturating_sub(LOCAL_REACH)..last];
    let pose = frames[position].world_from_camera;
    let config = VolumeConfig {
        origin: pose.translation(),
        ..volume.clone()
    };
    let model: Volume = fuse(loader, local, config, &mut |_| {})?;
    let camera = half(loader)?;
    let mut view = ModelView::new(&camera, &pose);
    model.predict(&camera, &pose, &mut view);
    Ok(view)
}

/// The depth camera at half size.
pub(super) fn half(loader: &FrameLoader<'_>) -> anyhow::Result<geometry::Intrinsics> {
    fusion::tracking::points::half_camera(&loader.depth_camera)
        .ok_or_else(|| anyhow::anyhow!("the depth images are too small to refine poses"))
}

/// The alignment of a frame with a keyframe's view; `None` unless it stands up to the gates.
pub(super) fn verified(
    view: &ModelView,
    frame: &LoadedFrame,
    expected: &Pose,
    reason: Reason,
) -> Option<Aligned> {
    let grey = frame.photograph.as_ref().map(|photograph| &photograph.grey);
    let input = IcpInput {
        points: &frame.points,
        view,
        grey,
    };
    let (start, gates) = match reason {
        Reason::Overlap => (*expected, OVERLAP_GATES),
        Reason::Looks => (Pose::IDENTITY, Gates::RELOCALISING),
    };
    let mut icp = Icp::new(IcpConfig::default());
    let passes = icp.config().passes.len();
    let mut photometric = Photometric::default();
    let coarse = icp.align(input, &mut photometric, start, 0..passes)?;
    if gates.state(&coarse, &start) == TrackState::Lost {
        return None;
    }
    let fine = align(&frame.points, view, grey, &coarse.view_from_live, FINE)?;
    let change = coarse.view_from_live.inverse() * fine.view_from_live;
    let is_near = change.translation().length() < f64::from(FINE.largest_distance)
        && angle_between(
            coarse.view_from_live.rotation(),
            fine.view_from_live.rotation(),
        ) < gates.largest_turn;
    let met = f64::from(fine.sums.met_count);
    let inliers = f64::from(fine.sums.inlier_count);
    let holds = inliers >= gates.least_inliers
        && inliers >= gates.least_agreement * met
        && met >= gates.least_overlap * fine.point_count as f64;
    (is_near && holds).then_some(fine)
}

/// The motions of the start between keyframes that follow each other.
fn sequential(frames: &[ActiveFrame], positions: &[usize]) -> Vec<Edge> {
    let pairs = positions.windows(2).enumerate();
    pairs
        .map(|(from, pair)| {
            let (first, last) = (pair[0], pair[1]);
            let mut covariance = [[0.0; 6]; 6];
            for frame in &frames[first + 1..=last] {
                add_drift(&mut covariance, frame);
            }
            Edge {
                from,
                to: from + 1,
                from_from_to: frames[first].world_from_camera.inverse()
                    * frames[last].world_from_camera,
                information: inverse(&covariance, LEAST_VARIANCE),
                is_loop: false,
            }
        })
        .collect()
}

/// Adds the error of the motion that ends at a frame.
fn add_drift(covariance: &mut [[f64; 6]; 6], frame: &ActiveFrame) {
    let sigma = if frame.follows_lost { GAP } else { DRIFT };
    for axis in 0..6 {
        covariance[axis][axis] += sigma[axis / 3] * sigma[axis / 3];
    }
    let Some(triangle) = &frame.covariance else {
        return;
    };
    let places = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    for ((row, column), &entry) in places.zip(triangle) {
        if !entry.is_finite() {
            continue;
        }
        covariance[row][column] += f64::from(entry);
        if row != column {
            covariance[column][row] += f64::from(entry);
        }
    }
}

/// Information after an error of `floor` (radians, metres) in every axis was added.
fn with_floor(information: &[[f64; 6]; 6], floor: [f64; 2]) -> [[f64; 6]; 6] {
    let mut covariance = inverse(information, LEAST_INFORMATION);
    for axis in 0..6 {
        covariance[axis][axis] += floor[axis / 3] * floor[axis / 3];
    }
    inverse(&covariance, LEAST_VARIANCE)
}

/// Least information of a direction: 1 radian or metre is not knowing.
const LEAST_INFORMATION: f64 = 1.0;
/// Least variance, far below what can be measured.
const LEAST_VARIANCE: f64 = 1e-12;

/// Inverse of a symmetric matrix whose eigenvalues are raised to `least` first.
fn inverse(matrix: &[[f64; 6]; 6], least: f64) -> [[f64; 6]; 6] {
    let eigen = symmetric_eigen(matrix);
    // NaN becomes the least.
    let values = eigen.values.map(|value| 1.0 / value.max(least));
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            (0..6)
                .map(|k| values[k] * eigen.vectors[k][row] * eigen.vectors[k][column])
                .sum()
        })
    })
}
