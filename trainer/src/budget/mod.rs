//! `--budget`.
pub mod bench;
