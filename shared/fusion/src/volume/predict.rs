//! The model as a camera would see it, by marching along each pixel's ray.

use geometry::{DMat3, DVec2, DVec3, Intrinsics, Pose};
use glam::{Mat3A, Vec3A};
use rayon::prelude::*;

use super::Volume;
use super::key::{BLOCK_EDGE, BLOCK_SHIFT, BLOCK_VOXELS};
use super::ranges::{TILE, Tiles};
use super::sampler::{FieldSample, Sampler};
use crate::model_view::{DepthRange, ModelView, Surfel};

#[cfg(test)]
mod tests;

/// Share of the distance that the field promises which a step uses (hard-cases D16).
const STEP_SHARE: f32 = 0.8;
/// Shortest step, in voxels.
const SHORTEST_STEP: f32 = 0.7;
/// Voxels by which a crossing may lie outside its two samples, which are those of the nearest voxels: off by
/// up to 0.87 voxels across the surface, so by five times that along a ray that meets it at 10 degrees.
const CROSSING_SLACK: f32 = 4.0;
/// Correction, in voxels, below which the next one would not show.
const SMALL_CORRECTION: f32 = 0.25;
/// Most corrections of a crossing.
const MOST_CORRECTIONS: usize = 4;
/// Slope, in truncations per voxel times truncation voxels, below which it says nothing (D15).
const LEAST_GRADIENT: f32 = 1e-3;

/// Lengths of a march along one ray, metres of z.
#[derive(Clone, Copy)]
struct March {
    /// Distance that a value of 1 promises.
    truncation: f32,
    /// The same in voxels.
    truncation_voxels: f32,
    /// Depths that the volume takes.
    gate: [f32; 2],
    /// Where the tile's rays start and end.
    nearest: f32,
    farthest: f32,
    min_weight: f32,
}

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

/// One ray: a point at depth z is `eye + z · slope`, in voxels.
#[derive(Clone, Copy)]
struct Ray {
    eye: Vec3A,
    slope: Vec3A,
    /// Metres of z per voxel of way.
    z_per_voxel: f32,
}

impl Ray {
    #[inline]
    fn at(&self, z: f32) -> Vec3A {
        self.eye + z * self.slope
    }
}

impl Volume {
    /// Writes into `view` what `camera`, an ideal pinhole (distortion is ignored), sees of the model from
    /// `world_from_camera`, within the depths that [`super::VolumeConfig`] gates.
    ///
    /// A surface is the first change from observed free space to behind a surface whose eight voxels have at
    /// least [`ModelView::min_weight`]; backs of surfaces and the ends of the band show nothing. Allocates
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
            .par_chunks_mut(width * TILE)
            .zip(view.ranges.par_chunks(tile_columns))
            .enumerate()
            .for_each(|(line, (surfels, ranges))| {
                let mut band = Band {
                    sampler: Sampler::new(self, rays.anchor),
                    rays: &rays,
                    march: self.march(min_weight),
                    first_row: line * TILE,
                    width,
                };
                for (column, range) in ranges.iter().enumerate() {
                    band.predict_tile(column * TILE, range, surfels);
                }
            });
    }

    /// A march through everything that the volume can hold.
    fn march(&self, min_weight: f32) -> March {
        March {
            truncation: self.config.truncation(),
            truncation_voxels: self.config.truncation_voxels,
            gate: [
                self.config.min_depth,
                self.config.max_depth + self.config.truncation(),
            ],
            nearest: 0.0,
            farthest: 0.0,
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
}

impl Band<'_> {
    /// Predicts the pixels of the tile from column `first`; `surfels` are the rows of the band.
    fn predict_tile(&mut self, first: usize, range: &DepthRange, surfels: &mut [Surfel]) {
        let last = (first + TILE).min(self.width);
        self.march.nearest = range.nearest.max(self.march.gate[0]);
        self.march.farthest = range.farthest.min(self.march.gate[1]);
        for (row, surfels) in surfels.chunks_exact_mut(self.width).enumerate() {
            let y = self.first_row + row;
            let start = self.rays.forward + y as f32 * self.rays.down;
            for (x, surfel) in (first..last).zip(&mut surfels[first..last]) {
                let ray = Ray::new(self.rays.eye, start + x as f32 * self.rays.right);
                *surfel = match first_surface(&mut self.sampler, &ray, &self.march) {
                    Some((z, sample)) => self.rays.surfel(x, y, z, &sample),
                    None => Surfel::NONE,
                };
            }
        }
    }
}

impl Ray {
    fn new(eye: Vec3A, slope: Vec3A) -> Self {
        Self {
            eye,
            slope,
            z_per_voxel: slope.length_recip(),
        }
    }
}

/// Depth and field of the first crossing from free space to behind a surface.
fn first_surface(
    sampler: &mut Sampler<'_>,
    ray: &Ray,
    march: &March,
) -> Option<(f32, FieldSample)> {
    let shortest = SHORTEST_STEP * ray.z_per_voxel;
    let mut z = march.nearest;
    // Depth and value of the sample before, where it lies in front of a surface.
    let mut before: Option<(f32, f32)> = None;
    while z < march.farthest {
        // The nearest voxel: half a voxel off at most, and the crossing is refined.
        let point = ray.at(z) + 0.5;
        let voxel = point.floor().as_ivec3();
        let block = sampler.block((voxel >> BLOCK_SHIFT).to_array());
        let Some(block) = block else {
            before = None;
            z += (way_out_of_block(point, ray) * ray.z_per_voxel).max(shortest);
            continue;
        };
        let [x, y, place_z] = (voxel & (BLOCK_EDGE as i32 - 1)).to_array();
        let index = (x | y << BLOCK_SHIFT | place_z << (2 * BLOCK_SHIFT)) as usize;
        let tsdf = block.tsdf[index & (BLOCK_VOXELS - 1)];
        if tsdf.is_sign_negative() {
            if let Some(before) = before
                && let Some(found) = refine(sampler, ray, march, before, (z, tsdf))
            {
                return Some(found);
            }
            before = None;
        } else {
            before = Some((z, tsdf));
        }
        z += (STEP_SHARE * march.truncation * tsdf.abs()).max(shortest);
    }
    None
}

/// Voxels of way from `point` to the border of its block.
fn way_out_of_block(point: Vec3A, ray: &Ray) -> f32 {
    let size = BLOCK_EDGE as f32;
    let within = point - (point / size).floor() * size;
    let direction = ray.slope * ray.z_per_voxel;
    let ahead = Vec3A::select(direction.cmpge(Vec3A::ZERO), size - within, within);
    // Parallel to a side the way is infinite.
    (ahead / direction.abs()).min_element()
}

/// Moves a crossing to the zero of the trilinear field; `None` when it is no surface.
fn refine(
    sampler: &mut Sampler<'_>,
    ray: &Ray,
    march: &March,
    (z_before, tsdf_before): (f32, f32),
    (z_behind, tsdf_behind): (f32, f32),
) -> Option<(f32, FieldSample)> {
    let slack = CROSSING_SLACK * ray.z_per_voxel;
    let (low, high) = (z_before - slack, z_behind + slack);
    let mut z = z_before + (z_behind - z_before) * tsdf_before / (tsdf_before - tsdf_behind);
    for _ in 0..MOST_CORRECTIONS {
        let sample = sampler.sample(ray.at(z).to_array(), march.min_weight)?;
        let gradient = Vec3A::from_array(sample.gradient);
        // Change of the value per metre of z: falls where the ray enters a surface.
        let fall = -gradient.dot(ray.slope);
        let is_slope = gradient.length() * march.truncation_voxels > LEAST_GRADIENT;
        if !(fall > 0.0) || !is_slope {
            return None;
        }
        let correction = (sample.tsdf / fall).clamp(-2.0 * ray.z_per_voxel, 2.0 * ray.z_per_voxel);
        z += correction;
        if !(z >= low && z <= high) {
            return None;
        }
        if correction.abs() < SMALL_CORRECTION * ray.z_per_voxel {
            return Some((z, sample));
        }
    }
    None
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

    /// Depth of a point in voxels, metres.
    pub(super) fn depth(&self, point: Vec3A) -> f32 {
        (self.homogeneous_from_voxels * (point - self.eye)).z
    }

    /// Depth from the middle of a box of half extent `half` voxels to its nearest corner, metres.
    pub(super) fn depth_reach(&self, half: f32) -> f32 {
        let [x, y, z] = self.columns().map(|column| column.z.abs());
        half * (x + y + z)
    }

    /// Whether a ball of `radius` voxels may reach into the image.
    pub(super) fn may_see(&self, middle: Vec3A, radius: f32) -> bool {
        let from_eye = middle - self.eye;
        self.sides.iter().all(|side| side.dot(from_eye) > -radius)
    }

    /// Least and greatest pixel of a box about `middle`, which lies in front of the camera.
    pub(super) fn pixel_box(&self, middle: Vec3A, half: f32) -> ([f32; 2], [f32; 2]) {
        let at = self.homogeneous_from_voxels * (middle - self.eye);
        let [x, y, z] = self.columns().map(|column| column * half);
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for corner in 0..8_u8 {
            let sign = |axis: u8| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let at = at + sign(0) * x + sign(1) * y + sign(2) * z;
            let pixel = at / at.z;
            (low, high) = (low.min(pixel), high.max(pixel));
        }
        ([low.x, low.y], [high.x, high.y])
    }

    fn columns(&self) -> [Vec3A; 3] {
        let matrix = &self.homogeneous_from_voxels;
        [matrix.x_axis, matrix.y_axis, matrix.z_axis]
    }

    /// The surfel of pixel (`x`, `y`) at depth `z`.
    fn surfel(&self, x: usize, y: usize, z: f32, sample: &FieldSample) -> Surfel {
        let slope = (DVec2::new(x as f64, y as f64) - self.center) / self.focal;
        let normal = self.camera_from_volume * Vec3A::from_array(sample.gradient).normalize();
        Surfel {
            position: [slope.x as f32 * z, slope.y as f32 * z, z],
            grey: 0.0,
            normal: normal.to_array(),
            weight: sample.weight,
        }
    }
}
