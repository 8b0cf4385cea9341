//! `glint simulate`, from outside.

mod matte;
mod mitsuba;
mod program;
