//! What the model looks like from a pose.

use geometry::{Intrinsics, Pose};

/// A piece of surface that one pixel sees.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub struct Surfel {
    /// Camera axes of the view, metres.
    pub position: [f32; 3],
    /// Linear luminance, 1.0 = the white level; 0 when unknown.
    pub grey: f32,
    /// Unit, camera axes of the view, faces the camera.
    pub normal: [f32; 3],
    /// Weight of the volume; 0 = no surface here.
    pub weight: f32,
}

impl Surfel {
    /// No surface.
    pub const NONE: Self = Self {
        position: [0.0; 3],
        grey: 0.0,
        normal: [0.0; 3],
        weight: 0.0,
    };
}

/// The surfels that a camera sees from a pose.
#[derive(Clone, Debug)]
pub struct ModelView {
    /// Pinhole camera without distortion.
    pub camera: Intrinsics,
    /// Where it stands.
    pub world_from_camera: Pose,
    /// One per pixel, row-major.
    pub surfels: Vec<Surfel>,
}
