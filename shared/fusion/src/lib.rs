//! Depth images and poses in, surface and texture statistics out.
//!
//! For: hashed TSDF volumes, meshes of their zero surface, vertex normals and their noise, the robust
//! minimum over views. Not for: files, colour spaces, tracking threads, rendering.
//!
//! ```
//! use fusion::{MeshConfig, Volume, VolumeConfig, extract_mesh};
//! use geometry::{Intrinsics, Pose};
//! let camera = Intrinsics::pinhole(64, 48, 60.0, 60.0, 31.5, 23.5)?;
//! let mut volume = Volume::new(VolumeConfig { voxel_size: 0.02, ..VolumeConfig::default() })?;
//! let wall_one_metre_away = vec![1.0; 64 * 48];
//! for _ in 0..3 {
//!     volume.integrate(&wall_one_metre_away, &camera, &Pose::IDENTITY)?;
//! }
//! let mesh = extract_mesh(&volume, &MeshConfig::default());
//! assert!(mesh.positions.iter().all(|p| (p.z - 1.0).abs() < 1e-3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Map: [`volume`] the field and its update · [`kernels`] the vectorised inner loop · [`mesh`] marching
//! cubes and connected parts · [`model_view`] what a camera sees of it · [`normals`] smoothing and noise · [`texture`] robust minimum over views and
//! frame gains.
//!
//! Invariants: depth is f32 metres, 0 or non-finite = no measurement; the volume is relative to an f64
//! origin; results do not depend on the number of threads, nor on the instruction level; the caller's
//! rayon pool is used.

mod error;
pub mod kernels;
pub mod live;
pub mod mesh;
pub mod model_view;
pub mod normals;
pub mod texture;
pub mod tracking;
pub mod volume;

pub use error::{FusionError, LiveError};
pub use kernels::Level;
pub use mesh::{Mesh, MeshConfig, components, extract_mesh, remove_small_components};
pub use model_view::{ModelView, Surfel};
pub use normals::{NormalNoise, normal_noise, rounds_for_voxel, smooth_normals};
pub use texture::{RobustMinimum, Sample, frame_gains, robust_minimum};
pub use volume::{IntegrateStats, SETTLED_COLORS, Volume, VolumeConfig};
