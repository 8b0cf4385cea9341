//! The colour of a row, 8 voxels at once.

use std::arch::x86_64::*;

use imaging::LinearPixel;

use super::super::color::{ColorBlock, SATURATED, WEIGHT_CAP, WEIGHT_STEPS};
use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

/// As [`ColorBlock::blend`] for the lanes of `row` that `is_seen` marks, bit for bit.
///
/// # Safety
/// Every value of `index` must be an index of `pixels`.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn blend_row(
    color: &mut ColorBlock,
    row: usize,
    pixels: &[LinearPixel],
    index: &[u32; BLOCK_EDGE],
    is_seen: __m256,
    weight: __m256,
) {
    // SAFETY: the caller's.
    let [red, green, blue, flags] = unsafe { load_pixels(pixels, index) };
    let flags = _mm256_cvtepu16_epi32(flags);
    let stored = load_row(&color.weight, row);
    let bound = _mm256_set1_epi32(i32::from(SATURATED));
    let is_bound = has(stored, bound);
    let stored_weight = _mm256_andnot_si256(bound, stored);
    let is_valid = has(flags, _mm256_set1_epi32(i32::from(LinearPixel::VALID)));
    let is_saturated = has(flags, _mm256_set1_epi32(i32::from(LinearPixel::SATURATED)));
    let has_weight = _mm256_cmpgt_epi32(stored_weight, _mm256_setzero_si256());
    let is_better = _mm256_andnot_si256(is_bound, has_weight);
    let is_seen = _mm256_and_si256(_mm256_castps_si256(is_seen), is_valid);
    let is_used = _mm256_andnot_si256(_mm256_and_si256(is_saturated, is_better), is_seen);

    let is_replaced = _mm256_andnot_si256(is_saturated, is_bound);
    let kept = _mm256_cvtepi32_ps(_mm256_andnot_si256(is_replaced, stored_weight));
    let cap = _mm256_set1_ps(WEIGHT_CAP);
    let steps = _mm256_mul_ps(weight, _mm256_set1_ps(WEIGHT_STEPS));
    let steps = _mm256_floor_ps(_mm256_add_ps(steps, _mm256_set1_ps(0.5)));
    let added = _mm256_min_ps(_mm256_max_ps(steps, _mm256_set1_ps(1.0)), cap);
    let sum = _mm256_add_ps(kept, added);
    let share = _mm256_div_ps(added, sum);
    let sign = _mm256_set1_ps(-0.0);
    for (channel, codes) in color.channels.iter_mut().zip([red, green, blue]) {
        let before = load_row(channel, row);
        let seen = _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(codes));
        let stored = _mm256_cvtepi32_ps(before);
        let difference = _mm256_sub_ps(seen, stored);
        let size = _mm256_ceil_ps(_mm256_mul_ps(_mm256_andnot_ps(sign, difference), share));
        let step = _mm256_or_ps(size, _mm256_and_ps(sign, difference));
        let after = _mm256_cvttps_epi32(_mm256_add_ps(stored, step));
        store_row(channel, row, _mm256_blendv_epi8(before, after, is_used));
    }
    let after = _mm256_cvttps_epi32(_mm256_min_ps(sum, cap));
    let after = _mm256_or_si256(after, _mm256_and_si256(bound, is_saturated));
    store_row(
        &mut color.weight,
        row,
        _mm256_blendv_epi8(stored, after, is_used),
    );
}

/// Lanes of `value` that hold `bit`.
#[target_feature(enable = "avx2")]
fn has(value: __m256i, bit: __m256i) -> __m256i {
    _mm256_cmpeq_epi32(_mm256_and_si256(value, bit), bit)
}

/// Red, green, blue and flags of eight pixels.
///
/// # Safety
/// Every value of `index` must be an index of `pixels`.
#[target_feature(enable = "avx2")]
unsafe fn load_pixels(pixels: &[LinearPixel], index: &[u32; BLOCK_EDGE]) -> [__m128i; 4] {
    let pixel = |lane: usize| {
        // SAFETY: the caller's; a pixel is the 8 bytes that the load reads.
        unsafe {
            _mm_loadl_epi64(std::ptr::from_ref(pixels.get_unchecked(index[lane] as usize)).cast())
        }
    };
    let quad = |lane: usize| {
        let first = _mm_unpacklo_epi16(pixel(lane), pixel(lane + 1));
        let second = _mm_unpacklo_epi16(pixel(lane + 2), pixel(lane + 3));
        [
            _mm_unpacklo_epi32(first, second),
            _mm_unpackhi_epi32(first, second),
        ]
    };
    let ([red_green, blue_flags], [red_green_above, blue_flags_above]) = (quad(0), quad(4));
    [
        _mm_unpacklo_epi64(red_green, red_green_above),
        _mm_unpackhi_epi64(red_green, red_green_above),
        _mm_unpacklo_epi64(blue_flags, blue_flags_above),
        _mm_unpackhi_epi64(blue_flags, blue_flags_above),
    ]
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_row(values: &[u16; BLOCK_VOXELS], row: usize) -> __m256i {
    let values = &values[row * BLOCK_EDGE..(row + 1) * BLOCK_EDGE];
    // SAFETY: the slice is 8 u16 long.
    _mm256_cvtepu16_epi32(unsafe { _mm_loadu_si128(values.as_ptr().cast()) })
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_row(values: &mut [u16; BLOCK_VOXELS], row: usize, lanes: __m256i) {
    let values = &mut values[row * BLOCK_EDGE..(row + 1) * BLOCK_EDGE];
    let packed = _mm_packus_epi32(
        _mm256_castsi256_si128(lanes),
        _mm256_extracti128_si256::<1>(lanes),
    );
    // SAFETY: the slice is 8 u16 long.
    unsafe { _mm_storeu_si128(values.as_mut_ptr().cast(), packed) }
}
