//! Frames that stand for those around them, and which of them see the same surface.

use fusion::tracking::Thumbnail;
use fusion::tracking::keyframes::angle_between;
use geometry::{DVec3, Intrinsics, Pose};

use super::frames::LoadedFrame;

/// Distance from the keyframe before, metres …
const DISTANCE: f64 = 0.06;
/// … or angle, radians, from which a frame is a keyframe.
const ANGLE: f64 = 0.14;
/// Most keyframes: farther apart in longer recordings.
const LIMIT: usize = 240;
/// Share of a frame's points that another must see for the two to be aligned.
const LEAST_OVERLAP: f64 = 0.35;
/// Largest angle between two views that are aligned, radians: beyond it neither sees the other's surface well.
const LARGEST_TURN: f64 = 1.0;
/// Partners by overlap that each keyframe is aligned with.
const PARTNERS: usize = 10;
/// Partners by looks, where poses say nothing.
const ALIKE: usize = 2;
/// Largest difference of thumbnails that look alike: frames of one place differ by 0.05 to 0.15.
const ALIKE_DIFFERENCE: f64 = 0.2;
/// Differences of depth by which two points may be one surface: what a drift of centimetres makes, and the grid.
const DEPTH_SHARE: f32 = 0.08;

/// What is kept of a keyframe.
pub(super) struct Keyframe {
    /// Place in the list of frames.
    pub(super) position: usize,
    /// How it looks.
    thumbnail: Thumbnail,
    camera: Intrinsics,
    /// Depth of every pixel of `camera`, metres, NaN = unknown.
    depth: Vec<f32>,
}

impl Keyframe {
    pub(super) fn new(position: usize, frame: &LoadedFrame) -> Option<Self> {
        let coarsest = frame.points.levels().last()?;
        let grid = &coarsest.points;
        let depth = (0..grid.tile_count())
            .flat_map(|tile| grid.tile(tile).z.iter().copied())
            .collect();
        let mut thumbnail = Thumbnail::default();
        let grey = frame.photograph.as_ref().and_then(|photograph| {
            let levels = &photograph.grey.levels;
            levels.get(1).or(levels.first())
        });
        thumbnail.load(frame.points.depth(), grey.map(|(_, image)| image));
        Some(Self {
            position,
            thumbnail,
            camera: coarsest.camera,
            depth,
        })
    }

    /// Share of this keyframe's points that `other` sees at about their depth.
    fn overlap(&self, other: &Self, other_from_self: &Pose) -> f64 {
        let (mut seen, mut measured) = (0_u32, 0_u32);
        let width = self.camera.width() as usize;
        for (index, &z) in self.depth.iter().enumerate().step_by(3) {
            if !z.is_finite() {
                continue;
            }
            measured += 1;
            let pixel = glam::DVec2::new((index % width) as f64, (index / width) as f64);
            let Some(ray) = self.camera.camera_from_pixel(pixel) else {
                continue;
            };
            let point: DVec3 = other_from_self.transform_point(ray * (f64::from(z) / ray.z));
            let Some((x, y)) = other
                .camera
                .pixel_from_camera(point)
                .and_then(|pixel| other.camera.contains(pixel))
            else {
                continue;
            };
            let there = other.depth[(y * other.camera.width() + x) as usize];
            // NaN fails.
            seen += u32::from((there - point.z as f32).abs() <= DEPTH_SHARE * there);
        }
        if measured == 0 {
            0.0
        } else {
            f64::from(seen) / f64::from(measured)
        }
    }
}

/// Places of the keyframes in a path: the first frame, each that is far from the one before, and the last.
pub(super) fn choose(path: &[Pose]) -> Vec<usize> {
    let mut stretch = 1.0;
    loop {
        let mut chosen: Vec<usize> = Vec::new();
        for (position, pose) in path.iter().enumerate() {
            let is_far = chosen.last().is_none_or(|&before| {
                let before = &path[before];
                (before.translation() - pose.translation()).length() >= stretch * DISTANCE
                    || angle_between(before.rotation(), pose.rotation()) >= stretch * ANGLE
            });
            if is_far || position + 1 == path.len() {
                chosen.push(position);
            }
        }
        if chosen.len() <= LIMIT {
            return chosen;
        }
        stretch *= 1.25;
    }
}

/// Why two keyframes are aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reason {
    /// Their poses say that they see the same.
    Overlap,
    /// They look alike.
    Looks,
}

/// Pairs (earlier, later) of keyframes to align, by earlier and later.
pub(super) fn candidates(keyframes: &[Keyframe], path: &[Pose]) -> Vec<(usize, usize, Reason)> {
    let mut pairs = Vec::new();
    for (later, keyframe) in keyframes.iter().enumerate() {
        let pose = &path[keyframe.position];
        let mut seen: Vec<(f64, usize)> = Vec::new();
        let mut alike: Vec<(f64, usize)> = Vec::new();
        for (earlier, other) in keyframes[..later].iter().enumerate() {
            let other_pose = &path[other.position];
            let near = angle_between(pose.rotation(), other_pose.rotation()) <= LARGEST_TURN;
            let overlap = if near {
                keyframe.overlap(other, &(other_pose.inverse() * *pose))
            } else {
                0.0
            };
            if overlap >= LEAST_OVERLAP {
                seen.push((overlap, earlier));
            } else {
                let difference = keyframe.thumbnail.difference(&other.thumbnail);
                if difference <= ALIKE_DIFFERENCE {
                    alike.push((difference, earlier));
                }
            }
        }
        for earlier in spaced(seen.iter().map(|(_, earlier)| *earlier).collect()) {
            pairs.push((earlier, later, Reason::Overlap));
        }
        alike.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for &(_, earlier) in alike.iter().take(ALIKE) {
            pairs.push((earlier, later, Reason::Looks));
        }
    }
    pairs.sort_by_key(|&(earlier, later, _)| (earlier, later));
    pairs
}

/// At most [`PARTNERS`] of rising numbers, spread evenly, first and last among them: far ones tie the path together,
/// near ones keep it smooth.
fn spaced(all: Vec<usize>) -> Vec<usize> {
    if all.len() <= PARTNERS {
        return all;
    }
    let last = all.len() - 1;
    (0..PARTNERS)
        .map(|place| all[place * last / (PARTNERS - 1)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keyframes_are_apart_and_few() {
        let path: Vec<Pose> = (0..3000)
            .map(|index| Pose::from_translation(DVec3::X * (0.02 * f64::from(index))))
            .collect();
        let chosen = choose(&path);
        assert!(chosen.len() <= LIMIT && chosen.len() > LIMIT / 2);
        assert_eq!((chosen[0], *chosen.last().unwrap()), (0, 2999));
        assert_eq!(choose(&path[..4]), [0, 3]);
        assert_eq!(choose(&path[..1]), [0]);
        assert_eq!(choose(&[]), Vec::<usize>::new());
    }

    #[test]
    fn partners_are_spread_evenly() {
        let chosen = spaced((0..100).collect());
        assert_eq!(chosen.len(), PARTNERS);
        assert_eq!((chosen[0], chosen[PARTNERS - 1]), (0, 99));
        assert_eq!(spaced(vec![3, 5]), [3, 5]);
    }
}
