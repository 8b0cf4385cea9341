//! Where along the rays of an image tile surface can be, from the blocks that may hold some.

use glam::Vec3A;

use super::blocks::{BlockStore, SLAB_BLOCKS, Slab};
use super::key::{BLOCK_EDGE, unpack};
use super::predict::VoxelRays;
use crate::kernels::integrate::Z_NEAR;
use crate::model_view::DepthRange;

/// Edge of a tile, pixels.
pub(super) const TILE: usize = 8;

/// The tiles of an image that is being predicted.
pub(super) struct Tiles<'a> {
    pub(super) ranges: &'a mut [DepthRange],
    pub(super) width: usize,
    pub(super) height: usize,
    /// Metres per voxel.
    pub(super) voxel_size: f32,
}

impl Tiles<'_> {
    /// Fits every tile's range around the blocks of `store` that it sees.
    ///
    /// Surface lies in cells with a corner behind it, so within a voxel of a block that has seen something
    /// behind: blocks of free space alone do not count.
    pub(super) fn fit(&mut self, store: &BlockStore, rays: &VoxelRays) {
        self.ranges.fill(DepthRange::EMPTY);
        for slab in store.slabs() {
            if slab.behind == 0 || !sees_slab(slab, rays) {
                continue;
            }
            let mut left = slab.behind;
            while left != 0 {
                let place = left.trailing_zeros() as usize % SLAB_BLOCKS;
                left &= left - 1;
                self.add_block(rays.local_voxel(unpack(slab.keys[place])), rays);
            }
        }
    }

    /// Adds the block whose first voxel is `first`.
    fn add_block(&mut self, first: Vec3A, rays: &VoxelRays) {
        let half = 0.5 * (BLOCK_EDGE as f32 + 1.0);
        let middle = first + (half - 1.0);
        let radius = half * 3.0_f32.sqrt();
        if !rays.may_see(middle, radius) {
            return;
        }
        // A voxel of slack in depth: a march starts in front of the surface.
        let depth = rays.depth(middle);
        let reach = rays.depth_reach(half) + self.voxel_size;
        let (nearest, farthest) = (depth - reach, depth + reach);
        let (mut low, mut high) = ([0.0; 2], [self.width as f32, self.height as f32]);
        if nearest > Z_NEAR {
            (low, high) = rays.pixel_box(middle, half);
        }
        let columns = tiles(low[0], high[0], self.width);
        let lines = tiles(low[1], high[1], self.height);
        let tile_columns = self.width.div_ceil(TILE);
        for line in lines {
            for range in &mut self.ranges[line * tile_columns..][columns.clone()] {
                range.nearest = range.nearest.min(nearest);
                range.farthest = range.farthest.max(farthest);
            }
        }
    }
}

/// Whether the box around a slab's blocks may reach into the image.
fn sees_slab(slab: &Slab, rays: &VoxelRays) -> bool {
    let (low, high) = (
        rays.local_voxel(slab.low) - 1.0,
        rays.local_voxel(slab.high) + BLOCK_EDGE as f32,
    );
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    rays.may_see(middle, half.length())
}

/// The tiles that hold pixels from `low` to `high`, of `size` pixels.
fn tiles(low: f32, high: f32, size: usize) -> std::ops::Range<usize> {
    // Casts saturate, at 0 too.
    let from = (low.ceil() as usize).min(size) / TILE;
    let to = if high >= 0.0 {
        (high.floor() as usize).min(size - 1) / TILE + 1
    } else {
        0
    };
    from..to.max(from)
}
