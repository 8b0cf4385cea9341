//! `glint import` of recordings of OpenNI: against the checksums of OpenNI2's own player, and on files made here.

mod files;
mod fuzz;
mod made;
mod mutate;
mod reference;

use std::path::PathBuf;

use glint::import::{ImportOptions, ImportReport, import};
use tempfile::TempDir;

/// A file and the recording that is made of it.
struct Import {
    folder: TempDir,
}

impl Import {
    fn of(bytes: &[u8]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("x.oni"), bytes).unwrap();
        Self { folder }
    }

    fn options(&self) -> ImportOptions {
        ImportOptions {
            input: self.folder.path().join("x.oni"),
            output: self.output(),
            format: None,
            rig: None,
            split: None,
            range: None,
        }
    }

    fn output(&self) -> PathBuf {
        self.folder.path().join("x.glint")
    }

    fn run(&self) -> anyhow::Result<ImportReport> {
        import(&self.options(), &mut |_, _| {})
    }
}
