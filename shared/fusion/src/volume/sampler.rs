//! Values of the field between voxels, with a cache of the blocks met last.

use glam::Vec3A;

use super::Volume;
use super::allocate::whole_below;
use super::key::{BLOCK_EDGE, BLOCK_SHIFT, pack};
use crate::kernels::field::{FieldSample, NOTHING, Neighbourhood, REACH, sample_fields};
use crate::kernels::integrate::{Block, ColorBlock};
use crate::kernels::prefetch::prefetch;

/// Entries of the cache along an axis, a power of two: neighbouring rays stay within such a cube of blocks.
const CACHE_EDGE: usize = 8;

#[derive(Clone, Copy)]
struct Slot<'a> {
    key: u64,
    block: Option<&'a Block>,
    /// Index of the block.
    index: u32,
}

/// Reads a volume at points given in voxels from an anchor block.
pub(super) struct Sampler<'a> {
    volume: &'a Volume,
    anchor: [i32; 3],
    slots: [Slot<'a>; CACHE_EDGE.pow(3)],
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
                index: 0,
            }; CACHE_EDGE.pow(3)],
        }
    }

    /// The block at coordinates relative to the anchor, which lie within ±2²⁰.
    #[inline]
    pub(super) fn block(&mut self, local: [i32; 3]) -> Option<&'a Block> {
        self.slot(local).block
    }

    #[inline]
    fn slot(&mut self, local: [i32; 3]) -> Slot<'a> {
        let [x, y, z] = local.map(|c| u64::from(c as u32) & 0x1f_ffff);
        let key = x | y << 21 | z << 42;
        let [x, y, z] = local.map(|c| c as usize % CACHE_EDGE);
        let place = (z * CACHE_EDGE + y) * CACHE_EDGE + x;
        if self.slots[place].key != key {
            self.slots[place] = self.look_up(key, local);
        }
        self.slots[place]
    }

    #[cold]
    fn look_up(&self, key: u64, local: [i32; 3]) -> Slot<'a> {
        let block: [i32; 3] =
            std::array::from_fn(|axis| local[axis].wrapping_add(self.anchor[axis]));
        let index = pack(block).and_then(|key| self.volume.store.find(key));
        Slot {
            key,
            block: index.map(|index| self.volume.block(index)),
            index: index.unwrap_or(0),
        }
    }

    /// The 4³ voxels about `point`.
    #[inline]
    pub(super) fn neighbourhood(&mut self, point: Vec3A) -> Neighbourhood<'a> {
        let cell = whole_below(point);
        let first = cell.map(|c| c.wrapping_sub(1));
        let lower = first.map(|c| c >> BLOCK_SHIFT);
        // Where the neighbourhood ends in the lower block, the upper part is never asked for.
        let upper = first.map(|c| c.wrapping_add(REACH as i32 - 1) >> BLOCK_SHIFT);
        let mut blocks = [&NOTHING; 8];
        let [x, y, z]: [usize; 3] =
            std::array::from_fn(|axis| usize::from(lower[axis] != upper[axis]));
        let ends = [lower, upper];
        for z in 0..=z {
            for y in 0..=y {
                for x in 0..=x {
                    let at = [ends[x][0], ends[y][1], ends[z][2]];
                    blocks[x | y << 1 | z << 2] = self.block(at).unwrap_or(&NOTHING);
                }
            }
        }
        Neighbourhood {
            blocks,
            first: first.map(|c| c as usize % BLOCK_EDGE),
            share: point - Vec3A::from_array(cell.map(|c| c as f32)),
        }
    }

    /// The field at each of `points`; [`FieldSample::NONE`] unless the eight voxels around one have at least
    /// `min_weight`.
    #[inline]
    pub(super) fn sample_all(
        &self,
        points: &[Neighbourhood<'a>],
        min_weight: f32,
        samples: &mut [FieldSample],
    ) {
        sample_fields(self.volume.level, points, min_weight, samples);
    }

    /// Asks for most of what [`Sampler::luminance`] reads at `point`.
    #[inline]
    pub(super) fn fetch_luminance(&mut self, point: Vec3A) {
        let cell = whole_below(point);
        let slot = self.slot(cell.map(|c| c >> BLOCK_SHIFT));
        let Some(color) = slot.block.and_then(|_| self.volume.color(slot.index)) else {
            return;
        };
        let [x, y, z] = cell.map(|c| c as usize % BLOCK_EDGE);
        // Four rows along y share a cache line.
        for z in [z, (z + 1) % BLOCK_EDGE] {
            let voxel = x | y << BLOCK_SHIFT | z << (2 * BLOCK_SHIFT);
            color
                .channels
                .iter()
                .chain([&color.weight])
                .for_each(|values| prefetch(values, voxel));
        }
    }

    /// Linear luminance at `point`, Rec. 709: the mean of the colours of the eight voxels around it, by their
    /// nearness; 0 where at most half of that is known. Lower bounds are not known.
    pub(super) fn luminance(&mut self, point: Vec3A) -> f32 {
        let cell = whole_below(point);
        let share = point - Vec3A::from_array(cell.map(|c| c as f32));
        let lower = cell.map(|c| c >> BLOCK_SHIFT);
        let first = cell.map(|c| c as usize % BLOCK_EDGE);
        let mut colors = [None; 8];
        let mut part_met = usize::MAX;
        let (mut sum, mut known) = (0.0, 0.0);
        for corner in 0..8usize {
            let voxel: [usize; 3] = std::array::from_fn(|axis| first[axis] + (corner >> axis & 1));
            let [x, y, z] = voxel.map(|v| v >> BLOCK_SHIFT);
            let part = x | y << 1 | z << 2;
            if part != part_met {
                part_met = part;
                let at = [x, y, z].map(|c| c as i32);
                let slot = self.slot(std::array::from_fn(|axis| lower[axis] + at[axis]));
                colors[part] = slot.block.and_then(|_| self.volume.color(slot.index));
            }
            let [x, y, z] = voxel.map(|v| v % BLOCK_EDGE);
            let radiance = colors[part].and_then(|c: &ColorBlock| {
                c.radiance(x | y << BLOCK_SHIFT | z << (2 * BLOCK_SHIFT))
            });
            if let Some(([red, green, blue], false)) = radiance {
                let portion: f32 = (0..3)
                    .map(|axis| share_of(corner >> axis & 1, share[axis]))
                    .product();
                sum += portion * (0.2126 * red + 0.7152 * green + 0.0722 * blue);
                known += portion;
            }
        }
        if known > 0.5 { sum / known } else { 0.0 }
    }
}

/// Share of the lower (0) or upper (1) end at a point `share` of the way.
#[inline]
fn share_of(end: usize, share: f32) -> f32 {
    if end == 0 { 1.0 - share } else { share }
}
