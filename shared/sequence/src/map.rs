//! The one place where a file becomes memory.

use std::fs::File;
use std::io;
use std::path::Path;

use memmap2::{Mmap, MmapMut, MmapOptions};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use crate::error::SequenceError;
use crate::layout::PAGE;

/// A file mapped for reading, under a shared lock as long as it lives.
#[derive(Debug)]
pub(crate) struct LockedMap {
    map: Mmap,
    /// Closing it gives the lock back.
    _file: File,
}

impl LockedMap {
    /// Maps a regular file. Errors when another process holds it exclusively: its writer.
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
        // behind a `&[u8]` must not change or vanish: a writer of ours holds the file exclusively while it
        // writes, so the shared lock keeps it away, and what is sealed is never written again. A program that
        // ignores advisory locks can still cut the file (SIGBUS) or change it (checksums then fail); tools
        // that must survive that read with `pread` instead.
        let map = unsafe { Mmap::map(&file) }?;
        Ok(Self { map, _file: file })
    }

    /// The whole file.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// Tells the system that pages of the map are not needed soon; they stay readable.
    pub(crate) fn release(&self) {
        #[expect(unsafe_code, reason = "the advice is marked unchecked in memmap2")]
        // SAFETY: the map is shared and backed by a file that nobody writes (above), so pages that are
        // dropped are read again from the file with the same content.
        let released = unsafe {
            self.map
                .unchecked_advise(memmap2::UncheckedAdvice::DontNeed)
        };
        // Advice: a system that cannot follow it keeps the pages.
        drop(released);
    }
}

/// A stretch of a file mapped for writing.
#[derive(Debug)]
pub(crate) struct WriteWindow {
    map: MmapMut,
    start: u64,
}

impl WriteWindow {
    /// Maps `start..end` of `file`; `start` is a multiple of a page. The caller has reserved the space on disk
    /// and holds the file's exclusive lock.
    pub(crate) fn new(file: &File, start: u64, end: u64) -> io::Result<Self> {
        let room = || io::Error::from(io::ErrorKind::InvalidInput);
        let bytes = end.checked_sub(start).ok_or_else(room)?;
        if bytes == 0 || !start.is_multiple_of(PAGE) || file.metadata()?.len() < end {
            return Err(room());
        }
        let bytes = usize::try_from(bytes).map_err(|_| room())?;
        #[expect(unsafe_code, reason = "memory-mapped writing")]
        // SAFETY: the file is at least `end` long (checked above) and its blocks are reserved with fallocate,
        // so that touching a page does not raise SIGBUS for want of space; the exclusive lock keeps other
        // writers of ours from cutting it. The memory is only ever written through `&mut self`; another window over
        // the same bytes, that of a `MappedSyncer`, is flushed and never read or written.
        let map = unsafe { MmapOptions::new().offset(start).len(bytes).map_mut(file) }?;
        // What is written is never read before: without this, each fault would read ahead.
        map.advise(memmap2::Advice::Random)?;
        Ok(Self { map, start })
    }

    /// Whether `offset..offset + bytes` lies inside.
    pub(crate) fn holds(&self, offset: u64, bytes: u64) -> bool {
        self.range(offset, bytes).is_some()
    }

    /// Stores `bytes` at `offset` of the file; false when that is outside.
    pub(crate) fn store(&mut self, offset: u64, bytes: &[u8]) -> bool {
        match self.range(offset, bytes.len() as u64) {
            Some(range) => {
                self.map[range].copy_from_slice(bytes);
                true
            }
            None => false,
        }
    }

    /// Makes `offset..offset + bytes` durable (msync).
    pub(crate) fn sync(&self, offset: u64, bytes: u64) -> io::Result<()> {
        match self.range(offset, bytes) {
            Some(range) => self.map.flush_range(range.start, range.len()),
            None => Err(io::ErrorKind::InvalidInput.into()),
        }
    }

    fn range(&self, offset: u64, bytes: u64) -> Option<std::ops::Range<usize>> {
        let start = usize::try_from(offset.checked_sub(self.start)?).ok()?;
        let end = start.checked_add(usize::try_from(bytes).ok()?)?;
        (end <= self.map.len()).then_some(start..end)
    }
}
