//! `glint export` of recordings: what is written is what is there, and an import gives it back.

mod damage;
mod json_in;
mod layouts;
mod made;
mod points;
mod round_trip;
