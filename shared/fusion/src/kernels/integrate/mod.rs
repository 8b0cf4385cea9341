//! Fuses one depth image into one block of 8³ voxels.
//!
//! Arithmetic bound: about 60 operations and one 8-lane gather per row of 8 voxels, against 128 bytes of
//! voxel traffic. Rows wholly behind the block's farthest depth are skipped, rows wholly in free space
//! skip projection and gather.
//!
//! Both levels do the same IEEE operations in the same order without fused multiply-add, so they agree
//! bit for bit. Fusing would round pixel coordinates differently, and a voxel on a pixel border would then
//! read another depth.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use super::Level;
use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

/// Nearest z at which a voxel counts as in front of the camera, metres (hard-cases A12).
pub(crate) const Z_NEAR: f32 = 0.01;

/// Truncated signed distance and weight of 8³ voxels, x fastest. Two contiguous arrays, so that a row
/// of 8 is one register.
#[derive(Clone)]
#[repr(C, align(64))]
pub struct Block {
    /// Distance to the surface in truncations, positive in free space, in (−1, 1].
    pub tsdf: [f32; BLOCK_VOXELS],
    /// Sum of observation weights up to the cap; 0 = never observed.
    pub weight: [f32; BLOCK_VOXELS],
}

impl Block {
    /// A block nobody has observed.
    pub const EMPTY: Self = Self {
        tsdf: [1.0; BLOCK_VOXELS],
        weight: [0.0; BLOCK_VOXELS],
    };
}

/// Most columns, and rows, of a depth image: exact in f32, and an index fits i32 together with
/// [`MOST_PIXELS`].
pub const LARGEST_SIDE: usize = 1 << 24;
/// Most pixels of a depth image, so that a gather's signed 32-bit index reaches all of them.
pub const MOST_PIXELS: usize = i32::MAX as usize;

/// A depth image without distortion; 0 = no measurement.
#[derive(Clone, Copy)]
pub struct DepthView<'a> {
    /// Metres, row-major, `width · height` values.
    pub depth: &'a [f32],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// How a block's voxels lie in front of the camera. Components are (u·z, v·z, z): homogeneous pixel
/// coordinates, affine in the voxel index.
#[derive(Clone, Copy, Debug)]
pub struct BlockView {
    /// Homogeneous pixel of voxel (0, 0, 0).
    pub start: [f32; 3],
    /// Step of the homogeneous pixel per voxel along x, y, z.
    pub step: [[f32; 3]; 3],
    /// Unit direction from the block to the camera, volume axes.
    pub to_camera: [f32; 3],
    /// z beyond which no voxel of the block is updated: the farthest depth in its pixels plus truncation.
    pub farthest: f32,
    /// z below which every voxel sees free space: the nearest depth in its pixels less truncation;
    /// −∞ when a pixel lacks a measurement or lies outside the image.
    pub nearest: f32,
}

/// What an observation is worth and how far it reaches.
#[derive(Clone, Copy, Debug)]
pub struct UpdateRule {
    /// Truncation distance, metres.
    pub truncation: f32,
    /// Observation weight at z = 1 m; it falls with 1/z².
    pub weight_at_one_metre: f32,
    /// Largest stored weight.
    pub weight_cap: f32,
    /// Smallest difference, in truncations, of opposite signs that counts as a conflict (hard-cases D07).
    pub conflict: f32,
}

/// Observations whose sign contradicts a stored value: held back until the whole block is read.
pub struct Conflicts {
    count: usize,
    index: [u16; BLOCK_VOXELS],
    tsdf: [f32; BLOCK_VOXELS],
    weight: [f32; BLOCK_VOXELS],
}

impl Conflicts {
    /// No conflicts.
    pub const NONE: Self = Self {
        count: 0,
        index: [0; BLOCK_VOXELS],
        tsdf: [0.0; BLOCK_VOXELS],
        weight: [0.0; BLOCK_VOXELS],
    };

    #[inline]
    fn push(&mut self, index: usize, tsdf: f32, weight: f32) {
        self.index[self.count] = index as u16;
        self.tsdf[self.count] = tsdf;
        self.weight[self.count] = weight;
        self.count += 1;
    }
}

/// Fuses `image` into `block` as `view` and `rule` say; `conflicts` is scratch.
///
/// The block must hold what earlier calls made of [`Block::EMPTY`]: finite values, weights from 0 to the cap.
///
/// # Panics
/// When `image.depth` is not `width · height` long, or the image exceeds [`LARGEST_SIDE`] or
/// [`MOST_PIXELS`].
pub fn integrate_block(
    level: Level,
    block: &mut Block,
    image: DepthView<'_>,
    view: &BlockView,
    rule: &UpdateRule,
    conflicts: &mut Conflicts,
) {
    // The vector kernel's reads rest on these three lines.
    assert!(image.width.max(image.height) <= LARGEST_SIDE);
    assert!(image.depth.len() <= MOST_PIXELS);
    assert_eq!(
        image.depth.len(),
        image.width * image.height,
        "one depth per pixel"
    );
    conflicts.count = 0;
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::integrate_rows(block, image, view, rule, conflicts),
        _ => scalar::integrate_rows(block, image, view, rule, conflicts),
    }
    if conflicts.count > 0 {
        resolve_conflicts(block, view, rule, conflicts);
    }
}

/// Homogeneous pixel of voxel (0, y, z).
#[inline(always)]
fn row_start(view: &BlockView, y: usize, z: usize) -> [f32; 3] {
    let (y, z) = (y as f32, z as f32);
    std::array::from_fn(|c| view.start[c] + (y * view.step[1][c] + z * view.step[2][c]))
}

/// The running average that both levels compute per voxel.
#[inline(always)]
fn average(stored: f32, stored_weight: f32, tsdf: f32, weight: f32, cap: f32) -> (f32, f32) {
    let sum = stored_weight + weight;
    (stored + (tsdf - stored) * (weight / sum), sum.min(cap))
}

/// Cosine between the stored gradient and the direction to the camera below which the stored surface
/// faces away from this camera. A margin keeps noisy grazing views on the ordinary average.
const FACES_AWAY: f32 = -0.2;
/// Share of the slope of a distance field that a gradient needs to count as one.
const LEAST_SLOPE: f32 = 0.3;

/// Decides held-back observations (hard-cases D07).
///
/// A stored value whose gradient points away from this camera belongs to the other side of a thin thing.
/// There, "seen as free" is a fact and "behind a surface" a guess, so the positive one of the two stands.
/// All decisions are taken before the first is applied: a gradient must not see half an update.
fn resolve_conflicts(
    block: &mut Block,
    view: &BlockView,
    rule: &UpdateRule,
    conflicts: &Conflicts,
) {
    let mut faces_away = [false; BLOCK_VOXELS];
    for (is_away, &index) in faces_away
        .iter_mut()
        .zip(&conflicts.index[..conflicts.count])
    {
        *is_away = stored_surface_faces_away(block, usize::from(index), view, rule);
    }
    for (entry, &is_away) in faces_away.iter().enumerate().take(conflicts.count) {
        let index = usize::from(conflicts.index[entry]);
        let (tsdf, weight) = (conflicts.tsdf[entry], conflicts.weight[entry]);
        if !is_away {
            let averaged = average(
                block.tsdf[index],
                block.weight[index],
                tsdf,
                weight,
                rule.weight_cap,
            );
            (block.tsdf[index], block.weight[index]) = averaged;
        } else if tsdf > 0.0 {
            (block.tsdf[index], block.weight[index]) = (tsdf, weight.min(rule.weight_cap));
        }
    }
}

fn stored_surface_faces_away(
    block: &Block,
    index: usize,
    view: &BlockView,
    rule: &UpdateRule,
) -> bool {
    let mut along_view = 0.0;
    let mut squared = 0.0;
    for (axis, stride) in [1, BLOCK_EDGE, BLOCK_EDGE * BLOCK_EDGE]
        .into_iter()
        .enumerate()
    {
        let place = index / stride % BLOCK_EDGE;
        let before = if place > 0 && block.weight[index - stride] > 0.0 {
            index - stride
        } else {
            index
        };
        let after = if place + 1 < BLOCK_EDGE && block.weight[index + stride] > 0.0 {
            index + stride
        } else {
            index
        };
        let voxels = ((after - before) / stride).max(1) as f32;
        let slope = (block.tsdf[after] - block.tsdf[before]) / voxels;
        along_view += slope * view.to_camera[axis];
        squared += slope * slope;
    }
    // A true distance field changes by `rule.conflict` (one voxel in truncations) per voxel.
    let length = squared.sqrt();
    length > LEAST_SLOPE * rule.conflict && along_view < FACES_AWAY * length
}
