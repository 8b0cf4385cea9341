//! Subject `render`: core-milliseconds of a drawn view against its error.
//!
//! The child is `glint render RUN --path test --camera`, this program again, which draws the held-out frames as the
//! camera would have coded them. The pictures are judged here against the photographs; smaller ones are enlarged
//! first, as a viewer would.
//!
//! Median texture and nearest photograph are drawn too: what everybody has without a map of the room.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use geometry::Pose;
use imaging::decode_png_rgb8;
use sequence::Recording;
use serde_json::Value;

use super::srm::view_figures;
use super::subject::{Axis, Knob, PointFigures, PointRunner, Setting, Subject};
use crate::eval::model::Model;
use crate::eval::views::judge_pictures;
use crate::run_folder::RunFolder;
use crate::stages::poses::poses_of_run;
use crate::train::TrainConfig;

/// Core-milliseconds of a view.
pub const COST: Axis = Axis {
    key: "draw_core_ms",
    label: "core-ms a drawn view",
};
/// Error over the object.
pub const ERROR: Axis = Axis {
    key: "l1",
    label: "L1 of held-out photographs over the object",
};
/// What a reader must see beside them.
pub const BESIDE: &[Axis] = &[
    Axis {
        key: "lpips",
        label: "LPIPS",
    },
    Axis {
        key: "psnr",
        label: "PSNR, dB",
    },
    Axis {
        key: "ssim",
        label: "SSIM",
    },
    Axis {
        key: "highlight_ratio",
        label: "highlights drawn over seen",
    },
    Axis {
        key: "prep_core_s",
        label: "preparation, core-seconds",
    },
    Axis {
        key: "rss_peak_mb",
        label: "peak memory, MiB",
    },
];

/// Knobs of effects-and-tradeoffs B2 that the renderer has, and the baselines.
pub const SUBJECT: Subject = Subject {
    name: "render",
    knobs: &[
        Knob {
            name: "scale",
            default: "1",
            others: &["1/2", "1/4"],
        },
        Knob {
            name: "samples",
            default: "1",
            others: &["4"],
        },
        Knob {
            name: "model",
            default: "composition",
            others: &["diffuse", "nearest"],
        },
    ],
    cost: COST,
    error: ERROR,
    beside: BESIDE,
    exact: &["lpips", "psnr", "ssim", "highlight_ratio"],
    no_candidates: &[
        ("model=diffuse", "a baseline: it shows no reflection"),
        (
            "model=nearest",
            "a baseline: its reflections do not move with the view",
        ),
    ],
    tracked: None,
};

/// Name of the pictures in the folder of a point.
const PICTURES: &str = "pictures";
/// Parts of the held-out frames that the bootstrap draws.
const BLOCK_COUNT: usize = 10;
/// Steps of the kernel's clock in which a child's time is counted, seconds, with room for rounding.
const CLOCK_STEP_S: f64 = 0.05;

/// Draws a run at every point.
pub struct RenderRunner {
    /// This program.
    pub program: PathBuf,
    /// The run folder.
    pub run: PathBuf,
    /// Folder with the object's masks; without it the shiny segments of the run are the mask.
    pub masks: Option<PathBuf>,
    /// Threads of every child.
    pub threads: usize,
    recording: Recording,
    model: Model,
    poses: Vec<Option<Pose>>,
    judged: RefCell<BTreeMap<String, PointFigures>>,
}

impl RenderRunner {
    /// Reads the run and its recording.
    ///
    /// # Errors
    /// When either cannot be read.
    pub fn open(
        program: PathBuf,
        run: PathBuf,
        masks: Option<PathBuf>,
        threads: usize,
    ) -> anyhow::Result<Self> {
        let folder = RunFolder::open(&run)?;
        let config: TrainConfig =
            toml::from_str(&std::fs::read_to_string(folder.path("config.toml"))?)?;
        let recording = Recording::open(&config.recording)?;
        Ok(Self {
            program,
            masks,
            threads,
            model: Model::load(&folder)?,
            poses: poses_of_run(&folder, &recording, &config.poses)?,
            recording,
            run,
            judged: RefCell::default(),
        })
    }

    fn judge(&self, pictures: &Path) -> anyhow::Result<PointFigures> {
        let picture = |index: usize| {
            let path = pictures.join(format!("{index:06}.png"));
            let bytes = std::fs::read(&path);
            let bytes =
                bytes.with_context(|| format!("no picture of frame {index} was left behind"))?;
            Ok(decode_png_rgb8(&bytes)?)
        };
        let masks = self.masks.as_deref();
        let judged = judge_pictures(&self.recording, &self.model, &self.poses, masks, &picture)?;
        let judged = judged.context("no pixel of a held-out frame shows the object")?;
        Ok(PointFigures {
            metrics: view_figures(&judged.error),
            blocks: judged.blocks(BLOCK_COUNT),
        })
    }
}

impl PointRunner for RenderRunner {
    fn subject(&self) -> &Subject {
        &SUBJECT
    }

    fn command(&self, setting: &Setting, desk: &Path) -> anyhow::Result<Command> {
        let mut command = Command::new(&self.program);
        command.arg("render").arg(&self.run);
        command.args(["--path", "test", "--camera", "--json", "--threads"]);
        command.arg(self.threads.to_string());
        command.arg("-o").arg(desk.join(PICTURES));
        for (knob, level) in setting {
            command.arg(format!("--{knob}")).arg(level);
        }
        Ok(command)
    }

    fn figures(&self, last_line: &str, desk: &Path, core_s: f64) -> anyhow::Result<PointFigures> {
        let summary: Value =
            serde_json::from_str(last_line).context("the renderer did not print its summary")?;
        let number = |key: &str| {
            let value = summary[key].as_f64();
            value.with_context(|| format!("the summary has no {key}"))
        };
        let pictures = number("pictures")?;
        let counted =
            number("prep_core_s")? + 1e-3 * number(COST.key)? * pictures + number("write_core_s")?;
        ensure!(
            counted <= core_s + CLOCK_STEP_S,
            "the renderer counts {counted:.2} core-seconds, {core_s:.2} were seen from outside"
        );
        let folder = desk.join(PICTURES);
        let mut hasher = blake3::Hasher::new();
        for entry in sorted(&folder)? {
            hasher.update(&std::fs::read(entry)?);
        }
        // The same pictures have the same figures: only their cost differs.
        let key = hasher.finalize().to_hex().to_string();
        let known = self.judged.borrow().get(&key).cloned();
        let mut figures = match known {
            Some(figures) => figures,
            None => {
                let figures = self.judge(&folder)?;
                self.judged.borrow_mut().insert(key, figures.clone());
                figures
            }
        };
        for key in [
            COST.key,
            "prep_core_s",
            "write_core_s",
            "rss_peak_mb",
            "pictures",
        ] {
            figures.metrics.insert(key.to_owned(), number(key)?);
        }
        Ok(figures)
    }
}

fn sorted(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .context("the renderer left no pictures")?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    paths.sort();
    Ok(paths)
}

/// BLAKE3 of what a picture of a run is made from, and of the recording.
///
/// # Errors
/// When a file of the run cannot be read.
pub fn content_hash(run: &Path) -> anyhow::Result<String> {
    let folder = RunFolder::open(run)?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(folder.manifest()?.recording_hash.as_bytes());
    for file in [
        crate::train::SRM_FILE,
        crate::train::LINEAR_DIFFUSE_FILE,
        crate::train::MEDIAN_FILE,
    ] {
        hasher.update(&std::fs::read(folder.path(file))?);
    }
    Ok(hasher.finalize().to_hex().to_string())
}
