//! The format from outside: round trip, damage, faults of the disk, crashes.

mod crashes;
mod damage;
mod edit;
mod faults;
mod fuzz;
mod hex_dump;
mod holding;
mod hostile;
mod memory;
mod mutate;
mod round_trip;
mod seal;
mod small;
mod tiny;
mod vectors;
