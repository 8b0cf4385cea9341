//! Value, slope and weight of the field at points between voxels.
//!
//! The value is trilinear. The slope is the trilinear mean of central differences, or of the differences between
//! the eight voxels along an axis on which the voxels beyond are not observed or saturated.
//!
//! Bound: a point reads 12 rows of four distances and 4 of weights, 256 bytes on about 10 cache lines; memory
//! decides where they are not near, so callers fetch them ahead ([`Neighbourhood::fetch`]). Arithmetic: about
//! 45 lerps and differences, 5 instructions of 8 lanes for the lerps.
//!
//! Both levels do the same IEEE operations in the same order, so they agree bit for bit.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use glam::Vec3A;

use super::Level;
use super::integrate::Block;
use super::prefetch::prefetch;
use crate::volume::key::{BLOCK_EDGE, BLOCK_SHIFT, BLOCK_VOXELS};

/// Voxels of a neighbourhood along an axis.
pub(crate) const REACH: usize = 4;
/// Distance, in truncations, from which a value is saturated or was never observed: no slope leads there.
const SATURATED: f32 = 0.999;

/// Stands in where there is no block.
pub(crate) static NOTHING: Block = Block::EMPTY;

/// The field at a point between voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FieldSample {
    /// Signed distance in truncations.
    pub(crate) tsdf: f32,
    /// Its change per voxel.
    pub(crate) gradient: Vec3A,
    /// Weight; 0 where one of the eight voxels has less than was asked for, and the rest is 0 too.
    pub(crate) weight: f32,
}

impl FieldSample {
    /// No field.
    pub(crate) const NONE: Self = Self {
        tsdf: 0.0,
        gradient: Vec3A::ZERO,
        weight: 0.0,
    };
}

/// The 4³ voxels about a point, in up to eight blocks.
#[derive(Clone, Copy)]
pub(crate) struct Neighbourhood<'a> {
    /// Blocks of the lower and upper part along x, y, z (bits 0, 1, 2). A part that the neighbourhood does not
    /// reach into is never read.
    pub(crate) blocks: [&'a Block; 8],
    /// Place of its first voxel in the block of the lower part, below [`BLOCK_EDGE`].
    pub(crate) first: [usize; 3],
    /// Where between the second and the third voxel the point lies, along x, y, z.
    pub(crate) share: Vec3A,
}

impl<'a> Neighbourhood<'a> {
    /// Nothing observed anywhere.
    pub(crate) const NONE: Self = Self {
        blocks: [&NOTHING; 8],
        first: [0; 3],
        share: Vec3A::ZERO,
    };

    /// Part along y and z, and offset in that block, of the row at (y, z).
    #[inline(always)]
    fn line(&self, y: usize, z: usize) -> (usize, usize) {
        let (y, z) = (self.first[1] + y, self.first[2] + z);
        let part = (y >> BLOCK_SHIFT & 1) << 1 | (z >> BLOCK_SHIFT & 1) << 2;
        let (y, z) = (y % BLOCK_EDGE, z % BLOCK_EDGE);
        (part, BLOCK_EDGE * (y + BLOCK_EDGE * z))
    }

    /// Asks for the voxels that a sample reads.
    #[inline]
    pub(crate) fn fetch(&self) {
        // Rows 2k and 2k + 1 of a block share a cache line.
        for (y, z) in [
            (1, 0),
            (2, 0),
            (0, 1),
            (2, 1),
            (3, 1),
            (0, 2),
            (2, 2),
            (3, 2),
            (1, 3),
            (2, 3),
        ] {
            self.fetch_row(y, z, |block| &block.tsdf);
        }
        for (y, z) in [(1, 1), (2, 1), (1, 2), (2, 2)] {
            self.fetch_row(y, z, |block| &block.weight);
        }
    }

    #[inline(always)]
    fn fetch_row(&self, y: usize, z: usize, values: impl Fn(&'a Block) -> &'a [f32; BLOCK_VOXELS]) {
        let (part, line) = self.line(y, z);
        let x = self.first[0];
        prefetch(values(self.blocks[part]), line + x % BLOCK_EDGE);
        if x + REACH > BLOCK_EDGE {
            prefetch(values(self.blocks[part | 1]), line);
        }
    }
}

/// Samples the field at each point into `samples`: [`FieldSample::NONE`] unless the eight voxels around it have
/// at least `min_weight`, which is above 0.
///
/// # Panics
/// When there are fewer samples than points, or a first voxel lies outside its block.
#[inline]
pub(crate) fn sample_fields(
    level: Level,
    points: &[Neighbourhood<'_>],
    min_weight: f32,
    samples: &mut [FieldSample],
) {
    // The vector kernel's reads rest on this line.
    assert!(
        points
            .iter()
            .all(|point| point.first.iter().all(|&first| first < BLOCK_EDGE))
    );
    let samples = &mut samples[..points.len()];
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::sample_fields(points, min_weight, samples),
        _ => scalar::sample_fields(points, min_weight, samples),
    }
}

/// Slope at `share` between the inner two of four values; `ends` is the largest one that the outer two rest on.
#[inline(always)]
fn slope([a, b, c, d]: [f32; REACH], share: f32, ends: f32) -> f32 {
    if ends < SATURATED {
        0.5 * ((c - a) * (1.0 - share) + (d - b) * share)
    } else {
        c - b
    }
}
