//! `info`, `verify`, `recover`, `cut`: what a file holds, what it lacks, what can be made of it.

use std::path::Path;
use std::time::Duration;

use sequence::follow::Follower;
use sequence::scan::Checking;
use sequence::source::PreadFile;
use sequence::summary::Summary;
use sequence::{Contents, SequenceError};

use crate::status::StopFlag;

/// The recording in numbers, from its sealed chunks. Works on files that are being written.
pub fn info(path: &Path) -> Result<Summary, SequenceError> {
    let read = || {
        let file = PreadFile::open(path)?;
        let contents = Contents::read(&file, Checking::Marks)?;
        let description = contents
            .description
            .as_ref()
            .ok_or(SequenceError::NoDescription)?;
        Ok(Summary::of(&contents, description))
    };
    read().map_err(|error: SequenceError| error.in_file(path))
}

/// Time between two looks at a file that grows.
const FOLLOW_INTERVAL: Duration = Duration::from_millis(200);

/// Calls `show` whenever chunks were added, until the file is closed or `stop` is set. Returns the last summary,
/// `None` when not even a first chunk came.
pub fn follow(
    path: &Path,
    stop: &StopFlag,
    show: &mut dyn FnMut(&Summary),
) -> Result<Option<Summary>, SequenceError> {
    let mut follower = Follower::open(path)?;
    let mut last = None;
    loop {
        if follower.poll()? > 0
            && let Some(contents) = follower.contents()
            && let Some(description) = &contents.description
        {
            let summary = Summary::of(contents, description);
            show(&summary);
            last = Some(summary);
        }
        if follower.is_closed() || stop.is_set() {
            return Ok(last);
        }
        std::thread::sleep(FOLLOW_INTERVAL);
    }
}
