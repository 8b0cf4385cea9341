//! What threads share of a recording: whether it ends and why, and counters.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use sequence::GapCause;

/// Why a recording ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndReason {
    /// The source has no more.
    Complete = 1,
    /// The user, or a signal.
    Stopped = 2,
    /// The time is up.
    Duration = 3,
    /// It goes on in another file.
    Part = 4,
    /// The disk is full, or down to the reserve.
    DiskFull = 5,
    /// The disk reports errors.
    DiskError = 6,
    /// The camera is gone.
    Unplugged = 7,
}

impl EndReason {
    const ALL: [Self; 7] = [
        Self::Complete,
        Self::Stopped,
        Self::Duration,
        Self::Part,
        Self::DiskFull,
        Self::DiskError,
        Self::Unplugged,
    ];

    /// The cause of gaps that this reason makes.
    pub fn gap_cause(self) -> Option<GapCause> {
        match self {
            Self::DiskFull => Some(GapCause::DiskFull),
            Self::DiskError => Some(GapCause::DiskError),
            Self::Complete | Self::Stopped | Self::Duration | Self::Part | Self::Unplugged => None,
        }
    }
}

impl fmt::Display for EndReason {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Complete => "complete",
            Self::Stopped => "stopped",
            Self::Duration => "duration",
            Self::Part => "part",
            Self::DiskFull => "disk-full",
            Self::DiskError => "disk-error",
            Self::Unplugged => "unplugged",
        })
    }
}

/// Set once, by whoever first has a reason to end.
#[derive(Clone, Debug, Default)]
pub struct StopFlag {
    reason: Arc<AtomicUsize>,
    /// Set by every signal.
    signal: Arc<AtomicBool>,
}

impl StopFlag {
    /// Ends the recording; a reason that is there already stays.
    pub fn stop(&self, reason: EndReason) {
        let _ =
            self.reason
                .compare_exchange(0, reason as usize, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Ends the recording when SIGINT or SIGTERM comes.
    pub fn stop_on_signals(&self) -> std::io::Result<()> {
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            let flag = Arc::clone(&self.reason);
            signal_hook::flag::register_usize(signal, flag, EndReason::Stopped as usize)?;
            signal_hook::flag::register(signal, Arc::clone(&self.signal))?;
        }
        Ok(())
    }

    /// Forgets the signals so far: what comes now stops what follows the recording.
    pub fn watch_for_another(&self) -> AnotherSignal {
        self.signal.store(false, Ordering::Relaxed);
        AnotherSignal(Arc::clone(&self.signal))
    }

    /// Whether the recording ends.
    pub fn is_set(&self) -> bool {
        self.reason.load(Ordering::Relaxed) != 0
    }

    /// Why, when it is set.
    pub fn reason(&self) -> Option<EndReason> {
        let number = self.reason.load(Ordering::Relaxed);
        EndReason::ALL
            .into_iter()
            .find(|reason| *reason as usize == number)
    }
}

/// Whether another signal came since this was made.
#[derive(Clone, Debug)]
pub struct AnotherSignal(Arc<AtomicBool>);

impl AnotherSignal {
    /// Whether one came.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Counters that are shown while recording. None of them decides anything.
#[derive(Debug, Default)]
pub struct Status {
    frames_in: AtomicU64,
    frames_recorded: AtomicU64,
    frames_missing: AtomicU64,
    payload_bytes: AtomicU64,
    file_bytes: AtomicU64,
    room_bytes: AtomicU64,
    ring_fill_percent: AtomicU64,
    tracked: AtomicU64,
    lost: AtomicU64,
    skipped: AtomicU64,
    effort_level: AtomicU64,
}

/// The counters at a moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct StatusNow {
    /// Frames that the source had.
    pub frames_in: u64,
    /// Frames in the file.
    pub frames_recorded: u64,
    /// Frames in gaps.
    pub frames_missing: u64,
    /// Bytes of frames in the file.
    pub payload_bytes: u64,
    /// Bytes of all files.
    pub file_bytes: u64,
    /// Bytes that the disk can still take; 0 before the first chunk.
    pub room_bytes: u64,
    /// Use of the buffer in front of the disk, percent.
    pub ring_fill_percent: u64,
    /// Frames whose pose is known.
    pub tracked: u64,
    /// Frames whose pose is not known.
    pub lost: u64,
    /// Frames that were recorded and not tracked, for want of time.
    pub skipped: u64,
    /// Steps that fusion has given way, 0 to 3.
    pub effort_level: u64,
}

impl Status {
    pub(crate) fn add_in(&self, count: u64) {
        self.frames_in.fetch_add(count, Ordering::Relaxed);
    }

    pub(crate) fn add_recorded(&self, bytes: u64) {
        self.frames_recorded.fetch_add(1, Ordering::Relaxed);
        self.payload_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    pub(crate) fn add_missing(&self, count: u64) {
        self.frames_missing.fetch_add(count, Ordering::Relaxed);
    }

    pub(crate) fn set_bytes(&self, bytes: u64, room_bytes: u64) {
        self.file_bytes.store(bytes, Ordering::Relaxed);
        self.room_bytes.store(room_bytes, Ordering::Relaxed);
    }

    pub(crate) fn set_ring_fill(&self, fraction: f64) {
        let percent = (100.0 * fraction).round() as u64;
        self.ring_fill_percent.store(percent, Ordering::Relaxed);
    }

    pub(crate) fn set_fusion(&self, tracked: u64, lost: u64, skipped: u64, effort_level: u64) {
        self.tracked.store(tracked, Ordering::Relaxed);
        self.lost.store(lost, Ordering::Relaxed);
        self.skipped.store(skipped, Ordering::Relaxed);
        self.effort_level.store(effort_level, Ordering::Relaxed);
    }

    /// The counters now.
    pub fn now(&self) -> StatusNow {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        StatusNow {
            frames_in: read(&self.frames_in),
            frames_recorded: read(&self.frames_recorded),
            frames_missing: read(&self.frames_missing),
            payload_bytes: read(&self.payload_bytes),
            file_bytes: read(&self.file_bytes),
            room_bytes: read(&self.room_bytes),
            ring_fill_percent: read(&self.ring_fill_percent),
            tracked: read(&self.tracked),
            lost: read(&self.lost),
            skipped: read(&self.skipped),
            effort_level: read(&self.effort_level),
        }
    }
}
