//! Subject `codec`: core time a pair against bytes a pair. Everything is lossless, and checked to be.
//!
//! A point reads frames of a recording into memory, codes and stores them as a recorder does, decodes the payloads
//! and compares, three times over; the default is run beside it by turns, pair by pair, and the cost is the ratio of
//! the two: on a busy machine times swing by half, the ratio by a few percent. Baselines that a reader knows stand beside the coders of `sequence`: RVL as published and
//! 16-bit PNG.

mod coder;
mod point;
mod rvl;

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context as _;

pub use self::point::run_point;

use super::subject::{Axis, Knob, PointFigures, PointRunner, Setting, Subject};

/// Knobs of effects-and-tradeoffs B2 that `sequence` has. It has one predictor, and colour is coded as the camera
/// sent it.
pub const SUBJECT: Subject = Subject {
    name: "codec",
    knobs: &[
        Knob {
            name: "depth-coder",
            default: "fast",
            others: &["dense", "rvl", "png16"],
        },
        Knob {
            name: "depth-domain",
            default: "recorded",
            others: &["samples", "codes"],
        },
        Knob {
            name: "zstd-level",
            default: "1",
            others: &["-5", "3", "6", "9", "12", "19"],
        },
        Knob {
            name: "chunk-pairs",
            default: "30",
            others: &["1", "15", "60"],
        },
        Knob {
            name: "threads",
            default: "1",
            others: &["2"],
        },
    ],
    cost: Axis {
        key: "encode_ratio",
        label: "core time to encode and store a pair, times that of the default beside it",
    },
    error: Axis {
        key: "bytes_per_pair",
        label: "bytes a pair in the file",
    },
    beside: &[
        Axis {
            key: "encode_ms",
            label: "encode, core-ms (median of the fastest of 3)",
        },
        Axis {
            key: "decode_ratio",
            label: "decode, times the default",
        },
        Axis {
            key: "encode_ms_p99",
            label: "encode p99, core-ms",
        },
        Axis {
            key: "encode_wall_ms",
            label: "encode, wall ms (median)",
        },
        Axis {
            key: "decode_ms",
            label: "decode, core-ms (median of the fastest of 3)",
        },
        Axis {
            key: "decode_ms_p99",
            label: "decode p99, core-ms",
        },
        Axis {
            key: "depth_percent",
            label: "depth, % of raw",
        },
        Axis {
            key: "deadline_miss_fraction",
            label: "share over 33.3 ms",
        },
        Axis {
            key: "rss_peak_mb",
            label: "peak memory, MiB",
        },
    ],
    exact: &["depth_percent", "depth_bytes"],
    no_candidates: &[
        (
            "depth-domain=codes",
            "what a sensor that sends codes would cost: no choice of ours",
        ),
        (
            "chunk-pairs=60",
            "a crash may cost two seconds: design.md allows about one",
        ),
    ],
    tracked: None,
};

/// Runs the points of `codec` by calling this program again.
#[derive(Clone, Debug)]
pub struct CodecRunner {
    /// The program.
    pub program: PathBuf,
    /// The recording.
    pub recording: PathBuf,
    /// Pairs that are coded, spread evenly.
    pub pair_count: u32,
}

impl PointRunner for CodecRunner {
    fn subject(&self) -> &Subject {
        &SUBJECT
    }

    fn command(&self, setting: &Setting, desk: &Path) -> anyhow::Result<Command> {
        let threads = setting.get("threads").map_or("1", String::as_str);
        let mut command = Command::new(&self.program);
        command
            .args(["--json", "--threads", threads, "tradeoff", "codec"])
            .arg(&self.recording)
            .arg("-o")
            .arg(desk)
            .args(["--pairs", &self.pair_count.to_string()])
            .args(["--point", &typed(setting)]);
        Ok(command)
    }

    fn figures(&self, last_line: &str, _desk: &Path, _core_s: f64) -> anyhow::Result<PointFigures> {
        serde_json::from_str(last_line).context("the point did not print its figures")
    }
}

/// A setting as it is typed after `--point`: `name=level,name=level`.
pub fn typed(setting: &Setting) -> String {
    let levels = setting
        .iter()
        .map(|(name, level)| format!("{name}={level}"));
    levels.collect::<Vec<_>>().join(",")
}

/// What [`typed`] wrote.
///
/// # Errors
/// A sentence where a knob or level is not one of the subject's.
pub fn parse_setting(text: &str) -> Result<Setting, String> {
    let mut setting = Setting::new();
    for part in text.split(',') {
        let (name, level) = part
            .split_once('=')
            .ok_or_else(|| format!("`{part}` is no name=level"))?;
        let knob = SUBJECT.knobs.iter().find(|knob| knob.name == name);
        let knob = knob.ok_or_else(|| format!("there is no knob `{name}`"))?;
        if knob.default != level && !knob.others.contains(&level) {
            return Err(format!("`{name}` has no level `{level}`"));
        }
        setting.insert(name.to_owned(), level.to_owned());
    }
    match SUBJECT
        .knobs
        .iter()
        .find(|knob| !setting.contains_key(knob.name))
    {
        Some(knob) => Err(format!("the level of `{}` is missing", knob.name)),
        None => Ok(setting),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tradeoff::subject::MOST_POINTS;

    #[test]
    fn every_point_can_be_typed() {
        let points = SUBJECT.points();
        assert!(points.len() <= MOST_POINTS);
        for point in points {
            assert_eq!(parse_setting(&typed(&point.setting)), Ok(point.setting));
        }
        for wrong in ["", "threads", "threads=9", "speed=1", "threads=1"] {
            assert!(parse_setting(wrong).is_err(), "{wrong}");
        }
    }
}
