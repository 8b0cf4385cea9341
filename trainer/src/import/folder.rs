//! The plain folder: `frames/NNNNNN.color.jpg`, `frames/NNNNNN.depth.png`, `poses.txt` in TUM's form.

use std::ops::Range;
use std::path::Path;

use geometry::{DQuat, DVec3, Pose};

use super::error::{ImportError, read_text};
use super::source::{Images, Source, SourceFrame};
use super::transform::LARGEST_QUATERNION_ERROR;

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
    let mut frames: Vec<SourceFrame> = Vec::with_capacity(images.wanted.len());
    for (number, color, depth) in images.wanted {
        let line = &lines[number as usize - images.numbers.start];
        let (time_nanos, world_from_camera, rotation_error) = line.parse(&poses_path)?;
        if let Some(previous) = frames.last()
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
        frames.push(SourceFrame {
            number,
            time_nanos,
            color,
            depth,
            world_from_camera,
        });
    }
    Ok(Source {
        frames,
        numbers: images.numbers,
        poses_path,
        worst_rotation_error,
        notes: Vec::new(),
    })
}

/// A line of a TUM trajectory that is no comment.
struct TumLine {
    /// From 1.
    number: usize,
    text: String,
}

fn tum_lines(path: &Path) -> Result<Vec<TumLine>, ImportError> {
    let text = read_text(path)?;
    let lines = text
        .lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
        .map(|(number, line)| TumLine {
            number,
            text: line.to_owned(),
        });
    Ok(lines.collect())
}

impl TumLine {
    /// Time in nanoseconds, pose, and how far the quaternion's length was from 1.
    fn parse(&self, path: &Path) -> Result<(i64, Pose, f64), ImportError> {
        let wrong = |message: String| ImportError::Text {
            path: path.to_path_buf(),
            line: Some(self.number),
            message,
        };
        let words: Vec<&str> = self.text.split_whitespace().collect();
        let &[time, ref numbers @ ..] = words.as_slice() else {
            return Err(wrong("the line is empty".to_owned()));
        };
        if numbers.len() != 7 {
            return Err(wrong(format!(
                "{} values, expected 8: timestamp tx ty tz qx qy qz qw",
                words.len()
            )));
        }
        let time_nanos = nanos_from_seconds(time)
            .ok_or_else(|| wrong(format!("`{time}` is no time in seconds")))?;
        let mut values = [0.0_f64; 7];
        for (value, word) in values.iter_mut().zip(numbers) {
            *value = word
                .parse()
                .map_err(|_| wrong(format!("`{word}` is no number")))?;
        }
        let [tx, ty, tz, qx, qy, qz, qw] = values;
        let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
        let rotation_error = (rotation.length() - 1.0).abs();
        let pose =
            Pose::new(rotation, DVec3::new(tx, ty, tz)).map_err(|source| ImportError::Pose {
                path: path.to_path_buf(),
                line: Some(self.number),
                source,
            })?;
        if rotation_error > LARGEST_QUATERNION_ERROR {
            return Err(wrong(format!(
                "qx qy qz qw has length {:.4}, not 1: are the columns in order?",
                rotation.length()
            )));
        }
        Ok((time_nanos, pose, rotation_error))
    }
}

/// Decimal seconds to nanoseconds without a detour through floating point, which would round Unix times to
/// 0.2 µs. Digits beyond the ninth are cut; an exponent is accepted, rounded as f64.
fn nanos_from_seconds(text: &str) -> Option<i64> {
    const NANOS: i64 = 1_000_000_000;
    if text.contains(['e', 'E']) {
        let nanos = (text.parse::<f64>().ok()? * NANOS as f64).round();
        // Beyond 2^62 the cast would saturate.
        return (nanos.abs() < 4.6e18).then_some(nanos as i64);
    }
    let (is_negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let all_digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    if !(all_digits(whole) && all_digits(fraction)) || (whole.is_empty() && fraction.is_empty()) {
        return None;
    }
    let seconds: i64 = if whole.is_empty() {
        0
    } else {
        whole.parse().ok()?
    };
    let nine: String = fraction
        .chars()
        .chain("000000000".chars())
        .take(9)
        .collect();
    let nanos = seconds
        .checked_mul(NANOS)?
        .checked_add(nine.parse().ok()?)?;
    Some(if is_negative { -nanos } else { nanos })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_exact_nanoseconds() {
        for (text, nanos) in [
            ("0.000000", 0),
            ("0.100000", 100_000_000),
            ("1305031102.175304", 1_305_031_102_175_304_000),
            ("-0.5", -500_000_000),
            ("+7", 7_000_000_000),
            (".25", 250_000_000),
            ("3.", 3_000_000_000),
            ("0.1234567899", 123_456_789),
            ("1.5e-1", 150_000_000),
        ] {
            assert_eq!(nanos_from_seconds(text), Some(nanos), "{text}");
        }
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for text in [
            "",
            ".",
            "-",
            "nan",
            "inf",
            "1,5",
            "1e400",
            "9223372037",
            "--1",
            "1.2.3",
            "1e10",
        ] {
            assert_eq!(nanos_from_seconds(text), None, "{text}");
        }
    }
}
