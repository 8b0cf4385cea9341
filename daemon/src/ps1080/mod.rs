//! PrimeSense cameras with the PS1080 chip (Carmine, Xtion): the driver. What the bytes mean is in crate `ps1080`.
//!
//! [`usb`] what is needed of USB, and `libusb` that on a real bus · `exchange` and [`session`] requests · [`open`] what
//! the camera is · [`modes`] what is asked of it · `streams` and `control` switching it on, between the arrivals of data ·
//! `frame_clock`, `samples` and `assemble` frames, their numbers and what is missing · `exposure` · `describe` what the
//! recording says · [`camera`] all of it as a source · `list` which cameras there are.
//!
//! One thread does all: it reaps transfers, decodes their payload straight into pooled frames, and steps the conversation
//! in between, so that no reply is waited for while data come. Samples are the camera's own, untouched.

mod assemble;
pub mod camera;
mod control;
mod describe;
mod error;
mod exchange;
mod exposure;
mod frame_clock;
#[cfg(feature = "usb")]
pub mod libusb;
pub mod modes;
pub mod open;
mod samples;
pub mod session;
mod streams;
pub mod usb;

pub use camera::Camera;
pub use error::CameraError;

use crate::source_spec::CameraSpec;

/// Opens the camera that `spec` names, and configures it.
///
/// # Errors
/// No such camera, or more than one; one that cannot be opened or cannot do what is wanted.
#[cfg(feature = "usb")]
pub fn open_camera(spec: &CameraSpec) -> anyhow::Result<Camera> {
    libusb::open_camera(spec)
}

/// This program was built without USB.
///
/// # Errors
/// Always.
#[cfg(not(feature = "usb"))]
pub fn open_camera(_: &CameraSpec) -> anyhow::Result<Camera> {
    anyhow::bail!(
        "this glintd was built without the feature `usb`; build it with, or replay a recording"
    )
}
