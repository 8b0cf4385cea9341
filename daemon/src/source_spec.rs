//! What the user names as the source of frames.

use std::path::PathBuf;
use std::str::FromStr;

/// Where frames come from.
#[derive(Clone, Debug, PartialEq)]
pub enum SourceSpec {
    /// A recording in place of a camera: `replay:FILE[?speed=max|1|0.5][&loop]`.
    Replay(ReplaySpec),
}

/// A recording that is played.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplaySpec {
    /// The recording.
    pub path: PathBuf,
    /// How fast.
    pub speed: Speed,
    /// From the beginning again when it ends.
    pub repeats: bool,
}

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// As fast as the recorder can; the source waits, nothing is dropped.
    Max,
    /// Times the speed of the camera; frames come whether the recorder is ready or not.
    Times(f64),
}

/// A source that cannot be used, in a sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is no source: {why}; write replay:FILE, replay:FILE?speed=max or replay:FILE?speed=0.5&loop"
)]
pub struct SourceSpecError {
    text: String,
    why: String,
}

/// Slowest and fastest replay.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

impl FromStr for SourceSpec {
    type Err = SourceSpecError;

    fn from_str(text: &str) -> Result<Self, SourceSpecError> {
        let wrong = |why: String| SourceSpecError {
            text: text.to_owned(),
            why,
        };
        let (kind, rest) = text
            .split_once(':')
            .ok_or_else(|| wrong("it has no kind".to_owned()))?;
        if kind != "replay" {
            return Err(wrong(format!("there is no kind `{kind}`")));
        }
        let (path, options) = rest.rsplit_once('?').unwrap_or((rest, ""));
        if path.is_empty() {
            return Err(wrong("it names no file".to_owned()));
        }
        let mut spec = ReplaySpec {
            path: path.into(),
            speed: Speed::Times(1.0),
            repeats: false,
        };
        for option in options.split('&').filter(|option| !option.is_empty()) {
            match option.split_once('=') {
                Some(("speed", "max")) => spec.speed = Speed::Max,
                Some(("speed", number)) => {
                    let times = number.parse().ok().filter(|times| SPEEDS.contains(times));
                    spec.speed = Speed::Times(times.ok_or_else(|| {
                        wrong(format!("speed is max or 0.01 to 100, not `{number}`"))
                    })?);
                }
                None if option == "loop" => spec.repeats = true,
                _ => return Err(wrong(format!("`{option}` is neither speed=… nor loop"))),
            }
        }
        Ok(Self::Replay(spec))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_and_unknown_ones_refused() {
        let SourceSpec::Replay(spec) = "replay:a dir/x.glint?speed=0.5&loop".parse().unwrap();
        assert_eq!(spec.path, PathBuf::from("a dir/x.glint"));
        assert_eq!((spec.speed, spec.repeats), (Speed::Times(0.5), true));
        let SourceSpec::Replay(spec) = "replay:x.glint?speed=max".parse().unwrap();
        assert_eq!((spec.speed, spec.repeats), (Speed::Max, false));
        for text in [
            "x.glint",
            "replay:",
            "camera:0",
            "replay:x?speed=0",
            "replay:x?speed=nan",
            "replay:x?fast",
        ] {
            let error = text.parse::<SourceSpec>().unwrap_err().to_string();
            assert!(
                error.contains(text) && error.contains("speed=max"),
                "{error}"
            );
        }
    }
}
