//! The TUM RGB-D benchmark's folder: `rgb.txt` and `depth.txt` list images with their own times,
//! `groundtruth.txt` a path with times of its own.

use std::ops::Range;
use std::path::Path;

use geometry::Pose;
use sequence::FrameTimes;

use super::error::ImportError;
use super::rig::PoseStamps;
use super::source::{Source, SourceImage, is_inside, number_frames};
use super::trajectory::{TumLine, tum_lines};

pub(crate) const DEPTH_LIST: &str = "depth.txt";
pub(crate) const COLOR_LIST: &str = "rgb.txt";
const POSE_LIST: &str = "groundtruth.txt";

/// A pose is interpolated between two that are at most this far apart. Motion capture runs at 100 Hz and
/// more; over a longer hole a hand does what it likes.
const WIDEST_POSE_GAP_NANOS: i128 = 50_000_000;

/// Colour images this far outside the depth images wanted may still belong to one of them.
const COLOR_MARGIN_NANOS: i64 = 20_000_000;

/// Reads the lists. `range` counts depth images in the order of their times, from 0.
pub(crate) fn read(
    folder: &Path,
    range: Option<&Range<usize>>,
    stamps: PoseStamps,
) -> Result<Source, ImportError> {
    let mut notes = Vec::new();
    let mut depth = image_list(folder, DEPTH_LIST, "depth images", &mut notes)?;
    let mut color = image_list(folder, COLOR_LIST, "colour images", &mut notes)?;
    let numbers = 0..depth.len();
    if let Some(range) = range {
        if range.end > depth.len() {
            return Err(ImportError::Range {
                start: range.start,
                end: range.end,
                first: 0,
                stop: depth.len(),
            });
        }
        depth = depth[range.clone()].to_vec();
        color = around(&color, &depth);
    }
    if color.is_empty() {
        return Err(ImportError::NoFrames {
            path: folder.join(COLOR_LIST),
            expected: "colour images of that time",
        });
    }
    number_frames(&mut depth);
    number_frames(&mut color);
    let poses_path = folder.join(POSE_LIST);
    let (path, worst_rotation_error) = read_path(&poses_path, &mut notes)?;
    let world_from_camera: Vec<Option<Pose>> = depth
        .iter()
        .map(|image| pose_at(&path, image.times.device_nanos, stamps))
        .collect();
    let unposed_count = world_from_camera
        .iter()
        .filter(|pose| pose.is_none())
        .count();
    if unposed_count > 0 && !path.is_empty() {
        notes.push(format!(
            "{unposed_count} depth images have no pose: {POSE_LIST} has no two poses around them at most 50 ms apart"
        ));
    }
    Ok(Source {
        depth,
        color,
        world_from_camera,
        gaps: Vec::new(),
        recorded: None,
        numbers,
        poses_path,
        worst_rotation_error,
        notes,
    })
}

/// The images of a list in the order of their times, numbered from 0.
fn image_list(
    folder: &Path,
    name: &str,
    expected: &'static str,
    notes: &mut Vec<String>,
) -> Result<Vec<SourceImage>, ImportError> {
    let list = folder.join(name);
    let mut images = Vec::new();
    for line in tum_lines(&list)? {
        let (time_nanos, file) = line.time(&list)?;
        images.push(SourceImage {
            number: None,
            times: FrameTimes {
                device_nanos: time_nanos,
                ..FrameTimes::default()
            },
            path: folder.join(inside(&list, &line, file)?),
        });
    }
    if images.is_empty() {
        return Err(ImportError::NoFrames {
            path: list,
            expected,
        });
    }
    sort_by_time(&mut images, |image| image.times.device_nanos, name, notes);
    for (number, image) in (0..).zip(&mut images) {
        image.number = Some(number);
    }
    Ok(images)
}

/// A file name of a list, which must lie in the folder: a list that was downloaded chooses no other file.
fn inside<'a>(list: &Path, line: &TumLine, file: &'a str) -> Result<&'a Path, ImportError> {
    let path = Path::new(file);
    if is_inside(path) {
        return Ok(path);
    }
    Err(line.wrong(
        list,
        format!("`{file}` is no file of the folder; a line is `timestamp filename`"),
    ))
}

/// Sorts by time, equal times in the order of the list, and notes what was wrong with the list.
fn sort_by_time<T>(
    lines: &mut [T],
    nanos: impl Fn(&T) -> i64,
    name: &str,
    notes: &mut Vec<String>,
) {
    let backward_count = count_neighbours(lines, |a, b| nanos(b) < nanos(a));
    if backward_count > 0 {
        lines.sort_by_key(&nanos);
        notes.push(format!(
            "{name}: {backward_count} lines go back in time; all were sorted by time"
        ));
    }
    let equal_count = count_neighbours(lines, |a, b| nanos(a) == nanos(b));
    if equal_count > 0 {
        notes.push(format!(
            "{name}: {equal_count} lines have the time of the line before; all are kept, in the order of the list"
        ));
    }
}

fn count_neighbours<T>(lines: &[T], holds: impl Fn(&T, &T) -> bool) -> usize {
    lines
        .windows(2)
        .filter(|pair| holds(&pair[0], &pair[1]))
        .count()
}

/// The colour images that may belong to one of the depth images.
pub(super) fn around(color: &[SourceImage], depth: &[SourceImage]) -> Vec<SourceImage> {
    let (Some(first), Some(last)) = (depth.first(), depth.last()) else {
        return Vec::new();
    };
    let from = first.times.device_nanos.saturating_sub(COLOR_MARGIN_NANOS);
    let to = last.times.device_nanos.saturating_add(COLOR_MARGIN_NANOS);
    color
        .iter()
        .filter(|image| (from..=to).contains(&image.times.device_nanos))
        .cloned()
        .collect()
}

/// A pose of the path and when it was taken.
struct StampedPose {
    time_nanos: i64,
    world_from_camera: Pose,
}

/// The path by time, empty where there is none, and the worst quaternion length's distance from 1.
fn read_path(path: &Path, notes: &mut Vec<String>) -> Result<(Vec<StampedPose>, f64), ImportError> {
    if !path.exists() {
        notes.push(format!("no {POSE_LIST}: the recording has no poses"));
        return Ok((Vec::new(), 0.0));
    }
    let mut poses = Vec::new();
    let mut worst_rotation_error = 0.0_f64;
    for line in tum_lines(path)? {
        let (time_nanos, pose, rotation_error) = line.pose(path)?;
        worst_rotation_error = worst_rotation_error.max(rotation_error);
        if let Some(world_from_camera) = pose {
            poses.push(StampedPose {
                time_nanos,
                world_from_camera,
            });
        }
    }
    sort_by_time(&mut poses, |pose| pose.time_nanos, POSE_LIST, notes);
    Ok((poses, worst_rotation_error))
}

/// The pose at a time: that of the same stamp, or one between the two stamps around it.
fn pose_at(path: &[StampedPose], time_nanos: i64, stamps: PoseStamps) -> Option<Pose> {
    let after = path.partition_point(|pose| pose.time_nanos < time_nanos);
    let next = path.get(after)?;
    if next.time_nanos == time_nanos {
        return Some(next.world_from_camera);
    }
    let previous = path.get(after.checked_sub(1)?)?;
    // Wider than the times: hostile stamps lie up to 2^64 apart.
    let gap = i128::from(next.time_nanos) - i128::from(previous.time_nanos);
    if stamps == PoseStamps::Frames || gap > WIDEST_POSE_GAP_NANOS {
        return None;
    }
    let elapsed = i128::from(time_nanos) - i128::from(previous.time_nanos);
    let fraction = elapsed as f64 / gap as f64;
    let (a, b) = (previous.world_from_camera, next.world_from_camera);
    let rotation = a.rotation().slerp(b.rotation(), fraction);
    Pose::new(rotation, a.translation().lerp(b.translation(), fraction)).ok()
}

#[cfg(test)]
mod tests {
    use geometry::DVec3;

    use super::*;

    fn turning(milliseconds: &[i64]) -> Vec<StampedPose> {
        let pose = |&ms: &i64| {
            let seconds = ms as f64 * 1e-3;
            StampedPose {
                time_nanos: ms * 1_000_000,
                world_from_camera: Pose::from_translation(DVec3::X * seconds)
                    * Pose::from_axis_angle(DVec3::Y, seconds),
            }
        };
        milliseconds.iter().map(pose).collect()
    }

    #[test]
    fn a_pose_between_two_stamps_lies_on_the_way() {
        let path = turning(&[0, 10, 60, 111, 130]);
        for (ms, seconds) in [
            (0, 0.0),
            (4, 0.004),
            (10, 0.01),
            (35, 0.035),
            (60, 0.06),
            (130, 0.13),
        ] {
            let pose = pose_at(&path, ms * 1_000_000, PoseStamps::Own).unwrap();
            assert!((pose.translation().x - seconds).abs() < 1e-12);
            assert!((2.0 * pose.rotation().y.asin() - seconds).abs() < 1e-9);
        }
    }

    #[test]
    fn no_pose_outside_the_path_or_in_a_hole() {
        let path = turning(&[0, 10, 60, 111, 130]);
        for ms in [
            -1,
            61,
            80,
            110,
            131,
            i64::MIN / 1_000_000,
            i64::MAX / 1_000_000,
        ] {
            assert!(
                pose_at(&path, ms * 1_000_000, PoseStamps::Own).is_none(),
                "{ms}"
            );
        }
        assert!(pose_at(&path, 10_000_000, PoseStamps::Frames).is_some());
        assert!(pose_at(&path, 10_000_001, PoseStamps::Frames).is_none());
        assert!(pose_at(&[], 0, PoseStamps::Own).is_none());
    }

    #[test]
    fn a_quaternion_of_the_other_sign_turns_the_short_way() {
        let mut path = turning(&[0, 40]);
        let turned = path[1].world_from_camera;
        path[1].world_from_camera = Pose::new(-turned.rotation(), turned.translation()).unwrap();
        let pose = pose_at(&path, 20_000_000, PoseStamps::Own).unwrap();
        assert!((2.0 * pose.rotation().y.abs().asin() - 0.02).abs() < 1e-9);
    }
}
