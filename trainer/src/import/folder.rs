//! The plain folder: `frames/NNNNNN.color.jpg`, `frames/NNNNNN.depth.png`, `poses.txt` in TUM's form.

use std::ops::Range;
use std::path::Path;

use super::error::ImportError;
use super::source::{Images, PairedImages, Source};
use super::trajectory::tum_lines;

/// Reads what is beside the images. Masks and truth are not looked at.
pub(crate) fn read(folder: &Path, range: Option<&Range<usize>>) -> Result<Source, ImportError> {
    let images = Images::find(&folder.join("frames"), "", range)?;
    let poses_path = folder.join("poses.txt");
    let lines = tum_lines(&poses_path)?;
    if lines.len() != images.numbers.len() {
        return Err(ImportError::PoseCount {
            path: poses_path,
            pose_count: lines.len(),
            frame_count: images.numbers.len(),
        });
    }
    let mut worst_rotation_error = 0.0_f64;
    let mut pairs: Vec<PairedImages> = Vec::with_capacity(images.wanted.len());
    for (number, color, depth) in images.wanted {
        let line = &lines[number as usize - images.numbers.start];
        let (time_nanos, world_from_camera, rotation_error) = line.pose(&poses_path)?;
        if let Some(previous) = pairs.last()
            && time_nanos <= previous.time_nanos
        {
            return Err(ImportError::TimeOrder {
                path: poses_path,
                line: line.number,
                nanos: time_nanos,
                previous_nanos: previous.time_nanos,
            });
        }
        worst_rotation_error = worst_rotation_error.max(rotation_error);
        pairs.push(PairedImages {
            number,
            time_nanos,
            color,
            depth,
            world_from_camera,
        });
    }
    Ok(Source::of_pairs(
        pairs,
        images.numbers,
        poses_path,
        worst_rotation_error,
        Vec::new(),
    ))
}
