//! The wire language from outside: examples of the protocol document, round trips in any pieces, losses, damage.

mod damage;
mod fuzz;
mod golden;
mod hard;
mod host;
mod losses;
mod made;
mod mutate;
mod receive;
mod round_trip;
mod splits;
mod versions;
