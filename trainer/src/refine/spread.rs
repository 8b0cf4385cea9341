//! Corrections of some frames, given to the frames between them.

use geometry::{DVec3, Pose, rotation};
use glam::DQuat;

use super::{ActiveFrame, StartFrame};

/// What a camera was moved by, world axes.
#[derive(Clone, Copy, Debug)]
struct Correction {
    turn: DQuat,
    shift: DVec3,
}

impl Correction {
    fn of(before: &Pose, after: &Pose) -> Self {
        Self {
            turn: after.rotation() * before.rotation().inverse(),
            shift: after.translation() - before.translation(),
        }
    }

    fn between(&self, other: &Self, share: f64) -> Self {
        Self {
            turn: rotation::slerp(self.turn, other.turn, share),
            shift: self.shift.lerp(other.shift, share),
        }
    }

    fn apply(&self, pose: &Pose) -> Pose {
        // Finite parts of finite poses.
        Pose::new(self.turn * pose.rotation(), pose.translation() + self.shift).unwrap_or(*pose)
    }
}

/// Corrections by rising places.
struct Corrections {
    places: Vec<f64>,
    corrections: Vec<Correction>,
}

impl Corrections {
    /// The correction at a place: linear between two, that of the nearest beyond the ends.
    fn at(&self, place: f64) -> Option<Correction> {
        let after = self.places.partition_point(|known| *known < place);
        let high = after.min(self.places.len().checked_sub(1)?);
        let low = if after > high {
            high
        } else {
            after.saturating_sub(1)
        };
        let (low_place, high_place) = (self.places[low], self.places[high]);
        let width = high_place - low_place;
        let share = if width > 0.0 {
            ((place - low_place) / width).clamp(0.0, 1.0)
        } else {
            0.0
        };
        Some(self.corrections[low].between(&self.corrections[high], share))
    }
}

/// Frames moved by the corrections of the keyframes at `positions`, linearly between them.
pub(super) fn between_keyframes(
    frames: &[ActiveFrame],
    positions: &[usize],
    solved: &[Pose],
) -> Vec<ActiveFrame> {
    let corrections = Corrections {
        places: positions.iter().map(|&position| position as f64).collect(),
        corrections: positions
            .iter()
            .zip(solved)
            .map(|(&position, pose)| Correction::of(&frames[position].world_from_camera, pose))
            .collect(),
    };
    frames
        .iter()
        .enumerate()
        .map(|(position, frame)| ActiveFrame {
            world_from_camera: corrections
                .at(position as f64)
                .map_or(frame.world_from_camera, |c| {
                    c.apply(&frame.world_from_camera)
                }),
            ..*frame
        })
        .collect()
}

/// All frames moved as those of `before` were moved to `after`, by index.
pub(super) fn corrected(
    before: &[ActiveFrame],
    after: &[ActiveFrame],
    frames: &[StartFrame],
) -> Vec<Pose> {
    let known: Vec<(usize, Pose, Pose)> = before
        .iter()
        .zip(after)
        .map(|(b, a)| (b.index, b.world_from_camera, a.world_from_camera))
        .collect();
    let places: Vec<(usize, Pose)> = frames
        .iter()
        .map(|f| (f.index, f.world_from_camera))
        .collect();
    transferred(&known, &places)
}

/// `poses` (index, pose) moved as the `known` frames (index, before, after; by rising index) were: those exactly,
/// others between by the corrections of their neighbours.
pub(crate) fn transferred(known: &[(usize, Pose, Pose)], poses: &[(usize, Pose)]) -> Vec<Pose> {
    let corrections = Corrections {
        places: known.iter().map(|(index, ..)| *index as f64).collect(),
        corrections: known.iter().map(|(_, b, a)| Correction::of(b, a)).collect(),
    };
    poses
        .iter()
        .map(|(index, pose)| {
            match known.binary_search_by_key(index, |(index, ..)| *index) {
                // Rounding must not touch what is known.
                Ok(place) => known[place].2,
                Err(_) => corrections
                    .at(*index as f64)
                    .map_or(*pose, |correction| correction.apply(pose)),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_between_take_their_share() {
        let before = Pose::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let after = Pose::from_axis_angle(DVec3::Y, 0.2)
            * Pose::from_translation(DVec3::new(0.5, 2.0, 3.0));
        let known = [(10, before, before), (20, before, after)];
        let poses: Vec<(usize, Pose)> = [5, 10, 15, 20, 30].map(|index| (index, before)).into();
        let moved = transferred(&known, &poses);
        assert_eq!((moved[0], moved[1]), (before, before));
        assert_eq!(moved[3], after);
        let middle = (before.translation() + after.translation()) / 2.0;
        assert!((moved[2].translation() - middle).length() < 1e-12);
        let turn = rotation::log(moved[2].rotation()).length();
        assert!((turn - 0.1).abs() < 1e-9, "{turn}");
        assert!((moved[4].translation() - after.translation()).length() < 1e-12);
        assert_eq!(transferred(&[], &poses)[2], before);
    }
}
