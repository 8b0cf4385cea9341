//! All frames fused, each aligned with the whole, all moved at once; again at finer voxels.

use fusion::tracking::keyframes::angle_between;
use fusion::{ModelView, Volume, VolumeConfig};
use geometry::trajectory::mean_rotation;
use geometry::{DVec3, Pose};

use super::align::{Aligned, Pairing, align};
use super::frames::FrameLoader;
use super::loops::half;
use super::{ActiveFrame, fuse};

/// Largest correction of one round that is believed, metres and radians.
const LARGEST_CORRECTION: [f64; 2] = [0.02, 0.03];
/// What must hold of a frame before it is moved: share of points that meet the model …
const LEAST_MET: f64 = 0.4;
/// … and of these within three deviations.
const LEAST_AGREEMENT: f64 = 0.5;

/// What one round did.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    /// Median shift of a camera, metres.
    pub(super) shift: f64,
    /// Median turn of a camera, radians.
    pub(super) turn: f64,
    /// Frames that kept their pose, because their alignment did not stand up.
    pub(super) kept_count: usize,
}

/// Fuses `frames`, aligns each with the whole and moves all; the mean correction is none.
pub(super) fn round(
    loader: &FrameLoader<'_>,
    frames: &mut [ActiveFrame],
    volume: &VolumeConfig,
    progress: &mut dyn FnMut(usize),
) -> anyhow::Result<Round> {
    let model: Volume = fuse(loader, frames, volume.clone(), progress)?;
    let camera = half(loader)?;
    let pairing = Pairing {
        // A band of the model on either side.
        largest_distance: 4.0 * volume.voxel_size,
        robust_scale: 3.0,
    };
    let indices: Vec<usize> = frames.iter().map(|frame| frame.index).collect();
    let before: Vec<Pose> = frames.iter().map(|frame| frame.world_from_camera).collect();
    let found = loader.map(&indices, |position, frame| {
        let pose = before[position];
        let mut view = ModelView::new(&camera, &pose);
        model.predict(&camera, &pose, &mut view);
        let grey = frame.photograph.as_ref().map(|photograph| &photograph.grey);
        let aligned = align(&frame.points, &view, grey, &Pose::IDENTITY, pairing);
        Ok(aligned
            .filter(stands)
            .map(|aligned| pose * aligned.view_from_live))
    })?;
    let kept_count = found.iter().filter(|pose| pose.is_none()).count();
    let mut after: Vec<Pose> = found
        .iter()
        .zip(&before)
        .map(|(found, before)| found.unwrap_or(*before))
        .collect();
    regauge(&before, &mut after);
    let shifts: Vec<f64> = pairs(&before, &after)
        .map(|(b, a)| (b.translation() - a.translation()).length())
        .collect();
    let turns: Vec<f64> = pairs(&before, &after)
        .map(|(b, a)| angle_between(b.rotation(), a.rotation()))
        .collect();
    for (frame, pose) in frames.iter_mut().zip(after) {
        frame.world_from_camera = pose;
    }
    let median = |mut values: Vec<f64>| geometry::robust::median(&mut values).unwrap_or(0.0);
    Ok(Round {
        shift: median(shifts),
        turn: median(turns),
        kept_count,
    })
}

fn pairs<'a>(before: &'a [Pose], after: &'a [Pose]) -> impl Iterator<Item = (&'a Pose, &'a Pose)> {
    before.iter().zip(after)
}

fn stands(aligned: &Aligned) -> bool {
    let met = f64::from(aligned.sums.met_count);
    let [shift, turn] = LARGEST_CORRECTION;
    met >= LEAST_MET * aligned.point_count as f64
        && f64::from(aligned.sums.inlier_count) >= LEAST_AGREEMENT * met
        && met > 0.0
        && aligned.view_from_live.translation().length() <= shift
        && geometry::rotation::log(aligned.view_from_live.rotation()).length() <= turn
}

/// Moves `after` as a whole so that positions keep their mean and orientations turn by none on average: what all
/// cameras together do is no correction.
pub(super) fn regauge(before: &[Pose], after: &mut [Pose]) {
    let turns = before.iter().zip(&*after);
    let Some(turn) = mean_rotation(turns.map(|(b, a)| (b.rotation(), a.rotation()))) else {
        return;
    };
    let mean = |poses: &[Pose]| {
        poses.iter().map(Pose::translation).sum::<DVec3>() / poses.len().max(1) as f64
    };
    let (from, to) = (mean(after), mean(before));
    if let Ok(gauge) = Pose::new(turn, to - turn * from) {
        for pose in after {
            *pose = gauge * *pose;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_of_all_cameras_is_no_correction() {
        let before: Vec<Pose> = (0..20)
            .map(|index| {
                let angle = 0.1 * f64::from(index);
                Pose::from_axis_angle(DVec3::Y, angle)
                    * Pose::from_translation(DVec3::new(0.0, 0.02 * angle, -1.0))
            })
            .collect();
        let moved = Pose::from_axis_angle(DVec3::new(0.1, 1.0, 0.2), 0.02)
            * Pose::from_translation(DVec3::new(0.01, -0.02, 0.03));
        let mut after: Vec<Pose> = before.iter().map(|pose| moved * *pose).collect();
        regauge(&before, &mut after);
        for (before, after) in before.iter().zip(&after) {
            assert!((before.translation() - after.translation()).length() < 1e-12);
            assert!(angle_between(before.rotation(), after.rotation()) < 1e-9);
        }
    }
}
