//! The run folder: where every stage keeps its outputs, written beside and renamed.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};

use crate::clock::Cost;

/// A run folder on disk.
#[derive(Clone, Debug)]
pub struct RunFolder {
    root: PathBuf,
}

/// `manifest.json`: what was made from what.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of glint that wrote the folder.
    pub glint_version: String,
    /// Path of the recording as it was given.
    pub recording: PathBuf,
    /// Hash of the recording's contents.
    pub recording_hash: String,
    /// Profile.
    pub profile: String,
    /// Newest stage that ended.
    pub newest_stage: String,
    /// Cost of every stage, in order of name.
    pub stages: BTreeMap<String, Cost>,
    /// Worker threads.
    pub threads: usize,
}

impl RunFolder {
    /// Makes a new folder; refuses one that already holds a run unless `overwrite`.
    pub fn create(root: &Path, overwrite: bool) -> anyhow::Result<Self> {
        let manifest = root.join("manifest.json");
        if manifest.exists() && !overwrite {
            bail!(
                "{} already holds a run: give another folder with -o, or --overwrite to replace it",
                root.display()
            );
        }
        std::fs::create_dir_all(root)
            .with_context(|| format!("cannot make the run folder {}", root.display()))?;
        if manifest.exists() {
            std::fs::remove_file(&manifest)?;
        }
        let folder = Self {
            root: root.to_path_buf(),
        };
        folder.write("log.jsonl", b"")?;
        Ok(folder)
    }

    /// Opens a folder that holds a run.
    pub fn open(root: &Path) -> anyhow::Result<Self> {
        if !root.join("manifest.json").exists() {
            bail!(
                "{} holds no finished run (manifest.json is missing); make one with `glint train`",
                root.display()
            );
        }
        Ok(Self {
            root: root.to_path_buf(),
        })
    }

    /// The path of a file inside.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Writes a file under its final name in one step: beside, sync, rename.
    pub fn write(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        write_atomically(&self.path(name), bytes)
    }

    /// Writes a value as JSON.
    pub fn write_json<T: Serialize>(&self, name: &str, value: &T) -> anyhow::Result<()> {
        let mut text = serde_json::to_string_pretty(value)?;
        text.push('\n');
        self.write(name, text.as_bytes())
    }

    /// Reads a JSON file of the folder.
    pub fn read_json<T: for<'de> Deserialize<'de>>(&self, name: &str) -> anyhow::Result<T> {
        let path = self.path(name);
        let text = std::fs::read_to_string(&path)
            .with_context(|| format!("cannot read {}: is this a finished run?", path.display()))?;
        serde_json::from_str(&text)
            .with_context(|| format!("{} does not hold what it should", path.display()))
    }

    /// The manifest.
    pub fn manifest(&self) -> anyhow::Result<Manifest> {
        self.read_json("manifest.json")
    }

    /// Appends one event to `log.jsonl`.
    pub fn log(&self, event: &serde_json::Value) -> anyhow::Result<()> {
        let mut file = std::fs::OpenOptions::new()
            .append(true)
            .create(true)
            .open(self.path("log.jsonl"))?;
        writeln!(file, "{event}")?;
        Ok(())
    }
}

/// Writes `bytes` to `path` so that no partial file ever has that name. Makes the folder.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let mut file = tempfile::NamedTempFile::new_in(folder)
        .with_context(|| format!("cannot write in {}", folder.display()))?;
    file.write_all(bytes)
        .with_context(|| format!("cannot write {}", path.display()))?;
    file.as_file().sync_data()?;
    // A temporary file is private; results are not.
    rustix::fs::fchmod(file.as_file(), rustix::fs::Mode::from_raw_mode(0o644))?;
    file.persist(path)
        .with_context(|| format!("cannot write {}", path.display()))?;
    Ok(())
}
