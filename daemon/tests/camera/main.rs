//! The driver against a camera in software, in the camera's own time.

mod faults;
mod registration;
mod infrared;
mod jpeg;
mod transport;
mod unplug;
mod whole;
