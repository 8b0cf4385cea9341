//! Which blocks a depth image touches.

use glam::Vec3A;
use rayon::prelude::*;

use super::key::{mix, pack};
use crate::kernels::integrate::DepthView;

/// Rows of one parallel task. Fixed, so that the order of keys does not depend on threads.
const BAND_ROWS: usize = 60;
/// Entries of the per-task cache of recently touched blocks, a power of two.
const CACHE_ENTRIES: usize = 4096;
/// Rays that at least cross a piece of surface as wide as the truncation: the coarsest grid of pixels that
/// keeps this is followed. Fewer miss blocks of which only a corner reaches into the band.
const RAYS_PER_TRUNCATION: f32 = 2.0;
/// Pixels between followed rays, coarsest first.
const STRIDES: [usize; 2] = [4, 2];
/// Pixels that are tested together for depth edges.
const CHUNK: usize = 16;
/// Depth steps by which neighbours on one surface may differ: less is noise and no depth edge.
const NOISE_STEPS: f32 = 1.5;
/// Bit of a touched key, above the 63 bits of the key itself: more than one ray met the block.
const REPEATED: u64 = 1 << 63;

/// The pixel rays in block units, relative to the block that holds the camera: a point at depth z of
/// pixel (x, y) is `eye + z (forward + x right + y down)`.
pub(super) struct BlockRays {
    /// Block that local coordinates count from.
    pub anchor: [i32; 3],
    /// Camera centre.
    pub eye: Vec3A,
    /// Ray of pixel (0, 0) per metre of z.
    pub forward: Vec3A,
    /// Change of the ray per column.
    pub right: Vec3A,
    /// Change of the ray per row.
    pub down: Vec3A,
    /// Half of the band to allocate, metres of z.
    pub truncation: f32,
    /// The same in block edges.
    pub truncation_in_blocks: f32,
    /// Samples of the band on each side of the surface.
    pub half_samples: usize,
    /// Metres of z between samples.
    pub sample_step: f32,
    /// Resolution of depth at 1 m, metres; it grows with z².
    pub depth_step: f32,
}

/// Finds the blocks that a frame's rays meet; its buffers are reused from frame to frame.
#[derive(Default)]
pub(super) struct Toucher {
    bands: Vec<Band>,
}

impl Toucher {
    /// Samples rays through depth ± truncation and collects the blocks on the way.
    ///
    /// Every fourth or second pixel in x and y is followed, as blocks are many pixels large or few, and every
    /// pixel where blocks are smaller still or next to a depth edge: there a thin part, or a stretch of surface
    /// seen at a grazing angle, would fall between rays.
    pub(super) fn touch(&mut self, image: DepthView<'_>, rays: &BlockRays) {
        let pixel_in_blocks = rays.right.length().max(rays.down.length());
        let grids = STRIDES.map(|stride| Grid {
            mask: stride - 1,
            farthest: rays.truncation_in_blocks
                / (stride as f32 * RAYS_PER_TRUNCATION * pixel_in_blocks),
            // Between two followed rays depth then changes by no more than both bands cover.
            jump: 2.0 * rays.truncation / stride as f32,
        });
        let band_count = image.height.div_ceil(BAND_ROWS);
        self.bands.resize_with(band_count, Band::default);
        self.bands
            .par_iter_mut()
            .enumerate()
            .for_each(|(number, band)| {
                band.clear(rays);
                let rows = number * BAND_ROWS..((number + 1) * BAND_ROWS).min(image.height);
                for y in rows {
                    band.walk_row(image, y, &grids, rays);
                }
            });
    }

    /// Keys of touched blocks in image order, each with whether more than one ray met it. A key stands once
    /// or more often.
    pub(super) fn keys(&self) -> impl Iterator<Item = (u64, bool)> {
        let keys = self.bands.iter().flat_map(|band| &band.keys);
        keys.map(|&key| (key & !REPEATED, key & REPEATED != 0))
    }

    /// Requests beyond the coordinate range of keys.
    pub(super) fn out_of_range_count(&self) -> usize {
        self.bands.iter().map(|band| band.out_of_range_count).sum()
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.bands.iter().map(Band::bytes).sum()
    }
}

/// Which pixels are followed up to a depth.
struct Grid {
    /// Low bits that are 0 in the column and the row of a followed pixel.
    mask: usize,
    /// Depth up to which the grid is dense enough, metres.
    farthest: f32,
    /// Difference to a neighbour from which a pixel off the grid is followed, metres.
    jump: f32,
}

/// The block that one sample of the last ray fell into.
#[derive(Clone, Copy)]
struct LastTouch {
    cell: [i32; 3],
    is_repeated: bool,
}

/// A pixel that is followed.
#[derive(Clone, Copy)]
struct Followed {
    slope: Vec3A,
    depth: f32,
}

/// The walk over one band of rows.
#[derive(Default)]
struct Band {
    /// Keys met, with [`REPEATED`].
    keys: Vec<u64>,
    out_of_range_count: usize,
    last: Vec<LastTouch>,
    /// Keys met of late, and where they stand in `keys`.
    cache: Vec<(u64, u32)>,
    /// Differences to neighbours of the row at hand, metres.
    jumps: Vec<f32>,
    followed: Vec<Followed>,
    /// Blocks of the followed pixels at one sample, and at the sample before.
    cells: [Vec<[i32; 3]>; 2],
}

impl Band {
    fn clear(&mut self, rays: &BlockRays) {
        self.keys.clear();
        self.out_of_range_count = 0;
        self.last.clear();
        let nowhere = LastTouch {
            cell: [i32::MIN; 3],
            is_repeated: true,
        };
        self.last.resize(2 * rays.half_samples + 1, nowhere);
        self.cache.clear();
        self.cache.resize(CACHE_ENTRIES, (u64::MAX, 0));
    }

    fn bytes(&self) -> usize {
        let cells = self.cells.iter().map(Vec::capacity).sum::<usize>();
        self.keys.capacity() * size_of::<u64>()
            + self.last.capacity() * size_of::<LastTouch>()
            + self.cache.capacity() * size_of::<(u64, u32)>()
            + self.jumps.capacity() * size_of::<f32>()
            + self.followed.capacity() * size_of::<Followed>()
            + cells * size_of::<[i32; 3]>()
    }

    fn walk_row(
        &mut self,
        image: DepthView<'_>,
        y: usize,
        grids: &[Grid; STRIDES.len()],
        rays: &BlockRays,
    ) {
        let width = image.width;
        let row = &image.depth[y * width..(y + 1) * width];
        // Borders compare with themselves.
        let above = &image.depth[y.saturating_sub(1) * width..][..width];
        let below = &image.depth[(y + 1).min(image.height - 1) * width..][..width];
        largest_differences(row, above, below, &mut self.jumps);
        self.follow_row(row, y, grids, rays);

        // From depth − truncation to depth + truncation, half a block apart at most. The middle sample is the
        // surface point, so no block with surface is passed over; a corner of the band that is cut short falls
        // to the samples of other rays.
        for sample in 0..self.last.len() {
            let offset = sample as f32 * rays.sample_step - rays.truncation;
            self.cells.swap(0, 1);
            let cells = &mut self.cells[0];
            cells.clear();
            cells.extend(
                self.followed
                    .iter()
                    .map(|pixel| whole_below(rays.eye + (pixel.depth + offset) * pixel.slope)),
            );
            self.touch_cells(sample, rays.anchor);
        }
    }

    /// Lists the pixels of a row that are followed.
    fn follow_row(
        &mut self,
        row: &[f32],
        y: usize,
        grids: &[Grid; STRIDES.len()],
        rays: &BlockRays,
    ) {
        self.followed.clear();
        let [coarse, fine] = grids;
        let start = rays.forward + y as f32 * rays.down;
        let is_on_grid =
            y & coarse.mask == 0 || y & fine.mask == 0 && has_far(row, coarse.farthest);
        // The difference from which a pixel off the grid counts.
        let noise_at_one_metre = NOISE_STEPS * rays.depth_step;
        let limit = |depth: f32| {
            let noise = noise_at_one_metre * depth * depth;
            let jump = if depth < coarse.farthest {
                coarse.jump
            } else {
                fine.jump
            };
            let limit = if jump > noise { jump } else { noise };
            if depth < fine.farthest { limit } else { 0.0 }
        };
        for (chunk, (depths, jumps)) in row.chunks(CHUNK).zip(self.jumps.chunks(CHUNK)).enumerate()
        {
            // Most chunks lie off the grid and hold no edge. A loaded frame holds no NaN.
            let has_edge = depths
                .iter()
                .zip(jumps)
                .fold(false, |any, (&depth, &jump)| {
                    any | ((jump >= limit(depth)) & (depth > 0.0))
                });
            if !has_edge && !is_on_grid {
                continue;
            }
            for (n, (&depth, &jump)) in depths.iter().zip(jumps).enumerate() {
                let x = chunk * CHUNK + n;
                let mask = if depth < coarse.farthest {
                    coarse.mask
                } else {
                    fine.mask
                };
                if depth > 0.0 && ((x | y) & mask == 0 || jump >= limit(depth)) {
                    let slope = start + x as f32 * rays.right;
                    self.followed.push(Followed { slope, depth });
                }
            }
        }
    }

    /// Touches the blocks of one sample of every followed pixel.
    fn touch_cells(&mut self, sample: usize, anchor: [i32; 3]) {
        let mut last = self.last[sample];
        for n in 0..self.cells[0].len() {
            let cell = self.cells[0][n];
            // Neighbouring rays mostly meet the same blocks; the second meeting still counts.
            if cell == last.cell && last.is_repeated {
                continue;
            }
            // Two samples in one block are still one ray.
            if sample > 0 && cell == self.cells[1][n] {
                continue;
            }
            last = LastTouch {
                cell,
                is_repeated: cell == last.cell,
            };
            self.touch(cell, anchor);
        }
        self.last[sample] = last;
    }

    fn touch(&mut self, cell: [i32; 3], anchor: [i32; 3]) {
        let block = std::array::from_fn(|axis| cell[axis].saturating_add(anchor[axis]));
        let Some(key) = pack(block) else {
            self.out_of_range_count += 1;
            return;
        };
        let slot = &mut self.cache
            [(key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize & (CACHE_ENTRIES - 1)];
        if slot.0 == key {
            self.keys[slot.1 as usize] |= REPEATED;
        } else {
            *slot = (key, self.keys.len() as u32);
            self.keys.push(key);
        }
    }
}

/// Whether a depth of the row reaches `limit`.
fn has_far(row: &[f32], limit: f32) -> bool {
    row.iter().fold(false, |any, &depth| any | (depth >= limit))
}

/// The largest whole numbers not above the coordinates (within ±2²¹; on a whole number it may be the one
/// below). Adding 1.5·2²³ leaves no bit behind the point, which needs no instruction beyond an addition.
#[inline]
pub(super) fn whole_below(point: Vec3A) -> [i32; 3] {
    const SHIFT: f32 = 12_582_912.0;
    ((point - 0.5) + SHIFT)
        .to_array()
        .map(|c| (c.to_bits() as i32).wrapping_sub(SHIFT.to_bits() as i32))
}

/// For each pixel the largest absolute difference to its four neighbours. Plain comparisons, because the
/// frame holds no NaN, and a vector unit has them.
fn largest_differences(row: &[f32], above: &[f32], below: &[f32], out: &mut Vec<f32>) {
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    out.clear();
    out.extend(
        row.iter()
            .zip(above)
            .zip(below)
            .map(|((&depth, &above), &below)| larger((above - depth).abs(), (below - depth).abs())),
    );
    let (lefts, rights) = (&row[..row.len() - 1], &row[1..]);
    for ((out, &left), &depth) in out[1..].iter_mut().zip(lefts).zip(rights) {
        *out = larger(*out, (left - depth).abs());
    }
    for ((out, &depth), &right) in out.iter_mut().zip(lefts).zip(rights) {
        *out = larger(*out, (right - depth).abs());
    }
}

/// Remembers blocks that one ray has met, so that only the second meeting allocates (hard-cases D17).
///
/// Of fixed size: a newer block replaces an older one with the same slot, which only delays the older.
pub(super) struct Frontier {
    keys: Vec<u64>,
}

impl Default for Frontier {
    fn default() -> Self {
        Self {
            keys: vec![u64::MAX; 1 << 16],
        }
    }
}

impl Frontier {
    /// Whether `key` was met before; remembers it.
    pub(super) fn is_known(&mut self, key: u64) -> bool {
        let slot = mix(key) as usize & (self.keys.len() - 1);
        std::mem::replace(&mut self.keys[slot], key) == key
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.keys.len() * size_of::<u64>()
    }
}
