//! `points.jsonl`: one line a run, durable before the next begins, so that a measurement goes on where it stopped.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

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
}

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
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
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
        let mut journal = Self {
            file,
            path,
            beginning: beginning.clone(),
            records: Vec::new(),
        };
        let mut lines = text.lines();
        match lines.next() {
            None => journal.append("begin", &serde_json::to_value(beginning)?)?,
            Some(first) => {
                let begun: Beginning = journal.parse(first)?;
                journal.require(&begun, beginning)?;
                journal.beginning = begun;
            }
        }
        for line in lines {
            let record: PointRecord = journal.parse(line)?;
            journal.records.push(record);
        }
        Ok(journal)
    }

    fn parse<T: for<'de> Deserialize<'de>>(&self, line: &str) -> anyhow::Result<T> {
        serde_json::from_str(line).with_context(|| {
            format!(
                "{} has a line that is not ours: move the file away to begin anew",
                self.path.display()
            )
        })
    }

    fn require(&self, begun: &Beginning, wanted: &Beginning) -> anyhow::Result<()> {
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
                self.path.display()
            );
        }
        Ok(())
    }

    /// What the measurement began with: runs belong to that version and commit, not to those that go on with it.
    pub(super) fn beginning(&self) -> &Beginning {
        &self.beginning
    }

    /// The runs so far.
    pub(super) fn records(&self) -> &[PointRecord] {
        &self.records
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

/// The run that counts for each repetition of each point: the last one.
pub(super) fn counting(records: &[PointRecord]) -> BTreeMap<(String, u32), &PointRecord> {
    records
        .iter()
        .map(|record| ((record.point.clone(), record.repetition), record))
        .collect()
}
