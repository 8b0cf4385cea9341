//! The linear joint solve of the diffuse texture D and the specular reflectance map (SRM).
//!
//! For: turning per-pixel observations of a shiny object into a panorama of the room it reflects
//! (Park 2020 section 3.2 without networks), with a confidence for every texel. Not for: reading images or
//! meshes, deciding which pixel sees what, drawing: rows come in, texels go out.
//!
//! One row is one pixel:
//! `observed = Σ bᵢ D(vᵢ) + gain · (V Σ aⱼ S(tⱼ) + (1 − V) first bounce)`, three channels that share
//! their structure. D and S are solved together, both non-negative, with D pulled weakly to zero: that
//! prior decides how a constant is split between them (see [`offset`]).
//!
//! ```
//! use srm::{JointSettings, Problem, Row, Rows};
//! let panorama = geometry::PanoramaSize::from_height(4).unwrap();
//! let mut rows = Rows::default();
//! for texel in 0..32 {
//!     rows.push(Row {
//!         vertices: [0; 3], barycentric: [1.0, 0.0, 0.0],
//!         texels: [texel; 4], taps: [0.3, 0.0, 0.0, 0.0],
//!         observed: [0.3; 3], known: [0.0; 3], weight: 1.0, clipped: 0, frame: 0, segment: 0,
//!     });
//! }
//! let solution = Problem::new(rows, 1, panorama).unwrap().solve(&JointSettings::default());
//! let seen = 0.3 * solution.specular[0][0] + solution.diffuse[0][0];
//! assert!((seen - 0.3).abs() < 0.05);
//! ```
//!
//! Map: [`rows`] what a pixel says · [`problem`] the normal equations, never formed · [`regularisation`]
//! what is asked beyond the rows · [`weights`] of a round · [`solver`] bounded conjugate gradients ·
//! [`joint`] robust reweighting and the solution · [`confidence`] what a texel is
//! worth · [`offset`] the direction the data do not see · [`selection`] choices by held-out frames ·
//! [`gains`] of single segments,
//! for drawing · [`resolution`] the finest detail.
//!
//! Invariants: sums run in f64 over a fixed number of tiles, so that the bits do not depend on the number
//! of threads; finite rows give finite texels; D and S are never negative.

pub mod confidence;
pub mod gains;
pub mod joint;
pub mod offset;
pub mod problem;
pub mod regularisation;
pub mod resolution;
pub mod rows;
pub mod selection;
pub mod solver;
pub mod weights;

pub use confidence::{Confidence, TexelFlags};
pub use joint::{DiffuseTreatment, JointSettings, Solution};
pub use problem::{Problem, SrmError};
pub use regularisation::Regularisation;
pub use rows::{Row, Rows};
pub use weights::Weights;
