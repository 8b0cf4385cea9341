//! What cameras make of light: codes of a colour mosaic and shifts of a structured-light depth sensor.

pub mod color;
pub mod depth;

pub use color::{ColorSensor, NoiseModel};
pub use depth::{DepthSensor, ShiftModel};
