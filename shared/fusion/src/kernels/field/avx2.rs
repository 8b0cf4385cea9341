//! A point at a time, its rows along y in the lower and those along z in the upper four lanes.
#![expect(unsafe_code, reason = "vector loads through pointers")]

use std::arch::x86_64::*;

use glam::Vec3A;

use super::{FieldSample, Neighbourhood, slope};
use crate::kernels::integrate::Block;
use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

/// As [`super::scalar::sample_fields`], bit for bit. First voxels lie in their blocks.
pub(super) fn sample_fields(
    points: &[Neighbourhood<'_>],
    min_weight: f32,
    samples: &mut [FieldSample],
) {
    // Anyone can write `Level::Avx2`; asking costs one load.
    if !std::is_x86_feature_detected!("avx2") {
        return super::scalar::sample_fields(points, min_weight, samples);
    }
    // SAFETY: AVX2 was detected above; `super::sample_fields` asserts that first voxels lie in their blocks.
    unsafe {
        for (point, out) in points.iter().zip(samples) {
            *out = match point.first[0] {
                5 => sample::<4>(point, min_weight),
                6 => sample::<8>(point, min_weight),
                7 => sample::<12>(point, min_weight),
                _ => sample::<0>(point, min_weight),
            };
        }
    }
}

/// The sample of a point whose rows begin `SHIFT` bytes behind the middle of a row of the lower block, or, with 0,
/// end in it.
///
/// # Safety
/// `first` lies in the block, and `SHIFT` belongs to `first[0]`.
#[target_feature(enable = "avx2")]
unsafe fn sample<const SHIFT: i32>(point: &Neighbourhood<'_>, min_weight: f32) -> FieldSample {
    let share = point.share;
    // SAFETY: `line` gives the start of a row inside a block; the caller vouches for the rest.
    let row = |y: usize, z: usize| unsafe { load::<SHIFT>(point, y, z, |block| &block.tsdf) };
    // SAFETY: as above.
    let weights = |y: usize, z: usize| unsafe { load::<SHIFT>(point, y, z, |block| &block.weight) };
    let [a, b, c, d] = [weights(1, 1), weights(2, 1), weights(1, 2), weights(2, 2)];
    let least = _mm_min_ps(_mm_min_ps(a, b), _mm_min_ps(c, d));
    let is_enough = _mm_movemask_ps(_mm_cmpge_ps(least, _mm_set1_ps(min_weight)));
    if is_enough & 0b0110 != 0b0110 {
        return FieldSample::NONE;
    }
    let (along_y, along_z) = (_mm_set1_ps(share.y), _mm_set1_ps(share.z));
    let middle_weight = lerp(lerp(a, b, along_y), lerp(c, d, along_y), along_z);

    let inner = [[row(1, 1), row(2, 1)], [row(1, 2), row(2, 2)]];
    let before = [
        _mm256_set_m128(row(1, 0), row(0, 1)),
        _mm256_set_m128(row(2, 0), row(0, 2)),
    ];
    let behind = [
        _mm256_set_m128(row(1, 3), row(3, 1)),
        _mm256_set_m128(row(2, 3), row(3, 2)),
    ];
    let across = _mm256_set_m128(along_y, along_z);
    // Values along y in the lower, along z in the upper lanes.
    let lower = lerp_both(
        _mm256_set_m128(inner[0][0], inner[0][0]),
        _mm256_set_m128(inner[0][1], inner[1][0]),
        across,
    );
    let upper = lerp_both(
        _mm256_set_m128(inner[1][0], inner[0][1]),
        _mm256_set_m128(inner[1][1], inner[1][1]),
        across,
    );
    let first = lerp_both(before[0], before[1], across);
    let last = lerp_both(behind[0], behind[1], across);
    let middle = lerp(
        _mm256_extractf128_ps::<1>(lower),
        _mm256_extractf128_ps::<1>(upper),
        along_z,
    );

    // Transposed, so that each half holds the four values of its axis at the point's x.
    let (low_before, high_before) = (
        _mm256_unpacklo_ps(first, lower),
        _mm256_unpackhi_ps(first, lower),
    );
    let (low_behind, high_behind) = (
        _mm256_unpacklo_ps(upper, last),
        _mm256_unpackhi_ps(upper, last),
    );
    let at_x = lerp_both(
        _mm256_shuffle_ps::<0b11_10_11_10>(low_before, low_behind),
        _mm256_shuffle_ps::<0b01_00_01_00>(high_before, high_behind),
        _mm256_set1_ps(share.x),
    );
    let ends = _mm256_max_ps(
        _mm256_max_ps(before[0], before[1]),
        _mm256_max_ps(behind[0], behind[1]),
    );
    let ends_x = _mm_max_ps(
        _mm_max_ps(inner[0][0], inner[0][1]),
        _mm_max_ps(inner[1][0], inner[1][1]),
    );
    let (values, ends, ends_x) = (halves(at_x), halves(ends), lanes(ends_x));
    let (middle, weight) = (lanes(middle), lanes(middle_weight));
    FieldSample {
        tsdf: middle[1] + (middle[2] - middle[1]) * share.x,
        gradient: Vec3A::new(
            slope(middle, share.x, ends_x[0].max(ends_x[3])),
            slope(values[0], share.y, ends[0][1].max(ends[0][2])),
            slope(values[1], share.z, ends[1][1].max(ends[1][2])),
        ),
        weight: weight[1] + (weight[2] - weight[1]) * share.x,
    }
}

/// Four values in a row along x.
///
/// # Safety
/// As [`sample`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load<const SHIFT: i32>(
    point: &Neighbourhood<'_>,
    y: usize,
    z: usize,
    values: impl Fn(&Block) -> &[f32; BLOCK_VOXELS],
) -> __m128 {
    let (part, line) = point.line(y, z);
    let lower = values(point.blocks[part]).as_ptr();
    // SAFETY: rows are 8 long and begin at `line`, at most 504. With `SHIFT` 0 the first voxel is at most the
    // fifth of its row; else four values are read from the middle of one row and four from the start of another.
    unsafe {
        if SHIFT == 0 {
            return _mm_loadu_ps(lower.add(line + point.first[0]));
        }
        let upper = values(point.blocks[part | 1]).as_ptr();
        let (low, high) = (
            _mm_loadu_ps(lower.add(line + BLOCK_EDGE / 2)),
            _mm_loadu_ps(upper.add(line)),
        );
        _mm_castsi128_ps(_mm_alignr_epi8::<SHIFT>(
            _mm_castps_si128(high),
            _mm_castps_si128(low),
        ))
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn lerp(a: __m128, b: __m128, share: __m128) -> __m128 {
    _mm_add_ps(a, _mm_mul_ps(_mm_sub_ps(b, a), share))
}

#[inline]
#[target_feature(enable = "avx2")]
fn lerp_both(a: __m256, b: __m256, share: __m256) -> __m256 {
    _mm256_add_ps(a, _mm256_mul_ps(_mm256_sub_ps(b, a), share))
}

#[inline]
#[target_feature(enable = "avx2")]
fn lanes(values: __m128) -> [f32; 4] {
    let mut out = [0.0; 4];
    // SAFETY: `out` has room for four lanes.
    unsafe { _mm_storeu_ps(out.as_mut_ptr(), values) };
    out
}

#[inline]
#[target_feature(enable = "avx2")]
fn halves(values: __m256) -> [[f32; 4]; 2] {
    [
        lanes(_mm256_castps256_ps128(values)),
        lanes(_mm256_extractf128_ps::<1>(values)),
    ]
}
