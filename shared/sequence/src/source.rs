//! Where bytes of a recording come from: a map, or `pread` for tools that must survive a file that shrinks.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use rustix::fs::{SeekFrom, seek};
use rustix::io::Errno;

use crate::error::SequenceError;
use crate::map::LockedMap;

/// Bytes at offsets.
pub trait ByteSource {
    /// Length in bytes, now.
    fn byte_count(&self) -> io::Result<u64>;
    /// Fills the beginning of `buffer` with the bytes at `offset`; returns how many, 0 at the end.
    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize>;
    /// The first offset from `offset` on that may hold anything but zeros; `None` when all the rest is a hole.
    fn next_data(&self, offset: u64) -> Option<u64> {
        Some(offset)
    }

    /// Exactly `buffer.len()` bytes, or `None` when the source ends before.
    fn read_exact_at(&self, mut offset: u64, mut buffer: &mut [u8]) -> io::Result<Option<()>> {
        while !buffer.is_empty() {
            match self.read_at(offset, buffer) {
                Ok(0) => return Ok(None),
                Ok(count) => {
                    buffer = &mut buffer[count..];
                    offset += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Some(()))
    }
}

impl ByteSource for [u8] {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        let start = usize::try_from(offset)
            .unwrap_or(usize::MAX)
            .min(self.len());
        let count = buffer.len().min(self.len() - start);
        buffer[..count].copy_from_slice(&self[start..start + count]);
        Ok(count)
    }
}

impl ByteSource for LockedMap {
    fn byte_count(&self) -> io::Result<u64> {
        self.bytes().byte_count()
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        self.bytes().read_at(offset, buffer)
    }
}

/// A file read with `pread`, without a lock.
#[derive(Debug)]
pub struct PreadFile(File);

impl PreadFile {
    /// Opens a regular file.
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        // Asked before opening: a pipe would block.
        if !std::fs::metadata(path)?.is_file() {
            return Err(SequenceError::NotAFile);
        }
        Ok(Self(File::open(path)?))
    }
}

impl ByteSource for PreadFile {
    fn byte_count(&self) -> io::Result<u64> {
        Ok(self.0.metadata()?.len())
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read_at(buffer, offset)
    }

    fn next_data(&self, offset: u64) -> Option<u64> {
        match seek(&self.0, SeekFrom::Data(offset)) {
            Ok(data) => Some(data),
            Err(Errno::NXIO) => None,
            // A file system that does not know its holes.
            Err(_) => Some(offset),
        }
    }
}
