//! The specification of the row update.

use super::observations::{Octants, first_octant};
use super::{
    Block, BlockView, ColorBlock, ColorView, Conflicts, DepthView, UpdateRule, Z_NEAR, average,
    row_start,
};
use crate::volume::key::BLOCK_EDGE;

/// Updates every voxel of `block`, and the colour of those near the observed surface; sign conflicts go to
/// `conflicts` instead. Returns the octants in
/// which an observation lies behind the surface.
pub(super) fn integrate_rows(
    block: &mut Block,
    mut color: Option<(&mut ColorBlock, ColorView<'_>)>,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
    conflicts: &mut Conflicts,
) -> Octants {
    conflicts.before.clone_from(block);
    conflicts.set_rows(u64::MAX);
    let mut behind = 0;
    let per_metre = 1.0 / rule.truncation;
    let weighted_conflict = rule.conflict_at_one_metre * rule.weight_at_one_metre;
    for row in 0..BLOCK_EDGE * BLOCK_EDGE {
        let start = row_start(view, row % BLOCK_EDGE, row / BLOCK_EDGE);
        let end_z = start[2] + 7.0 * view.step[0][2];
        if start[2].min(end_z) > view.farthest {
            continue;
        }
        let is_free = start[2].max(end_z) < view.nearest;
        for x in 0..BLOCK_EDGE {
            let [u, v, z]: [f32; 3] =
                std::array::from_fn(|c| start[c] + x as f32 * view.step[0][c]);
            if z < Z_NEAR || z.is_nan() {
                continue;
            }
            let inverse_z = 1.0 / z;
            let (tsdf, pixel) = if is_free {
                (1.0, 0)
            } else {
                // Adding ½ and truncating is rounding to the nearest pixel, once negatives are out.
                let (column, line) = (u * inverse_z + 0.5, v * inverse_z + 0.5);
                let is_inside = column >= 0.0
                    && column < image.width as f32
                    && line >= 0.0
                    && line < image.height as f32;
                if !is_inside {
                    continue;
                }
                let pixel = line as usize * image.width + column as usize;
                let depth = image.depth[pixel];
                let distance = depth - z;
                if !(depth > 0.0 && distance >= -rule.truncation) {
                    continue;
                }
                ((distance * per_metre).min(1.0), pixel)
            };
            let weight = inverse_z * inverse_z * rule.weight_at_one_metre;
            // Underflows far away; a first average would be 0/0.
            if weight <= 0.0 {
                continue;
            }
            if tsdf.is_sign_negative() {
                behind |= 1 << (first_octant(row) + 2 * x / BLOCK_EDGE);
            }
            let index = row * BLOCK_EDGE + x;
            let (stored, stored_weight) = (block.tsdf[index], block.weight[index]);
            let difference = (tsdf - stored).abs();
            let is_conflict = stored.is_sign_negative() != tsdf.is_sign_negative()
                && difference > rule.conflict
                // weight = weight_at_one_metre / z²
                && difference * weight > weighted_conflict
                && stored_weight > 0.5 * weight;
            if is_conflict {
                conflicts.push(index, tsdf, weight);
            } else {
                (block.tsdf[index], block.weight[index]) =
                    average(stored, stored_weight, tsdf, weight, rule.weight_cap);
                if let Some((color, colors)) = &mut color
                    && tsdf.abs() <= colors.reach
                {
                    color.blend(index, colors.pixels[pixel], weight);
                }
            }
        }
    }
    behind
}
