//! Device time: counters that wrap made into nanoseconds, and the line from device time to host time.
//!
//! For: the second of a frame's three times (raw counter, unwrapped device time, host arrival), and for
//! comparing two devices by the host's clock. Not for: reading a clock; whoever reads the device passes
//! the numbers in.
//!
//! Map: [`TickUnwrapper`] raw ticks to nanoseconds since the first one · [`ClockFit`] (device, host) pairs
//! to a [`ClockLine`].
//!
//! Host times are those of a clock that never steps back (`CLOCK_MONOTONIC`), in nanoseconds. All times are
//! `i64` nanoseconds: a float loses frames (`f32` seconds resolve 31 ms after 100 h). Nothing here
//! allocates after it was made, and no number makes it panic.

mod fit;
mod ticks;

pub use fit::{ClockFit, ClockLine};
pub use ticks::{TickUnwrapper, Unwrapped};

#[cfg(test)]
mod tests;
