//! The row update, 8 voxels at once.
#![expect(
    unsafe_code,
    reason = "vector loads, stores and gathers through pointers"
)]

use std::arch::x86_64::*;

use super::{Block, BlockView, Conflicts, DepthView, UpdateRule, Z_NEAR, row_start};
use crate::volume::key::BLOCK_EDGE;

/// As [`super::scalar::integrate_rows`], bit for bit.
pub(super) fn integrate_rows(
    block: &mut Block,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
    conflicts: &mut Conflicts,
) {
    // Anyone can write `Level::Avx2`; asking costs one load.
    if !std::is_x86_feature_detected!("avx2") {
        return super::scalar::integrate_rows(block, image, view, rule, conflicts);
    }
    // SAFETY: AVX2 was detected on the line above.
    unsafe { integrate_rows_avx2(block, image, view, rule, conflicts) }
}

#[target_feature(enable = "avx2")]
fn integrate_rows_avx2(
    block: &mut Block,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
    conflicts: &mut Conflicts,
) {
    let zero = _mm256_setzero_ps();
    let one = _mm256_set1_ps(1.0);
    let half = _mm256_set1_ps(0.5);
    let magnitude = _mm256_castsi256_ps(_mm256_set1_epi32(0x7fff_ffff));
    let z_near = _mm256_set1_ps(Z_NEAR);
    let width = _mm256_set1_ps(image.width as f32);
    let height = _mm256_set1_ps(image.height as f32);
    let columns = _mm256_set1_epi32(image.width as i32);
    let behind = _mm256_set1_ps(-rule.truncation);
    let per_metre = _mm256_set1_ps(1.0 / rule.truncation);
    let weight_at_one_metre = _mm256_set1_ps(rule.weight_at_one_metre);
    let cap = _mm256_set1_ps(rule.weight_cap);
    let conflict = _mm256_set1_ps(rule.conflict);
    let lanes = _mm256_setr_ps(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0);
    let along_u = _mm256_mul_ps(lanes, _mm256_set1_ps(view.step[0][0]));
    let along_v = _mm256_mul_ps(lanes, _mm256_set1_ps(view.step[0][1]));
    let along_z = _mm256_mul_ps(lanes, _mm256_set1_ps(view.step[0][2]));
    let row_z = 7.0 * view.step[0][2];

    for row in 0..BLOCK_EDGE * BLOCK_EDGE {
        let start = row_start(view, row % BLOCK_EDGE, row / BLOCK_EDGE);
        let end_z = start[2] + row_z;
        if start[2].min(end_z) > view.farthest {
            continue;
        }
        let z = _mm256_add_ps(_mm256_set1_ps(start[2]), along_z);
        let inverse_z = _mm256_div_ps(one, z);
        let in_front = _mm256_cmp_ps::<_CMP_GE_OQ>(z, z_near);
        let (tsdf, observed) = if start[2].max(end_z) < view.nearest {
            (one, in_front)
        } else {
            let u = _mm256_add_ps(_mm256_set1_ps(start[0]), along_u);
            let v = _mm256_add_ps(_mm256_set1_ps(start[1]), along_v);
            let column = _mm256_add_ps(_mm256_mul_ps(u, inverse_z), half);
            let line = _mm256_add_ps(_mm256_mul_ps(v, inverse_z), half);
            let inside_columns = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(column, zero),
                _mm256_cmp_ps::<_CMP_LT_OQ>(column, width),
            );
            let inside_lines = _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GE_OQ>(line, zero),
                _mm256_cmp_ps::<_CMP_LT_OQ>(line, height),
            );
            let inside = _mm256_and_ps(in_front, _mm256_and_ps(inside_columns, inside_lines));
            let pixel = _mm256_add_epi32(
                _mm256_mullo_epi32(_mm256_cvttps_epi32(line), columns),
                _mm256_cvttps_epi32(column),
            );
            // SAFETY: only lanes of `inside` are read; there 0 <= column < width and 0 <= line < height,
            // so the index is below width * height = depth.len(), which the caller asserts and which
            // fits i32 (16384² at most).
            let depth =
                unsafe { _mm256_mask_i32gather_ps::<4>(zero, image.depth.as_ptr(), pixel, inside) };
            let distance = _mm256_sub_ps(depth, z);
            let measured = _mm256_cmp_ps::<_CMP_GT_OQ>(depth, zero);
            let reached = _mm256_cmp_ps::<_CMP_GE_OQ>(distance, behind);
            let observed = _mm256_and_ps(inside, _mm256_and_ps(measured, reached));
            if _mm256_movemask_ps(observed) == 0 {
                continue;
            }
            (
                _mm256_min_ps(_mm256_mul_ps(distance, per_metre), one),
                observed,
            )
        };
        let weight = _mm256_mul_ps(_mm256_mul_ps(inverse_z, inverse_z), weight_at_one_metre);

        let tsdf_row = &mut block.tsdf[row * BLOCK_EDGE..(row + 1) * BLOCK_EDGE];
        let weight_row = &mut block.weight[row * BLOCK_EDGE..(row + 1) * BLOCK_EDGE];
        // SAFETY: both rows are exactly 8 f32 long by the slicing above.
        let (stored, stored_weight) = unsafe {
            (
                _mm256_loadu_ps(tsdf_row.as_ptr()),
                _mm256_loadu_ps(weight_row.as_ptr()),
            )
        };
        let change = _mm256_sub_ps(tsdf, stored);
        let disagrees = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_and_ps(change, magnitude), conflict),
            _mm256_cmp_ps::<_CMP_GT_OQ>(stored_weight, _mm256_mul_ps(half, weight)),
        );
        // The sign bits differ where the xor is negative; blendv reads only the sign bit.
        let opposed = _mm256_and_ps(
            _mm256_xor_ps(stored, tsdf),
            _mm256_and_ps(disagrees, observed),
        );
        let opposed_lanes = _mm256_movemask_ps(opposed);

        let sum = _mm256_add_ps(stored_weight, weight);
        let averaged = _mm256_add_ps(stored, _mm256_mul_ps(change, _mm256_div_ps(weight, sum)));
        let mut written = observed;
        if opposed_lanes != 0 {
            written = _mm256_blendv_ps(observed, zero, opposed);
            hold_back(row, opposed_lanes, tsdf, weight, conflicts);
        }
        let new_tsdf = _mm256_blendv_ps(stored, averaged, written);
        let new_weight = _mm256_blendv_ps(stored_weight, _mm256_min_ps(sum, cap), written);
        // SAFETY: both rows are exactly 8 f32 long by the slicing above.
        unsafe {
            _mm256_storeu_ps(tsdf_row.as_mut_ptr(), new_tsdf);
            _mm256_storeu_ps(weight_row.as_mut_ptr(), new_weight);
        }
    }
}

#[target_feature(enable = "avx2")]
fn hold_back(row: usize, mut lanes: i32, tsdf: __m256, weight: __m256, conflicts: &mut Conflicts) {
    let mut tsdf_lanes = [0.0; BLOCK_EDGE];
    let mut weight_lanes = [0.0; BLOCK_EDGE];
    // SAFETY: both arrays are 8 f32 long.
    unsafe {
        _mm256_storeu_ps(tsdf_lanes.as_mut_ptr(), tsdf);
        _mm256_storeu_ps(weight_lanes.as_mut_ptr(), weight);
    }
    while lanes != 0 {
        let lane = lanes.trailing_zeros() as usize;
        conflicts.push(
            row * BLOCK_EDGE + lane,
            tsdf_lanes[lane],
            weight_lanes[lane],
        );
        lanes &= lanes - 1;
    }
}
