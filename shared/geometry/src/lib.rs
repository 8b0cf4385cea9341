//! Poses, cameras, directions and the panorama: the pure mathematics everything else stands on.
//!
//! For: rigid transforms named by both ends, pinhole cameras with distortion, the one mapping between
//! directions and panorama texels, alignment of paths, robust statistics. Not for: images, files, time,
//! colour.
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
//! Map: [`pose`] rigid motion in f64 · [`rotation`] SO(3) and SE(3) maps, interpolation · [`camera`]
//! intrinsics · [`distortion`] of lenses · [`panorama`] directions and texels · [`direction`] angles,
//! bases, mirror reflection · [`alignment`] of two paths, absolute trajectory error · [`trajectory`] relative
//! error, orientations, time between clocks · [`svd`] of 3x3 matrices · [`symmetric`] eigenvalues · [`robust`]
//! medians and scales.
//!
//! Invariants: no allocation per call except in [`robust`], [`trajectory`] and
//! [`alignment::trajectory_error`]; a value that comes out of a `Result` or `Option` is valid (a [`Pose`] is
//! rigid, an [`Intrinsics`] is usable); finite input of a size that occurs (lengths and angles below 1e150)
//! never gives NaN; NaN never becomes a number silently, except where a function says so.

pub mod alignment;
pub mod camera;
pub mod direction;
pub mod distortion;
pub mod panorama;
pub mod pose;
pub mod robust;
pub mod rotation;
pub mod svd;
pub mod symmetric;
pub mod trajectory;

pub use alignment::{
    AlignmentError, AlignmentRank, RigidAlignment, TrajectoryError, align_rigid, trajectory_error,
};
pub use camera::{CameraError, Distortion, Intrinsics};
pub use glam::{DMat3, DQuat, DVec2, DVec3, Vec2, Vec3, Vec3A};
pub use panorama::PanoramaSize;
pub use pose::{Pose, PoseError};
pub use symmetric::{SymmetricEigen, symmetric_eigen};
