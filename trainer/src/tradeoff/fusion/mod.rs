//! Subject `fusion`: core-milliseconds a frame of the recorder, tracking and fusing, against the error of its path.
//!
//! The child is `glintd record replay:RECORDING?speed=max --json`; its summary and the `live` poses that it stored
//! are judged here, and its mesh where a reference is given. Which flag turns a knob is part of the data.
//! A replay at `speed=max` waits for everybody, so that the same setting gives the same poses at every repetition
//! and under any load; only its cost differs.
//!
//! [`careful`] the mesh that others are compared with where nothing better is known · `world` how meshes are laid on
//! each other.

pub mod careful;
mod world;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, bail, ensure};
use geometry::Pose;
use sequence::Recording;
use serde_json::{Map, Value};

use self::world::reference_from_live;
use super::subject::{Axis, Knob, PointFigures, PointRunner, Setting, Subject};
use crate::eval::mesh::{self, Sightings, read_mesh};
use crate::eval::trajectory::{self, JudgedPath, TrajectoryOptions, TrajectoryReference};

/// Parts of the path that the bootstrap draws.
const BLOCK_COUNT: usize = 10;
/// Points on each surface: a tenth of those of `glint eval`, for a tenth of the time.
const SAMPLE_COUNT: usize = 100_000;

/// Core-milliseconds of a frame, all of the recorder.
pub const COST: Axis = Axis {
    key: "frame_core_ms",
    label: "core-ms a frame, recording and replay included",
};
/// Error of the path.
pub const ERROR: Axis = Axis {
    key: "ate_mm",
    label: "trajectory error after alignment, mm",
};
/// Share of frames tracked, which stands beside every error.
pub const TRACKED: &str = "tracked_fraction";
/// What a reader must see beside them.
pub const BESIDE: &[Axis] = &[
    Axis {
        key: TRACKED,
        label: "share of frames tracked",
    },
    Axis {
        key: "wrong_accepted",
        label: "OK poses that are wrong",
    },
    Axis {
        key: "rpe_1s_m",
        label: "error over 1 s, m",
    },
    Axis {
        key: "fscore_5mm",
        label: "F-score of the mesh at 5 mm",
    },
    Axis {
        key: "track_core_ms_p50",
        label: "tracking, core-ms (median)",
    },
    Axis {
        key: "fuse_memory_mb",
        label: "volume, MiB",
    },
    Axis {
        key: "rss_peak_mb",
        label: "peak memory, MiB",
    },
];

/// Knobs of effects-and-tradeoffs B2 that the recorder has.
pub const SUBJECT: Subject = Subject {
    name: "fusion",
    knobs: &[
        Knob {
            name: "voxel-mm",
            default: "5",
            others: &["4", "6", "8", "10"],
        },
        Knob {
            name: "truncation-voxels",
            default: "6",
            others: &["4", "8"],
        },
        Knob {
            name: "fuse-stride",
            default: "1",
            others: &["2", "3"],
        },
        Knob {
            name: "view-level",
            default: "2",
            others: &["0", "1", "3"],
        },
        Knob {
            name: "icp-iterations",
            default: "8/5/4",
            others: &["10/5/4", "5/3/2", "4/2/1"],
        },
        Knob {
            name: "photometric",
            default: "on",
            others: &["off"],
        },
    ],
    cost: COST,
    error: ERROR,
    beside: BESIDE,
    exact: &[TRACKED, "wrong_accepted", "rpe_1s_m", "fscore_5mm"],
    no_candidates: &[],
    tracked: Some(TRACKED),
};

/// How [`SUBJECT`] is typed for `glintd record`.
pub const FLAGS: &[(&str, Flag)] = &[
    ("voxel-mm", Flag::Value("--voxel-mm")),
    ("truncation-voxels", Flag::Value("--truncation-voxels")),
    ("fuse-stride", Flag::Value("--fuse-stride")),
    ("view-level", Flag::Value("--view-level")),
    ("icp-iterations", Flag::Value("--icp-iterations")),
    ("photometric", Flag::Value("--photometric")),
];

/// How a level of a knob is typed for the recorder.
#[derive(Clone, Copy, Debug)]
pub enum Flag {
    /// The flag and the level after it: `--voxel-mm 5`.
    Value(&'static str),
    /// The flag alone where the level is `on`, nothing where it is `off`.
    Switch(&'static str),
}

/// Runs the points of a subject whose knobs are flags of `glintd record`.
#[derive(Clone, Debug)]
pub struct FusionRunner {
    /// What is compared.
    pub subject: Subject,
    /// The flag of every knob, by its name.
    pub flags: &'static [(&'static str, Flag)],
    /// The recorder.
    pub program: PathBuf,
    /// The recording that is replayed; its set `source` is the reference.
    pub recording: PathBuf,
    /// Mesh of the reference, in its world.
    pub mesh: Option<PathBuf>,
    /// Meshes that were judged; empty at first.
    pub judged_meshes: JudgedMeshes,
}

/// Figures by what they are of, mesh and place: repetitions of a point make the same mesh, and to judge one takes
/// longer than to record it.
pub type JudgedMeshes = RefCell<BTreeMap<String, Map<String, Value>>>;

/// Names of what the recorder leaves in the folder of a point.
const LIVE_RECORDING: &str = "live.glint";
const LIVE_MESH: &str = "live.ply";

/// Steps of the kernel's clock in which a child's time is counted, seconds, with room for rounding.
const CLOCK_STEP_S: f64 = 0.05;

impl PointRunner for FusionRunner {
    fn subject(&self) -> &Subject {
        &self.subject
    }

    fn command(&self, setting: &Setting, desk: &Path) -> anyhow::Result<Command> {
        let mut command = Command::new(&self.program);
        let source = format!("replay:{}?speed=max", self.recording.display());
        command
            .args(["record", &source, "--json", "-o"])
            .arg(desk.join(LIVE_RECORDING));
        if self.mesh.is_some() {
            command.arg("--mesh").arg(desk.join(LIVE_MESH));
        }
        for (knob, flag) in self.flags {
            let level = setting
                .get(*knob)
                .with_context(|| format!("no level of `{knob}`"))?;
            match (flag, level.as_str()) {
                (Flag::Value(flag), level) => {
                    command.args([*flag, level]);
                }
                (Flag::Switch(flag), "on") => {
                    command.arg(flag);
                }
                (Flag::Switch(_), "off") => {}
                (Flag::Switch(flag), level) => bail!("{flag} cannot be `{level}`"),
            }
        }
        Ok(command)
    }

    fn figures(&self, last_line: &str, desk: &Path, core_s: f64) -> anyhow::Result<PointFigures> {
        let summary: Value =
            serde_json::from_str(last_line).context("the recorder did not print its summary")?;
        if let Some(failure) = summary.get("fuse_failure").and_then(Value::as_str) {
            bail!("fusion ended early: {failure}");
        }
        let recording = Recording::open(&desk.join(LIVE_RECORDING))?;
        let judged = judge(&recording)?;
        let frames = recording.frame_count().max(1) as f64;
        let mut metrics = BTreeMap::from([
            (
                COST.key.to_owned(),
                1e3 * self.recording_core_s(&summary, core_s)? / frames,
            ),
            (ERROR.key.to_owned(), 1e3 * judged.metrics.whole.ate.rmse),
        ]);
        let mut take = |keys: Map<String, Value>| {
            let numbers = keys
                .into_iter()
                .filter_map(|(key, value)| Some((key, value.as_f64()?)));
            metrics.extend(numbers);
        };
        take(trajectory::summary(&judged.metrics));
        if let Some(reference) = &self.mesh {
            take(self.mesh_figures(&recording, &judged, desk, reference)?);
        }
        if let Value::Object(keys) = summary.clone() {
            take(keys);
        }
        Ok(PointFigures {
            metrics,
            blocks: squared_errors(&recording, &judged)?,
        })
    }
}

impl FusionRunner {
    /// Core-seconds until the recording was closed. The mesh comes after it and is asked for by us, not by the
    /// frames: where there is one, the recorder's own count is taken, if it is not more than was seen from outside.
    fn recording_core_s(&self, summary: &Value, core_s: f64) -> anyhow::Result<f64> {
        if self.mesh.is_none() {
            return Ok(core_s);
        }
        let counted = summary.get("cpu_s").and_then(Value::as_f64);
        let counted = counted.context("the summary has no cpu_s")?;
        ensure!(
            counted <= core_s + CLOCK_STEP_S,
            "the recorder counts {counted:.2} core-seconds, {core_s:.2} were seen from outside"
        );
        Ok(counted)
    }

    fn mesh_figures(
        &self,
        recording: &Recording,
        judged: &JudgedPath,
        desk: &Path,
        reference: &Path,
    ) -> anyhow::Result<Map<String, Value>> {
        let sightings = Sightings {
            camera: recording.depth_camera(),
            world_from_depth: judged.reference.iter().flatten().copied().collect(),
        };
        let (reference_from_live, origin) = reference_from_live(recording, judged)?;
        let bytes = std::fs::read(desk.join(LIVE_MESH)).context("the recorder left no mesh")?;
        let key = format!("{} {reference_from_live:?}", blake3::hash(&bytes));
        if let Some(figures) = self.judged_meshes.borrow().get(&key) {
            return Ok(figures.clone());
        }
        let metrics = mesh::compare(
            &read_mesh(&desk.join(LIVE_MESH))?,
            &read_mesh(reference)?,
            &reference_from_live,
            origin,
            Some(&sightings),
            SAMPLE_COUNT,
            &|_, _| {},
        )?;
        let figures = mesh::summary(&metrics);
        self.judged_meshes.borrow_mut().insert(key, figures.clone());
        Ok(figures)
    }
}

/// The path that was tracked, by the set `source` of the same recording.
fn judge(recording: &Recording) -> anyhow::Result<JudgedPath> {
    trajectory::evaluate(
        recording,
        &TrajectoryOptions {
            reference: TrajectoryReference::Source,
            poses: "live".to_owned(),
            fit_offset: false,
            ranges: Vec::new(),
        },
    )
}

/// Mean squared distance of each of ten parts of the path, m²; frames without a pose at the last one, so that a part
/// that was lost is a bad part and not a missing one.
fn squared_errors(recording: &Recording, judged: &JudgedPath) -> anyhow::Result<Vec<f64>> {
    let frames = trajectory::estimated_frames(recording, "live")?;
    let mut held: Option<Pose> = frames.iter().find_map(|frame| frame.tracked.pose());
    let mut squares = Vec::with_capacity(frames.len());
    for (frame, reference) in frames.iter().zip(&judged.reference) {
        held = frame.tracked.pose().or(held);
        if let (Some(held), Some(reference)) = (held, reference) {
            let aligned = judged.alignment.reference_from_estimate * held;
            squares.push((reference.translation() - aligned.translation()).length_squared());
        }
    }
    let count = squares.len();
    let part = |part: usize| {
        let range = part * count / BLOCK_COUNT..(part + 1) * count / BLOCK_COUNT;
        let part = &squares[range];
        part.iter().sum::<f64>() / part.len().max(1) as f64
    };
    Ok((0..BLOCK_COUNT).map(part).collect())
}
