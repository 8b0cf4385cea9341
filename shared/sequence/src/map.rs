//! The one place where a file becomes memory.

use std::fs::File;
use std::path::Path;

use memmap2::Mmap;
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use crate::error::SequenceError;

/// A file mapped for reading, under a shared lock as long as it lives.
#[derive(Debug)]
pub(crate) struct LockedMap {
    map: Mmap,
    /// Closing it gives the lock back.
    _file: File,
}

impl LockedMap {
    /// Maps a regular file. Errors when another process holds it exclusively.
    pub(crate) fn open(path: &Path) -> Result<Self, SequenceError> {
        // Asked before opening: a pipe would block.
        if !std::fs::metadata(path)?.is_file() {
            return Err(SequenceError::NotAFile);
        }
        let file = File::open(path)?;
        match flock(&file, FlockOperation::NonBlockingLockShared) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => return Err(SequenceError::Busy),
            Err(error) => return Err(SequenceError::Io(error.into())),
        }
        #[expect(
            unsafe_code,
            reason = "a map is the only way to frame i in O(1) without copies"
        )]
        // SAFETY: the map is read-only and private to this process, and `file` stays open beside it. Memory
        // behind a `&[u8]` must not change or vanish: glint writes recordings under another name and renames
        // them, so an existing one is never changed or cut in place by us, and a program that changes files
        // in place and honours advisory locks is kept away by the shared lock. A program that ignores both
        // can still cut the file (SIGBUS) or change it (checksums then fail); that is the user's to avoid.
        let map = unsafe { Mmap::map(&file) }?;
        Ok(Self { map, _file: file })
    }

    /// The whole file.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.map
    }
}
