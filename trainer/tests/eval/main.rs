//! `glint eval --trajectory` and `--mesh`: paths and surfaces whose errors are known.

mod fusion;
mod path;
mod program;
mod recording;
