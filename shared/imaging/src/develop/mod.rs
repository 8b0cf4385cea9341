//! Development: a colour frame as the camera sent it, of any layout, into linear radiance.
//!
//! Two users, one definition: [`Developer`] fills [`crate::LinearPixel`]s and a half-size grey image in one pass for
//! the live path, [`radiance`] gives a [`crate::Radiance`] for training; both take response, vignetting and
//! exposure from a [`crate::Corrector`] and agree to the rounding of the fixed point. [`codes`] gives 8-bit
//! red, green, blue for pictures and files.
//!
//! Order: saturation is marked on raw samples; then a mosaic is linearised and interpolated
//! ([`ColorLayout::BayerGrbg`]), YUV becomes codes by its own matrix and is linearised; marks grow by
//! [`crate::radiance::CHROMA_REACH`] pixels where colour is shared by neighbours (hard-cases B07).

mod bands;
mod layout;
mod live;
mod marks;
mod mosaic;
mod offline;
#[cfg(test)]
mod tests;
mod yuv;

pub use self::layout::{ChromaSiting, ColorLayout, YuvCoding, YuvMatrix, YuvRange};
pub use self::live::Developer;
pub use self::offline::{codes, radiance};
pub use self::yuv::YuvConverter;
