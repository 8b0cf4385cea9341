//! What an image says about a block's voxels, row by row: scratch between the two passes of the vector kernel.

use crate::volume::key::{BLOCK_EDGE, BLOCK_VOXELS};

/// A bit for each 4³ voxels of a block, x lowest, then y, then z.
pub type Octants = u8;

/// Octant of the first voxel of a row; the second half of the row lies in the next.
#[inline]
pub(super) fn first_octant(row: usize) -> usize {
    let half = BLOCK_EDGE / 2;
    2 * (row % BLOCK_EDGE / half) + 4 * (row / BLOCK_EDGE / half)
}

/// Rows of a block.
pub(super) const ROWS: usize = BLOCK_EDGE * BLOCK_EDGE;

/// Observations of a block. Rows that no bit marks hold what earlier blocks left.
pub(super) struct Observations {
    /// Observed distances in truncations.
    pub(super) tsdf: [f32; BLOCK_VOXELS],
    /// Their weights, 0 without an observation.
    pub(super) weight: [f32; BLOCK_VOXELS],
    /// Pixels that the voxels project to.
    pub(super) pixel: [[u32; BLOCK_EDGE]; ROWS],
    /// Bit r: row r holds an observation.
    pub(super) rows: u64,
    /// Bit r: row r was projected; its pixels are indices of the image.
    pub(super) projected: u64,
    /// Octants with an observation behind the surface.
    pub(super) behind: Octants,
}

impl Observations {
    pub(super) const NONE: Self = Self {
        tsdf: [0.0; BLOCK_VOXELS],
        weight: [0.0; BLOCK_VOXELS],
        pixel: [[0; BLOCK_EDGE]; ROWS],
        rows: 0,
        projected: 0,
        behind: 0,
    };
}
