//! Which blocks a depth image touches.

use rayon::prelude::*;

use super::key::{mix, pack};
use crate::kernels::integrate::DepthView;

/// Rows of one parallel task. Fixed, so that the order of keys does not depend on threads.
const BAND_ROWS: usize = 60;
/// Entries of the per-task cache of recently touched blocks, a power of two.
const CACHE_ENTRIES: usize = 4096;
/// Rays per block edge below which every pixel is followed instead of every second one.
const RAYS_PER_BLOCK: f32 = 3.0;

/// The pixel rays in block units, relative to the block that holds the camera: a point at depth z of
/// pixel (x, y) is `eye + z (forward + x right + y down)`.
pub(super) struct BlockRays {
    /// Block that local coordinates count from.
    pub anchor: [i32; 3],
    /// Camera centre.
    pub eye: [f32; 3],
    /// Ray of pixel (0, 0) per metre of z.
    pub forward: [f32; 3],
    /// Change of the ray per column.
    pub right: [f32; 3],
    /// Change of the ray per row.
    pub down: [f32; 3],
    /// Half of the band to allocate, metres of z.
    pub truncation: f32,
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

/// Samples each ray through depth ± truncation and collects the blocks on the way.
///
/// Every second pixel in x and y is followed, and every pixel next to a depth edge, where a thin part
/// would fall between rays, or so far away that blocks shrink to a few pixels.
pub(super) fn touched_blocks(image: DepthView<'_>, rays: &BlockRays) -> Touched {
    let pixel_in_blocks = length(rays.right).max(length(rays.down));
    let every_pixel_beyond = 1.0 / (2.0 * RAYS_PER_BLOCK * pixel_in_blocks);
    let bands: Vec<Touched> = (0..image.height.div_ceil(BAND_ROWS))
        .into_par_iter()
        .map(|band| {
            let mut walker = Walker::new(rays);
            for y in band * BAND_ROWS..((band + 1) * BAND_ROWS).min(image.height) {
                walk_row(image, y, every_pixel_beyond, &mut walker);
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

fn walk_row(image: DepthView<'_>, y: usize, every_pixel_beyond: f32, walker: &mut Walker<'_>) {
    let width = image.width;
    let row = &image.depth[y * width..(y + 1) * width];
    // Borders compare with themselves.
    let above = &image.depth[y.saturating_sub(1) * width..][..width];
    let below = &image.depth[(y + 1).min(image.height - 1) * width..][..width];
    let truncation = walker.rays.truncation;
    for x in 0..width {
        let depth = row[x];
        // A loaded frame holds no NaN.
        if depth <= 0.0 {
            continue;
        }
        let is_on_grid = (x | y) & 1 == 0;
        if !is_on_grid && depth < every_pixel_beyond {
            let (left, right) = (row[x.saturating_sub(1)], row[(x + 1).min(width - 1)]);
            let nearest = left.min(right).min(above[x]).min(below[x]);
            let farthest = left.max(right).max(above[x]).max(below[x]);
            if farthest - depth < truncation && depth - nearest < truncation {
                continue;
            }
        }
        walker.walk(x as f32, y as f32, depth);
    }
}

/// The block that one sample of the last ray fell into.
#[derive(Clone, Copy)]
struct LastTouch {
    cell: [i32; 3],
    is_repeated: bool,
}

struct Walker<'a> {
    rays: &'a BlockRays,
    last: Vec<LastTouch>,
    cache: Vec<(u64, bool)>,
    touched: Touched,
}

impl<'a> Walker<'a> {
    fn new(rays: &'a BlockRays) -> Self {
        let last = LastTouch {
            cell: [i32::MIN; 3],
            is_repeated: true,
        };
        Self {
            rays,
            last: vec![last; 2 * rays.half_samples + 1],
            cache: vec![(u64::MAX, false); CACHE_ENTRIES],
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
    fn walk(&mut self, x: f32, y: f32, depth: f32) {
        let rays = self.rays;
        let slope: [f32; 3] = std::array::from_fn(|axis| {
            rays.forward[axis] + x * rays.right[axis] + y * rays.down[axis]
        });
        for sample in 0..self.last.len() {
            let z = depth + (sample as f32 - rays.half_samples as f32) * rays.sample_step;
            let cell = std::array::from_fn(|axis| floor(rays.eye[axis] + z * slope[axis]));
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
    fn touch(&mut self, local: [i32; 3]) {
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

/// `floor` as an integer without a library call.
#[inline]
fn floor(value: f32) -> i32 {
    let truncated = value as i32;
    truncated.saturating_sub(i32::from(truncated as f32 > value))
}

fn length(v: [f32; 3]) -> f32 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
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
