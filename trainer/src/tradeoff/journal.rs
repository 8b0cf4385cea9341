//! `points.jsonl`: one line a run, durable before the next begins, so that a measurement goes on where it stopped.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::audit::AuditRecord;
use super::child::{ChildCost, PointStatus};
use super::machine::Machine;
use super::subject::{PointFigures, Setting};

/// What all runs of a measurement share; the first line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beginning {
    /// Subject.
    pub subject: String,
    /// Name of the input.
    pub scene: String,
    /// BLAKE3 of the input.
    pub scene_blake3: String,
    /// BLAKE3 of the program that runs the points.
    pub program_blake3: String,
    /// Version of the program.
    pub version: String,
    /// Commit that the program was built from, where the build said so.
    pub commit: String,
    /// The machine.
    pub machine: Machine,
    /// Seed of the order and of the bootstrap.
    pub seed: u64,
    /// Times that every point is run.
    pub repetitions: u32,
    /// Names of all points.
    pub grid: Vec<String>,
}

/// One run of one point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointRecord {
    /// Name of the point.
    pub point: String,
    /// All levels.
    pub setting: Setting,
    /// From 0.
    pub repetition: u32,
    /// Counts all runs of the measurement, from 0.
    pub order: usize,
    /// The run before it was disturbed, and this one counts in its place.
    pub is_second_try: bool,
    /// How it ended.
    pub status: PointStatus,
    /// Why, where it did not end well.
    pub reason: String,
    /// What it cost from outside.
    pub cost: ChildCost,
    /// What it found.
    pub figures: PointFigures,
    /// When it began.
    pub started_utc: String,
    /// Program and arguments.
    pub command: Vec<String>,
    /// The last line of its output, from which the figures were read.
    pub log: String,
    /// BLAKE3 of that line: a record without is not drawn.
    pub log_blake3: String,
}

impl PointRecord {
    /// Whether the host took so much time away that the run says little.
    pub fn is_disturbed(&self) -> bool {
        self.cost.steal_fraction > 0.05
    }

    /// Whether the record still is what the process said.
    pub fn is_genuine(&self) -> bool {
        self.log_blake3 == blake3::hash(self.log.as_bytes()).to_hex().as_str()
    }
}

/// The file.
#[derive(Debug)]
pub(super) struct Journal {
    file: File,
    path: PathBuf,
    /// As it was written when the measurement began, perhaps by an older build.
    beginning: Beginning,
    records: Vec<PointRecord>,
    audits: Vec<AuditRecord>,
}

/// Event of a line that holds an audit.
const AUDIT_EVENT: &str = "audit";

/// Name of the file in the output folder, before which the subject stands.
pub(super) fn journal_path(folder: &Path, subject: &str) -> PathBuf {
    folder.join(format!("{subject}.points.jsonl"))
}

impl Journal {
    /// Opens the journal of `beginning` in `folder`, or begins it. A torn last line is cut off: that run was not
    /// finished.
    ///
    /// # Errors
    /// When the file is of another measurement, damaged, or cannot be written.
    pub(super) fn open(folder: &Path, beginning: &Beginning) -> anyhow::Result<Self> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make {}", folder.display()))?;
        let path = journal_path(folder, &beginning.subject);
        Self::read(path, Some(beginning))
    }

    /// Opens the journal of `subject` in `folder`, which is there.
    ///
    /// # Errors
    /// When it is not, is damaged, or cannot be written.
    pub(super) fn reopen(folder: &Path, subject: &str) -> anyhow::Result<Self> {
        let path = journal_path(folder, subject);
        if !path.is_file() {
            bail!(
                "{} is not there: `glint tradeoff {subject}` writes it",
                path.display()
            );
        }
        Self::read(path, None)
    }

    fn read(path: PathBuf, wanted: Option<&Beginning>) -> anyhow::Result<Self> {
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(wanted.is_some())
            .truncate(false)
            .open(&path)
            .with_context(|| format!("cannot write {}", path.display()))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        let whole = bytes
            .iter()
            .rposition(|byte| *byte == b'\n')
            .map_or(0, |at| at + 1);
        file.set_len(whole as u64)?;
        file.seek(SeekFrom::Start(whole as u64))?;
        let text = std::str::from_utf8(&bytes[..whole])
            .with_context(|| format!("{} is no text", path.display()))?;
        let mut lines = text.lines();
        let first: Option<Beginning> = lines.next().map(|line| parse(&path, line)).transpose()?;
        let is_new = first.is_none();
        if let (Some(begun), Some(wanted)) = (&first, wanted) {
            require(&path, begun, wanted)?;
        }
        let Some(beginning) = first.or_else(|| wanted.cloned()) else {
            bail!("{} is empty: nothing was measured", path.display());
        };
        let mut journal = Self {
            file,
            path,
            beginning,
            records: Vec::new(),
            audits: Vec::new(),
        };
        if is_new {
            journal.append("begin", &serde_json::to_value(&journal.beginning)?)?;
        }
        for line in lines {
            let event: Value = parse(&journal.path, line)?;
            if event["event"] == AUDIT_EVENT {
                journal.audits.push(parse(&journal.path, line)?);
            } else {
                journal.records.push(parse(&journal.path, line)?);
            }
        }
        Ok(journal)
    }

    /// What the measurement began with: runs belong to that version and commit, not to those that go on with it.
    pub(super) fn beginning(&self) -> &Beginning {
        &self.beginning
    }

    /// The runs so far.
    pub(super) fn records(&self) -> &[PointRecord] {
        &self.records
    }

    /// The audits so far.
    pub(super) fn audits(&self) -> &[AuditRecord] {
        &self.audits
    }

    /// Adds an audit and makes it durable.
    pub(super) fn push_audit(&mut self, record: AuditRecord) -> anyhow::Result<()> {
        self.append(AUDIT_EVENT, &serde_json::to_value(&record)?)?;
        self.audits.push(record);
        Ok(())
    }

    /// Adds a run and makes it durable.
    pub(super) fn push(&mut self, record: PointRecord) -> anyhow::Result<()> {
        self.append("point", &serde_json::to_value(&record)?)?;
        self.records.push(record);
        Ok(())
    }

    fn append(&mut self, event: &str, value: &Value) -> anyhow::Result<()> {
        let mut line = json!({"event": event});
        if let (Some(line), Some(value)) = (line.as_object_mut(), value.as_object()) {
            line.extend(value.clone());
        }
        let write = || -> std::io::Result<()> {
            let mut file = &self.file;
            file.write_all(format!("{line}\n").as_bytes())?;
            file.sync_data()
        };
        write().with_context(|| format!("cannot write {}", self.path.display()))
    }
}

fn parse<T: for<'de> Deserialize<'de>>(path: &Path, line: &str) -> anyhow::Result<T> {
    serde_json::from_str(line).with_context(|| {
        format!(
            "{} has a line that is not ours: move the file away to begin anew",
            path.display()
        )
    })
}

fn require(path: &Path, begun: &Beginning, wanted: &Beginning) -> anyhow::Result<()> {
    let differing = [
        ("recording", begun.scene_blake3 != wanted.scene_blake3),
        ("program", begun.program_blake3 != wanted.program_blake3),
        ("machine", begun.machine != wanted.machine),
        ("seed", begun.seed != wanted.seed),
        (
            "number of repetitions",
            begun.repetitions != wanted.repetitions,
        ),
        ("grid", begun.grid != wanted.grid),
    ];
    if let Some((what, _)) = differing.iter().find(|(_, differs)| *differs) {
        bail!(
            "{} was begun with another {what}: runs of the two do not compare; give another folder with -o",
            path.display()
        );
    }
    Ok(())
}

/// The run that counts for each repetition of each point: the last one.
pub(super) fn counting(records: &[PointRecord]) -> BTreeMap<(String, u32), &PointRecord> {
    records
        .iter()
        .map(|record| ((record.point.clone(), record.repetition), record))
        .collect()
}
