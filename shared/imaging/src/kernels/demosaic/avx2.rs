//! The specification compiled for AVX2, whose loops the compiler widens to eight columns; but for packing, where
//! it does not.
#![expect(
    unsafe_code,
    reason = "calls into code compiled for AVX2; vector loads and stores inside slices whose lengths are asserted"
)]

use std::arch::x86_64::*;

use super::{ColorRows, scalar};
use crate::linear_pixel::{LinearPixel, RADIANCE_ONE};

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
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { pack_row_avx2(rgb, flags, pixels) }
}

#[target_feature(enable = "avx2")]
fn pack_row_avx2(rgb: [&[f32]; 3], flags: &[u8], pixels: &mut [LinearPixel]) {
    let done = pixels.len() / 8 * 8;
    let (eights, rest) = pixels.as_chunks_mut::<8>();
    let [reds, greens, blues] = rgb.map(|row| row.as_chunks::<8>().0);
    let flag_eights = flags.as_chunks::<8>().0;
    for ((((pixels, red), green), blue), flags) in eights
        .iter_mut()
        .zip(reds)
        .zip(greens)
        .zip(blues)
        .zip(flag_eights)
    {
        // SAFETY: eight bytes.
        let flags = unsafe { _mm256_cvtepu8_epi32(_mm_loadl_epi64(flags.as_ptr().cast())) };
        let is_dropped = _mm256_cmpeq_epi32(flags, _mm256_setzero_si256());
        let [red, green, blue] = [code_of(red), code_of(green), code_of(blue)];
        let red_green = _mm256_or_si256(red, _mm256_slli_epi32::<16>(green));
        let blue_flags = _mm256_or_si256(blue, _mm256_slli_epi32::<16>(flags));
        let red_green = _mm256_andnot_si256(is_dropped, red_green);
        let blue_flags = _mm256_andnot_si256(is_dropped, blue_flags);
        // Pixels 0, 1, 4, 5 and 2, 3, 6, 7.
        let low = _mm256_unpacklo_epi32(red_green, blue_flags);
        let high = _mm256_unpackhi_epi32(red_green, blue_flags);
        let target = pixels.as_mut_ptr().cast::<__m256i>();
        // SAFETY: eight pixels are 64 bytes.
        unsafe {
            _mm256_storeu_si256(target, _mm256_permute2x128_si256::<0x20>(low, high));
            _mm256_storeu_si256(target.add(1), _mm256_permute2x128_si256::<0x31>(low, high));
        }
    }
    scalar::pack_row(rgb.map(|row| &row[done..]), &flags[done..], rest);
}

/// Eight radiances as codes of the fixed point.
#[inline]
#[target_feature(enable = "avx2")]
fn code_of(radiance: &[f32; 8]) -> __m256i {
    // SAFETY: eight floats.
    let radiance = unsafe { _mm256_loadu_ps(radiance.as_ptr()) };
    let scaled = _mm256_mul_ps(radiance, _mm256_set1_ps(f32::from(RADIANCE_ONE)));
    let rounded = _mm256_add_ps(scaled, _mm256_set1_ps(0.5));
    // A radiance that is not a number becomes 0, as a cast makes it.
    let positive = _mm256_max_ps(rounded, _mm256_setzero_ps());
    _mm256_cvttps_epi32(_mm256_min_ps(positive, _mm256_set1_ps(65_535.0)))
}
