//! The model where a measured depth image says that it should be: for a camera whose place is nearly known.

use geometry::{Intrinsics, Pose};
use rayon::prelude::*;

use super::super::Volume;
use super::super::allocate::whole_below;
use super::super::key::{BLOCK_EDGE, BLOCK_SHIFT};
use super::super::march::{Approach, March};
use super::super::ranges::{Detail, TILE};
use super::super::sampler::Sampler;
use super::{Band, DepthRange, Guesses, STRIP, VoxelRays, Walks};
use crate::kernels::integrate::Block;
use crate::kernels::prefetch::prefetch;
use crate::model_view::{ModelView, Surfel};

/// Rows of tiles of one parallel task: a view for tracking is small, and two workers share it.
const BAND_TILES: usize = 8;
/// Correction, in voxels, below which the next one is left out: the field is straight enough over a voxel, where a
/// first step from the nearest voxel ends.
const SMALL_CORRECTION: f32 = 0.75;

impl Volume {
    /// As [`Volume::predict`], without luminance, for the pixels that measured something: `depth` holds a depth per
    /// pixel of `camera`, metres along z, as a camera near `world_from_camera` saw it; 0 and NaN mean no measurement,
    /// and no surfel.
    ///
    /// A pixel starts at its depth and finds the surface about it in a step or two. Where there is none within a
    /// truncation, its ray is marched from the front; so of two surfaces on a ray the one that was measured is shown.
    /// The same bits for any number of threads; allocates nothing once the view has its size.
    ///
    /// # Panics
    /// When `depth` has not one value per pixel.
    pub fn predict_near(
        &self,
        camera: &Intrinsics,
        world_from_camera: &Pose,
        depth: &[f32],
        view: &mut ModelView,
    ) {
        let rays = self.look_from(camera, world_from_camera, Detail::Blocks, view);
        assert_eq!(depth.len(), view.surfels.len(), "a depth per pixel");
        let width = view.width();
        let tile_columns = width.div_ceil(TILE);
        let min_weight = view.min_weight.max(f32::MIN_POSITIVE);
        view.surfels
            .par_chunks_mut(width * TILE * BAND_TILES)
            .zip(view.ranges.par_chunks(tile_columns * BAND_TILES))
            .zip(depth.par_chunks(width * TILE * BAND_TILES))
            .enumerate()
            .for_each(|(number, ((surfels, ranges), depth))| {
                let mut band = Band {
                    sampler: Sampler::new(self, rays.anchor),
                    rays: &rays,
                    march: March {
                        small_correction: SMALL_CORRECTION,
                        ..self.march(min_weight)
                    },
                    first_row: number * TILE * BAND_TILES,
                    width,
                    has_color: false,
                };
                for left in (0..width).step_by(STRIP) {
                    band.approach_strip(left, depth, ranges, surfels);
                }
            });
    }

    /// Fills in the luminance of every surfel of a view of this volume, 0 where it is not known.
    pub fn shade(&self, view: &mut ModelView) {
        if !self.has_color() {
            return;
        }
        let rays = VoxelRays::new(self, &view.camera, &view.world_from_camera);
        let width = view.width();
        view.surfels
            .par_chunks_mut(width * TILE * BAND_TILES)
            .enumerate()
            .for_each(|(number, surfels)| {
                let mut band = Band {
                    sampler: Sampler::new(self, rays.anchor),
                    rays: &rays,
                    march: self.march(0.0),
                    first_row: number * TILE * BAND_TILES,
                    width,
                    has_color: true,
                };
                for left in (0..width).step_by(STRIP) {
                    band.shade_strip(left, surfels);
                }
            });
    }
}

/// A measured point, and the voxel nearest to it.
#[derive(Clone, Copy)]
struct Measured<'a> {
    /// Metres; 0 = no measurement.
    z: f32,
    block: Option<&'a Block>,
    index: usize,
}

impl Measured<'_> {
    const NONE: Self = Self {
        z: 0.0,
        block: None,
        index: 0,
    };
}

/// What the voxel nearest to a measured point says.
enum FirstStep {
    /// Surface is about here.
    Near(Approach),
    /// There is no surface within a truncation.
    Astray,
    /// Nothing was measured.
    Unmeasured,
}

impl<'a> Band<'a> {
    /// Predicts the strip from column `left` about the measured depths.
    ///
    /// Distances are those along the view, so the voxel nearest to a measured point says where on its ray the surface
    /// lies, up to a voxel; one Newton step from there finds it. A row's voxels are asked for before they are read.
    fn approach_strip(
        &mut self,
        left: usize,
        depth: &[f32],
        ranges: &[DepthRange],
        surfels: &mut [Surfel],
    ) {
        let right = (left + STRIP).min(self.width);
        let (mut walks, mut guesses) = (Walks::new(), Guesses::new());
        let mut points = [Measured::NONE; STRIP];
        for y in 0..surfels.len() / self.width {
            let row = &depth[y * self.width..][..self.width];
            for (x, point) in (left..right).zip(&mut points) {
                *point = self.measured((x, y), row[x]);
            }
            for (x, point) in (left..right).zip(&points) {
                match self.first_step((x, y), point) {
                    FirstStep::Near(approach) => guesses.push(x, approach, &mut self.sampler),
                    FirstStep::Astray => self.set_off((x, y), ranges, &mut walks, surfels),
                    FirstStep::Unmeasured => surfels[y * self.width + x] = Surfel::NONE,
                }
            }
            self.refine(y, &mut guesses, ranges, &mut walks, surfels);
        }
        self.walk(&mut walks, surfels);
    }

    /// The voxel nearest to the measured point of a pixel, which is asked for.
    fn measured(&mut self, (x, y): (usize, usize), z: f32) -> Measured<'a> {
        if !(z > 0.0 && z.is_finite()) {
            return Measured::NONE;
        }
        let slope = self.slope((x, y));
        let voxel = whole_below(self.rays.eye + z * slope + 0.5);
        let block = self.sampler.block(voxel.map(|v| v >> BLOCK_SHIFT));
        let [i, j, k] = voxel.map(|v| v as usize % BLOCK_EDGE);
        let index = i | j << BLOCK_SHIFT | k << (2 * BLOCK_SHIFT);
        if let Some(block) = block {
            prefetch(&block.tsdf, index);
            prefetch(&block.weight, index);
        }
        Measured { z, block, index }
    }

    /// Where the surface about a measured point should be.
    fn first_step(&self, pixel: (usize, usize), point: &Measured<'_>) -> FirstStep {
        if !(point.z > 0.0) {
            return FirstStep::Unmeasured;
        }
        let Some(block) = point.block else {
            return FirstStep::Astray;
        };
        let (tsdf, weight) = (block.tsdf[point.index], block.weight[point.index]);
        if !(weight > 0.0 && tsdf.abs() < 1.0) {
            return FirstStep::Astray;
        }
        let reach = self.march.truncation;
        FirstStep::Near(Approach {
            ray: self.ray(pixel),
            z: point.z + tsdf * reach,
            limits: [point.z - 2.0 * reach, point.z + 2.0 * reach],
        })
    }

    /// Looks up the luminance of the strip's surfels; a row is asked for before the one above is read.
    fn shade_strip(&mut self, left: usize, surfels: &mut [Surfel]) {
        let right = (left + STRIP).min(self.width);
        let row_count = surfels.len() / self.width;
        for y in 0..=row_count {
            if y < row_count {
                for x in left..right {
                    let surfel = &surfels[y * self.width + x];
                    if surfel.is_surface() {
                        let point = self.ray((x, y)).at(surfel.position[2]);
                        self.sampler.fetch_luminance(point);
                    }
                }
            }
            if let Some(y) = y.checked_sub(1) {
                for x in left..right {
                    let surfel = &surfels[y * self.width + x];
                    if surfel.is_surface() {
                        let point = self.ray((x, y)).at(surfel.position[2]);
                        let grey = self.sampler.luminance(point);
                        surfels[y * self.width + x].grey = grey;
                    }
                }
            }
        }
    }
}
