//! Images: buffers, the way from sensor codes to linear radiance and metres, files, error measures.
//!
//! For: pixel memory, transfer curves, response, vignetting, development, registration, half-size images, JPEG, PNG and EXR, measures
//! of image error. Not for: frames and recordings (`sequence`), cameras and poses (`geometry`), devices.
//!
//! ```
//! use imaging::{Corrector, Image, Response, Vignetting, is_measured, metres_from_raw};
//! let response = Response::gamma(2.2)?;
//! let corrector = Corrector::new(&response, &Vignetting::none(), 4, 3, 1.0);
//! let radiance = corrector.correct(&Image::new(4, 3, [128, 255, 0]), false);
//! assert!(radiance.saturated.at(0, 0));
//! assert!((corrector.encode(0, 0, radiance.linear.at(0, 0))[0] - 128.0).abs() < 1e-3);
//! let (depth, counts) = metres_from_raw(&Image::new(4, 3, 1500), 0.001, 0.4..=8.0);
//! assert!(is_measured(depth.at(0, 0)) && counts.measured_count == 12);
//! # Ok::<(), imaging::ImagingError>(())
//! ```
//!
//! Map: [`image`] buffers · [`depth`] codes to metres · [`response`] code curves · [`vignetting`] fall-off ·
//! [`radiance`] the correction in one pass · [`develop`] raw frames of any layout into radiance ·
//! [`linear_pixel`] fixed-point radiance of the live path · [`registration`] the colour of every depth pixel ·
//! [`kernels`] vectorised inner loops ·
//! [`pyramid`] half sizes · [`srgb`] the transfer curve of screens · [`files`] JPEG and PNG ·
//! [`exr_files`] panoramas and confidence · [`whole_file`] no partial files · [`measures`] errors and their
//! summaries · [`error`] what is refused.
//!
//! Invariants: an [`Image`] holds width · height pixels; "no measurement" is asked through [`is_measured`];
//! saturation is marked on raw codes; decoders check declared sizes before they allocate; results do not
//! depend on the number of threads.

pub mod depth;
pub mod develop;
pub mod error;
pub mod exr_files;
pub mod files;
pub mod image;
pub mod kernels;
pub mod linear_pixel;
pub mod measures;
pub mod pyramid;
pub mod radiance;
pub mod registration;
pub mod response;
pub mod srgb;
pub mod undistortion;
pub mod vignetting;
pub mod whole_file;

pub use crate::depth::{
    DepthCounts, DepthTable, NO_DEPTH, is_measured, metres_from_float, metres_from_raw,
};
pub use crate::develop::{ChromaSiting, ColorLayout, Developer, YuvCoding, YuvMatrix, YuvRange};
pub use crate::error::ImagingError;
pub use crate::exr_files::{
    ConfidenceMap, Layer, PanoramaAttributes, read_channel_exr, read_confidence_exr, read_rgb_exr,
    write_confidence_exr, write_layers_exr, write_rgb_exr,
};
pub use crate::files::{
    decode_jpeg, decode_png_gray8, decode_png_gray16, decode_png_mask, decode_png_mosaic8,
    decode_png_rgb8, encode_jpeg, encode_png_gray16, encode_png_mask, encode_png_rgb8,
    jpeg_is_subsampled,
};
pub use crate::image::{DepthImage, Image, LinearImage, Mask, Rgb8Image};
pub use crate::kernels::Level;
pub use crate::linear_pixel::{LinearPixel, RADIANCE_ONE};
pub use crate::pyramid::{DepthTolerance, depth_pyramid, half_color, half_depth};
pub use crate::radiance::{Corrector, Radiance, dilated};
pub use crate::registration::Registration;
pub use crate::response::{CodeFlag, Response, ResponseRepair};
pub use crate::srgb::Srgb8;
pub use crate::undistortion::Undistortion;
pub use crate::vignetting::Vignetting;
pub use crate::whole_file::write_whole_file;
