//! The model as a camera would see it, by marching along each pixel's ray.

use geometry::{DMat3, DVec2, DVec3, Intrinsics, Pose};
use glam::{Mat3A, Vec3A};
use rayon::prelude::*;

use super::Volume;
use super::key::BLOCK_EDGE;
use super::march::{March, Ray, Turn, Walk, refine};
use super::ranges::{TILE, Tiles};
use super::sampler::{FieldSample, Sampler};
use crate::model_view::{DepthRange, ModelView, Surfel};

#[cfg(test)]
mod tests;

/// Rows of tiles of one parallel task. Each pixel is computed by itself, so tasks do not show in the result.
const BAND_TILES: usize = 8;
/// Every so many columns and rows a pixel is marched; those between start from them.
const GRID: usize = 2;
/// Columns that are predicted together.
const STRIP: usize = 16;

/// The camera in voxels from an anchor block: a point at depth z of pixel (x, y) is
/// `eye + z (forward + x right + y down)`.
pub(super) struct VoxelRays {
    /// Block that coordinates count from.
    anchor: [i32; 3],
    eye: Vec3A,
    forward: Vec3A,
    right: Vec3A,
    down: Vec3A,
    camera_from_volume: Mat3A,
    /// Focal lengths and centre, pixels.
    focal: DVec2,
    center: DVec2,
    /// Homogeneous pixel (u·z, v·z, z), metres, of a vector in voxels.
    homogeneous_from_voxels: Mat3A,
    /// Unit normals of the planes that bound what the camera sees, pointing inwards.
    sides: [Vec3A; 5],
}

impl Volume {
    /// Writes into `view` what `camera`, an ideal pinhole (distortion is ignored), sees of the model from
    /// `world_from_camera`, within the depths that [`super::VolumeConfig`] gates.
    ///
    /// A surface is the first change from observed free space to behind a surface whose eight voxels have at
    /// least [`ModelView::min_weight`]; backs of surfaces and the ends of the band show nothing. What is narrower
    /// than two pixels may be missed in front of a surface. Allocates
    /// nothing once the view has its size; the same bits for any number of threads.
    pub fn predict(&self, camera: &Intrinsics, world_from_camera: &Pose, view: &mut ModelView) {
        view.reset(camera, world_from_camera);
        let rays = VoxelRays::new(self, camera, world_from_camera);
        let (width, height) = (view.width(), view.height());
        let tile_columns = width.div_ceil(TILE);
        view.ranges
            .resize(tile_columns * height.div_ceil(TILE), DepthRange::EMPTY);
        let mut tiles = Tiles {
            ranges: &mut view.ranges,
            width,
            height,
            voxel_size: self.config.voxel_size,
        };
        tiles.fit(&self.store, &rays);

        let min_weight = view.min_weight.max(f32::MIN_POSITIVE);
        view.surfels
            .par_chunks_mut(width * TILE * BAND_TILES)
            .zip(view.ranges.par_chunks(tile_columns * BAND_TILES))
            .enumerate()
            .for_each(|(number, (surfels, ranges))| {
                let mut band = Band {
                    sampler: Sampler::new(self, rays.anchor),
                    rays: &rays,
                    march: self.march(min_weight),
                    first_row: number * TILE * BAND_TILES,
                    width,
                    has_color: self.has_color(),
                };
                // Strip by strip, so that the sampler meets the same blocks again. Pixels between those of a
                // strip's grid look at the first of the next.
                let strip_count = width.div_ceil(STRIP);
                for strip in 0..=strip_count {
                    if strip < strip_count {
                        band.march_strip(strip * STRIP, ranges, surfels);
                    }
                    if strip > 0 {
                        band.fill_strip((strip - 1) * STRIP, ranges, surfels);
                    }
                }
            });
    }

    /// A march through everything that the volume can hold.
    fn march(&self, min_weight: f32) -> March {
        March {
            truncation: self.config.truncation(),
            truncation_voxels: self.config.truncation_voxels,
            nearest: self.config.min_depth,
            farthest: self.config.max_depth + self.config.truncation(),
            min_weight,
        }
    }
}

/// A row of tiles.
struct Band<'a> {
    sampler: Sampler<'a>,
    rays: &'a VoxelRays,
    march: March,
    first_row: usize,
    width: usize,
    has_color: bool,
}

impl<'a> Band<'a> {
    /// Predicts every second pixel of every second row of the strip from column `left`.
    ///
    /// The rays of a row take turns: each asks for the voxel that it needs next and looks at it a turn later,
    /// because a march is a chain of reads that each wait for memory.
    fn march_strip(&mut self, left: usize, ranges: &[DepthRange], surfels: &mut [Surfel]) {
        let right = (left + STRIP).min(self.width);
        for y in (0..surfels.len() / self.width).step_by(GRID) {
            let mut walks = [const { None }; STRIP / GRID];
            for (walk, x) in walks.iter_mut().zip((left..right).step_by(GRID)) {
                surfels[y * self.width + x] = Surfel::NONE;
                *walk = self.start((x, y), ranges);
            }
            let mut is_walking = true;
            while is_walking {
                is_walking = false;
                for slot in &mut walks {
                    let Some(walk) = slot else { continue };
                    match walk.turn(&mut self.sampler, &self.march) {
                        Turn::Ahead => is_walking = true,
                        Turn::Past => *slot = None,
                        Turn::Surface(z, sample) => {
                            let (x, y) = walk.pixel;
                            surfels[y * self.width + x] = self.surfel(walk, z, &sample);
                            *slot = None;
                        }
                    }
                }
            }
        }
    }

    /// Predicts the pixels between those that were marched: where those around one agree, it starts at their
    /// depth, else it is marched too. So a thing is missed only if it is narrower than two pixels.
    fn fill_strip(&mut self, left: usize, ranges: &[DepthRange], surfels: &mut [Surfel]) {
        let right = (left + STRIP).min(self.width);
        for y in 0..surfels.len() / self.width {
            let mut guesses = [None; STRIP];
            for (guess, x) in guesses.iter_mut().zip(left..right) {
                if x % GRID != 0 || y % GRID != 0 {
                    *guess = self.guess((x, y), surfels);
                }
                if let Some(z) = *guess {
                    self.sampler.fetch(self.ray((x, y)).at(z));
                }
            }
            for (guess, x) in guesses.into_iter().zip(left..right) {
                if x % GRID != 0 || y % GRID != 0 {
                    surfels[y * self.width + x] = self.fill((x, y), guess, ranges);
                }
            }
        }
    }

    /// Mean depth of the marched pixels around one, where all see surface within a truncation.
    fn guess(&self, (x, y): (usize, usize), surfels: &[Surfel]) -> Option<f32> {
        let (before_x, behind_x) = (x - x % GRID, x + x % GRID);
        let (before_y, behind_y) = (y - y % GRID, y + y % GRID);
        if behind_x >= self.width || behind_y * self.width >= surfels.len() {
            return None;
        }
        let corners = [
            (before_x, before_y),
            (behind_x, before_y),
            (before_x, behind_y),
            (behind_x, behind_y),
        ];
        let around = corners.map(|(x, y)| &surfels[y * self.width + x]);
        let depths = around.map(|surfel| surfel.position[2]);
        let least = depths.into_iter().fold(f32::INFINITY, f32::min);
        let most = depths.into_iter().fold(0.0, f32::max);
        let agrees = most - least < self.march.truncation;
        (around.iter().all(|surfel| surfel.is_surface()) && agrees)
            .then(|| 0.25 * depths.iter().sum::<f32>())
    }

    /// The surfel of a pixel from a guess of its depth, or by a march.
    fn fill(&mut self, pixel: (usize, usize), guess: Option<f32>, ranges: &[DepthRange]) -> Surfel {
        if let Some(guess) = guess {
            let ray = self.ray(pixel);
            let reach = self.march.truncation;
            let limits = [guess - reach, guess + reach];
            if let Some((z, sample)) = refine(&mut self.sampler, &ray, &self.march, guess, limits) {
                return self.surfel(&Walk::at(ray, pixel), z, &sample);
            }
        }
        let Some(mut walk) = self.start(pixel, ranges) else {
            return Surfel::NONE;
        };
        loop {
            match walk.turn(&mut self.sampler, &self.march) {
                Turn::Ahead => {}
                Turn::Past => return Surfel::NONE,
                Turn::Surface(z, sample) => return self.surfel(&walk, z, &sample),
            }
        }
    }

    fn ray(&self, (x, y): (usize, usize)) -> Ray {
        let row = self.rays.forward + (self.first_row + y) as f32 * self.rays.down;
        Ray::new(self.rays.eye, row + x as f32 * self.rays.right)
    }

    /// A walk along a pixel's ray through the range of its tile; `None` without a block on the way.
    fn start(&mut self, pixel: (usize, usize), ranges: &[DepthRange]) -> Option<Walk<'a>> {
        let tile_columns = self.width.div_ceil(TILE);
        let range = &ranges[pixel.1 / TILE * tile_columns + pixel.0 / TILE];
        let mut walk = Walk::at(self.ray(pixel), pixel);
        walk.z = range.nearest.max(self.march.nearest);
        walk.farthest = range.farthest.min(self.march.farthest);
        walk.seek(&mut self.sampler).then_some(walk)
    }

    fn surfel(&mut self, walk: &Walk<'_>, z: f32, sample: &FieldSample) -> Surfel {
        let (x, y) = walk.pixel;
        let mut surfel = self.rays.surfel(x, self.first_row + y, z, sample);
        if self.has_color {
            surfel.grey = self.sampler.luminance(walk.ray.at(z));
        }
        surfel
    }
}

impl VoxelRays {
    fn new(volume: &Volume, camera: &Intrinsics, world_from_camera: &Pose) -> Self {
        let voxel_size = f64::from(volume.config().voxel_size);
        let eye = (world_from_camera.translation() - volume.config().origin) / voxel_size;
        let anchor = (eye / BLOCK_EDGE as f64).floor();
        let (focal, center) = (camera.focal(), camera.center());
        let volume_from_camera = world_from_camera.matrix();
        // Rows of the projection, and the planes u = 0, u = width, v = 0, v = height, z = 0.
        let row = |v: DVec3| volume_from_camera * v * voxel_size;
        let depth = row(DVec3::Z);
        let column = row(DVec3::new(focal.x, 0.0, center.x));
        let line = row(DVec3::new(0.0, focal.y, center.y));
        let (width, height) = (f64::from(camera.width()), f64::from(camera.height()));
        let sides = [
            column,
            width * depth - column,
            line,
            height * depth - line,
            depth,
        ];
        let in_voxels = |v: DVec3| (volume_from_camera * v / voxel_size).as_vec3a();
        Self {
            // A cast saturates: a camera beyond every block sees nothing there.
            anchor: anchor.to_array().map(|c| c as i32),
            eye: (eye - anchor * BLOCK_EDGE as f64).as_vec3a(),
            forward: in_voxels((-center / focal).extend(1.0)),
            right: in_voxels(DVec3::new(1.0 / focal.x, 0.0, 0.0)),
            down: in_voxels(DVec3::new(0.0, 1.0 / focal.y, 0.0)),
            camera_from_volume: volume_from_camera.transpose().as_mat3().into(),
            focal,
            center,
            homogeneous_from_voxels: DMat3::from_cols(column, line, depth)
                .transpose()
                .as_mat3()
                .into(),
            sides: sides.map(|side| side.normalize().as_vec3a()),
        }
    }

    /// The first voxel of a block.
    pub(super) fn local_voxel(&self, block: [i32; 3]) -> Vec3A {
        let local: [f32; 3] = std::array::from_fn(|axis| {
            block[axis].saturating_sub(self.anchor[axis]) as f32 * BLOCK_EDGE as f32
        });
        Vec3A::from_array(local)
    }

    /// Homogeneous pixel (u·z, v·z, z) of a point in voxels.
    pub(super) fn homogeneous(&self, point: Vec3A) -> Vec3A {
        self.homogeneous_from_voxels * (point - self.eye)
    }

    /// Change of the homogeneous pixel per voxel along x, y, z.
    pub(super) fn voxel_steps(&self) -> [Vec3A; 3] {
        let matrix = &self.homogeneous_from_voxels;
        [matrix.x_axis, matrix.y_axis, matrix.z_axis]
    }

    /// Whether a ball of `radius` voxels may reach into the image.
    pub(super) fn may_see(&self, middle: Vec3A, radius: f32) -> bool {
        let from_eye = middle - self.eye;
        self.sides.iter().all(|side| side.dot(from_eye) > -radius)
    }

    /// The surfel of pixel (`x`, `y`) at depth `z`.
    fn surfel(&self, x: usize, y: usize, z: f32, sample: &FieldSample) -> Surfel {
        let slope = (DVec2::new(x as f64, y as f64) - self.center) / self.focal;
        let normal = self.camera_from_volume * sample.gradient.normalize();
        Surfel {
            position: [slope.x as f32 * z, slope.y as f32 * z, z],
            grey: 0.0,
            normal: normal.to_array(),
            weight: sample.weight,
        }
    }
}
