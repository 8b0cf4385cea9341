//! The codecs from outside: what goes in comes out, the hard cases, hostile bytes.

mod frames;
mod hard;
mod hostile;
mod round_trip;
mod tables;
mod vectors;
