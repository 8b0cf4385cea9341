//! A measured table `srm.csv`, read back.

use std::collections::BTreeMap;

use anyhow::{Context as _, ensure};
use geometry::robust;

use crate::tradeoff::srm::{COST, ERROR, SUBJECT};
use crate::tradeoff::subject::{DEFAULT_POINT, Setting};

/// Stages whose cost stands in the table.
const STAGES: [&str; 5] = ["poses", "geometry", "effects", "diffuse", "linear"];

/// The measurement of one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Points that ended well, the default among them.
    pub points: Vec<MeasuredPoint>,
}

/// A point of a table: medians over its repetitions.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredPoint {
    /// Name.
    pub name: String,
    /// All levels.
    pub setting: Setting,
    /// Core-seconds of the training.
    pub core_s: f64,
    /// Of these, each stage's.
    pub stages: BTreeMap<&'static str, f64>,
    /// Error of the map.
    pub error: f64,
    /// Pixels that gave rows, before matte segments were left out: what the solver was given.
    pub pixels: f64,
    /// Training frames times pixels of a photograph of the scene.
    pub scene_size: f64,
    /// Score of the machine then, core-milliseconds.
    pub bench_ms: f64,
    /// Whether it is, or may be, on the front.
    pub is_on_front: bool,
}

impl Table {
    /// Reads the text of a table.
    ///
    /// # Errors
    /// When a column is missing, no point ended well, or the default did not.
    pub fn parse(text: &str) -> anyhow::Result<Self> {
        let mut lines = text.lines().map(fields);
        let header = lines.next().context("the table is empty")?;
        let mut rows: BTreeMap<String, Vec<BTreeMap<String, String>>> = BTreeMap::new();
        for line in lines {
            let row: BTreeMap<String, String> = header.iter().cloned().zip(line).collect();
            let name = row.get("point").context("no column `point`")?.clone();
            rows.entry(name).or_default().push(row);
        }
        let mut points = Vec::new();
        // In the order of the grid, whatever that of the file.
        for point in SUBJECT.points() {
            let Some(runs) = rows.get(&point.name) else {
                continue;
            };
            let ended_well = |row: &BTreeMap<String, String>| {
                row.get("status").is_some_and(|status| status == "ok")
            };
            if runs.iter().all(ended_well) {
                let found = measured(&point.name, point.setting, runs);
                points.push(found.with_context(|| format!("point {}", point.name))?);
            }
        }
        ensure!(
            points.iter().any(|point| point.name == DEFAULT_POINT),
            "the default is not among the points that ended well"
        );
        Ok(Self { points })
    }

    /// The point of a name.
    pub fn point(&self, name: &str) -> Option<&MeasuredPoint> {
        self.points.iter().find(|point| point.name == name)
    }
}

fn measured(
    name: &str,
    setting: Setting,
    runs: &[BTreeMap<String, String>],
) -> anyhow::Result<MeasuredPoint> {
    let median = |key: &str| -> anyhow::Result<f64> {
        let mut values = runs
            .iter()
            .map(|run| {
                let text = run.get(key).with_context(|| format!("no column `{key}`"))?;
                let value: f64 = text
                    .parse()
                    .with_context(|| format!("{key} is `{text}`, which is no number"))?;
                ensure!(value.is_finite() && value >= 0.0, "{key} is {value}");
                Ok(value)
            })
            .collect::<anyhow::Result<Vec<f64>>>()?;
        robust::median(&mut values).context("no run")
    };
    let mut stages = BTreeMap::new();
    for stage in STAGES {
        stages.insert(stage, median(&format!("{stage}_core_s"))?);
    }
    Ok(MeasuredPoint {
        name: name.to_owned(),
        setting,
        core_s: median(COST.key)?,
        stages,
        error: median(ERROR.key)?,
        pixels: median("pixels")?,
        scene_size: median("scene_frames")? * median("scene_pixels")?,
        bench_ms: median("bench_ms")?,
        is_on_front: runs
            .first()
            .and_then(|run| run.get("front"))
            .is_some_and(|front| front != "no"),
    })
}

/// Fields of a line; commas within quotes do not part them (RFC 4180, without line breaks in fields).
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut is_quoted = false;
    for letter in line.chars() {
        match letter {
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(String::new()),
            other => {
                if let Some(last) = fields.last_mut() {
                    last.push(other);
                }
            }
        }
    }
    fields
}
