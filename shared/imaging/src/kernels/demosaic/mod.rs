//! Rows of a Bayer mosaic in linear radiance into rows of full colour, after Hamilton and Adams (US patent
//! 5 629 734, expired): green along the flatter direction, red and blue by their difference from green.
//!
//! Green at a red or blue site is the mean of its two green neighbours in the direction in which green and the
//! site's own colour change less, plus a quarter of the own colour's second difference. What red and blue
//! have beyond green varies slowly, so its bilinear interpolation is enough; it is separable, along the row here
//! and across rows in [`color_row`].
//!
//! Bound: per pixel five reads of raw rows and two writes, then four reads and 8 bytes written, all but the last
//! in the first-level cache. The vector level is the specification compiled for AVX2: same operations, same
//! order, no fused multiply-add, so the same bits.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use super::Level;
use crate::linear_pixel::LinearPixel;

/// Columns of a raw row before its first pixel and after its last.
pub(crate) const RAW_PAD: usize = 2;
/// The same of a row of differences.
pub(crate) const DIFFERENCE_PAD: usize = 1;

/// Green of a row, and by how much its second colour differs from green, known at the sites of that colour and
/// 0 elsewhere. `raw` holds the rows y − 2 to y + 2, padded by [`RAW_PAD`] on both sides; `difference` is
/// padded by [`DIFFERENCE_PAD`] and its pads are left alone. Sites of the second colour are the columns whose
/// lowest bit is `parity`.
///
/// # Panics
/// When a row has another length than `green` and its pads.
pub(crate) fn green_row(
    level: Level,
    raw: [&[f32]; 5],
    parity: usize,
    green: &mut [f32],
    difference: &mut [f32],
) {
    let width = green.len();
    assert!(raw.iter().all(|row| row.len() == width + 2 * RAW_PAD));
    assert!(difference.len() == width + 2 * DIFFERENCE_PAD);
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::green_row(raw, parity, green, difference),
        _ => scalar::green_row(raw, parity, green, difference),
    }
}

/// Fills a row of differences (padded, pads set) between its sites: `filled[x]` = itself where it is known, else
/// the mean of left and right.
///
/// # Panics
/// When `difference` is not [`DIFFERENCE_PAD`] longer on both sides than `filled`.
pub(crate) fn fill_row(level: Level, difference: &[f32], filled: &mut [f32]) {
    assert!(difference.len() == filled.len() + 2 * DIFFERENCE_PAD);
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::fill_row(difference, filled),
        _ => scalar::fill_row(difference, filled),
    }
}

/// What a row's colour is made of: green, the filled differences of its own second colour, and those of the
/// third colour in the rows above and below.
#[derive(Clone, Copy)]
pub(crate) struct ColorRows<'a> {
    pub(crate) green: &'a [f32],
    pub(crate) own: &'a [f32],
    pub(crate) above: &'a [f32],
    pub(crate) below: &'a [f32],
}

/// The second and the third colour of a row, not below 0.
///
/// # Panics
/// When the rows differ in length.
pub(crate) fn color_row(level: Level, rows: ColorRows<'_>, second: &mut [f32], third: &mut [f32]) {
    let width = rows.green.len();
    assert!([rows.own.len(), rows.above.len(), rows.below.len()] == [width; 3]);
    assert!(second.len() == width && third.len() == width);
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::color_row(rows, second, third),
        _ => scalar::color_row(rows, second, third),
    }
}

/// `pixels[x]` from radiances of red, green, blue (1.0 = white) and `flags[x]`, rounded half up; where a flag
/// is 0 the whole pixel is.
///
/// # Panics
/// When the rows differ in length.
pub(crate) fn pack_row(level: Level, rgb: [&[f32]; 3], flags: &[u8], pixels: &mut [LinearPixel]) {
    assert!(rgb.iter().all(|row| row.len() == pixels.len()) && flags.len() == pixels.len());
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::pack_row(rgb, flags, pixels),
        _ => scalar::pack_row(rgb, flags, pixels),
    }
}
