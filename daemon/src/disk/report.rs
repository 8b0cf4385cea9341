//! What the disk thread is told, and what it did.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use sequence::file_layer::FileLayer;
use sequence::{Gap, SequenceError};

use crate::latency::Latencies;
use crate::status::EndReason;

/// Makes the file of a path.
pub type LayerFactory = Box<dyn FnMut(&Path) -> Result<Box<dyn FileLayer>, SequenceError> + Send>;

/// When a recording goes on in another file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rotation {
    /// At this size, bytes.
    pub bytes: Option<u64>,
    /// At this age.
    pub age: Option<Duration>,
}

/// A recording that begins before it is asked for: the last frames wait in memory until the trigger.
#[derive(Clone, Debug)]
pub struct PreTrigger {
    /// So much before the trigger is kept.
    pub span: Duration,
    /// Memory that may be used for it, bytes.
    pub bytes: usize,
    /// Set when the recording is asked for.
    pub trigger: Arc<AtomicBool>,
}

/// What the disk thread did.
#[derive(Debug, Default)]
pub struct DiskReport {
    /// The files, in order.
    pub files: Vec<PathBuf>,
    /// Their bytes.
    pub bytes: u64,
    /// Frames that are in the files.
    pub frames: u64,
    /// Depth frames among them.
    pub depth_frames: u64,
    /// Frames that went before the trigger came.
    pub not_asked_for: u64,
    /// Frames that repeat their predecessor.
    pub repeats: u64,
    /// Everything that is missing.
    pub gaps: Vec<Gap>,
    /// Device times of the first and the last frame, nanoseconds.
    pub device_nanos: Option<[i64; 2]>,
    /// Time that passed to encode and store a depth frame and the colour frame of its pair, added up: they overlap.
    pub pair_wall: Latencies,
    /// The same in time of a processor.
    pub pair_core: Latencies,
    /// From the last byte of a pair until it stood in the file, for others to read.
    pub to_recorded: Latencies,
    /// Time to make a chunk durable.
    pub seals: Latencies,
    /// What ended the recording, when it was the disk.
    pub failure: Option<EndReason>,
}

impl DiskReport {
    /// Device time from the first frame to the last, seconds.
    pub fn span_s(&self) -> f64 {
        self.device_nanos
            .map_or(0.0, |[first, last]| last.saturating_sub(first) as f64 / 1e9)
    }
}
