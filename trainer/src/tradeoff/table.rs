//! `<subject>.csv`: a row for every run, also of those that failed.

use std::collections::BTreeSet;

use super::journal::PointRecord;
use super::machine::short_hash;
use super::result::{Measurement, PointResult};

/// Columns in front of the knobs.
const BEFORE: [&str; 12] = [
    "run_id",
    "version",
    "commit",
    "machine_id",
    "subject",
    "scene",
    "scene_blake3",
    "seed",
    "point",
    "repetition",
    "order",
    "config_blake3",
];
/// Columns between knobs and figures.
const BETWEEN: [&str; 9] = [
    "status",
    "reason",
    "core_s",
    "wall_s",
    "user_s",
    "sys_s",
    "steal_fraction",
    "load_average",
    "log_blake3",
];
/// Columns behind the figures.
const BEHIND: [&str; 2] = ["started_utc", "front"];

/// The text of the table.
pub(super) fn csv(measurement: &Measurement) -> String {
    let metrics = metric_keys(measurement);
    let knobs = measurement.subject.knobs.iter().map(|knob| knob.name);
    let header = BEFORE
        .into_iter()
        .chain(knobs)
        .chain(BETWEEN)
        .chain(metrics.iter().copied())
        .chain(BEHIND);
    let mut text = line(header.map(str::to_owned));
    for point in &measurement.points {
        for run in &point.runs {
            text.push_str(&row(measurement, point, run, &metrics));
        }
    }
    text
}

/// Every figure that any run has, in order, without those that a child calls as a column is called: what was seen
/// from outside stands there.
fn metric_keys(measurement: &Measurement) -> BTreeSet<&str> {
    let runs = measurement.points.iter().flat_map(|point| &point.runs);
    let columns = BEFORE.iter().chain(&BETWEEN).chain(&BEHIND);
    runs.flat_map(|run| run.figures.metrics.keys().map(String::as_str))
        .filter(|key| !columns.clone().any(|column| column == key))
        .collect()
}

fn row(
    measurement: &Measurement,
    point: &PointResult,
    run: &PointRecord,
    metrics: &BTreeSet<&str>,
) -> String {
    let beginning = &measurement.beginning;
    let config: String = run
        .setting
        .iter()
        .map(|(name, level)| format!("{name}={level}\n"))
        .collect();
    let key = format!("{config}{}\n{}", run.repetition, run.log_blake3);
    let before = [
        short_hash(key.as_bytes()),
        beginning.version.clone(),
        beginning.commit.clone(),
        beginning.machine.id(),
        beginning.subject.clone(),
        beginning.scene.clone(),
        beginning.scene_blake3.chars().take(12).collect(),
        beginning.seed.to_string(),
        run.point.clone(),
        run.repetition.to_string(),
        run.order.to_string(),
        short_hash(config.as_bytes()),
    ];
    let knobs = measurement.subject.knobs.iter();
    let knobs = knobs.map(|knob| run.setting.get(knob.name).cloned().unwrap_or_default());
    let cost = &run.cost;
    let between = [
        run.status.to_string(),
        run.reason.clone(),
        number(cost.core_s()),
        number(cost.wall_s),
        number(cost.user_s),
        number(cost.sys_s),
        number(cost.steal_fraction),
        number(cost.load_average),
        run.log_blake3.chars().take(12).collect(),
    ];
    let figures = metrics.iter().map(|key| {
        let value = run.figures.metrics.get(*key);
        value.map_or_else(String::new, |value| number(*value))
    });
    let behind = [run.started_utc.clone(), point.front.to_string()];
    line(
        before
            .into_iter()
            .chain(knobs)
            .chain(between)
            .chain(figures)
            .chain(behind),
    )
}

/// Six digits, the least that names every figure; empty for what is not a number.
fn number(value: f64) -> String {
    if !value.is_finite() {
        return String::new();
    }
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    rounded.to_string()
}

/// A line of fields, quoted where a program could be misled (RFC 4180).
fn line(fields: impl IntoIterator<Item = String>) -> String {
    let quoted = |field: String| {
        if field.contains([',', '"', '\n', '\r']) {
            format!(
                "\"{}\"",
                field.replace('"', "\"\"").replace(['\n', '\r'], " ")
            )
        } else {
            field
        }
    };
    let fields: Vec<String> = fields.into_iter().map(quoted).collect();
    format!("{}\n", fields.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_that_mislead_are_quoted_and_numbers_are_short() {
        let fields = ["a", "b,c", "say \"x\"", "two\nlines"].map(str::to_owned);
        assert_eq!(line(fields), "a,\"b,c\",\"say \"\"x\"\"\",\"two lines\"\n");
        assert_eq!(number(0.1 + 0.2), "0.3");
        assert_eq!(number(1_234_567.0), "1234570");
        assert_eq!(number(f64::NAN), "");
    }
}
