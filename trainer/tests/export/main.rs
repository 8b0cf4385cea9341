//! `glint export` of recordings: what is written is what is there, and an import gives it back.

mod damage;
mod layouts;
mod made;
mod points;
mod round_trip;
