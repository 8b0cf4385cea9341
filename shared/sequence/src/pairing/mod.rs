//! Which colour frame belongs to which depth frame, by time.
//!
//! For: a reader's view of a recording, which keeps every frame of both streams ([`pair_by_time`]), and a
//! recorder that sees the frames arrive ([`StreamingPairer`]). Not for: clocks; both streams' times are of
//! one clock, in `i64` nanoseconds ([`clock`](crate::clock) makes them so).
//!
//! Pairing by nearest stamp uses frames twice, pairing by position is off by one for ever after a lost frame
//! (hard-cases B12). Here a frame is in one pair or in none, pairs do not cross, and both frames of a pair
//! are at most a window apart: half a period is the usual window, since then no frame has two candidates.
//!
//! The two functions make the same pairs wherever the frames of each stream are more than two windows apart,
//! arrive in the order of their times, and no stream is more than 4 frames ahead of the other. With closer
//! frames (jitter, repeated stamps) the streaming one, which cannot know what comes, makes as many pairs
//! but may choose the earlier frame where a later one is nearer.

mod matching;
mod streaming;

pub use matching::{Pair, Pairing, pair_by_time};
pub use streaming::{Event, MAX_WAITING, StreamingPairer};

#[cfg(test)]
mod tests;
