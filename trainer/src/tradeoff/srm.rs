//! Subject `srm`: core-seconds of a training in profile `draft` against the error of the map of the room.
//!
//! The child is `glint train RECORDING`, this program again; it gets the recording and nothing else. The map that it
//! leaves is judged here, against the truth that only this process was told of, and its composition against the
//! held-out photographs. The same setting gives the same bits at every repetition: a map that was judged is not
//! judged again; only its cost differs.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use sequence::Recording;
use serde_json::Value;

use super::subject::{Axis, Knob, PointFigures, PointRunner, Setting, Subject};
use crate::budget::bench;
use crate::eval::environment::{self, EnvironmentMetrics};
use crate::eval::model::Model;
use crate::eval::trajectory::{frames_to_source, posed_frames};
use crate::eval::views::{self, ViewError};
use crate::run_folder::RunFolder;
use crate::stages::poses::{REFINED, poses_of_run};
use crate::train::{CONFIDENCE_FILE, LINEAR_DIFFUSE_FILE, SRM_FILE, TrainConfig};

/// Core-seconds of the training.
pub const COST: Axis = Axis {
    key: "train_core_s",
    label: "core-seconds of the training",
};
/// Error of the map over all that can be reached.
pub const ERROR: Axis = Axis {
    key: "env_log_rmse_reach",
    label: "logarithmic error of the map over the reach",
};
/// What a reader must see beside them.
pub const BESIDE: &[Axis] = &[
    Axis {
        key: "env_corr_reach",
        label: "correlation over the reach",
    },
    Axis {
        key: "env_corr",
        label: "correlation, claimed",
    },
    Axis {
        key: "coverage",
        label: "share claimed",
    },
    Axis {
        key: "l1",
        label: "L1 of held-out photographs",
    },
    Axis {
        key: "lpips",
        label: "LPIPS of held-out photographs",
    },
    Axis {
        key: "rows",
        label: "rows",
    },
    Axis {
        key: "rss_peak_mb",
        label: "peak memory, MiB",
    },
];

/// Knobs of effects-and-tradeoffs B2 that the draft has, at most 12 points.
pub const SUBJECT: Subject = Subject {
    name: "srm",
    knobs: &[
        Knob {
            name: "pixel-stride",
            default: "2",
            others: &["1", "4"],
        },
        Knob {
            name: "voxel-mm",
            default: "2",
            others: &["3", "4"],
        },
        Knob {
            name: "map-height",
            default: "126",
            others: &["250", "62"],
        },
        Knob {
            name: "frame-stride",
            default: "1",
            others: &["2", "4"],
        },
        Knob {
            name: "effects",
            default: "auto",
            others: &["all", "none"],
        },
    ],
    cost: COST,
    error: ERROR,
    beside: BESIDE,
    exact: &[
        "env_corr_reach",
        "env_corr",
        "env_log_rmse",
        "coverage",
        "l1",
        "lpips",
        "rows",
    ],
    no_candidates: &[],
    tracked: None,
};

/// Name of the run in the folder of a point.
const RUN: &str = "run";
/// Steps of the kernel's clock in which a child's time is counted, seconds, with room for rounding.
const CLOCK_STEP_S: f64 = 0.05;

/// Trains a recording at every point.
#[derive(Clone, Debug)]
pub struct SrmRunner {
    /// This program.
    pub program: PathBuf,
    /// The recording; a `source` pose set is in it.
    pub recording: PathBuf,
    /// Folder with `environment.exr` and `reach.exr`.
    pub truth: PathBuf,
    /// GGX width of the lobe that dominates the map.
    pub truth_alpha: f64,
    /// Folder with the object's masks; without it the shiny segments of each run are its mask.
    pub masks: Option<PathBuf>,
    /// Threads of every child.
    pub threads: usize,
    /// Maps that were judged; empty at first.
    pub judged: RefCell<BTreeMap<String, PointFigures>>,
}

impl PointRunner for SrmRunner {
    fn subject(&self) -> &Subject {
        &SUBJECT
    }

    fn command(&self, setting: &Setting, desk: &Path) -> anyhow::Result<Command> {
        let mut command = Command::new(&self.program);
        command.arg("train").arg(&self.recording);
        command.arg("-o").arg(desk.join(RUN));
        command.args(["--poses", "source", "--json", "--threads"]);
        command.arg(self.threads.to_string());
        for (knob, level) in setting {
            command.arg(format!("--{knob}")).arg(level);
        }
        Ok(command)
    }

    fn figures(&self, last_line: &str, desk: &Path, core_s: f64) -> anyhow::Result<PointFigures> {
        let summary: Value =
            serde_json::from_str(last_line).context("the training did not print its summary")?;
        let counted = summary["cost"]["core_s"].as_f64();
        let counted = counted.context("the summary has no cost")?;
        ensure!(
            counted <= core_s + CLOCK_STEP_S,
            "the training counts {counted:.2} core-seconds, {core_s:.2} were seen from outside"
        );
        let run = RunFolder::open(&desk.join(RUN))?;
        let mut figures = self.judge(&run)?;
        let mut take = |key: &str, value: f64| figures.metrics.insert(key.to_owned(), value);
        take(COST.key, core_s);
        for key in ["pixels", "rows", "frames", "triangles", "rss_peak_mb"] {
            let value = summary[key].as_f64();
            take(
                key,
                value.with_context(|| format!("the summary has no {key}"))?,
            );
        }
        let manifest = run.manifest()?;
        for (stage, cost) in &manifest.stages {
            take(&format!("{stage}_core_s"), cost.core_s);
        }
        let recording = Recording::open(&self.recording)?;
        let camera = recording.color_camera().intrinsics;
        take("scene_frames", recording.split().train.len() as f64);
        take(
            "scene_pixels",
            f64::from(camera.width()) * f64::from(camera.height()),
        );
        // What the machine did then: `--budget` scales by it.
        take("bench_ms", bench::score_ms());
        Ok(figures)
    }
}

impl SrmRunner {
    /// Figures of the map and of the composition; those of an earlier run with the same files where there is one.
    fn judge(&self, run: &RunFolder) -> anyhow::Result<PointFigures> {
        let mut hasher = blake3::Hasher::new();
        for file in [SRM_FILE, CONFIDENCE_FILE, LINEAR_DIFFUSE_FILE] {
            hasher.update(&std::fs::read(run.path(file))?);
        }
        let key = hasher.finalize().to_hex().to_string();
        if let Some(figures) = self.judged.borrow().get(&key) {
            return Ok(figures.clone());
        }
        let recording = Recording::open(&self.recording)?;
        let config: TrainConfig =
            toml::from_str(&std::fs::read_to_string(run.path("config.toml"))?)?;
        let poses = poses_of_run(run, &recording, &config.poses)?;
        // Refined poses have a world of their own.
        let to_source = match config.poses.as_str() {
            REFINED => frames_to_source(&recording, &posed_frames(&recording, &poses), REFINED)?,
            _ => None,
        };
        let room = environment::evaluate(
            &run.path(SRM_FILE),
            &run.path(CONFIDENCE_FILE),
            &self.truth,
            to_source.map(|found| found.reference_from_estimate.rotation()),
            self.truth_alpha,
            None,
        )?;
        let mut metrics = room_figures(&room);
        let masks = self.masks.as_deref();
        let model = Model::load(run)?;
        let judged = views::evaluate_at(&recording, &model, &poses, masks, &|_, _| {})?;
        if let Some((views, _)) = judged {
            metrics.extend(view_figures(&views.composition));
        }
        let figures = PointFigures {
            metrics,
            blocks: room.env_log_square_sectors,
        };
        self.judged.borrow_mut().insert(key, figures.clone());
        Ok(figures)
    }
}

fn room_figures(room: &EnvironmentMetrics) -> BTreeMap<String, f64> {
    let mut figures: BTreeMap<String, f64> = [
        (ERROR.key, room.env_log_rmse_reach),
        ("env_corr_reach", room.env_corr_reach),
        ("env_corr", room.env_corr),
        ("env_log_rmse", room.env_log_rmse),
        ("coverage", room.coverage),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value))
    .collect();
    let bars = [
        ("env_bar_deg_h", &room.env_bar_deg_h),
        ("env_bar_deg_v", &room.env_bar_deg_v),
    ];
    for (key, bar) in bars {
        // Words, where no or every bar is resolved, stay out: they are no numbers.
        let width = bar.as_ref().and_then(|bar| bar.to_string().parse().ok());
        if let Some(width) = width {
            figures.insert(key.to_owned(), width);
        }
    }
    figures
}

/// Figures of predicted photographs by key.
pub(super) fn view_figures(error: &ViewError) -> BTreeMap<String, f64> {
    let some = [
        ("l1", Some(error.l1)),
        ("psnr", Some(error.psnr)),
        ("ssim", error.ssim),
        ("lpips", error.lpips),
        ("highlight_ratio", error.highlight_ratio),
    ];
    some.into_iter()
        .filter_map(|(key, value)| Some((key.to_owned(), value?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tradeoff::subject::DEFAULT_POINT;

    fn runner() -> SrmRunner {
        SrmRunner {
            program: "/bin/glint".into(),
            recording: "room.glint".into(),
            truth: "/secret/truth".into(),
            truth_alpha: 0.02,
            masks: Some("/secret/masks".into()),
            threads: 1,
            judged: RefCell::default(),
        }
    }

    #[test]
    fn the_child_is_told_every_level_and_nothing_of_the_truth() {
        assert!(SUBJECT.points().len() <= 12);
        let setting = SUBJECT.setting_of("voxel-mm=3").expect("a point");
        let command = runner().command(&setting, Path::new("desk")).unwrap();
        let words: Vec<String> = command
            .get_args()
            .map(|word| word.to_string_lossy().into_owned())
            .collect();
        let said = words.join(" ");
        assert!(said.starts_with("train room.glint -o desk/run "), "{said}");
        assert!(said.contains("--voxel-mm 3") && said.contains("--pixel-stride 2"));
        assert!(said.contains("--threads 1") && !said.contains("secret"));
        assert!(SUBJECT.setting_of(DEFAULT_POINT).is_some());
    }

    #[test]
    fn a_child_that_counts_more_than_was_seen_has_failed() {
        let line = r#"{"event":"summary","cost":{"core_s":5.0,"wall_s":5.0}}"#;
        let error = runner().figures(line, Path::new("desk"), 4.0).unwrap_err();
        assert!(error.to_string().contains("4.00 were seen from outside"));
        assert!(runner().figures("{}", Path::new("desk"), 4.0).is_err());
    }
}
