//! The format from outside: round trip, damage, faults of the disk, crashes.

mod round_trip;
mod small;
