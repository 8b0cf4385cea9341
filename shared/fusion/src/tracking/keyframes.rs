//! Places that were seen, to find the way back.

use geometry::{DQuat, Pose};

use super::thumbnail::Thumbnail;

/// A frame that was tracked well.
#[derive(Clone, Debug)]
pub struct Keyframe {
    /// World that its pose is in.
    pub map: u32,
    /// Where the depth camera was.
    pub world_from_camera: Pose,
    /// How it looked.
    pub thumbnail: Thumbnail,
}

/// Keyframes of all maps, at most [`KeyframeConfig::limit`].
#[derive(Debug)]
pub struct Keyframes {
    config: KeyframeConfig,
    frames: Vec<Keyframe>,
}

/// When a frame becomes a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframeConfig {
    /// Distance to every keyframe of the map, metres …
    pub distance: f64,
    /// … or angle, radians.
    pub angle: f64,
    /// Most keyframes (25 KB each); a full list takes no more.
    pub limit: usize,
}

impl Default for KeyframeConfig {
    fn default() -> Self {
        Self {
            distance: 0.12,
            angle: 0.15,
            limit: 2000,
        }
    }
}

impl Keyframes {
    /// None yet.
    pub fn new(config: KeyframeConfig) -> Self {
        Self {
            config,
            frames: Vec::new(),
        }
    }

    /// Number of keyframes.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// A keyframe by index.
    pub fn get(&self, index: usize) -> &Keyframe {
        &self.frames[index]
    }

    /// Keeps a frame that is far enough from all others of its map; whether it did.
    pub fn offer(&mut self, map: u32, world_from_camera: &Pose, thumbnail: &Thumbnail) -> bool {
        let is_near = |frame: &Keyframe| {
            frame.map == map
                && (frame.world_from_camera.translation() - world_from_camera.translation())
                    .length()
                    < self.config.distance
                && angle_between(
                    frame.world_from_camera.rotation(),
                    world_from_camera.rotation(),
                ) < self.config.angle
        };
        if self.frames.len() >= self.config.limit || self.frames.iter().any(is_near) {
            return false;
        }
        self.frames.push(Keyframe {
            map,
            world_from_camera: *world_from_camera,
            thumbnail: thumbnail.clone(),
        });
        true
    }

    /// Writes the indices of the keyframes most like `thumbnail` into `best`, most alike first, at most `count`.
    pub fn most_alike(&self, thumbnail: &Thumbnail, count: usize, best: &mut Vec<(f64, usize)>) {
        best.clear();
        for (index, frame) in self.frames.iter().enumerate() {
            let difference = frame.thumbnail.difference(thumbnail);
            if !difference.is_finite() {
                continue;
            }
            let place = best.partition_point(|(known, _)| *known <= difference);
            if place < count {
                best.truncate(count - 1);
                best.insert(place, (difference, index));
            }
        }
    }
}

/// Angle of the rotation between two, radians.
pub fn angle_between(one: DQuat, other: DQuat) -> f64 {
    geometry::rotation::log(one.inverse() * other).length()
}
