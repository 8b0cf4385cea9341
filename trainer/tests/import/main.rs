//! `glint import`: whole folders, what is refused, folders of two streams with their own times, recordings of OpenNI.

mod folders;
mod layouts;
mod oni;
mod refusals;
mod tum;
