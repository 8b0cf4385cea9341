//! Rows of YUV 4:2:2 into codes of red, green, blue, and which of them are clipped, in integers.
//!
//! Bound: a pixel reads 2 bytes and writes 3, 1.5 MB a VGA frame, 0.05 ms at 28 GB/s of one core. Arithmetic decides:
//! five 32-bit products a pixel. Both levels compute the same integers.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use super::Level;

/// Fraction bits of the gain of luma.
pub(crate) const LUMA_BITS: u32 = 16;
/// Chroma is interpolated to quarters of a code, so its gains have two bits less.
pub(crate) const CHROMA_BITS: u32 = LUMA_BITS - 2;
/// One half in the sum.
pub(crate) const HALF: i32 = 1 << (LUMA_BITS - 1);

/// What samples become: gains in fixed point and shares of chroma samples in quarters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gains {
    pub(crate) luma: i32,
    /// Luma code of black.
    pub(crate) black: i32,
    pub(crate) red_of_v: i32,
    pub(crate) green_of_u: i32,
    pub(crate) green_of_v: i32,
    pub(crate) blue_of_u: i32,
    /// Shares of the chroma of the pair before, the own one and the one after at the left pixel, in quarters.
    pub(crate) left: [i16; 3],
    /// The same at the right pixel.
    pub(crate) right: [i16; 3],
}

/// Order of the samples of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PairOrder {
    Uyvy,
    Yuyv,
}

/// `codes` of the pixels of a row of pairs; at the ends of the row a missing neighbour is the pair itself.
///
/// # Panics
/// Unless there are two codes a pair.
pub(crate) fn rgb_row(
    level: Level,
    gains: &Gains,
    order: PairOrder,
    pairs: &[[u8; 4]],
    codes: &mut [[u8; 3]],
) {
    // The vector kernel's writes rest on this line.
    assert!(codes.len() == 2 * pairs.len());
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::rgb_row(gains, order, pairs, codes),
        _ => scalar::rgb_row(gains, order, pairs, codes),
    }
}

/// Marks the pixels of which some channel, by their own luma and the chroma stored for them, before interpolation,
/// is at least `limit`, a code.
///
/// # Panics
/// Unless there are two marks a pair.
pub(crate) fn saturated_row(
    level: Level,
    gains: &Gains,
    order: PairOrder,
    limit: u8,
    pairs: &[[u8; 4]],
    marks: &mut [bool],
) {
    // The vector kernel's writes rest on this line.
    assert!(marks.len() == 2 * pairs.len());
    let limit = i32::from(limit) << LUMA_BITS;
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::saturated_row(gains, order, limit, pairs, marks),
        _ => scalar::saturated_row(gains, order, limit, pairs, marks),
    }
}

/// Codes of one pixel, chroma in whole codes.
#[inline]
pub(crate) fn rgb(gains: &Gains, y: u8, u: u8, v: u8) -> [u8; 3] {
    scalar::rgb(gains, y, u, v)
}
