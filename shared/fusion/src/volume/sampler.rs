//! Values of the field between voxels, with a cache of the blocks met last.

use glam::{Vec3A, Vec4};

use super::Volume;
use super::allocate::whole_below;
use super::key::{BLOCK_EDGE, BLOCK_SHIFT, BLOCK_VOXELS, pack};
use crate::kernels::integrate::Block;
use crate::kernels::prefetch::prefetch;

/// Entries of the cache along an axis, a power of two: neighbouring rays stay within such a cube of blocks.
const CACHE_EDGE: usize = 8;
/// Distance, in truncations, from which a value is saturated or was never observed: no slope leads there.
const SATURATED: f32 = 0.999;
/// Voxels of a neighbourhood along an axis.
const REACH: usize = 4;
/// Stands in where there is no block.
static NOTHING: Block = Block::EMPTY;

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

/// The field at a point between voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FieldSample {
    /// Signed distance in truncations.
    pub(super) tsdf: f32,
    /// Its change per voxel.
    pub(super) gradient: Vec3A,
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

    /// Value and slope at `point`; `None` unless the eight voxels around it have at least `min_weight`.
    ///
    /// The value is trilinear. The slope is the trilinear mean of central differences, or of the differences
    /// between the eight voxels along an axis on which the voxels beyond are not observed or saturated.
    pub(super) fn sample(&mut self, point: Vec3A, min_weight: f32) -> Option<FieldSample> {
        let cell = whole_below(point);
        let share = point - Vec3A::from_array(cell.map(|c| c as f32));
        let around = Around::new(self, cell);
        let weight = around.weight(share, min_weight)?;

        // Rows along x, named by their place along y and z; 1 and 2 enclose the point.
        let row = |y, z| around.row(y, z);
        let inner = [[row(1, 1), row(2, 1)], [row(1, 2), row(2, 2)]];
        let (before_y, behind_y) = ([row(0, 1), row(0, 2)], [row(3, 1), row(3, 2)]);
        let (before_z, behind_z) = ([row(1, 0), row(2, 0)], [row(1, 3), row(2, 3)]);
        let along_z = |[a, b]: [Vec4; 2]| a + (b - a) * share.z;
        let along_y = |[a, b]: [Vec4; 2]| a + (b - a) * share.y;
        let at_x = |row: Vec4| row.y + (row.z - row.y) * share.x;
        let lines = [along_y(inner[0]), along_y(inner[1])];
        let middle = along_z(lines);
        let value = at_x(middle);

        let ends =
            |rows: [Vec4; 2], others: [Vec4; 2]| rows[0].max(rows[1]).max(others[0].max(others[1]));
        let ends_x = ends(inner[0], inner[1]);
        let (ends_y, ends_z) = (ends(before_y, behind_y), ends(before_z, behind_z));
        let in_y = [[inner[0][0], inner[1][0]], [inner[0][1], inner[1][1]]].map(along_z);
        let slopes = [
            slope(middle.to_array(), share.x, ends_x.x.max(ends_x.w)),
            slope(
                [along_z(before_y), in_y[0], in_y[1], along_z(behind_y)].map(at_x),
                share.y,
                ends_y.y.max(ends_y.z),
            ),
            slope(
                [along_y(before_z), lines[0], lines[1], along_y(behind_z)].map(at_x),
                share.z,
                ends_z.y.max(ends_z.z),
            ),
        ];
        Some(FieldSample {
            tsdf: value,
            gradient: Vec3A::from_array(slopes),
            weight,
        })
    }

    /// Asks for what [`Sampler::sample`] reads at `point`.
    pub(super) fn fetch(&mut self, point: Vec3A) {
        let around = Around::new(self, whole_below(point));
        for z in 0..REACH {
            // Two rows share a cache line, or nearly so.
            for y in [0, 2, 3] {
                around.fetch(y, z, |block| &block.tsdf);
            }
        }
        for (y, z) in [(1, 1), (2, 1), (1, 2), (2, 2)] {
            around.fetch(y, z, |block| &block.weight);
        }
    }

    /// Linear luminance at `point`, Rec. 709: the mean of the colours of the eight voxels around it, by their
    /// nearness; 0 where at most half of that is known. Lower bounds are not known.
    pub(super) fn luminance(&mut self, point: Vec3A) -> f32 {
        let cell = whole_below(point);
        let share = point - Vec3A::from_array(cell.map(|c| c as f32));
        let (mut sum, mut known) = (0.0, 0.0);
        for corner in 0..8usize {
            let step = |axis: usize| (corner >> axis & 1) as i32;
            let voxel: [i32; 3] = std::array::from_fn(|axis| cell[axis] + step(axis));
            let slot = self.slot(voxel.map(|v| v >> BLOCK_SHIFT));
            let color = slot.block.and_then(|_| self.volume.color(slot.index));
            let [x, y, z] = voxel.map(|v| v as usize % BLOCK_EDGE);
            let radiance =
                color.and_then(|c| c.radiance(x | y << BLOCK_SHIFT | z << (2 * BLOCK_SHIFT)));
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

/// Slope at `share` between the inner two of four values; `ends` is the largest one that the outer two rest on.
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
    blocks: [&'a Block; 8],
    /// Place of voxel −1 of the neighbourhood in its block.
    first: [usize; 3],
}

impl<'a> Around<'a> {
    fn new(sampler: &mut Sampler<'a>, cell: [i32; 3]) -> Self {
        let first = cell.map(|c| c.wrapping_sub(1));
        let lower = first.map(|c| c >> BLOCK_SHIFT);
        // Where the neighbourhood ends in the lower block, the upper part is never asked for.
        let upper = first.map(|c| c.wrapping_add(REACH as i32 - 1) >> BLOCK_SHIFT);
        let crossed: usize = (0..3)
            .map(|axis| usize::from(lower[axis] != upper[axis]) << axis)
            .sum();
        let mut blocks = [&NOTHING; 8];
        for (part, block) in blocks.iter_mut().enumerate() {
            if part & !crossed == 0 {
                let ends = [lower, upper];
                let at = std::array::from_fn(|axis| ends[part >> axis & 1][axis]);
                *block = sampler.block(at).unwrap_or(&NOTHING);
            }
        }
        Self {
            blocks,
            first: first.map(|c| c as usize % BLOCK_EDGE),
        }
    }

    /// Part along y and z, and offset in that block, of the row at (y, z).
    #[inline]
    fn line(&self, y: usize, z: usize) -> (usize, usize) {
        let (y, z) = (self.first[1] + y, self.first[2] + z);
        let part = (y >> BLOCK_SHIFT) << 1 | (z >> BLOCK_SHIFT) << 2;
        let (y, z) = (y % BLOCK_EDGE, z % BLOCK_EDGE);
        (part, BLOCK_EDGE * (y + BLOCK_EDGE * z))
    }

    /// Four values in a row along x, of what `values` shows of a block.
    #[inline]
    fn gather(
        &self,
        y: usize,
        z: usize,
        values: impl Fn(&'a Block) -> &'a [f32; BLOCK_VOXELS],
    ) -> Vec4 {
        let (part, line) = self.line(y, z);
        let lower = values(self.blocks[part]);
        let x = self.first[0];
        if x + REACH <= BLOCK_EDGE {
            return Vec4::from_slice(&lower[line + x..][..REACH]);
        }
        let upper = values(self.blocks[part | 1]);
        let at = |x: usize| {
            let half = if x < BLOCK_EDGE { lower } else { upper };
            half[line + x % BLOCK_EDGE]
        };
        Vec4::new(at(x), at(x + 1), at(x + 2), at(x + 3))
    }

    /// Asks for the values that [`Around::gather`] reads.
    #[inline]
    fn fetch(&self, y: usize, z: usize, values: impl Fn(&'a Block) -> &'a [f32; BLOCK_VOXELS]) {
        let (part, line) = self.line(y, z);
        let x = self.first[0];
        prefetch(values(self.blocks[part]), line + x);
        if x + REACH > BLOCK_EDGE {
            prefetch(values(self.blocks[part | 1]), line);
        }
    }

    /// Distances of a row; 1 where there is no block.
    #[inline]
    fn row(&self, y: usize, z: usize) -> Vec4 {
        self.gather(y, z, |block| &block.tsdf)
    }

    /// Trilinear weight of the cell; `None` when one of its corners has less than `min_weight`.
    #[inline]
    fn weight(&self, share: Vec3A, min_weight: f32) -> Option<f32> {
        let row = |y, z| self.gather(y, z, |block| &block.weight);
        let [a, b, c, d] = [row(1, 1), row(2, 1), row(1, 2), row(2, 2)];
        let least = a.min(b).min(c.min(d));
        if !(least.y.min(least.z) >= min_weight) {
            return None;
        }
        let (low, high) = (a + (b - a) * share.y, c + (d - c) * share.y);
        let middle = low + (high - low) * share.z;
        Some(middle.y + (middle.z - middle.y) * share.x)
    }
}
