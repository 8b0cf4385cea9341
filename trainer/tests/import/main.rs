//! `glint import`: whole folders, what is refused, and folders of two streams with their own times.

mod folders;
mod layouts;
mod refusals;
mod tum;
