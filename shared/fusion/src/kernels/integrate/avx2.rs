//! The row update, 8 voxels at once, in two passes over a block.
//!
//! The first pass only reads the image: it ends in 64 rows of observations, and none of its branches waits
//! for a load. The second reads and writes voxels, which the block before has prefetched. A lane without an
//! observation carries weight 0 and keeps what is stored.
#![expect(
    unsafe_code,
    reason = "vector loads and stores and pixel reads through pointers"
)]

use std::arch::x86_64::*;

use super::observations::{Observations, Octants, ROWS, first_octant};
use super::{Block, BlockView, ColorBlock, ColorView, Conflicts, DepthView, UpdateRule, Z_NEAR};
use crate::volume::key::BLOCK_EDGE;

mod color;

const CACHE_LINE_VOXELS: usize = 64 / size_of::<f32>();

/// As [`super::scalar::integrate_rows`], bit for bit.
pub(super) fn integrate_rows(
    block: &mut Block,
    color: Option<(&mut ColorBlock, ColorView<'_>)>,
    ahead: Option<&Block>,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
    conflicts: &mut Conflicts,
) -> Octants {
    // Anyone can write `Level::Avx2`; asking costs one load.
    if !std::is_x86_feature_detected!("avx2") {
        return super::scalar::integrate_rows(block, color, image, view, rule, conflicts);
    }
    // SAFETY: AVX2 was detected above.
    unsafe {
        if view.is_inside {
            observe::<true>(ahead, image, view, rule, &mut conflicts.observations);
        } else {
            observe::<false>(ahead, image, view, rule, &mut conflicts.observations);
        }
        average_rows(block, color, rule, conflicts);
    }
    conflicts.observations.behind
}

/// Reads the image for every row that can be in the band, and fetches the block `ahead` meanwhile.
/// `INSIDE`: see [`BlockView::is_inside`].
#[target_feature(enable = "avx2")]
fn observe<const INSIDE: bool>(
    ahead: Option<&Block>,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
    out: &mut Observations,
) {
    let mut start = [[0.0f32; ROWS]; 3];
    let (active, free) = row_starts(view, &mut start);
    (out.rows, out.projected) = (0, 0);
    let Some(last) = image.depth.len().checked_sub(1) else {
        return;
    };

    let last_pixel = _mm256_set1_epi32(last as i32);
    let zero = _mm256_setzero_ps();
    let one = _mm256_set1_ps(1.0);
    let half = _mm256_set1_ps(0.5);
    let z_near = _mm256_set1_ps(Z_NEAR);
    let width = _mm256_set1_ps(image.width as f32);
    let height = _mm256_set1_ps(image.height as f32);
    let columns = _mm256_set1_epi32(image.width as i32);
    let deepest = _mm256_set1_ps(-rule.truncation);
    let per_metre = _mm256_set1_ps(1.0 / rule.truncation);
    let weight_at_one_metre = _mm256_set1_ps(rule.weight_at_one_metre);
    let lanes = lanes();
    let [along_u, along_v, along_z] =
        view.step[0].map(|step| _mm256_mul_ps(lanes, _mm256_set1_ps(step)));

    let mut left = active & free;
    while left != 0 {
        let row = left.trailing_zeros() as usize;
        left &= left - 1;
        let z = _mm256_add_ps(_mm256_set1_ps(start[2][row]), along_z);
        let inverse_z = _mm256_div_ps(one, z);
        let in_front = if INSIDE {
            all_lanes()
        } else {
            _mm256_cmp_ps::<_CMP_GE_OQ>(z, z_near)
        };
        let weight = _mm256_mul_ps(_mm256_mul_ps(inverse_z, inverse_z), weight_at_one_metre);
        store_row(&mut out.tsdf, row, _mm256_and_ps(one, in_front));
        store_row(&mut out.weight, row, _mm256_and_ps(weight, in_front));
        out.rows |= u64::from(_mm256_movemask_ps(in_front) != 0) << row;
    }

    let mut behind = 0;
    let mut left = active & !free;
    while left != 0 {
        let row = left.trailing_zeros() as usize;
        left &= left - 1;
        if let Some(ahead) = ahead {
            prefetch_line(ahead, row);
        }
        let u = _mm256_add_ps(_mm256_set1_ps(start[0][row]), along_u);
        let v = _mm256_add_ps(_mm256_set1_ps(start[1][row]), along_v);
        let z = _mm256_add_ps(_mm256_set1_ps(start[2][row]), along_z);
        let inverse_z = _mm256_div_ps(one, z);
        let column = _mm256_add_ps(_mm256_mul_ps(u, inverse_z), half);
        let line = _mm256_add_ps(_mm256_mul_ps(v, inverse_z), half);
        let pixel = _mm256_add_epi32(
            _mm256_mullo_epi32(_mm256_cvttps_epi32(line), columns),
            _mm256_cvttps_epi32(column),
        );
        // Lanes outside read some pixel and then hold depth 0.
        let pixel = _mm256_min_epu32(pixel, last_pixel);
        // SAFETY: an unsigned minimum with the last index, which fits i32 (`super::integrate_block` asserts it)
        // and exists (tested above).
        let mut depth = unsafe { load_pixels(image.depth, pixel, &mut out.pixel[row]) };
        if !INSIDE {
            let inside_columns = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(column, zero),
                _mm256_cmp_ps::<_CMP_LT_OQ>(column, width),
            );
            let inside_lines = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(line, zero),
                _mm256_cmp_ps::<_CMP_LT_OQ>(line, height),
            );
            let in_front = _mm256_cmp_ps::<_CMP_GE_OQ>(z, z_near);
            let inside = _mm256_and_ps(in_front, _mm256_and_ps(inside_columns, inside_lines));
            depth = _mm256_and_ps(depth, inside);
        }
        let distance = _mm256_sub_ps(depth, z);
        let measured = _mm256_cmp_ps::<_CMP_GT_OQ>(depth, zero);
        let reached = _mm256_cmp_ps::<_CMP_GE_OQ>(distance, deepest);
        let observed = _mm256_and_ps(measured, reached);
        let tsdf = _mm256_min_ps(_mm256_mul_ps(distance, per_metre), one);
        let weight = _mm256_mul_ps(_mm256_mul_ps(inverse_z, inverse_z), weight_at_one_metre);
        let tsdf = _mm256_and_ps(tsdf, observed);
        let weight = _mm256_and_ps(weight, observed);
        store_row(&mut out.tsdf, row, tsdf);
        store_row(&mut out.weight, row, weight);
        out.rows |= u64::from(_mm256_movemask_ps(observed) != 0) << row;
        let is_counted = _mm256_cmp_ps::<_CMP_GT_OQ>(weight, zero);
        let lanes = _mm256_movemask_ps(_mm256_and_ps(tsdf, is_counted));
        let halves = u8::from(lanes & 0x0f != 0) | u8::from(lanes & 0xf0 != 0) << 1;
        behind |= halves << first_octant(row);
    }
    out.projected = active & !free;
    out.behind = behind;
}

/// Fuses the observed rows into the block; sign conflicts are held back.
#[target_feature(enable = "avx2")]
fn average_rows(
    block: &mut Block,
    mut color: Option<(&mut ColorBlock, ColorView<'_>)>,
    rule: &UpdateRule,
    conflicts: &mut Conflicts,
) {
    let zero = _mm256_setzero_ps();
    let half = _mm256_set1_ps(0.5);
    let magnitude = _mm256_castsi256_ps(_mm256_set1_epi32(0x7fff_ffff));
    let cap = _mm256_set1_ps(rule.weight_cap);
    let conflict = _mm256_set1_ps(rule.conflict);
    let weighted_conflict = _mm256_set1_ps(rule.conflict_at_one_metre * rule.weight_at_one_metre);
    let rows = conflicts.observations.rows;
    conflicts.set_rows(rows);
    let mut left = rows;
    while left != 0 {
        let row = left.trailing_zeros() as usize;
        left &= left - 1;
        let tsdf = load_row(&conflicts.observations.tsdf, row);
        let mut weight = load_row(&conflicts.observations.weight, row);
        let stored = load_row(&block.tsdf, row);
        let stored_weight = load_row(&block.weight, row);
        store_row(&mut conflicts.before.tsdf, row, stored);
        store_row(&mut conflicts.before.weight, row, stored_weight);
        let change = _mm256_sub_ps(tsdf, stored);
        let difference = _mm256_and_ps(change, magnitude);
        let is_large = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(difference, conflict),
            _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_mul_ps(difference, weight), weighted_conflict),
        );
        let disagrees = _mm256_and_ps(
            is_large,
            _mm256_cmp_ps::<_CMP_GT_OQ>(stored_weight, _mm256_mul_ps(half, weight)),
        );
        let observed = _mm256_cmp_ps::<_CMP_GT_OQ>(weight, zero);
        // The sign bits differ where the xor has its sign bit; movemask and blendv read only that.
        let opposed = _mm256_and_ps(
            _mm256_xor_ps(stored, tsdf),
            _mm256_and_ps(disagrees, observed),
        );
        let opposed_lanes = _mm256_movemask_ps(opposed);
        if opposed_lanes != 0 {
            hold_back(row, opposed_lanes, conflicts);
            weight = _mm256_blendv_ps(weight, zero, opposed);
        }
        let sum = _mm256_add_ps(stored_weight, weight);
        // 0/0 in lanes that were never observed, which the blend leaves out.
        let average = _mm256_add_ps(stored, _mm256_mul_ps(change, _mm256_div_ps(weight, sum)));
        let fused = _mm256_cmp_ps::<_CMP_GT_OQ>(weight, zero);
        store_row(
            &mut block.tsdf,
            row,
            _mm256_blendv_ps(stored, average, fused),
        );
        store_row(
            &mut block.weight,
            row,
            _mm256_blendv_ps(stored_weight, _mm256_min_ps(sum, cap), fused),
        );
        let Some((color, colors)) = &mut color else {
            continue;
        };
        let near = _mm256_cmp_ps::<_CMP_LE_OQ>(
            _mm256_and_ps(tsdf, magnitude),
            _mm256_set1_ps(colors.reach),
        );
        let near = _mm256_and_ps(fused, near);
        let observations = &conflicts.observations;
        if _mm256_movemask_ps(near) != 0 && observations.projected >> row & 1 == 1 {
            let pixel = &observations.pixel[row];
            // SAFETY: the pixels of a projected row are indices of the depth image, which has as many
            // pixels (`super::integrate_block` asserts it).
            unsafe { color::blend_row(color, row, colors.pixels, pixel, near, weight) };
        }
    }
}

fn hold_back(row: usize, mut lanes: i32, conflicts: &mut Conflicts) {
    while lanes != 0 {
        let index = row * BLOCK_EDGE + lanes.trailing_zeros() as usize;
        let observations = &conflicts.observations;
        conflicts.push(index, observations.tsdf[index], observations.weight[index]);
        lanes &= lanes - 1;
    }
}

/// Homogeneous pixel of the first voxel of each row, as `super::row_start` computes it; with it the rows
/// that reach the band, and those wholly in free space.
#[target_feature(enable = "avx2")]
fn row_starts(view: &BlockView, start: &mut [[f32; ROWS]; 3]) -> (u64, u64) {
    let lanes = lanes();
    let row_z = _mm256_set1_ps(7.0 * view.step[0][2]);
    let (farthest, nearest) = (_mm256_set1_ps(view.farthest), _mm256_set1_ps(view.nearest));
    let (mut active, mut free) = (0u64, 0u64);
    for z in 0..BLOCK_EDGE {
        for (c, starts) in start.iter_mut().enumerate() {
            let along_y = _mm256_mul_ps(lanes, _mm256_set1_ps(view.step[1][c]));
            let offset = _mm256_add_ps(along_y, _mm256_set1_ps(z as f32 * view.step[2][c]));
            store_row(
                starts,
                z,
                _mm256_add_ps(_mm256_set1_ps(view.start[c]), offset),
            );
        }
        let first = load_row(&start[2], z);
        let last = _mm256_add_ps(first, row_z);
        let is_active = _mm256_cmp_ps::<_CMP_NGT_UQ>(_mm256_min_ps(first, last), farthest);
        let is_free = _mm256_cmp_ps::<_CMP_LT_OQ>(_mm256_max_ps(first, last), nearest);
        active |= (_mm256_movemask_ps(is_active) as u64) << (8 * z);
        free |= (_mm256_movemask_ps(is_free) as u64) << (8 * z);
    }
    (active, free)
}

/// Asks for one of the 64 cache lines of the block that comes next. All at once would fill the miss
/// buffers and stall; one per row never does.
#[inline]
#[target_feature(enable = "avx2")]
fn prefetch_line(ahead: &Block, line: usize) {
    let voxel = line % (ROWS / 2) * CACHE_LINE_VOXELS;
    let values = if line < ROWS / 2 {
        &ahead.tsdf
    } else {
        &ahead.weight
    };
    _mm_prefetch::<_MM_HINT_T0>((&raw const values[voxel]).cast());
}

#[target_feature(enable = "avx2")]
fn all_lanes() -> __m256 {
    _mm256_castsi256_ps(_mm256_set1_epi32(-1))
}

#[target_feature(enable = "avx2")]
fn lanes() -> __m256 {
    _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_row<const N: usize>(values: &[f32; N], row: usize) -> __m256 {
    let values = &values[row * BLOCK_EDGE..(row + 1) * BLOCK_EDGE];
    // SAFETY: the slice is 8 f32 long.
    unsafe { _mm256_loadu_ps(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store_row<const N: usize>(values: &mut [f32; N], row: usize, lanes: __m256) {
    let values = &mut values[row * BLOCK_EDGE..(row + 1) * BLOCK_EDGE];
    // SAFETY: the slice is 8 f32 long.
    unsafe { _mm256_storeu_ps(values.as_mut_ptr(), lanes) }
}

/// The depths of eight pixels, whose indices stay in `index`. Eight scalar loads take less time than the
/// gather instruction on Zen 3.
///
/// # Safety
/// Every lane of `pixel` must be an index of `depth`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load_pixels(depth: &[f32], pixel: __m256i, index: &mut [u32; BLOCK_EDGE]) -> __m256 {
    // SAFETY: the array is 8 u32 long.
    unsafe { _mm256_storeu_si256(index.as_mut_ptr().cast(), pixel) };
    // SAFETY: the caller's.
    let at = |lane: usize| unsafe { *depth.get_unchecked(index[lane] as usize) };
    _mm256_setr_ps(at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7))
}
