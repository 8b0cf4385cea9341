//! The host's clocks.

use rustix::time::{ClockId, clock_gettime};

/// The host's clocks. All intervals are of the monotonic one; the wall clock is read once, for a label.
#[derive(Clone, Copy, Debug)]
pub struct HostClock {
    /// Nanoseconds that never jump.
    pub monotonic: fn() -> i64,
    /// Nanoseconds since 1970.
    pub wall: fn() -> i64,
}

impl Default for HostClock {
    fn default() -> Self {
        fn nanos(id: ClockId) -> i64 {
            let time = clock_gettime(id);
            time.tv_sec
                .saturating_mul(1_000_000_000)
                .saturating_add(time.tv_nsec)
        }
        Self {
            monotonic: || nanos(ClockId::Monotonic),
            wall: || nanos(ClockId::Realtime),
        }
    }
}
