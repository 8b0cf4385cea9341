//! From the world of the tracker to that of the reference, for meshes.
//!
//! The alignment of a path makes its positions fit; on a short path a few millimetres of them are degrees of
//! rotation (50 frames of RedKitchen that lie within 5 mm of a line: 20 degrees), and a degree is 35 mm on a wall
//! 2 m away. Orientations are known to a few tenths of a degree whatever the path.

use geometry::svd::signed_svd;
use geometry::trajectory::mean_rotation;
use geometry::{DMat3, DVec3, Pose};
use sequence::Recording;

use crate::eval::trajectory::{JudgedPath, estimated_frames};

/// Width of a path, metres root mean square, from which its positions tell the rotation: 3 mm are a degree in 0.17 m.
const WIDE_ENOUGH: f64 = 0.1;

/// What moves a mesh of the judged poses into the world of the reference, and from what that was taken: the
/// alignment of the path where the path is wide, else the mean of the orientations, with the mean of the positions.
pub(super) fn reference_from_live(
    recording: &Recording,
    judged: &JudgedPath,
) -> anyhow::Result<(Pose, &'static str)> {
    let by_positions = (
        judged.alignment.reference_from_estimate,
        "the positions of the trajectory",
    );
    let frames = estimated_frames(recording, &judged.metrics.poses)?;
    let pairs: Vec<(Pose, Pose)> = frames
        .iter()
        .zip(&judged.reference)
        .filter_map(|(frame, reference)| Some(((*reference)?, frame.tracked.pose()?)))
        .collect();
    let centre = |of: fn(&(Pose, Pose)) -> DVec3| {
        pairs.iter().map(of).sum::<DVec3>() / pairs.len().max(1) as f64
    };
    let reference_centre = centre(|(reference, _)| reference.translation());
    if width(&pairs, reference_centre) >= WIDE_ENOUGH {
        return Ok(by_positions);
    }
    let rotations = pairs.iter().map(|(r, e)| (r.rotation(), e.rotation()));
    let Some(rotation) = mean_rotation(rotations) else {
        return Ok(by_positions);
    };
    let estimate_centre = centre(|(_, estimate)| estimate.translation());
    let found = Pose::new(rotation, reference_centre - rotation * estimate_centre);
    Ok(found.map_or(by_positions, |pose| {
        (pose, "the orientations of the trajectory")
    }))
}

/// Root mean square distance of the reference's positions from their centre, across the direction in which they
/// spread most and within the plane that holds most of them, metres.
fn width(pairs: &[(Pose, Pose)], centre: DVec3) -> f64 {
    let mut scatter = DMat3::ZERO;
    for (reference, _) in pairs {
        let offset = reference.translation() - centre;
        scatter += DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z);
    }
    (signed_svd(scatter).values.y / pairs.len().max(1) as f64).sqrt()
}
