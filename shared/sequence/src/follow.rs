//! Reading a file while it is written.

use std::path::{Path, PathBuf};

use crate::checksum::Beginning;
use crate::contents::Contents;
use crate::error::SequenceError;
use crate::scan::{Checking, Scanner, beginning};
use crate::source::PreadFile;

/// Follows a recording as far as it is committed. Reads with `pread` and without a lock, so that it neither
/// disturbs the writer nor dies when the file is cut.
#[derive(Debug)]
pub struct Follower {
    path: PathBuf,
    file: PreadFile,
    /// `None` until the first page is there.
    contents: Option<Contents>,
    position: (u64, u64),
}

impl Follower {
    /// Opens a file, which may still be empty.
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        Ok(Self {
            path: path.to_path_buf(),
            file: PreadFile::open(path).map_err(|error| error.in_file(path))?,
            contents: None,
            position: (crate::layout::PAGE, 0),
        })
    }

    /// Reads the chunks that were committed since the last call; returns how many.
    pub fn poll(&mut self) -> Result<usize, SequenceError> {
        self.poll_here().map_err(|error| error.in_file(&self.path))
    }

    fn poll_here(&mut self) -> Result<usize, SequenceError> {
        let contents = match &mut self.contents {
            Some(contents) => contents,
            None => match beginning(&self.file)? {
                Beginning::Recording(file_id) => self.contents.insert(Contents::new(file_id)),
                Beginning::OtherVersion => return Err(SequenceError::OtherVersion),
                // The first page may be half written.
                Beginning::Damaged | Beginning::Foreign => return Ok(0),
            },
        };
        let mut scanner = Scanner::of_file(&self.file, contents.file_id, Checking::Marks)?;
        scanner.go_on_from(self.position);
        let mut count = 0;
        while let Some(chunk) = scanner.next_committed()? {
            contents.add(&scanner, &chunk)?;
            count += 1;
        }
        if count > 0 {
            contents.sort();
        }
        self.position = scanner.position();
        Ok(count)
    }

    /// What was committed so far; `None` before the first page.
    pub fn contents(&self) -> Option<&Contents> {
        self.contents.as_ref()
    }

    /// Whether the writer has closed the file.
    pub fn is_closed(&self) -> bool {
        self.contents
            .as_ref()
            .is_some_and(|contents| contents.end.is_some())
    }

    /// The file that is followed, for reading frames.
    pub fn source(&self) -> &PreadFile {
        &self.file
    }
}
