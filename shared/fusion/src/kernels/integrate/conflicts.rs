//! Observations that contradict what is stored: the two sides of a thin thing (hard-cases D07).

use super::observations::Observations;
use super::{Block, BlockView, UpdateRule, average};
use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

/// Cosine between the stored gradient and the direction to the camera below which the stored surface
/// faces away from this camera. A margin keeps noisy grazing views on the ordinary average.
const FACES_AWAY: f32 = -0.2;
/// Share of the slope of a distance field that a gradient needs to count as one.
const LEAST_SLOPE: f32 = 0.3;

/// Observations whose sign contradicts a stored value, held back until the whole block is read; scratch
/// that is reused from block to block.
pub struct Conflicts {
    count: usize,
    index: [u16; BLOCK_VOXELS],
    tsdf: [f32; BLOCK_VOXELS],
    weight: [f32; BLOCK_VOXELS],
    /// Bit r: row r is in `before`.
    rows: u64,
    /// What the rows that changed held before.
    pub(super) before: Block,
    /// All observations of the block.
    pub(super) observations: Observations,
}

impl Conflicts {
    /// No conflicts.
    pub const NONE: Self = Self {
        count: 0,
        index: [0; BLOCK_VOXELS],
        tsdf: [0.0; BLOCK_VOXELS],
        weight: [0.0; BLOCK_VOXELS],
        rows: 0,
        before: Block::EMPTY,
        observations: Observations::NONE,
    };

    pub(super) fn clear(&mut self) {
        self.count = 0;
        self.rows = 0;
    }

    /// Says which rows were copied to `before`.
    pub(super) fn set_rows(&mut self, rows: u64) {
        self.rows = rows;
    }

    #[inline]
    pub(super) fn push(&mut self, index: usize, tsdf: f32, weight: f32) {
        self.index[self.count] = index as u16;
        self.tsdf[self.count] = tsdf;
        self.weight[self.count] = weight;
        self.count += 1;
    }

    /// Decides the held-back observations.
    ///
    /// A stored value whose gradient points away from this camera belongs to the other side of a thin thing.
    /// There, "seen as free" is a fact and "behind a surface" a guess, so the positive one of the two stands.
    /// Gradients are those of the block before this frame: the frame's own values beside an old one would
    /// make a slope that no surface has.
    pub(super) fn resolve(&self, block: &mut Block, view: &BlockView, rule: &UpdateRule) {
        let mut faces_away = [false; BLOCK_VOXELS];
        for (is_away, &index) in faces_away.iter_mut().zip(&self.index[..self.count]) {
            *is_away = self.stored_surface_faces_away(block, usize::from(index), view, rule);
        }
        for (entry, &is_away) in faces_away.iter().enumerate().take(self.count) {
            let index = usize::from(self.index[entry]);
            let (tsdf, weight) = (self.tsdf[entry], self.weight[entry]);
            let (stored, stored_weight) = (block.tsdf[index], block.weight[index]);
            if !is_away {
                let averaged = average(stored, stored_weight, tsdf, weight, rule.weight_cap);
                (block.tsdf[index], block.weight[index]) = averaged;
            } else if tsdf > 0.0 {
                (block.tsdf[index], block.weight[index]) = (tsdf, weight.min(rule.weight_cap));
            }
        }
    }

    /// Distance and weight before this frame.
    #[inline]
    fn stored(&self, block: &Block, index: usize) -> (f32, f32) {
        let holder = if self.rows >> (index / BLOCK_EDGE) & 1 == 1 {
            &self.before
        } else {
            block
        };
        (holder.tsdf[index], holder.weight[index])
    }

    fn stored_surface_faces_away(
        &self,
        block: &Block,
        index: usize,
        view: &BlockView,
        rule: &UpdateRule,
    ) -> bool {
        let (here, _) = self.stored(block, index);
        let (mut along_view, mut squared) = (0.0, 0.0);
        for axis in 0..3 {
            let stride = BLOCK_EDGE.pow(axis as u32);
            let place = index / stride % BLOCK_EDGE;
            // The value itself stands in for a neighbour that is unobserved or in another block.
            let (mut before, mut after, mut voxels) = (here, here, 0.0_f32);
            if place > 0
                && let (tsdf, weight) = self.stored(block, index - stride)
                && weight > 0.0
            {
                (before, voxels) = (tsdf, voxels + 1.0);
            }
            if place + 1 < BLOCK_EDGE
                && let (tsdf, weight) = self.stored(block, index + stride)
                && weight > 0.0
            {
                (after, voxels) = (tsdf, voxels + 1.0);
            }
            let slope = (after - before) / voxels.max(1.0);
            along_view += slope * view.to_camera[axis];
            squared += slope * slope;
        }
        // A true distance field changes by `rule.conflict` (one voxel in truncations) per voxel.
        let length = squared.sqrt();
        length > LEAST_SLOPE * rule.conflict && along_view < FACES_AWAY * length
    }
}
