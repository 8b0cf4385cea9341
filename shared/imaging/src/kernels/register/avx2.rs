//! Projection: the specification compiled for AVX2, whose loop the compiler widens. Sampling: the lanes of two
//! neighbouring pixels at once.
#![expect(
    unsafe_code,
    reason = "calls into code compiled for AVX2; vector loads and stores inside checked indices"
)]

use std::arch::x86_64::*;

use super::scalar::{self, Corner};
use super::{ProjectedRow, Projection, Seen};
use crate::linear_pixel::LinearPixel;

/// See [`super::project_row`].
pub(super) fn project_row(
    projection: &Projection,
    v: usize,
    depth: &[f32],
    projected: &mut ProjectedRow,
) {
    #[target_feature(enable = "avx2")]
    fn widened(projection: &Projection, v: usize, depth: &[f32], projected: &mut ProjectedRow) {
        scalar::project_row(projection, v, depth, projected);
    }
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { widened(projection, v, depth, projected) }
}

/// See [`super::sample_row`].
pub(super) fn sample_row(seen: &Seen, row: &ProjectedRow, pixels: &mut [LinearPixel]) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { sample_row_avx2(seen, row, pixels) }
}

#[target_feature(enable = "avx2")]
fn sample_row_avx2(seen: &Seen, row: &ProjectedRow, pixels: &mut [LinearPixel]) {
    let points = row.x.iter().zip(&row.y).zip(&row.inverse_depth);
    for (pixel, ((&x, &y), &inverse_depth)) in pixels.iter_mut().zip(points) {
        if inverse_depth == 0.0 || seen.is_hidden(x, y, inverse_depth) {
            *pixel = LinearPixel::INVALID;
            continue;
        }
        *pixel = match plain_sample(seen, x, y) {
            Some(pixel) => pixel,
            None => scalar::sample(seen, x, y),
        };
    }
}

/// The sample where all four pixels are inside, valid and unsaturated.
#[inline]
#[target_feature(enable = "avx2")]
fn plain_sample(seen: &Seen, x: f32, y: f32) -> Option<LinearPixel> {
    let corner = Corner::of(x, y);
    let (left, upper) = (
        usize::try_from(corner.x).ok()?,
        usize::try_from(corner.y).ok()?,
    );
    if left + 1 >= seen.width || upper + 1 >= seen.height {
        return None;
    }
    let first = upper * seen.width + left;
    // SAFETY: both pairs of pixels, 16 bytes each, lie in the image, `width · height` pixels long by the
    // caller's assertion: left + 1 < width and upper + 1 < height.
    let (above, below) = unsafe {
        let above = seen.color.as_ptr().add(first);
        (
            _mm_loadu_si128(above.cast()),
            _mm_loadu_si128(above.add(seen.width).cast()),
        )
    };
    let valid = _mm_set1_epi64x(i64::from(LinearPixel::VALID) << 48);
    let flags = _mm_set1_epi64x((0xffff_u64 << 48).cast_signed());
    let others = _mm_or_si128(_mm_xor_si128(above, valid), _mm_xor_si128(below, valid));
    if _mm_testz_si128(others, flags) == 0 {
        return None;
    }
    let x_shares = _mm256_set_m128(
        _mm_set1_ps(corner.x_shares[1]),
        _mm_set1_ps(corner.x_shares[0]),
    );
    let [upper_share, lower_share] = corner.y_shares;
    let lanes = |pair: __m128i, share: f32| {
        let weights = _mm256_mul_ps(x_shares, _mm256_set1_ps(share));
        _mm256_mul_ps(weights, _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(pair)))
    };
    let columns = _mm256_add_ps(lanes(above, upper_share), lanes(below, lower_share));
    let sum = _mm_add_ps(
        _mm256_castps256_ps128(columns),
        _mm256_extractf128_ps::<1>(columns),
    );
    let rounded = _mm_cvttps_epi32(_mm_add_ps(sum, _mm_set1_ps(0.5)));
    let packed = _mm_packus_epi32(rounded, rounded);
    // The lane of flags sums to 1 but for rounding; it is set, not trusted.
    let packed = _mm_insert_epi16::<3>(packed, i32::from(LinearPixel::VALID));
    let mut pixel = LinearPixel::INVALID;
    // SAFETY: a pixel is the lower 8 bytes.
    unsafe { _mm_storel_epi64((&raw mut pixel).cast(), packed) };
    Some(pixel)
}
