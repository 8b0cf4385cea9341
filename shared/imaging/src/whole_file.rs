//! Files that appear under their name only when they are complete.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::ImagingError;

/// Distinguishes the names of files that are being written at the same time by one process.
static NEXT_PART: AtomicU64 = AtomicU64::new(0);

/// Writes `bytes` beside `path`, syncs and renames: `path` holds its old content, or all of the new one.
/// On error the part beside it is removed.
pub fn write_whole_file(path: &Path, bytes: &[u8]) -> Result<(), ImagingError> {
    let io = |source| ImagingError::Io {
        path: path.to_path_buf(),
        source,
    };
    let part = part_beside(path).ok_or_else(|| io(std::io::ErrorKind::InvalidInput.into()))?;
    let written = write_and_sync(&part, bytes).and_then(|()| fs::rename(&part, path));
    if let Err(source) = written {
        // The first error is the one to report; the part may not even exist.
        let _ = fs::remove_file(&part);
        return Err(io(source));
    }
    sync_folder(path).map_err(io)
}

fn part_beside(path: &Path) -> Option<PathBuf> {
    let number = NEXT_PART.fetch_add(1, Ordering::Relaxed);
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name()?);
    name.push(format!(".{}-{number}.part", std::process::id()));
    Some(path.with_file_name(name))
}

fn write_and_sync(part: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create_new(part)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Makes the rename itself durable.
fn sync_folder(path: &Path) -> std::io::Result<()> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}
