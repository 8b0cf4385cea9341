//! The diffuse colour of a surface point from many views: a robust minimum (paper section 3.1, app. G).

mod gains;
mod minimum;

pub use self::gains::frame_gains;
pub use self::minimum::{RobustMinimum, Sample, robust_minimum};
