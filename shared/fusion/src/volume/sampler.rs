//! Values of the field between voxels, with a cache of the blocks met last.

use super::Volume;
use super::key::{BLOCK_EDGE, BLOCK_SHIFT, pack};
use crate::kernels::integrate::Block;

/// Entries of the cache along an axis, a power of two: neighbouring rays stay within such a cube of blocks.
const CACHE_EDGE: usize = 8;
/// Distance, in truncations, from which a value is saturated or was never observed: no slope leads there.
const SATURATED: f32 = 0.999;
/// Voxels of a neighbourhood along an axis.
const REACH: usize = 4;

#[derive(Clone, Copy)]
struct Slot<'a> {
    key: u64,
    block: Option<&'a Block>,
}

/// Reads a volume at points given in voxels from an anchor block.
pub(super) struct Sampler<'a> {
    volume: &'a Volume,
    anchor: [i32; 3],
    slots: [Slot<'a>; CACHE_EDGE.pow(3)],
}

/// The field at a point between voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FieldSample {
    /// Signed distance in truncations.
    pub(super) tsdf: f32,
    /// Its change per voxel.
    pub(super) gradient: [f32; 3],
    /// Weight.
    pub(super) weight: f32,
}

impl<'a> Sampler<'a> {
    /// `anchor`: the block whose first voxel is the point 0.
    pub(super) fn new(volume: &'a Volume, anchor: [i32; 3]) -> Self {
        Self {
            volume,
            anchor,
            slots: [Slot {
                key: u64::MAX,
                block: None,
            }; CACHE_EDGE.pow(3)],
        }
    }

    /// The block at coordinates relative to the anchor.
    #[inline]
    pub(super) fn block(&mut self, local: [i32; 3]) -> Option<&'a Block> {
        let block: [i32; 3] =
            std::array::from_fn(|axis| local[axis].wrapping_add(self.anchor[axis]));
        let key = pack(block)?;
        let mask = CACHE_EDGE - 1;
        let [x, y, z] = local.map(|c| c as usize & mask);
        let slot = &mut self.slots[(z * CACHE_EDGE + y) * CACHE_EDGE + x];
        if slot.key != key {
            let index = self.volume.store.find(key);
            let block = index.map(|index| self.volume.block(index));
            *slot = Slot { key, block };
        }
        slot.block
    }

    /// Value and slope at `point`; `None` unless the eight voxels around it have at least `min_weight`.
    ///
    /// The value is trilinear. The slope is the trilinear mean of central differences, or of the differences
    /// between the eight voxels along an axis on which the voxels beyond are not observed or saturated.
    pub(super) fn sample(&mut self, point: [f32; 3], min_weight: f32) -> Option<FieldSample> {
        let cell = point.map(f32::floor);
        let share: [f32; 3] = std::array::from_fn(|axis| point[axis] - cell[axis]);
        // Whole numbers; the cast saturates, and no block is that far away.
        let around = Around::new(self, cell.map(|c| c as i32));
        let weight = around.weight(share, min_weight)?;
        let [x_share, y_share, z_share] = share;

        // Along x: rows about the point, blended. Along y and z: every row at the point's x.
        let mut along_x = [0.0; REACH];
        let mut at_x = [[0.0; REACH]; REACH];
        // Largest outer value along x, y, z.
        let mut ends = [f32::NEG_INFINITY; 3];
        for (z, line) in at_x.iter_mut().enumerate() {
            for (y, value) in line.iter_mut().enumerate() {
                let is_inner = [y == 1 || y == 2, z == 1 || z == 2];
                if is_inner == [false; 2] {
                    continue;
                }
                let row = around.row(y, z);
                *value = row[1] + (row[2] - row[1]) * x_share;
                if is_inner == [true; 2] {
                    let part = share_of(y, y_share) * share_of(z, z_share);
                    for (sum, value) in along_x.iter_mut().zip(row) {
                        *sum += part * value;
                    }
                    ends[0] = ends[0].max(row[0].max(row[3]));
                } else {
                    let end = &mut ends[1 + usize::from(is_inner[0])];
                    *end = end.max(row[1].max(row[2]));
                }
            }
        }
        let along_y: [f32; REACH] =
            std::array::from_fn(|y| at_x[1][y] + (at_x[2][y] - at_x[1][y]) * z_share);
        let along_z: [f32; REACH] =
            std::array::from_fn(|z| at_x[z][1] + (at_x[z][2] - at_x[z][1]) * y_share);
        Some(FieldSample {
            tsdf: along_x[1] + (along_x[2] - along_x[1]) * x_share,
            gradient: [
                slope(along_x, x_share, ends[0]),
                slope(along_y, y_share, ends[1]),
                slope(along_z, z_share, ends[2]),
            ],
            weight,
        })
    }
}

/// Share of inner voxel `place` (1 or 2) at a point `share` of the way from 1 to 2.
#[inline]
fn share_of(place: usize, share: f32) -> f32 {
    if place == 1 { 1.0 - share } else { share }
}

/// Slope at `share` between the inner two of four voxels; `ends` is the largest value among the outer ones.
#[inline]
fn slope(values: [f32; REACH], share: f32, ends: f32) -> f32 {
    let [a, b, c, d] = values;
    if ends < SATURATED {
        0.5 * ((c - a) * (1.0 - share) + (d - b) * share)
    } else {
        c - b
    }
}

/// The up to eight blocks about a cell, and where its 4³ neighbourhood lies in them.
struct Around<'a> {
    /// Blocks of the lower and upper part along x, y, z (bits 0, 1, 2).
    blocks: [Option<&'a Block>; 8],
    /// Voxel −1 of the neighbourhood.
    first: [i32; 3],
}

impl<'a> Around<'a> {
    fn new(sampler: &mut Sampler<'a>, cell: [i32; 3]) -> Self {
        let first = cell.map(|c| c.wrapping_sub(1));
        let lower = first.map(|c| c >> BLOCK_SHIFT);
        let upper = first.map(|c| c.wrapping_add(REACH as i32 - 1) >> BLOCK_SHIFT);
        let mut blocks = [None; 8];
        for (part, block) in blocks.iter_mut().enumerate() {
            let is_upper = |axis: usize| part >> axis & 1 == 1;
            // Where the neighbourhood ends in the lower block, the upper part is never asked for.
            if (0..3).any(|axis| is_upper(axis) && lower[axis] == upper[axis]) {
                continue;
            }
            let at = std::array::from_fn(|axis| {
                if is_upper(axis) {
                    upper[axis]
                } else {
                    lower[axis]
                }
            });
            *block = sampler.block(at);
        }
        Self { blocks, first }
    }

    /// Part (0 or 1) of a voxel of the neighbourhood along an axis, and its place in that block.
    #[inline]
    fn place(&self, axis: usize, voxel: usize) -> (usize, usize) {
        let at = (self.first[axis] & (BLOCK_EDGE as i32 - 1)) as usize + voxel;
        (at >> BLOCK_SHIFT, at & (BLOCK_EDGE - 1))
    }

    /// Distances of the four voxels in a row along x; 1 where there is no block.
    #[inline]
    fn row(&self, y: usize, z: usize) -> [f32; REACH] {
        let ((part_y, y), (part_z, z)) = (self.place(1, y), self.place(2, z));
        std::array::from_fn(|x| {
            let (part_x, x) = self.place(0, x);
            self.blocks[part_x | part_y << 1 | part_z << 2].map_or(1.0, |block| {
                block.tsdf[x + BLOCK_EDGE * (y + BLOCK_EDGE * z)]
            })
        })
    }

    /// Trilinear weight of the cell; `None` when one of its corners has less than `min_weight`.
    fn weight(&self, share: [f32; 3], min_weight: f32) -> Option<f32> {
        let mut sum = 0.0;
        for corner in 0..8usize {
            let (mut part, mut voxel, mut portion) = (0, 0, 1.0);
            for (axis, &share) in share.iter().enumerate() {
                let place = 1 + (corner >> axis & 1);
                let (part_here, at) = self.place(axis, place);
                part |= part_here << axis;
                voxel |= at << (BLOCK_SHIFT as usize * axis);
                portion *= share_of(place, share);
            }
            let weight = self.blocks[part]?.weight[voxel];
            if !(weight >= min_weight) {
                return None;
            }
            sum += portion * weight;
        }
        Some(sum)
    }
}
