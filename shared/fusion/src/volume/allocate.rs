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
}

/// Blocks that a frame's rays meet.
pub(super) struct Touched {
    /// Keys in image order. A key met by one ray stands once, by more rays at least twice.
    pub keys: Vec<u64>,
    /// Requests beyond the coordinate range of keys.
    pub out_of_range_count: usize,
}

/// Samples rays through depth ± truncation and collects the blocks on the way.
///
/// Every fourth or second pixel in x and y is followed, as blocks are many pixels large or few, and every
/// pixel where blocks are smaller still or next to a depth edge: there a thin part, or a stretch of surface
/// seen at a grazing angle, would fall between rays.
pub(super) fn touched_blocks(image: DepthView<'_>, rays: &BlockRays) -> Touched {
    let pixel_in_blocks = rays.right.length().max(rays.down.length());
    let grids = STRIDES.map(|stride| Grid {
        mask: stride - 1,
        farthest: rays.truncation_in_blocks
            / (stride as f32 * RAYS_PER_TRUNCATION * pixel_in_blocks),
        // Between two followed rays depth then changes by no more than both bands cover.
        jump: 2.0 * rays.truncation / stride as f32,
    });
    let bands: Vec<Touched> = (0..image.height.div_ceil(BAND_ROWS))
        .into_par_iter()
        .map(|band| {
            let mut walker = Walker::new(rays);
            for y in band * BAND_ROWS..((band + 1) * BAND_ROWS).min(image.height) {
                walk_row(image, y, &grids, &mut walker);
            }
            walker.touched
        })
        .collect();
    let mut all = Touched {
        keys: Vec::new(),
        out_of_range_count: 0,
    };
    for band in bands {
        all.keys.extend(band.keys);
        all.out_of_range_count += band.out_of_range_count;
    }
    all
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

fn walk_row(
    image: DepthView<'_>,
    y: usize,
    grids: &[Grid; STRIDES.len()],
    walker: &mut Walker<'_>,
) {
    let width = image.width;
    let row = &image.depth[y * width..(y + 1) * width];
    // Borders compare with themselves.
    let above = &image.depth[y.saturating_sub(1) * width..][..width];
    let below = &image.depth[(y + 1).min(image.height - 1) * width..][..width];
    largest_differences(row, above, below, &mut walker.jumps);
    let start = walker.rays.forward + y as f32 * walker.rays.down;
    for (x, &depth) in row.iter().enumerate() {
        let grid = grids.iter().find(|grid| depth < grid.farthest);
        let is_followed =
            grid.is_none_or(|grid| (x | y) & grid.mask == 0 || walker.jumps[x] >= grid.jump);
        // A loaded frame holds no NaN.
        if is_followed && depth > 0.0 {
            walker.walk(start + x as f32 * walker.rays.right, depth);
        }
    }
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

/// The block that one sample of the last ray fell into.
#[derive(Clone, Copy)]
struct LastTouch {
    /// Whole numbers.
    cell: Vec3A,
    is_repeated: bool,
}

struct Walker<'a> {
    rays: &'a BlockRays,
    last: Vec<LastTouch>,
    cache: Vec<(u64, bool)>,
    /// Differences to neighbours of the row at hand, metres.
    jumps: Vec<f32>,
    touched: Touched,
}

impl<'a> Walker<'a> {
    fn new(rays: &'a BlockRays) -> Self {
        let last = LastTouch {
            cell: Vec3A::NAN,
            is_repeated: true,
        };
        Self {
            rays,
            last: vec![last; 2 * rays.half_samples + 1],
            cache: vec![(u64::MAX, false); CACHE_ENTRIES],
            jumps: Vec::new(),
            touched: Touched {
                keys: Vec::new(),
                out_of_range_count: 0,
            },
        }
    }

    /// Visits the blocks at samples from depth − truncation to depth + truncation on one ray, half a block
    /// apart at most. The middle sample is the surface point, so no block with surface is passed over; a
    /// corner of the band that is cut short falls to the samples of other rays.
    #[inline]
    fn walk(&mut self, slope: Vec3A, depth: f32) {
        let rays = self.rays;
        let step = rays.sample_step * slope;
        let mut point = rays.eye + (depth - rays.truncation) * slope;
        let mut previous = Vec3A::NAN;
        for sample in 0..self.last.len() {
            let cell = point.floor();
            point += step;
            // Two samples in one block are still one ray.
            if cell == previous {
                continue;
            }
            previous = cell;
            // Neighbouring rays mostly meet the same blocks; the second meeting still counts.
            let last = &mut self.last[sample];
            if last.cell != cell {
                *last = LastTouch {
                    cell,
                    is_repeated: false,
                };
                self.touch(cell);
            } else if !last.is_repeated {
                last.is_repeated = true;
                self.touch(cell);
            }
        }
    }

    #[inline]
    fn touch(&mut self, cell: Vec3A) {
        // Whole numbers; a cast saturates, and `pack` refuses what is that far away.
        let local = cell.to_array().map(|c| c as i32);
        let block = std::array::from_fn(|axis| local[axis].saturating_add(self.rays.anchor[axis]));
        let Some(key) = pack(block) else {
            self.touched.out_of_range_count += 1;
            return;
        };
        let slot = &mut self.cache
            [(key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize & (CACHE_ENTRIES - 1)];
        if slot.0 != key {
            *slot = (key, false);
            self.touched.keys.push(key);
        } else if !slot.1 {
            slot.1 = true;
            self.touched.keys.push(key);
        }
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
}
