//! Where the built library is, for tests that run programs with it.

use std::io;
use std::path::{Path, PathBuf};

/// Name under which programs look for libusb.
pub const LIBUSB_NAME: &str = "libusb-1.0.so.0";
const BUILT_NAME: &str = "libusb_lookalike.so";

/// The library of this build: beside the running test, or one folder up, where cargo puts what it was asked for.
pub fn find() -> Option<PathBuf> {
    let test = std::env::current_exe().ok()?;
    let folders = test.ancestors().skip(1).take(2);
    folders
        .map(|folder| folder.join(BUILT_NAME))
        .find(|library| library.is_file())
}

/// Puts the library into `folder`, which then belongs first into `LD_LIBRARY_PATH`.
///
/// # Errors
/// Where it has not been built, or the folder takes no link.
pub fn put_into(folder: &Path) -> io::Result<()> {
    let library = find().ok_or_else(|| io::Error::other(format!("{BUILT_NAME} is not built")))?;
    std::os::unix::fs::symlink(library, folder.join(LIBUSB_NAME))
}
