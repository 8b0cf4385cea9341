//! Text in TUM's form: lines that begin with a time, poses as `timestamp tx ty tz qx qy qz qw`.

use std::path::Path;

use geometry::{DQuat, DVec3, Pose};

use super::error::{ImportError, read_text};
use super::transform::LARGEST_QUATERNION_ERROR;

/// A line that is no comment.
pub(crate) struct TumLine {
    /// From 1.
    pub(crate) number: usize,
    pub(crate) text: String,
}

/// The lines of a file that are neither empty nor comments (`#`).
pub(crate) fn tum_lines(path: &Path) -> Result<Vec<TumLine>, ImportError> {
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
    /// The time in nanoseconds, and what follows it.
    pub(crate) fn time(&self, path: &Path) -> Result<(i64, &str), ImportError> {
        let (time, rest) = self
            .text
            .split_once(char::is_whitespace)
            .unwrap_or((&self.text, ""));
        let nanos = nanos_from_seconds(time)
            .ok_or_else(|| self.wrong(path, format!("`{time}` is no time in seconds")))?;
        Ok((nanos, rest.trim()))
    }

    /// Time in nanoseconds, pose, and how far the quaternion's length was from 1. No pose where all seven
    /// numbers are NaN, which says that the camera was lost.
    pub(crate) fn pose(&self, path: &Path) -> Result<(i64, Option<Pose>, f64), ImportError> {
        let word_count = self.text.split_whitespace().count();
        if word_count != 8 {
            let message =
                format!("{word_count} values, expected 8: timestamp tx ty tz qx qy qz qw");
            return Err(self.wrong(path, message));
        }
        let (time_nanos, numbers) = self.time(path)?;
        let mut values = [0.0_f64; 7];
        for (value, word) in values.iter_mut().zip(numbers.split_whitespace()) {
            *value = word
                .parse()
                .map_err(|_| self.wrong(path, format!("`{word}` is no number")))?;
        }
        if values.iter().all(|value| value.is_nan()) {
            return Ok((time_nanos, None, 0.0));
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
            let message = format!(
                "qx qy qz qw has length {:.4}, not 1: are the columns in order?",
                rotation.length()
            );
            return Err(self.wrong(path, message));
        }
        Ok((time_nanos, Some(pose), rotation_error))
    }

    pub(crate) fn wrong(&self, path: &Path, message: String) -> ImportError {
        ImportError::Text {
            path: path.to_path_buf(),
            line: Some(self.number),
            message,
        }
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
