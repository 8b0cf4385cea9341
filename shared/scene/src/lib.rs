//! A simulated capture with its truth.
//!
//! For: scenes of meshes and closed forms in a room or under a panorama, filmed by a colour camera and a
//! structured-light depth camera on a path held by hand; everything that real captures cannot tell (matte and
//! mirrored light apart, visibility, first bounces, normals, exact poses). Not for: files and recordings (the trainer
//! writes them), estimating anything: no estimator uses a line of this, and this uses none of theirs.
//!
//! ```no_run
//! use scene::{Film, FilmOptions};
//! let film = Film::new("mirror-ball", FilmOptions::default())?;
//! let frame = film.frame(0);
//! let truth = film.truth(0, 16);
//! assert!(frame.mosaic.width() == truth.diffuse.width());
//! # Ok::<(), scene::SceneError>(())
//! ```
//!
//! Map: [`catalogue`] all scenes by name · [`design`] what a scene is · [`shape`] meshes · [`material`] and [`texture`]
//! what they are made of · [`environment`] the light around · [`world`] objects ready for rays (`irradiance` the light
//! on matte surfaces) · [`lobe`] GGX and Fresnel · [`transport`] radiance along a ray · [`sensor`] codes and shifts ·
//! [`path`] where the camera is · [`film`] frames and truth · [`random`] numbers by counter.
//!
//! Invariants: same scene and seed, same bits, for any number of threads; an effect that is off draws no number and
//! traces no ray; world axes x right, y down, z forward, metres; radiance linear, 1.0 = white level.

pub mod catalogue;
pub mod design;
pub mod environment;
pub mod error;
pub mod film;
mod irradiance;
pub mod lobe;
pub mod material;
pub mod path;
pub mod random;
pub mod sensor;
pub mod shape;
pub mod texture;
pub mod transport;
pub mod world;

pub use environment::Environment;
pub use error::SceneError;
pub use film::{Film, FilmOptions, Frame, FrameTruth};
