//! The stages of training, in order: poses, geometry, diffuse, linear.

pub mod diffuse;
pub mod geometry;
pub mod linear;
pub mod object;
pub mod observe;
pub mod poses;
pub mod rows;
pub mod surface;

/// Sentences that training ends with when the input cannot be used; the exit code is 2.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// The recording has no poses of the wanted set.
    #[error(
        "the recording has no poses named `{0}`: import it with poses, or name another set with --poses"
    )]
    NoPoses(String),
    /// The recording has no poses that refinement could start from.
    #[error(
        "the recording has neither poses `live` nor `source` to refine: record it with fusion on, or import it with poses"
    )]
    NoStart,
    /// Too few frames to train from.
    #[error("only {0} training frames have a pose; at least 10 are needed")]
    TooFewFrames(usize),
    /// The depth images do not agree with each other under the poses.
    #[error(
        "the poses do not fit the depth images: after fusion only {percent:.0} % of the measured depth lies \
         on the surface (at least {least:.0} % should); check that each pose belongs to its frame, and its direction"
    )]
    PosesDoNotFit {
        /// Share of measured pixels near the fused surface, percent.
        percent: f64,
        /// Least share, percent.
        least: f64,
    },
    /// Fusion gave no surface.
    #[error(
        "fusion of {0} frames gave no surface; check the depth scale and the range of the recording"
    )]
    NoSurface(usize),
}
