//! Where along the rays of an image tile surface can be, from the blocks that may hold some.

use glam::Vec3A;

use super::blocks::{BlockStore, Slab};
use super::key::{BLOCK_EDGE, unpack};
use super::predict::VoxelRays;
use crate::kernels::integrate::{Octants, Z_NEAR};
use crate::model_view::DepthRange;

/// Edge of a tile, pixels.
pub(super) const TILE: usize = 2;
/// Voxels along an octant of a block.
const OCTANT_EDGE: f32 = BLOCK_EDGE as f32 / 2.0;

/// What ranges are fitted around.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Detail {
    /// Whole blocks: for few rays.
    Blocks,
    /// The octants that may hold surface: eight times the work, shorter marches.
    Octants,
}

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
    /// Surface lies in cells with a corner behind it, so within a voxel of an octant that has seen something
    /// behind: what has seen free space alone does not count.
    pub(super) fn fit(&mut self, store: &BlockStore, rays: &VoxelRays, detail: Detail) {
        self.ranges.fill(DepthRange::EMPTY);
        let steps = OctantSteps::new(rays, self.voxel_size, detail);
        for slab in store.slabs() {
            if !sees_slab(slab, rays) {
                continue;
            }
            for (&key, &behind) in slab.keys.iter().zip(&slab.behind) {
                if behind != 0 {
                    self.add_block(rays.local_voxel(unpack(key)), behind, &steps, rays);
                }
            }
        }
    }

    /// Adds the octants `behind` of the block whose first voxel is `first`.
    fn add_block(&mut self, first: Vec3A, behind: Octants, steps: &OctantSteps, rays: &VoxelRays) {
        let half = 0.5 * (BLOCK_EDGE as f32 + 1.0);
        let middle = first + (half - 1.0);
        if !rays.may_see(middle, half * 3.0_f32.sqrt()) {
            return;
        }
        let at = rays.homogeneous(first + steps.middle);
        if steps.detail == Detail::Blocks {
            return self.add_octant(at, steps);
        }
        for (octant, offset) in steps.offsets.iter().enumerate() {
            if behind >> octant & 1 == 1 {
                self.add_octant(at + *offset, steps);
            }
        }
    }

    /// Adds an octant by the homogeneous pixel of its middle.
    #[inline]
    fn add_octant(&mut self, at: Vec3A, steps: &OctantSteps) {
        let (nearest, farthest) = (at.z - steps.reach, at.z + steps.reach);
        let (mut low, mut high) = (
            Vec3A::ZERO,
            Vec3A::new(self.width as f32, self.height as f32, 0.0),
        );
        if nearest > Z_NEAR {
            // A corner at (U + δU) / (z + δz) is off the middle U / z by (δU − (U / z) δz) / (z + δz).
            let middle = at / at.z;
            let [x, y, z] = steps.half.map(|step| (step - middle * step.z).abs());
            let off = (x + y + z) / nearest;
            (low, high) = (middle - off, middle + off);
        }
        let columns = tiles(low.x, high.x, self.width);
        let lines = tiles(low.y, high.y, self.height);
        let tile_columns = self.width.div_ceil(TILE);
        for line in lines {
            for range in &mut self.ranges[line * tile_columns..][columns.clone()] {
                range.nearest = range.nearest.min(nearest);
                range.farthest = range.farthest.max(farthest);
            }
        }
    }
}

/// How octants lie to each other in the image: the same in every block. Homogeneous pixels (u·z, v·z, z). For
/// [`Detail::Blocks`] a block is one octant.
struct OctantSteps {
    detail: Detail,
    /// From a block's first voxel to the middle of octant 0, voxels.
    middle: Vec3A,
    /// From the middle of octant 0 to that of each octant.
    offsets: [Vec3A; 8],
    /// Half edges, along x, y, z, of the box in which an octant's voxels have cells.
    half: [Vec3A; 3],
    /// From a middle to the nearest corner, metres of z, and a voxel more: a march starts in front.
    reach: f32,
}

impl OctantSteps {
    fn new(rays: &VoxelRays, voxel_size: f32, detail: Detail) -> Self {
        let edge = match detail {
            Detail::Blocks => BLOCK_EDGE as f32,
            Detail::Octants => OCTANT_EDGE,
        };
        // Cells reach from the voxel before the octant to the one behind it.
        let half = 0.5 * (edge + 1.0);
        let [x, y, z] = rays.voxel_steps();
        Self {
            detail,
            middle: Vec3A::splat(half - 1.0),
            offsets: std::array::from_fn(|octant| {
                let step = |axis: usize| (octant >> axis & 1) as f32 * OCTANT_EDGE;
                step(0) * x + step(1) * y + step(2) * z
            }),
            half: [half * x, half * y, half * z],
            reach: half * (x.z.abs() + y.z.abs() + z.z.abs()) + voxel_size,
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
    let count = size.div_ceil(TILE);
    let from = (low.ceil() as usize / TILE).min(count);
    let to = if high >= 0.0 {
        (high as usize / TILE + 1).min(count)
    } else {
        0
    };
    from..to.max(from)
}
