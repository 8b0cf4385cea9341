//! 7-Scenes: `frame-NNNNNN.color.png` (or .jpg), `.depth.png`, `.pose.txt` (4x4, world from camera, metres).

use std::ops::Range;
use std::path::Path;

use geometry::pose::orthogonality_error;
use geometry::{DMat3, DVec3, Pose};

use super::error::{ImportError, read_text};
use super::source::{Images, PairedImages, Source};

pub(crate) const PREFIX: &str = "frame-";
pub(crate) const POSE_SUFFIX: &str = ".pose.txt";

/// Rate of the sensor that recorded the data set, for a rig file that names none.
pub(crate) const ASSUMED_RATE_HZ: f64 = 30.0;

/// Reads what is beside the images.
pub(crate) fn read(
    folder: &Path,
    range: Option<&Range<usize>>,
    rate_hz: f64,
) -> Result<Source, ImportError> {
    let images = Images::find(folder, PREFIX, range)?;
    let mut worst_rotation_error = 0.0_f64;
    let mut pairs = Vec::with_capacity(images.wanted.len());
    for (number, color, depth) in images.wanted {
        let path = pose_path(&depth);
        if !path.exists() {
            return Err(ImportError::MissingPart {
                frame: number,
                part: "pose",
                path,
            });
        }
        let (world_from_camera, rotation_error) = read_pose(&path)?;
        worst_rotation_error = worst_rotation_error.max(rotation_error);
        pairs.push(PairedImages {
            number,
            // Below 2^32 frames at 0.01 Hz and more: far inside f64's and i64's exact ranges.
            time_nanos: (f64::from(number) * 1e9 / rate_hz).round() as i64,
            color,
            depth,
            world_from_camera,
        });
    }
    let note = format!("the folder has no times: {rate_hz} frames a second assumed");
    Ok(Source::of_pairs(
        pairs,
        images.numbers,
        folder.to_path_buf(),
        worst_rotation_error,
        vec![note],
    ))
}

/// `frame-000017.pose.txt` beside `frame-000017.depth.png`.
fn pose_path(depth: &Path) -> std::path::PathBuf {
    // Twice: `.depth.png` counts as two extensions.
    depth.with_extension("").with_extension("pose.txt")
}

/// The pose and how far its matrix was from a rotation; no pose where all is NaN, which says that the camera
/// was lost.
fn read_pose(path: &Path) -> Result<(Option<Pose>, f64), ImportError> {
    let text = read_text(path)?;
    let wrong = |line, message| ImportError::Text {
        path: path.to_path_buf(),
        line,
        message,
    };
    let mut values = Vec::with_capacity(16);
    for (index, line) in text.lines().enumerate() {
        for word in line.split_whitespace() {
            let value: f64 = word
                .parse()
                .map_err(|_| wrong(Some(index + 1), format!("`{word}` is no number")))?;
            values.push(value);
        }
    }
    let Ok(m) = <[f64; 16]>::try_from(values.as_slice()) else {
        return Err(wrong(
            None,
            format!("{} numbers, a pose has 16 (4 rows of 4)", values.len()),
        ));
    };
    if m[..12].iter().all(|value| value.is_nan()) {
        return Ok((None, 0.0));
    }
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(
            None,
            "the last row is not 0 0 0 1: is the matrix transposed?".to_owned(),
        ));
    }
    let rotation = DMat3::from_cols(
        DVec3::new(m[0], m[4], m[8]),
        DVec3::new(m[1], m[5], m[9]),
        DVec3::new(m[2], m[6], m[10]),
    );
    let pose = Pose::from_matrix(rotation, DVec3::new(m[3], m[7], m[11])).map_err(|source| {
        ImportError::Pose {
            path: path.to_path_buf(),
            line: None,
            source,
        }
    })?;
    Ok((Some(pose), orthogonality_error(rotation)))
}
