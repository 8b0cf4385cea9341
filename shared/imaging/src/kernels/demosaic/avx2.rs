//! The specification compiled for AVX2: the compiler widens its loops to eight columns.
#![expect(unsafe_code, reason = "calls into code compiled for AVX2")]

use super::{ColorRows, scalar};
use crate::linear_pixel::LinearPixel;

/// See [`super::green_row`].
pub(super) fn green_row(
    raw: [&[f32]; 5],
    parity: usize,
    green: &mut [f32],
    difference: &mut [f32],
) {
    #[target_feature(enable = "avx2")]
    fn widened(raw: [&[f32]; 5], parity: usize, green: &mut [f32], difference: &mut [f32]) {
        scalar::green_row(raw, parity, green, difference);
    }
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { widened(raw, parity, green, difference) }
}

/// See [`super::fill_row`].
pub(super) fn fill_row(difference: &[f32], filled: &mut [f32]) {
    #[target_feature(enable = "avx2")]
    fn widened(difference: &[f32], filled: &mut [f32]) {
        scalar::fill_row(difference, filled);
    }
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { widened(difference, filled) }
}

/// See [`super::color_row`].
pub(super) fn color_row(rows: ColorRows<'_>, second: &mut [f32], third: &mut [f32]) {
    #[target_feature(enable = "avx2")]
    fn widened(rows: ColorRows<'_>, second: &mut [f32], third: &mut [f32]) {
        scalar::color_row(rows, second, third);
    }
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { widened(rows, second, third) }
}

/// See [`super::pack_row`].
pub(super) fn pack_row(rgb: [&[f32]; 3], flags: &[u8], pixels: &mut [LinearPixel]) {
    #[target_feature(enable = "avx2")]
    fn widened(rgb: [&[f32]; 3], flags: &[u8], pixels: &mut [LinearPixel]) {
        scalar::pack_row(rgb, flags, pixels);
    }
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { widened(rgb, flags, pixels) }
}
