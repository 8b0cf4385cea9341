//! LPIPS v0.1 with AlexNet (Zhang et al. 2018): how different two pictures look, as a network sees them.
//!
//! For: judging views (effects-and-tradeoffs.md C2). Not for: a loss; the net that judges never trains.
//!
//! Weights are part of the program (`recordings/perceptual/README.md` has their origin, licence and the exact
//! definition), so that a figure cannot depend on a file that lies somewhere. Pictures go in as encoded RGB in
//! [0, 1]; everything after it, order of channels, range, mask and crop, happens here and nowhere else
//! (hard-cases L09).

mod input;
mod network;
#[cfg(test)]
mod tests;

pub use input::{CROP_MARGIN, CropBox, NetworkInput, SMALLEST_SIDE};
pub use network::{Features, LayerDistances, Lpips};

/// Why there is no distance.
#[derive(Debug, thiserror::Error)]
pub enum PerceptualError {
    /// A picture is too small: the second pooling would have no pixel.
    #[error(
        "a picture of {width}x{height} pixels is too small for LPIPS: at least {SMALLEST_SIDE} each"
    )]
    TooSmall {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Two pictures, or a picture and its mask, differ in size.
    #[error("pictures of {left:?} and {right:?} pixels cannot be compared")]
    SizeMismatch {
        /// Size of one.
        left: (u32, u32),
        /// Size of the other.
        right: (u32, u32),
    },
    /// A value is not an encoded colour.
    #[error("pixel ({x}, {y}) holds {value}: encoded colours lie in 0 to 1")]
    ValueOutOfRange {
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// The value.
        value: f32,
    },
    /// The weights or the tensor library failed.
    #[error("LPIPS cannot be computed")]
    Network(#[from] candle_core::Error),
}
