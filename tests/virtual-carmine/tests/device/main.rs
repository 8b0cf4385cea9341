//! The camera as a host sees it.

mod conversation;
mod faults;
mod golden;
mod host;
mod invariants;
mod recording;
mod streams;
