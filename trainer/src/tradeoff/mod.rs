//! `glint tradeoff`: what accuracy costs in time, measured (effects-and-tradeoffs B).
//!
//! One knob at a time is turned around a default. Every point is run in a process of its own, several times, in
//! an order drawn anew for each repetition; what was run is durable and never run again; what failed stays.
//!
//! Map: [`subject`] knobs, axes and points as data · [`codec`] what recordings cost · [`fusion`] what tracking and
//! fusing live cost · [`srm`] what the map of the room costs · [`render`] what drawing costs · [`audit`] rows that are
//! run again · `child` a process and its cost · `journal` `points.jsonl` · [`front`] the Pareto front ·
//! `result` all runs of a point together · `table`, `plot`, `page` CSV, SVG and HTML · [`machine`] where it ran.

pub mod audit;
mod child;
pub mod codec;
pub mod front;
pub mod fusion;
mod journal;
pub mod machine;
mod page;
mod plot;
pub mod render;
mod result;
pub mod srm;
pub mod subject;
mod table;
#[cfg(test)]
mod tests;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::Context as _;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_pcg::Pcg64;

pub use self::child::{ChildCost, PointStatus};
pub use self::journal::{Beginning, PointRecord};
pub use self::result::{Measurement, PointResult};

use self::journal::{Journal, counting};
use self::machine::{Machine, utc_now};
use self::subject::{Point, PointFigures, PointRunner};
use crate::progress::Progress;
use crate::run_folder::write_atomically;

/// How a subject is measured.
#[derive(Clone, Debug)]
pub struct TradeoffOptions {
    /// Folder for the results.
    pub output: PathBuf,
    /// Name of the input.
    pub scene: String,
    /// BLAKE3 of the input.
    pub scene_blake3: String,
    /// The program that runs the points.
    pub program: PathBuf,
    /// Times that every point is run.
    pub repetitions: u32,
    /// Seed of the order and of the bootstrap.
    pub seed: u64,
    /// A point may take this long.
    pub timeout: Duration,
}

/// Measures what is missing and writes `<subject>.csv`, `.svg` and `.html` in the output folder.
///
/// # Errors
/// When the folder holds another measurement, cannot be written, or a signal came; what was run until then is
/// kept, and the results are of that.
pub fn measure(
    runner: &dyn PointRunner,
    options: &TradeoffOptions,
    progress: &Progress,
) -> anyhow::Result<Measurement> {
    let subject = runner.subject();
    let points = subject.points();
    let beginning = Beginning {
        subject: subject.name.to_owned(),
        scene: options.scene.clone(),
        scene_blake3: options.scene_blake3.clone(),
        program_blake3: hash_of(&options.program)?,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        commit: option_env!("GLINT_COMMIT").unwrap_or("unknown").to_owned(),
        machine: Machine::here(),
        seed: options.seed,
        repetitions: options.repetitions,
        grid: points.iter().map(|point| point.name.clone()).collect(),
    };
    let mut journal = Journal::open(&options.output, &beginning)?;
    progress.stage(subject.name);
    let ran = run_missing(runner, &points, options, &mut journal, progress);
    let measurement = Measurement::of(subject, journal.beginning().clone(), journal.records())
        .with_audits(journal.audits());
    // Also when it was stopped: what there is can be looked at.
    write_results(&measurement, &options.output)?;
    ran.map(|()| measurement)
}

/// Runs every point of every repetition that the journal lacks.
fn run_missing(
    runner: &dyn PointRunner,
    points: &[Point],
    options: &TradeoffOptions,
    journal: &mut Journal,
    progress: &Progress,
) -> anyhow::Result<()> {
    let total = points.len() * options.repetitions as usize;
    let mut done = 0;
    for repetition in 0..options.repetitions {
        let mut order: Vec<&Point> = points.iter().collect();
        let seed = options.seed.wrapping_add(u64::from(repetition));
        order.shuffle(&mut Pcg64::seed_from_u64(seed));
        for point in order {
            let key = (point.name.clone(), repetition);
            let found = counting(journal.records()).get(&key).copied().cloned();
            if found.is_none() {
                let record = run_point(runner, point, repetition, options, journal, false)?;
                let is_disturbed = record.is_disturbed();
                journal.push(record)?;
                if is_disturbed {
                    let record = run_point(runner, point, repetition, options, journal, true)?;
                    journal.push(record)?;
                }
            } else if found.is_some_and(|r| r.is_disturbed() && !r.is_second_try) {
                let record = run_point(runner, point, repetition, options, journal, true)?;
                journal.push(record)?;
            }
            done += 1;
            progress.step(done, total);
        }
    }
    Ok(())
}

fn run_point(
    runner: &dyn PointRunner,
    point: &Point,
    repetition: u32,
    options: &TradeoffOptions,
    journal: &Journal,
    is_second_try: bool,
) -> anyhow::Result<PointRecord> {
    crate::interrupt::check()?;
    let desk = tempfile::Builder::new()
        .prefix(".point-")
        .tempdir_in(&options.output)
        .with_context(|| format!("cannot write in {}", options.output.display()))?;
    let command = runner.command(&point.setting, desk.path())?;
    let words = words_of(&command, desk.path());
    let started_utc = utc_now();
    let ended = child::run(command, desk.path(), options.timeout)?;
    let (mut status, mut reason) = (ended.status, ended.reason);
    let mut figures = PointFigures::default();
    if status == PointStatus::Ok {
        match runner.figures(&ended.last_line, desk.path(), ended.cost.core_s()) {
            Ok(found) => figures = found,
            Err(error) => (status, reason) = (PointStatus::Failed, format!("{error:#}")),
        }
    }
    Ok(PointRecord {
        point: point.name.clone(),
        setting: point.setting.clone(),
        repetition,
        order: journal.records().len(),
        is_second_try,
        status,
        reason,
        cost: ended.cost,
        figures,
        started_utc,
        command: words,
        log_blake3: blake3::hash(ended.last_line.as_bytes())
            .to_hex()
            .to_string(),
        log: ended.last_line,
    })
}

/// Program and arguments; of the program only its name and of what is in `desk` the name there, since folders are of
/// one machine.
fn words_of(command: &Command, desk: &Path) -> Vec<String> {
    let program = Path::new(command.get_program()).file_name();
    let argument = |word: &OsStr| {
        let inside = Path::new(word).strip_prefix(desk);
        inside.map_or_else(|_| word.to_owned(), |inside| inside.as_os_str().to_owned())
    };
    program
        .map(OsStr::to_owned)
        .into_iter()
        .chain(command.get_args().map(argument))
        .map(|word| word.to_string_lossy().into_owned())
        .collect()
}

/// Whether a measurement of `subject` is in `folder`.
pub fn has_table(folder: &Path, subject: &str) -> bool {
    journal::journal_path(folder, subject).is_file()
}

/// A short name of recording and program together.
///
/// # Errors
/// When the program cannot be read.
pub fn program_key(options: &TradeoffOptions) -> anyhow::Result<String> {
    let both = format!("{}\n{}", options.scene_blake3, hash_of(&options.program)?);
    Ok(machine::short_hash(both.as_bytes()))
}

fn hash_of(path: &Path) -> anyhow::Result<String> {
    let bytes = std::fs::read(path)
        .with_context(|| format!("cannot read the program {}", path.display()))?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}

fn write_results(measurement: &Measurement, folder: &Path) -> anyhow::Result<()> {
    let name = |ending: &str| folder.join(format!("{}.{ending}", measurement.subject.name));
    let svg = plot::svg(measurement);
    write_atomically(&name("csv"), table::csv(measurement).as_bytes())?;
    write_atomically(&name("svg"), svg.as_bytes())?;
    write_atomically(&name("html"), page::html(measurement, &svg).as_bytes())
}
