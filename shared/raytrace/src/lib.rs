//! Triangles, rays and hits.
//!
//! For: nearest and any hits of rays, mirrored view rays that do not meet their own surface, what each pixel of a
//! camera sees, and the nearest point of a mesh. Not for: materials and colours; callers shade what is hit.
//!
//! ```
//! use glam::Vec3;
//! use raytrace::{Ray, Scene};
//! let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
//! let scene = Scene::new(&positions, &[[0, 1, 2]]).unwrap();
//! let hit = scene.closest(&Ray::new(Vec3::new(0.25, 0.5, -2.0), Vec3::Z)).unwrap();
//! assert_eq!((hit.triangle, hit.t, hit.u, hit.v), (0, 2.0, 0.25, 0.5));
//! ```
//!
//! Map: [`scene`] a mesh made ready, its queries · [`ray`] rays and hits · [`nearest`] points of the mesh near
//! others · [`mirror`] reflections and first bounces · [`visibility`] the buffer of triangle, depth and
//! barycentrics · [`warp`] whether two views see one point · `tree` the 8-wide hierarchy over obvhs' binary
//! one · `kernels` the walk, scalar and AVX2.
//!
//! Invariants: triangle indices are the caller's; the same bits for any number of threads and any
//! instruction set; triangles are closed sets, so a ray through a shared edge or vertex of a closed mesh hits;
//! NaN and infinity in a mesh are dropped and counted, in a ray they are a miss.

pub mod error;
mod kernels;
pub mod mirror;
pub mod nearest;
pub mod ray;
pub mod scene;
mod tree;
pub mod visibility;
pub mod warp;

pub use error::RaytraceError;
pub use kernels::Level;
pub use mirror::{MirrorQuery, Reflection};
pub use nearest::Nearest;
pub use ray::{Hit, NO_TRIANGLE, Ray};
pub use scene::{Scene, TriangleCounts};
pub use visibility::{VisibilityBuffer, rasterise, visibility_buffer};
