//! `glint simulate`, from outside.

mod mitsuba;
mod program;
