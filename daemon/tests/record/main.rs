//! The recorder from outside: a recording is played, what comes out is compared.

mod disks;
mod hard;
mod replay;
mod source;
