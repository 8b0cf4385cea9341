//! What a recording from a camera asks of the system: to run before other programs, and to stay in memory.

use rustix::mm::{MlockAllFlags, mlockall};

/// A thread between camera and disk. The nearer to the camera, the less it can wait: its memory is 64 KiB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub(crate) enum Priority {
    /// Writes, behind a ring of seconds.
    Disk = 10,
    /// Encodes, behind most of a second of frames.
    Record = 20,
    /// Puts pairs together.
    Pair = 25,
    /// Reads from the camera: what the unit grants (`LimitRTPRIO=30`).
    Source = 30,
}

impl Priority {
    /// Asks for it, for the calling thread alone: threads that it starts do not inherit it. Without it a busy machine may
    /// lose packets, and frames stand in the file later.
    pub(crate) fn ask(self) {
        if !set_fifo(self as i32) && self == Self::Source {
            tracing::info!(
                "no right to real-time priority: a busy machine may lose packets; `glintd doctor` says how to get it"
            );
        }
    }
}

/// Whether the system lets the calling thread run before all of lower priority.
#[expect(
    unsafe_code,
    reason = "a call of the C library that no crate of the house wraps"
)]
fn set_fifo(priority: i32) -> bool {
    // SAFETY: the structure is plain numbers, for which zero is a value.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = priority;
    // SAFETY: 0 is the calling thread; the structure is complete and only read.
    let code = unsafe {
        libc::sched_setscheduler(
            0,
            libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK,
            &raw const parameters,
        )
    };
    code == 0
}

/// Keeps what the program has in memory now, its own code too, from being put aside for others. Pages that were never
/// touched do not come into memory by this.
pub(crate) fn stay_in_memory() {
    if let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::ONFAULT) {
        tracing::info!(
            "memory may be swapped out ({error}): `glintd doctor` says how to get the right to lock it"
        );
    }
}
