//! A block with one voxel of neighbours below and two above, copied into one array.

use crate::kernels::integrate::Block;
use crate::volume::Volume;
use crate::volume::key::BLOCK_EDGE;

/// Voxels along an edge: −1 to 9.
pub(super) const HALO_EDGE: usize = BLOCK_EDGE + 3;

/// Distances and weights of voxels −1..=9 along each axis, x fastest.
pub(super) struct Halo {
    /// Truncated distance, NaN where the weight is below the limit.
    pub(super) tsdf: Vec<f32>,
    /// Weight, 0 where there is no block.
    pub(super) weight: Vec<f32>,
}

/// Index of voxel (x, y, z), each −1..=9.
#[inline]
pub(super) fn halo_index(x: i32, y: i32, z: i32) -> usize {
    ((z + 1) as usize * HALO_EDGE + (y + 1) as usize) * HALO_EDGE + (x + 1) as usize
}

impl Halo {
    pub(super) fn new() -> Self {
        let count = HALO_EDGE * HALO_EDGE * HALO_EDGE;
        Self {
            tsdf: vec![f32::NAN; count],
            weight: vec![0.0; count],
        }
    }

    /// Copies the surroundings of `block` (coordinates).
    pub(super) fn load(&mut self, volume: &Volume, block: [i32; 3], min_weight: f32) {
        let neighbours: [Option<&Block>; 27] = std::array::from_fn(|n| {
            let offset = [n % 3, n / 3 % 3, n / 9].map(|o| o as i32 - 1);
            let coordinates = std::array::from_fn(|axis| block[axis] + offset[axis]);
            volume
                .block_index(coordinates)
                .map(|index| volume.block(index))
        });
        for z in 0..HALO_EDGE {
            for y in 0..HALO_EDGE {
                let ((block_y, local_y), (block_z, local_z)) = (place(y), place(z));
                let out = (z * HALO_EDGE + y) * HALO_EDGE;
                for (block_x, from, to, start) in [(0, 7, 8, 0), (1, 0, 8, 1), (2, 0, 2, 9)] {
                    let range = out + start..out + start + to - from;
                    let (tsdf, weight) = (&mut self.tsdf[range.clone()], &mut self.weight[range]);
                    let Some(source) = neighbours[block_x + 3 * (block_y + 3 * block_z)] else {
                        tsdf.fill(f32::NAN);
                        weight.fill(0.0);
                        continue;
                    };
                    let row = BLOCK_EDGE * (local_y + BLOCK_EDGE * local_z);
                    for (n, (t, w)) in tsdf.iter_mut().zip(weight).enumerate() {
                        let voxel = row + from + n;
                        *w = source.weight[voxel];
                        *t = if *w >= min_weight {
                            source.tsdf[voxel]
                        } else {
                            f32::NAN
                        };
                    }
                }
            }
        }
    }

    /// Gradient of the distance at a voxel (x, y, z of 0..=8), per voxel; `None` when an axis has no
    /// observed neighbour. One-sided at the frontier.
    pub(super) fn gradient(&self, voxel: [i32; 3]) -> Option<glam::Vec3> {
        let middle = halo_index(voxel[0], voxel[1], voxel[2]);
        let here = self.tsdf[middle];
        let mut gradient = [0.0; 3];
        for (slope, stride) in gradient
            .iter_mut()
            .zip([1, HALO_EDGE, HALO_EDGE * HALO_EDGE])
        {
            let (below, above) = (self.tsdf[middle - stride], self.tsdf[middle + stride]);
            *slope = match (below.is_nan(), above.is_nan()) {
                (false, false) => 0.5 * (above - below),
                (false, true) => here - below,
                (true, false) => above - here,
                (true, true) => return None,
            };
        }
        Some(glam::Vec3::from_array(gradient))
    }
}

/// Neighbour (0, 1, 2) and place inside it of halo position 0..11.
fn place(position: usize) -> (usize, usize) {
    let shifted = position + BLOCK_EDGE - 1;
    (shifted / BLOCK_EDGE, shifted % BLOCK_EDGE)
}
