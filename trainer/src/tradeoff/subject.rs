//! What is measured, as data: knobs with their levels, axes, points.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde::{Deserialize, Serialize};

/// Most points of a subject: more is a search, not a comparison.
pub const MOST_POINTS: usize = 25;

/// Something that trades accuracy for time.
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// As it is typed and written.
    pub name: &'static str,
    /// Level at which it stands while others are turned.
    pub default: &'static str,
    /// The other levels that are run.
    pub others: &'static [&'static str],
}

/// A figure of a point.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Its key among the metrics.
    pub key: &'static str,
    /// With its unit, for people.
    pub label: &'static str,
}

/// What one subject compares. Less is better on both axes.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// As it is typed; files are named by it.
    pub name: &'static str,
    /// What can be turned.
    pub knobs: &'static [Knob],
    /// What it costs.
    pub cost: Axis,
    /// What is wrong, or big.
    pub error: Axis,
    /// Figures that a reader must see beside the axes.
    pub beside: &'static [Axis],
    /// Figures that are the same bit for bit whenever a point is run again, beside the error: an audit compares them.
    pub exact: &'static [&'static str],
    /// Points that are shown and are no candidates for the front, each with the reason.
    pub no_candidates: &'static [(&'static str, &'static str)],
    /// Key of the share of frames that were tracked, where there is one: below 0.95 a point is not on the front.
    pub tracked: Option<&'static str>,
}

/// A level for every knob, by name.
pub type Setting = BTreeMap<String, String>;

/// One point of the grid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Point {
    /// `default`, or the knob that differs from it: `zstd-level=6`.
    pub name: String,
    /// All levels.
    pub setting: Setting,
}

/// Name of the point with every knob at its default.
pub const DEFAULT_POINT: &str = "default";

impl Subject {
    /// The default, then one knob at a time at each of its other levels.
    pub fn points(&self) -> Vec<Point> {
        let default: Setting = self
            .knobs
            .iter()
            .map(|knob| (knob.name.to_owned(), knob.default.to_owned()))
            .collect();
        let turned = self.knobs.iter().flat_map(|knob| {
            knob.others.iter().map(|level| {
                let mut setting = default.clone();
                setting.insert(knob.name.to_owned(), (*level).to_owned());
                Point {
                    name: format!("{}={level}", knob.name),
                    setting,
                }
            })
        });
        let first = Point {
            name: DEFAULT_POINT.to_owned(),
            setting: default.clone(),
        };
        std::iter::once(first).chain(turned).collect()
    }

    /// The setting of a point by its name.
    pub fn setting_of(&self, name: &str) -> Option<Setting> {
        let found = self.points().into_iter().find(|point| point.name == name);
        found.map(|point| point.setting)
    }
}

/// What a child found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointFigures {
    /// Figures by key, among them those of the axes.
    pub metrics: BTreeMap<String, f64>,
    /// The error of consecutive parts of the input; their mean orders points as the error does. The same parts
    /// at every point, so that they can be drawn together.
    pub blocks: Vec<f64>,
}

/// How the points of a subject are run: a fresh process each.
pub trait PointRunner {
    /// What is compared.
    fn subject(&self) -> &Subject;

    /// The process of a point. It may write into `desk`, an empty folder; its last line on standard output goes
    /// to [`PointRunner::figures`].
    ///
    /// # Errors
    /// When the process cannot be described.
    fn command(&self, setting: &Setting, desk: &Path) -> anyhow::Result<Command>;

    /// The figures of a process that ended well, from its last line, what it left in `desk`, and the
    /// core-seconds that it took.
    ///
    /// # Errors
    /// When they cannot be had: the point has failed.
    fn figures(&self, last_line: &str, desk: &Path, core_s: f64) -> anyhow::Result<PointFigures>;
}
