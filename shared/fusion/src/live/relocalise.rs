//! The way back: known places that look alike, verified by alignment.

use geometry::Pose;

use super::{Effort, LiveFusion, Motion, Phase, Tracked};
use crate::tracking::{Alignment, IcpInput, TrackState, thumbnail};
use crate::volume::Volume;

/// Memory without which no other world begins.
const LEAST_MAP_BYTES: usize = 64 << 20;

impl LiveFusion {
    /// A lost frame: tried from where the camera was lost, then from the keyframes that look most alike.
    pub(super) fn search(&mut self, time_nanos: i64, effort: Effort, count: u32) -> Tracked {
        // The camera may have come back to where it was, or only one frame was bad.
        let last = self.motion.predicted(time_nanos);
        if let Some((alignment, state)) = self.aligned(&last, effort)
            && state != TrackState::Lost
            && self.config.relocalising.state(&alignment, &Pose::IDENTITY) != TrackState::Lost
        {
            return self.recognise(&alignment, time_nanos, true);
        }
        let mut alike = std::mem::take(&mut self.alike);
        self.keyframes
            .most_alike(&self.now, self.config.candidates, &mut alike);
        let mut best: Option<(Alignment, usize, Pose)> = None;
        for &(_, index) in &alike {
            let keyframe = self.keyframes.get(index);
            let (map, pose) = (keyframe.map as usize, keyframe.world_from_camera);
            if let Some(alignment) = self.aligned_with(index, map, &pose)
                && best
                    .as_ref()
                    .is_none_or(|(best, ..)| alignment.cost < best.cost)
            {
                best = Some((alignment, map, pose));
            }
        }
        self.alike = alike;
        if let Some((alignment, map, pose)) = best {
            self.enter(map);
            self.view.world_from_camera = pose;
            return self.recognise(&alignment, time_nanos, false);
        }
        self.phase = Phase::Lost(count + 1);
        if count + 1 >= self.config.new_map_after && self.begin_map() {
            self.phase = Phase::Empty;
            return self.track(time_nanos, effort);
        }
        self.lose(time_nanos)
    }

    /// Begins another world, if memory is left for one; the limit of the volume holds for all worlds together.
    fn begin_map(&mut self) -> bool {
        if self.free_bytes(self.maps.len()) < LEAST_MAP_BYTES {
            return false;
        }
        let Ok(volume) = Volume::new(self.config.volume.clone()) else {
            return false;
        };
        self.maps.push(super::Map { volume });
        self.enter(self.maps.len() - 1);
        true
    }

    /// Goes on in a map, which may grow by what the others leave.
    fn enter(&mut self, map: usize) {
        self.map = map;
        let bytes = self.free_bytes(map);
        self.maps[map].volume.set_memory_limit(bytes);
    }

    /// What the limit leaves for a map.
    fn free_bytes(&self, map: usize) -> usize {
        let others = self
            .maps
            .iter()
            .enumerate()
            .filter(|(index, _)| *index != map);
        let held: usize = others.map(|(_, other)| other.volume.memory_bytes()).sum();
        self.config.volume.memory_limit_bytes.saturating_sub(held)
    }

    /// Alignment with the view of a keyframe; `None` unless it stands up.
    fn aligned_with(&mut self, index: usize, map: usize, pose: &Pose) -> Option<Alignment> {
        let levels = self.points.levels();
        let camera = levels[self.config.view_level.min(levels.len() - 1)].camera;
        self.maps[map].volume.predict(&camera, pose, &mut self.view);
        let start = self.turned_from(index);
        let input = IcpInput {
            points: &self.points,
            view: &self.view,
            grey: None,
        };
        let pass_count = self.icp.config().passes.len();
        let mut best: Option<Alignment> = None;
        for start in [Some(Pose::IDENTITY), start].into_iter().flatten() {
            // A second coarse run: a place that only looks alike is farther off than a frame that follows.
            let coarse = self.icp.align(input, &mut self.photometric, start, 0..1)?;
            let again = self.icp.align(
                input,
                &mut self.photometric,
                coarse.view_from_live,
                0..pass_count,
            )?;
            if best.as_ref().is_none_or(|best| again.cost < best.cost) {
                best = Some(again);
            }
        }
        best.filter(|best| {
            self.config.relocalising.state(best, &Pose::IDENTITY) != TrackState::Lost
        })
    }

    /// Where the camera turned to since a keyframe, by the photographs.
    fn turned_from(&self, index: usize) -> Option<Pose> {
        let grey = self.grey.as_ref().filter(|_| self.has_grey)?;
        let (camera, _) = &grey.levels[0];
        let before = &self.keyframes.get(index).thumbnail;
        let turn =
            thumbnail::rotation_between(before, &self.now, camera, geometry::DQuat::IDENTITY)?;
        let color_from_depth = self.rig.color_from_depth.rotation();
        let now_from_before = color_from_depth.inverse() * turn * color_from_depth;
        Pose::new(now_from_before.inverse(), geometry::DVec3::ZERO).ok()
    }

    fn recognise(&mut self, alignment: &Alignment, time_nanos: i64, was_here: bool) -> Tracked {
        let pose = self.view.world_from_camera * alignment.view_from_live;
        self.motion = Motion::at_rest(pose, time_nanos);
        self.phase = Phase::Probation(u32::from(was_here));
        self.lost_at(pose)
    }

    /// A recognised place on probation: it counts when enough frames in a row follow from it.
    pub(super) fn prove(&mut self, time_nanos: i64, effort: Effort, count: u32) -> Tracked {
        let prior = self.motion.predicted(time_nanos);
        match self.aligned(&prior, effort) {
            Some((alignment, state)) if state != TrackState::Lost => {
                self.accept(&alignment, state, time_nanos);
                if count + 1 >= self.config.probation {
                    self.phase = Phase::Following;
                    self.tracked.is_relocalised = true;
                    self.tracked
                } else {
                    self.phase = Phase::Probation(count + 1);
                    let pose = self.tracked.world_from_camera;
                    self.lost_at(pose)
                }
            }
            _ => {
                self.phase = Phase::Lost(0);
                self.lose(time_nanos)
            }
        }
    }

    fn lost_at(&mut self, pose: Pose) -> Tracked {
        self.tracked.state = TrackState::Lost;
        self.tracked.covariance = None;
        self.tracked.world_from_camera = pose;
        self.tracked.map = self.map as u32;
        self.tracked
    }
}
