//! `glint eval --trajectory` and `--mesh`: paths and surfaces whose errors are known.

mod path;
mod program;
mod recording;
