//! The driver against a camera in software, in the camera's own time.

mod faults;
mod infrared;
mod jpeg;
mod registration;
mod transport;
mod unplug;
mod whole;
