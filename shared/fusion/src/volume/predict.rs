//! The model as a camera would see it, by marching along each pixel's ray.

use geometry::{DMat3, DVec2, DVec3, Intrinsics, Pose};
use glam::{Mat3A, Vec3A};
use rayon::prelude::*;

use super::Volume;
use super::key::BLOCK_EDGE;
use super::march::{Approach, Corrected, MOST_CORRECTIONS, March, Ray, Turn, Walk};
use super::ranges::{Detail, TILE, Tiles};
use super::sampler::Sampler;
use crate::kernels::field::{FieldSample, Neighbourhood};
use crate::model_view::{DepthRange, ModelView, Surfel};

mod near;
#[cfg(test)]
mod tests;

/// Rows of tiles of one parallel task. Each pixel is computed by itself, so tasks do not show in the result.
const BAND_TILES: usize = 16;
/// Every so many columns and rows a pixel is marched; those between start from them.
const COARSEST: usize = 4;
/// The finer grids, each from the one before.
const GRIDS: [usize; 2] = [2, 1];
/// Truncations of room between the nearest that a tile may hold and a surface that is guessed in it: with more,
/// something narrow may stand before it.
const MOST_FREE: f32 = 2.0;
/// Correction, in voxels, below which the next one would not show.
const SMALL_CORRECTION: f32 = 0.25;
/// Most walks that take turns.
const WALKS: usize = 32;
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
    /// than two pixels, or than four and within two truncations of what lies behind it, may be missed in front of
    /// a surface. Allocates nothing once the view has its size; the same bits for any number of threads.
    pub fn predict(&self, camera: &Intrinsics, world_from_camera: &Pose, view: &mut ModelView) {
        let rays = self.look_from(camera, world_from_camera, Detail::Octants, view);
        let width = view.width();
        let tile_columns = width.div_ceil(TILE);
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
                band.predict(ranges, surfels);
            });
    }

    /// Gives `view` its camera and place, and fits the ranges of its tiles.
    fn look_from(
        &self,
        camera: &Intrinsics,
        world_from_camera: &Pose,
        detail: Detail,
        view: &mut ModelView,
    ) -> VoxelRays {
        view.reset(camera, world_from_camera);
        let rays = VoxelRays::new(self, camera, world_from_camera);
        let (width, height) = (view.width(), view.height());
        view.ranges.resize(
            width.div_ceil(TILE) * height.div_ceil(TILE),
            DepthRange::EMPTY,
        );
        let mut tiles = Tiles {
            ranges: &mut view.ranges,
            width,
            height,
            voxel_size: self.config.voxel_size,
        };
        tiles.fit(&self.store, &rays, detail);
        rays
    }

    /// A march through everything that the volume can hold.
    fn march(&self, min_weight: f32) -> March {
        March {
            truncation: self.config.truncation(),
            truncation_voxels: self.config.truncation_voxels,
            nearest: self.config.min_depth,
            farthest: self.config.max_depth + self.config.truncation(),
            min_weight,
            small_correction: SMALL_CORRECTION,
        }
    }
}

/// A few rows of tiles.
struct Band<'a> {
    sampler: Sampler<'a>,
    rays: &'a VoxelRays,
    march: March,
    first_row: usize,
    width: usize,
    has_color: bool,
}

impl<'a> Band<'a> {
    /// Predicts the band's pixels.
    ///
    /// Strip by strip, so that the sampler meets the same blocks again; pixels look at the first column of the
    /// strip behind, so each finer grid follows a strip later.
    fn predict(&mut self, ranges: &[DepthRange], surfels: &mut [Surfel]) {
        let strip_count = self.width.div_ceil(STRIP);
        for strip in 0..strip_count + GRIDS.len() {
            if strip < strip_count {
                self.march_strip(strip * STRIP, ranges, surfels);
            }
            for (lag, &grid) in (1..).zip(&GRIDS) {
                if let Some(behind) = strip.checked_sub(lag).filter(|&s| s < strip_count) {
                    self.fill_strip(behind * STRIP, grid, ranges, surfels);
                }
            }
        }
    }

    /// Marches along the rays of the coarsest grid in the strip from column `left`.
    fn march_strip(&mut self, left: usize, ranges: &[DepthRange], surfels: &mut [Surfel]) {
        let right = (left + STRIP).min(self.width);
        let mut walks = Walks::new();
        for y in (0..surfels.len() / self.width).step_by(COARSEST) {
            for x in (left..right).step_by(COARSEST) {
                self.set_off((x, y), ranges, &mut walks, surfels);
            }
        }
        self.walk(&mut walks, surfels);
    }

    /// Adds a walk for a pixel, after all of them when there is no more room.
    fn set_off(
        &mut self,
        pixel: (usize, usize),
        ranges: &[DepthRange],
        walks: &mut Walks<'a>,
        surfels: &mut [Surfel],
    ) {
        surfels[pixel.1 * self.width + pixel.0] = Surfel::NONE;
        let Some(walk) = self.start(pixel, ranges) else {
            return;
        };
        if walks.count == walks.all.len() {
            self.walk(walks, surfels);
        }
        walks.all[walks.count] = Some(walk);
        walks.count += 1;
    }

    /// Goes all walks to their ends.
    ///
    /// They take turns: each asks for the voxel that it needs next and looks at it a turn later, because a march
    /// is a chain of reads that each wait for memory.
    fn walk(&mut self, walks: &mut Walks<'a>, surfels: &mut [Surfel]) {
        let mut is_walking = walks.count > 0;
        while is_walking {
            is_walking = false;
            for slot in &mut walks.all[..walks.count] {
                let Some(walk) = slot else { continue };
                match walk.turn(&mut self.sampler, &self.march) {
                    Turn::Ahead => is_walking = true,
                    Turn::Past => *slot = None,
                    Turn::Surface(z, sample) => {
                        let (x, y) = walk.pixel;
                        surfels[y * self.width + x] =
                            self.surfel(walk.pixel, &walk.ray, z, &sample);
                        *slot = None;
                    }
                }
            }
        }
        walks.count = 0;
    }

    /// Predicts the pixels of a grid of the strip that are not of the grid twice as coarse: where those around
    /// one agree, it starts at their depth, else it is marched too.
    fn fill_strip(
        &mut self,
        left: usize,
        grid: usize,
        ranges: &[DepthRange],
        surfels: &mut [Surfel],
    ) {
        let right = (left + STRIP).min(self.width);
        let (mut walks, mut guesses) = (Walks::new(), Guesses::new());
        for y in (0..surfels.len() / self.width).step_by(grid) {
            let is_between = y % (2 * grid) != 0;
            let (from, step) = if is_between {
                (left, grid)
            } else {
                (left + grid, 2 * grid)
            };
            for x in (from..right).step_by(step) {
                match self.guess((x, y), grid, ranges, surfels) {
                    Some(guess) => {
                        if self.has_color {
                            self.sampler.fetch_luminance(guess.ray.at(guess.z));
                        }
                        guesses.push(x, guess, &mut self.sampler);
                    }
                    None => self.set_off((x, y), ranges, &mut walks, surfels),
                }
            }
            self.refine(y, &mut guesses, ranges, &mut walks, surfels);
        }
        self.walk(&mut walks, surfels);
    }

    /// Follows guesses of row `y` to the surface; those that find none are marched.
    fn refine(
        &mut self,
        y: usize,
        guesses: &mut Guesses<'a>,
        ranges: &[DepthRange],
        walks: &mut Walks<'a>,
        surfels: &mut [Surfel],
    ) {
        let mut samples = [FieldSample::NONE; STRIP];
        for _ in 0..MOST_CORRECTIONS {
            let count = guesses.count;
            let points = &guesses.points[..count];
            self.sampler
                .sample_all(points, self.march.min_weight, &mut samples);
            guesses.count = 0;
            for (number, sample) in samples[..count].iter().enumerate() {
                let (x, mut approach) = guesses.all[number];
                match approach.correct(sample, &self.march) {
                    Corrected::Arrived => {
                        surfels[y * self.width + x] =
                            self.surfel((x, y), &approach.ray, approach.z, sample);
                    }
                    Corrected::Ahead => guesses.push(x, approach, &mut self.sampler),
                    Corrected::Astray => self.set_off((x, y), ranges, walks, surfels),
                }
            }
        }
        for &(x, _) in &guesses.all[..guesses.count] {
            self.set_off((x, y), ranges, walks, surfels);
        }
        guesses.count = 0;
    }

    /// Mean depth of the pixels of the coarser grid around one, where all see surface within a truncation. On a
    /// grid of more than a pixel none may lie far in front of it either.
    fn guess(
        &self,
        (x, y): (usize, usize),
        grid: usize,
        ranges: &[DepthRange],
        surfels: &[Surfel],
    ) -> Option<Approach> {
        // Behind the last pixel of a row or column of the grid, the one before is all there is.
        let around = |place: usize, size: usize| {
            let (before, off) = (place / (2 * grid) * (2 * grid), place % (2 * grid));
            let behind = before + 2 * off;
            (before, if behind < size { behind } else { before })
        };
        let (before_x, behind_x) = around(x, self.width);
        let (before_y, behind_y) = around(y, surfels.len() / self.width);
        let corners = [
            before_y * self.width + before_x,
            before_y * self.width + behind_x,
            behind_y * self.width + before_x,
            behind_y * self.width + behind_x,
        ];
        // No surface has depth 0.
        let depths = corners.map(|corner| surfels[corner].position[2]);
        let least = depths[0].min(depths[1]).min(depths[2].min(depths[3]));
        let most = depths[0].max(depths[1]).max(depths[2].max(depths[3]));
        let reach = self.march.truncation;
        let z = 0.25 * (depths[0] + depths[1] + (depths[2] + depths[3]));
        let is_near = grid == 1 || z - self.range((x, y), ranges).nearest < MOST_FREE * reach;
        (least > 0.0 && most - least < reach && is_near).then(|| Approach {
            ray: self.ray((x, y)),
            z,
            limits: [z - reach, z + reach],
        })
    }

    fn range<'r>(&self, (x, y): (usize, usize), ranges: &'r [DepthRange]) -> &'r DepthRange {
        &ranges[y / TILE * self.width.div_ceil(TILE) + x / TILE]
    }

    fn ray(&self, (x, y): (usize, usize)) -> Ray {
        Ray::new(self.rays.eye, self.slope((x, y)))
    }

    /// Way along a pixel's ray per metre of z, voxels.
    fn slope(&self, (x, y): (usize, usize)) -> Vec3A {
        let row = self.rays.forward + (self.first_row + y) as f32 * self.rays.down;
        row + x as f32 * self.rays.right
    }

    /// A walk along a pixel's ray through the range of its tile; `None` without a block on the way.
    fn start(&mut self, pixel: (usize, usize), ranges: &[DepthRange]) -> Option<Walk<'a>> {
        let range = self.range(pixel, ranges);
        let mut walk = Walk::at(self.ray(pixel), pixel);
        walk.z = range.nearest.max(self.march.nearest);
        walk.farthest = range.farthest.min(self.march.farthest);
        walk.seek(&mut self.sampler).then_some(walk)
    }

    fn surfel(
        &mut self,
        (x, y): (usize, usize),
        ray: &Ray,
        z: f32,
        sample: &FieldSample,
    ) -> Surfel {
        let mut surfel = self.rays.surfel(x, self.first_row + y, z, sample);
        if self.has_color {
            surfel.grey = self.sampler.luminance(ray.at(z));
        }
        surfel
    }
}

/// Walks that take turns.
struct Walks<'a> {
    all: [Option<Walk<'a>>; WALKS],
    count: usize,
}

impl Walks<'_> {
    fn new() -> Self {
        Self {
            all: [const { None }; WALKS],
            count: 0,
        }
    }
}

/// Guesses of a row of a strip, with their columns and the voxels about them.
struct Guesses<'a> {
    all: [(usize, Approach); STRIP],
    points: [Neighbourhood<'a>; STRIP],
    count: usize,
}

impl<'a> Guesses<'a> {
    fn new() -> Self {
        Self {
            all: [(0, Approach::NONE); STRIP],
            points: [Neighbourhood::NONE; STRIP],
            count: 0,
        }
    }

    /// Adds a guess and asks for its voxels.
    fn push(&mut self, x: usize, guess: Approach, sampler: &mut Sampler<'a>) {
        let point = sampler.neighbourhood(guess.ray.at(guess.z));
        point.fetch();
        self.all[self.count] = (x, guess);
        self.points[self.count] = point;
        self.count += 1;
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
