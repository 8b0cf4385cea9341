//! The same with vectors: a pixel's four lanes at once; four grey pixels at once.
#![expect(
    unsafe_code,
    reason = "vector loads and stores through pointers, inside slices whose lengths the callers assert"
)]

use std::arch::x86_64::*;

use super::scalar;
use super::{CodeLanes, LARGEST, LUMINANCE};
use crate::linear_pixel::{LinearPixel, RADIANCE_ONE};

/// See [`super::linear_row`].
pub(super) fn linear_row(
    lanes: &CodeLanes,
    codes: &[[u8; 3]],
    scale: &[f32],
    pixels: &mut [LinearPixel],
) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { linear_row_avx2(lanes, codes, scale, pixels) }
}

/// See [`super::grey_row`].
pub(super) fn grey_row(above: &[LinearPixel], below: &[LinearPixel], grey: &mut [f32]) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { grey_row_avx2(above, below, grey) }
}

#[target_feature(enable = "avx2")]
fn linear_row_avx2(
    lanes: &CodeLanes,
    codes: &[[u8; 3]],
    scale: &[f32],
    pixels: &mut [LinearPixel],
) {
    let (pairs, rest) = pixels.as_chunks_mut::<2>();
    let (code_pairs, code_rest) = codes.as_chunks::<2>();
    let (scale_pairs, scale_rest) = scale.as_chunks::<2>();
    for ((pair, codes), scale) in pairs.iter_mut().zip(code_pairs).zip(scale_pairs) {
        let first = lanes_of(lanes, codes[0], scale[0]);
        let second = lanes_of(lanes, codes[1], scale[1]);
        let both = _mm_packus_epi32(first, second);
        // SAFETY: a pair of pixels is 16 bytes.
        unsafe { _mm_storeu_si128(pair.as_mut_ptr().cast(), both) };
    }
    scalar::linear_row(lanes, code_rest, scale_rest, rest);
}

/// The four lanes of a pixel as integers.
#[inline]
#[target_feature(enable = "avx2")]
fn lanes_of([red, green, blue]: &CodeLanes, [r, g, b]: [u8; 3], scale: f32) -> __m128i {
    // SAFETY: each entry of the tables is four floats.
    let [red, green, blue] = unsafe {
        [
            _mm_loadu_ps(red[usize::from(r)].as_ptr()),
            _mm_loadu_ps(green[usize::from(g)].as_ptr()),
            _mm_loadu_ps(blue[usize::from(b)].as_ptr()),
        ]
    };
    let sum = _mm_add_ps(_mm_add_ps(red, green), blue);
    let scale = _mm_set1_ps(scale);
    let is_valid = _mm_and_ps(_mm_cmpneq_ps(scale, _mm_setzero_ps()), _mm_set1_ps(1.0));
    let scale = _mm_blend_ps::<0b1000>(scale, is_valid);
    let value = _mm_add_ps(_mm_mul_ps(sum, scale), _mm_set1_ps(0.5));
    let [x, y, z, w] = LARGEST;
    _mm_cvttps_epi32(_mm_min_ps(value, _mm_setr_ps(x, y, z, w)))
}

#[target_feature(enable = "avx2")]
fn grey_row_avx2(above: &[LinearPixel], below: &[LinearPixel], grey: &mut [f32]) {
    let (quads, rest) = grey.as_chunks_mut::<4>();
    let (above_quads, below_quads) = (above.as_chunks::<8>().0, below.as_chunks::<8>().0);
    let done = 8 * quads.len();
    for ((grey, above), below) in quads.iter_mut().zip(above_quads).zip(below_quads) {
        if !are_plain(above, below) {
            for (x, grey) in grey.iter_mut().enumerate() {
                let (above, below) = (&above[2 * x..], &below[2 * x..]);
                *grey = scalar::grey_of([above[0], above[1], below[0], below[1]]);
            }
            continue;
        }
        let sums: [__m128i; 4] = std::array::from_fn(|x| {
            // SAFETY: pixels 2x and 2x + 1 of 8 are 16 bytes inside the chunk.
            let (above, below) = unsafe {
                (
                    _mm_loadu_si128(above.as_ptr().add(2 * x).cast()),
                    _mm_loadu_si128(below.as_ptr().add(2 * x).cast()),
                )
            };
            let both = _mm256_add_epi32(_mm256_cvtepu16_epi32(above), _mm256_cvtepu16_epi32(below));
            _mm_add_epi32(
                _mm256_castsi256_si128(both),
                _mm256_extracti128_si256::<1>(both),
            )
        });
        // From four sums of [red, green, blue, flags] to four of each.
        let red_green = [
            _mm_unpacklo_epi32(sums[0], sums[1]),
            _mm_unpacklo_epi32(sums[2], sums[3]),
        ];
        let blue = _mm_unpacklo_epi64(
            _mm_unpackhi_epi32(sums[0], sums[1]),
            _mm_unpackhi_epi32(sums[2], sums[3]),
        );
        let red = _mm_unpacklo_epi64(red_green[0], red_green[1]);
        let green = _mm_unpackhi_epi64(red_green[0], red_green[1]);
        let weighted = _mm_add_ps(
            _mm_add_ps(
                _mm_mul_ps(_mm_set1_ps(LUMINANCE[0]), _mm_cvtepi32_ps(red)),
                _mm_mul_ps(_mm_set1_ps(LUMINANCE[1]), _mm_cvtepi32_ps(green)),
            ),
            _mm_mul_ps(_mm_set1_ps(LUMINANCE[2]), _mm_cvtepi32_ps(blue)),
        );
        // The divisor of the specification is a power of two here: the product is as exact.
        let mean = _mm_mul_ps(weighted, _mm_set1_ps(1.0 / (4.0 * f32::from(RADIANCE_ONE))));
        // SAFETY: four floats.
        unsafe { _mm_storeu_ps(grey.as_mut_ptr(), mean) };
    }
    scalar::grey_row(&above[done..], &below[done..], rest);
}

/// Whether all sixteen pixels are valid and unsaturated.
#[inline]
#[target_feature(enable = "avx2")]
fn are_plain(above: &[LinearPixel; 8], below: &[LinearPixel; 8]) -> bool {
    // SAFETY: eight pixels are 64 bytes.
    let quads = unsafe {
        [
            _mm256_loadu_si256(above.as_ptr().cast()),
            _mm256_loadu_si256(above.as_ptr().add(4).cast()),
            _mm256_loadu_si256(below.as_ptr().cast()),
            _mm256_loadu_si256(below.as_ptr().add(4).cast()),
        ]
    };
    let one = _mm256_set1_epi64x(i64::from(LinearPixel::VALID) << 48);
    let others = |quad| _mm256_xor_si256(quad, one);
    let mixed = _mm256_or_si256(
        _mm256_or_si256(others(quads[0]), others(quads[1])),
        _mm256_or_si256(others(quads[2]), others(quads[3])),
    );
    // What is left in the lanes of flags differs from "valid" in some pixel.
    let flags = _mm256_set1_epi64x((0xffff_u64 << 48).cast_signed());
    _mm256_testz_si256(mixed, flags) == 1
}
