//! Whether an alignment can be believed.

use geometry::Pose;

use super::icp::Alignment;
use super::keyframes::angle_between;

/// How sure tracking is of a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TrackState {
    /// All axes observed.
    Ok,
    /// Some axes kept their prediction: bits 0 to 2 rotation about x, y, z, bits 3 to 5 translation, camera axes.
    Weak(u8),
    /// The camera is not where it was expected, and nowhere that is known. Never fused.
    #[default]
    Lost,
}

/// What an alignment must show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gates {
    /// Fewest inliers, points of the half-size image (hard-cases C06).
    pub least_inliers: f64,
    /// Least share of the points on the model that agree with it.
    pub least_agreement: f64,
    /// Least share of all points that fall on the model.
    pub least_overlap: f64,
    /// Largest distance from the prediction, metres …
    pub largest_shift: f64,
    /// … and angle, radians.
    pub largest_turn: f64,
}

impl Gates {
    /// For a frame that follows another.
    pub const TRACKING: Self = Self {
        least_inliers: 500.0,
        least_agreement: 0.5,
        least_overlap: 0.3,
        largest_shift: 0.15,
        largest_turn: 0.2,
    };
    /// For a place that was recognised by its looks alone.
    pub const RELOCALISING: Self = Self {
        least_inliers: 2000.0,
        least_agreement: 0.6,
        least_overlap: 0.6,
        largest_shift: 0.5,
        largest_turn: 0.6,
    };

    /// The state that an alignment deserves; `view_from_expected` is where the camera was expected.
    pub fn state(&self, alignment: &Alignment, view_from_expected: &Pose) -> TrackState {
        let sums = &alignment.sums;
        let met = f64::from(sums.met_count);
        let inliers = f64::from(sums.inlier_count);
        let change = view_from_expected.inverse() * alignment.view_from_live;
        let turn = angle_between(
            view_from_expected.rotation(),
            alignment.view_from_live.rotation(),
        );
        let holds = inliers >= self.least_inliers
            && inliers >= self.least_agreement * met
            && met >= self.least_overlap * alignment.point_count as f64
            && change.translation().length() <= self.largest_shift
            && turn <= self.largest_turn;
        if !holds {
            TrackState::Lost
        } else if alignment.solution.rank == 6 {
            TrackState::Ok
        } else {
            TrackState::Weak(alignment.solution.weak_axes())
        }
    }
}
