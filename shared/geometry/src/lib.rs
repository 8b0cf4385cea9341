//! Poses, cameras, directions and the panorama: the pure mathematics everything else stands on.
//!
//! For: rigid transforms named by both ends, pinhole cameras with distortion, the one mapping between
//! directions and panorama texels, robust statistics. Not for: images, files, time, colour.
//!
//! ```
//! use geometry::{DVec3, Intrinsics, Pose};
//! let world_from_camera = Pose::from_translation(DVec3::new(0.0, 0.0, -1.0));
//! let camera = Intrinsics::pinhole(640, 480, 525.0, 525.0, 319.5, 239.5).unwrap();
//! let point_in_camera = world_from_camera.inverse().transform_point(DVec3::ZERO);
//! let pixel = camera.pixel_from_camera(point_in_camera).unwrap();
//! assert!((pixel.x - 319.5).abs() < 1e-12);
//! ```
//!
//! Map: [`pose`] rigid motion in f64 · [`rotation`] SO(3) maps and interpolation · [`camera`] intrinsics
//! · [`distortion`] of lenses · [`panorama`] directions and texels · [`direction`] angles, bases, mirror reflection ·
//! [`robust`] medians and scales.
//!
//! Invariants: no allocation per call except in [`robust`]; a value that exists is valid (a [`Pose`] is
//! rigid, an [`Intrinsics`] is usable); finite input never gives NaN.

pub mod camera;
pub mod direction;
pub mod distortion;
pub mod panorama;
pub mod pose;
pub mod robust;
pub mod rotation;

pub use camera::{CameraError, Distortion, Intrinsics};
pub use glam::{DMat3, DQuat, DVec2, DVec3, Vec2, Vec3, Vec3A};
pub use panorama::PanoramaSize;
pub use pose::{Pose, PoseError};
