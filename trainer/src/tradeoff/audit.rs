//! `glint tradeoff audit`: random rows of a table are run again (effects-and-tradeoffs B7).
//!
//! What repeats bit for bit must do so; the cost may differ by a quarter. The result is a line of the journal and
//! stands on the page.

#[cfg(test)]
mod tests;

use std::path::Path;

use anyhow::{Context as _, ensure};
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::child::PointStatus;
use super::journal::{Journal, PointRecord, counting};
use super::machine::{Machine, utc_now};
use super::result::Measurement;
use super::subject::{Point, PointFigures, PointRunner, Subject};
use super::{TradeoffOptions, hash_of, run_point, write_results};

/// Share by which the cost of a row that is run again may differ.
const COST_TOLERANCE: f64 = 0.25;

/// Rows that were run again, and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditRecord {
    /// When it began.
    pub started_utc: String,
    /// Seed of the choice.
    pub seed: u64,
    /// Whether program and machine are those of the measurement; costs are compared only on the same machine.
    pub is_same_program: bool,
    /// As above.
    pub is_same_machine: bool,
    /// The rows.
    pub rows: Vec<AuditedRow>,
}

/// One row that was run again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AuditedRow {
    /// Name of the point.
    pub point: String,
    /// Its repetition.
    pub repetition: u32,
    /// Cost now over cost then.
    pub cost_ratio: f64,
    /// What does not agree, in words; empty where all does.
    pub differing: Vec<String>,
}

impl AuditRecord {
    /// Rows that do not agree, each with what differs.
    pub fn disagreements(&self) -> Vec<String> {
        let bad = self.rows.iter().filter(|row| !row.differing.is_empty());
        bad.map(|row| {
            format!(
                "{} (repetition {}): {}",
                row.point,
                row.repetition,
                row.differing.join(", ")
            )
        })
        .collect()
    }

    /// For the page and the terminal.
    pub fn sentence(&self) -> String {
        let ratios = self.rows.iter().map(|row| row.cost_ratio);
        let (least, most) = ratios.fold((f64::INFINITY, 0.0_f64), |(a, b), ratio| {
            (a.min(ratio), b.max(ratio))
        });
        let bad = self.disagreements();
        let found = if bad.is_empty() {
            "all agree".to_owned()
        } else {
            format!("{} do not agree: {}", bad.len(), bad.join("; "))
        };
        let program = if self.is_same_program {
            ""
        } else {
            " by another build"
        };
        let machine = if self.is_same_machine {
            ""
        } else {
            ", on another machine, where costs do not compare"
        };
        format!(
            "audited {} with seed {}{program}: {} rows run again, {found}; cost {least:.2} to {most:.2} of what it \
             was{machine}",
            self.started_utc,
            self.seed,
            self.rows.len()
        )
    }
}

/// Runs `row_count` random rows of the table in `options.output` again; the page is written anew. Rows that failed
/// are not drawn.
///
/// # Errors
/// When there is no table, it is of another input, no row ended well, or a run cannot be started.
pub fn audit(
    runner: &dyn PointRunner,
    options: &TradeoffOptions,
    row_count: usize,
) -> anyhow::Result<AuditRecord> {
    let subject = runner.subject();
    let mut journal = Journal::reopen(&options.output, subject.name)?;
    let beginning = journal.beginning().clone();
    ensure!(
        beginning.scene_blake3 == options.scene_blake3,
        "{} was measured on another input ({}): give that one",
        options.output.display(),
        beginning.scene
    );
    let is_same_machine = beginning.machine == Machine::here();
    let mut rows: Vec<PointRecord> = counting(journal.records())
        .into_values()
        .filter(|row| row.status == PointStatus::Ok && row.is_genuine())
        .cloned()
        .collect();
    ensure!(!rows.is_empty(), "no row of {} ended well", subject.name);
    rows.shuffle(&mut Pcg64::seed_from_u64(options.seed));
    rows.truncate(row_count);
    let mut audited = AuditRecord {
        started_utc: utc_now(),
        seed: options.seed,
        is_same_program: beginning.program_blake3 == hash_of(&options.program)?,
        is_same_machine,
        rows: Vec::new(),
    };
    for row in &rows {
        let point = Point {
            name: row.point.clone(),
            setting: row.setting.clone(),
        };
        let again = run_point(runner, &point, row.repetition, options, &journal, false)?;
        audited
            .rows
            .push(compared(subject, row, &again, is_same_machine));
    }
    journal.push_audit(audited.clone())?;
    let measurement = Measurement::of(subject, beginning, journal.records());
    write_results(
        &measurement.with_audits(journal.audits()),
        Path::new(&options.output),
    )
    .context("the page cannot be written anew")?;
    Ok(audited)
}

fn compared(
    subject: &Subject,
    row: &PointRecord,
    again: &PointRecord,
    is_same_machine: bool,
) -> AuditedRow {
    let cost = |record: &PointRecord| {
        let cost = record.figures.metrics.get(subject.cost.key);
        cost.copied().unwrap_or(f64::NAN)
    };
    let cost_ratio = cost(again) / cost(row);
    let mut differing = Vec::new();
    if again.status == PointStatus::Ok {
        differing = differences(subject, &row.figures, &again.figures);
        let is_near = (cost_ratio - 1.0).abs() <= COST_TOLERANCE;
        if is_same_machine && !is_near {
            differing.push(format!("{} is {cost_ratio:.2} of it", subject.cost.key));
        }
    } else {
        differing.push(format!("{}: {}", again.status, again.reason));
    }
    AuditedRow {
        point: row.point.clone(),
        repetition: row.repetition,
        cost_ratio: if cost_ratio.is_finite() {
            cost_ratio
        } else {
            0.0
        },
        differing,
    }
}

/// Figures that should repeat and do not, with both values.
fn differences(subject: &Subject, then: &PointFigures, now: &PointFigures) -> Vec<String> {
    let keys = subject.exact.iter().chain([&subject.error.key]);
    let mut found: Vec<String> = keys
        .filter_map(|key| {
            let (then, now) = (then.metrics.get(*key), now.metrics.get(*key));
            let is_equal = then.map(|v| v.to_bits()) == now.map(|v| v.to_bits());
            let said = |value: Option<&f64>| value.map_or("nothing".to_owned(), f64::to_string);
            (!is_equal).then(|| format!("{key} was {}, is {}", said(then), said(now)))
        })
        .collect();
    let bits = |figures: &PointFigures| -> Vec<u64> {
        figures.blocks.iter().map(|block| block.to_bits()).collect()
    };
    if bits(then) != bits(now) {
        found.push("parts of the input err differently".to_owned());
    }
    found
}
