//! JPEG and PNG in memory, to and from images.
//!
//! Every decoder reads the declared size first and refuses it before anything is allocated when it exceeds
//! [`LARGEST_SIDE`] or when the file is too short to hold that many pixels at the format's best compression.

mod jpeg;
mod png;

pub use jpeg::{decode_jpeg, encode_jpeg, jpeg_is_subsampled};
pub use png::{
    decode_png_gray8, decode_png_gray16, decode_png_mask, decode_png_mosaic8, decode_png_rgb8,
    encode_png_gray16, encode_png_mask, encode_png_rgb8,
};

use crate::error::ImagingError;

/// Largest width and height that a decoder accepts, pixels.
pub const LARGEST_SIDE: u32 = 16384;

/// Bytes of pixels that one byte of file can stand for: deflate ends at 1032:1, a JPEG of single-bit blocks
/// at 1536:1.
const LARGEST_RATIO: u64 = 2048;

/// Refuses a declared size before memory is spent on it.
pub(crate) fn require_plausible_size(
    format: &'static str,
    width: u64,
    height: u64,
    bytes_per_pixel: u64,
    file_bytes: u64,
) -> Result<(), ImagingError> {
    let side = u64::from(LARGEST_SIDE);
    let allowed = (1..=side).contains(&width)
        && (1..=side).contains(&height)
        && width * height <= file_bytes.saturating_mul(LARGEST_RATIO) / bytes_per_pixel.max(1);
    if allowed {
        Ok(())
    } else {
        Err(ImagingError::TooLarge {
            format,
            width,
            height,
            file_bytes,
        })
    }
}
