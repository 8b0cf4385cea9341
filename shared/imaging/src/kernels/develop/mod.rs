//! A row of codes into fixed-point linear radiance, and the half-size grey of two such rows.
//!
//! Bound of [`linear_row`]: a pixel reads 3 code bytes and a 4-byte scale and writes 8, 4.6 MB a VGA frame or
//! 0.16 ms at 28 GB/s of one core. Arithmetic decides: three table rows of four lanes, two additions, one
//! product a pixel. Both levels do the same IEEE operations in the same order, so they agree bit for bit.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use super::Level;
use crate::linear_pixel::LinearPixel;

/// Half-size grey of the four pixels is their luminance by these weights (Rec. 709 primaries).
pub(crate) const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Largest value of each lane of a pixel: the channels' range, and flags 1 (valid) or 3 (and saturated).
const LARGEST: [f32; 4] = [65_535.0, 65_535.0, 65_535.0, 3.0];

/// What a code of red, green, blue adds to a pixel `[red, green, blue, flags]`: its radiance in its own lane,
/// in the lane of flags 2 where it is saturated, and red 1 for "valid".
pub(crate) type CodeLanes = [[[f32; 4]; 256]; 3];

/// `pixels[x]` from `codes[x]`: the lanes of its codes added up, times `scale[x]` (flags are not scaled),
/// rounded half up; a scale of 0 makes the pixel invalid.
///
/// # Panics
/// When the rows differ in length.
pub(crate) fn linear_row(
    level: Level,
    lanes: &CodeLanes,
    codes: &[[u8; 3]],
    scale: &[f32],
    pixels: &mut [LinearPixel],
) {
    // The vector kernel's reads and writes rest on this line.
    assert!(codes.len() == pixels.len() && scale.len() == pixels.len());
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::linear_row(lanes, codes, scale, pixels),
        _ => scalar::linear_row(lanes, codes, scale, pixels),
    }
}

/// `grey[x]` = mean luminance of the valid, unsaturated ones of pixels 2x and 2x + 1 of two rows, 1.0 = white;
/// 0 where there is none.
///
/// # Panics
/// When a row is shorter than twice `grey`.
pub(crate) fn grey_row(
    level: Level,
    above: &[LinearPixel],
    below: &[LinearPixel],
    grey: &mut [f32],
) {
    // The vector kernel's reads rest on this line.
    assert!(above.len() / 2 >= grey.len() && below.len() / 2 >= grey.len());
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::grey_row(above, below, grey),
        _ => scalar::grey_row(above, below, grey),
    }
}
