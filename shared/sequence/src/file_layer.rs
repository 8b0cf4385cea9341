//! The calls through which a recording reaches the disk: one trait, so that a test can make any of them fail.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt as _, OpenOptionsExt as _};
use std::path::Path;

use rustix::fs::{Advice, FallocateFlags, FlockOperation, fadvise, fallocate, flock, fstatfs};
use rustix::io::Errno;

use crate::error::SequenceError;
use crate::map::WriteWindow;

/// A file that is being written. Offsets and lengths are in bytes. Calls may fail, be interrupted
/// ([`io::ErrorKind::Interrupted`]) or do less than asked, as those of the operating system.
pub trait FileLayer: Send {
    /// Makes the file at least `offset + bytes` long, with space for `offset..offset + bytes` where the file
    /// system can promise it.
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()>;
    /// Stores the first bytes of `bytes` at `offset`, inside what was allocated; returns how many.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize>;
    /// Returns when `offset..offset + bytes` is durable.
    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()>;
    /// What makes stretches of this file durable while others are stored here; `None` where only [`FileLayer::sync`]
    /// does.
    fn syncer(&self) -> io::Result<Option<Box<dyn Syncer>>> {
        Ok(None)
    }
    /// Cuts the file to `bytes` and makes its length durable.
    fn set_len(&mut self, bytes: u64) -> io::Result<()>;
    /// Bytes that this user can still write to the file system.
    fn free_bytes(&mut self) -> io::Result<u64>;
    /// `offset..offset + bytes` will be synced before long: the system may begin to write it, and nobody waits. So a
    /// sync has less to do, and what is to be stored meanwhile waits less.
    fn begin_writing(&mut self, _offset: u64, _bytes: u64) {}
    /// Everything before `offset` is durable and will not be written again: its memory can go.
    fn release_before(&mut self, offset: u64);
}

/// Waits for the disk in a thread of its own.
pub trait Syncer: Send {
    /// As [`FileLayer::sync`]; nobody stores to `offset..offset + bytes` meanwhile.
    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()>;
}

/// How bytes reach the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WritePath {
    /// `pwrite` calls: no fault for each page, nothing to be made read-only before it is written (docs/performance.md has
    /// the figures).
    #[default]
    Pwrite,
    /// Stores into a map of the reserved space, where `fallocate` is a promise (ext4, XFS); elsewhere `pwrite`.
    Mapped,
}

/// Creates `path`, which must not exist, and locks it for its writer.
pub fn create(path: &Path, write_path: WritePath) -> Result<Box<dyn FileLayer>, SequenceError> {
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create_new(true)
        .mode(0o666)
        .open(path)?;
    layer_of(file, write_path)
}

/// Locks `file`, which is new and empty, and writes to it.
pub fn layer_of(file: File, write_path: WritePath) -> Result<Box<dyn FileLayer>, SequenceError> {
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => {}
        Err(Errno::WOULDBLOCK) => return Err(SequenceError::Busy),
        Err(error) => return Err(SequenceError::Io(error.into())),
    }
    let file = LockedFile(file);
    let is_mapped = write_path == WritePath::Mapped && reservation_is_a_promise(&file)?;
    Ok(if is_mapped {
        Box::new(MappedFile {
            file,
            end: 0,
            released: 0,
            window: None,
        })
    } else {
        Box::new(PlainFile { file, released: 0 })
    })
}

/// File systems on which a block that `fallocate` gave can always be written: they do not copy on write, do
/// not compress and charge quotas at once. Elsewhere a full disk would be a SIGBUS.
fn reservation_is_a_promise(file: &File) -> io::Result<bool> {
    const EXT4: u64 = 0xEF53;
    const XFS: u64 = 0x5846_5342;
    let kind = fstatfs(file)?.f_type as u64;
    Ok(kind == EXT4 || kind == XFS)
}

/// The file of a writer, with its lock.
#[derive(Debug)]
struct LockedFile(File);

impl Drop for LockedFile {
    fn drop(&mut self) {
        // Not left to closing: a process that is being started holds copies of all files for a moment. A lock
        // that cannot be given back goes with the last copy.
        let _ = flock(&self.0, FlockOperation::Unlock);
    }
}

impl std::ops::Deref for LockedFile {
    type Target = File;

    fn deref(&self) -> &File {
        &self.0
    }
}

/// Writes through a map of reserved space.
#[derive(Debug)]
struct MappedFile {
    /// Dropped before the lock.
    window: Option<WriteWindow>,
    file: LockedFile,
    /// Reserved up to here.
    end: u64,
    /// The window begins here.
    released: u64,
}

impl FileLayer for MappedFile {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        fallocate(&*self.file, FallocateFlags::empty(), offset, bytes)?;
        self.end = self.end.max(offset + bytes);
        Ok(())
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let count = bytes.len() as u64;
        let held = |window: &WriteWindow| window.holds(offset, count);
        if !self.window.as_ref().is_some_and(held) {
            self.window = None;
            self.window = Some(WriteWindow::new(&self.file, self.released, self.end)?);
        }
        let is_stored = self
            .window
            .as_mut()
            .is_some_and(|window| window.store(offset, bytes));
        if is_stored {
            Ok(bytes.len())
        } else {
            Err(io::ErrorKind::InvalidInput.into())
        }
    }

    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        match &self.window {
            Some(window) => window.sync(offset, bytes),
            None => self.file.sync_data(),
        }
    }

    fn syncer(&self) -> io::Result<Option<Box<dyn Syncer>>> {
        Ok(Some(Box::new(MappedSyncer(self.file.try_clone()?))))
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        self.window = None;
        self.file.set_len(bytes)?;
        self.end = bytes;
        self.file.sync_all()
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        free_bytes(&self.file)
    }

    fn begin_writing(&mut self, offset: u64, bytes: u64) {
        // Pages that are mapped are made read-only one by one before they are written, and each time all processors are
        // told; a map that is gone costs one such message.
        self.window = None;
        forget(&self.file, offset, offset.saturating_add(bytes));
    }

    fn release_before(&mut self, offset: u64) {
        self.window = None;
        forget(&self.file, self.released, offset);
        self.released = offset;
    }
}

/// Syncs what is stored through maps, by a map of its own: only that asks the system for a stretch of a file.
struct MappedSyncer(File);

impl Syncer for MappedSyncer {
    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        WriteWindow::new(&self.0, offset, offset.saturating_add(bytes))?.sync(offset, bytes)
    }
}

/// Writes through `pwrite`.
#[derive(Debug)]
struct PlainFile {
    file: LockedFile,
    released: u64,
}

impl FileLayer for PlainFile {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        match fallocate(&*self.file, FallocateFlags::empty(), offset, bytes) {
            // No reservation to be had: the write itself will say when the disk is full.
            Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(()),
            result => Ok(result?),
        }
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        self.file.write_at(bytes, offset)
    }

    fn sync(&mut self, _offset: u64, _bytes: u64) -> io::Result<()> {
        self.file.sync_data()
    }

    fn syncer(&self) -> io::Result<Option<Box<dyn Syncer>>> {
        Ok(Some(Box::new(PlainSyncer(self.file.try_clone()?))))
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)?;
        self.file.sync_all()
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        free_bytes(&self.file)
    }

    fn begin_writing(&mut self, offset: u64, bytes: u64) {
        forget(&self.file, offset, offset.saturating_add(bytes));
    }

    fn release_before(&mut self, offset: u64) {
        forget(&self.file, self.released, offset);
        self.released = offset;
    }
}

/// Syncs what is stored through `pwrite`: all of it.
struct PlainSyncer(File);

impl Syncer for PlainSyncer {
    fn sync(&mut self, _offset: u64, _bytes: u64) -> io::Result<()> {
        self.0.sync_data()
    }
}

fn free_bytes(file: &File) -> io::Result<u64> {
    let stat = rustix::fs::fstatvfs(file)?;
    Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
}

/// Takes durable pages out of the cache of the system: an hour of recording would fill it. Linux begins to write those
/// that are not durable, without waiting, and keeps them.
fn forget(file: &File, start: u64, end: u64) {
    if let Some(bytes) = std::num::NonZeroU64::new(end.saturating_sub(start)) {
        // Advice: a system that cannot follow it keeps the pages.
        let _ = fadvise(file, start, Some(bytes), Advice::DontNeed);
    }
}

/// Calls again as long as a signal interrupts.
pub(crate) fn uninterrupted<T>(mut call: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match call() {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

/// Stores all of `bytes` at `offset`.
pub(crate) fn write_all(
    layer: &mut dyn FileLayer,
    mut offset: u64,
    mut bytes: &[u8],
) -> io::Result<()> {
    while !bytes.is_empty() {
        match uninterrupted(|| layer.write_at(offset, bytes))? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            count => {
                offset += count as u64;
                bytes = &bytes[count.min(bytes.len())..];
            }
        }
    }
    Ok(())
}
