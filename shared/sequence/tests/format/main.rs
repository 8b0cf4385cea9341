//! The format from outside: round trip, damage, faults of the disk, crashes.

mod crashes;
mod edit;
mod faults;
mod hex_dump;
mod holding;
mod memory;
mod round_trip;
mod small;
mod tiny;
mod vectors;
