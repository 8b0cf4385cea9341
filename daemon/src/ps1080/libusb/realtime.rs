//! The thread that reads from the camera runs before all others where the system lets it.

/// Priority: what the unit grants (`LimitRTPRIO=30`).
const PRIORITY: i32 = 30;

/// Asks for it, for the calling thread alone: threads that it starts do not inherit it. Whether it was granted; without it
/// a busy machine may lose packets.
#[expect(
    unsafe_code,
    reason = "a call of the C library that no crate of the house wraps"
)]
pub(super) fn ask() -> bool {
    // SAFETY: the structure is plain numbers, for which zero is a value.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = PRIORITY;
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
