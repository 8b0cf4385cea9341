//! Where the camera is: frames against the model.
//!
//! [`points`] a frame coarse to fine · [`icp`] alignment with a predicted view · [`photometric`] the term that
//! helps where shape does not · [`equations`] which directions are observed · [`thumbnail`] fast rotation and
//! looks · [`keyframes`] known places · [`motion`] prediction by time · [`verdict`] when to believe ·
//! [`noise`] of depth.

pub mod equations;
pub mod icp;
pub mod keyframes;
pub mod motion;
pub mod noise;
pub mod photometric;
pub mod points;
pub mod thumbnail;
pub mod verdict;

pub use icp::{Alignment, Icp, IcpConfig, IcpInput, IcpPass};
pub use keyframes::{KeyframeConfig, Keyframes};
pub use motion::Motion;
pub use noise::DepthNoise;
pub use photometric::{GreyFrame, Photometric};
pub use points::PointPyramid;
pub use thumbnail::Thumbnail;
pub use verdict::{Gates, TrackState};
