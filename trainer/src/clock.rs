//! Wall seconds and core-seconds of a piece of work.

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};

/// What a piece of work cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Seconds on the wall clock.
    pub wall_s: f64,
    /// Seconds of processor time over all threads of this process.
    pub core_s: f64,
}

/// Measures from its creation.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    wall: f64,
    core: f64,
}

fn seconds(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self {
            wall: seconds(ClockId::Monotonic),
            core: seconds(ClockId::ProcessCPUTime),
        }
    }

    /// Cost since the start.
    pub fn cost(&self) -> Cost {
        let now = Self::start();
        Cost {
            wall_s: now.wall - self.wall,
            core_s: now.core - self.core,
        }
    }
}
