//! A truncated signed distance field in hashed blocks of 8³ voxels.
//!
//! Voxel `(i, j, k)` is a sample at `origin + voxel_size · (i, j, k)`; block `(a, b, c)` holds voxels
//! `8a..8a+8` and so on. Poses are taken relative to the origin in f64 before anything becomes f32
//! (hard-cases A14, D11).

mod allocate;
mod config;
mod depth;
pub mod key;
mod predict;
mod sampler;
mod table;
#[cfg(test)]
mod tests;

use geometry::{DMat3, DVec3, Intrinsics, Pose};
use rayon::prelude::*;

use self::allocate::{BlockRays, Frontier, touched_blocks};
use self::depth::FrameDepth;
use self::key::{BLOCK_EDGE, pack, split_voxel, unpack};
use crate::error::FusionError;
use crate::kernels::Level;
use crate::kernels::integrate::{Block, BlockView, Conflicts, UpdateRule, integrate_block};

pub use self::config::{MIN_TRUNCATION_VOXELS, VolumeConfig};
pub use self::table::BlockTable;

/// Longest way between two samples of a ray's band, in block edges: no layer of blocks is stepped over.
const LONGEST_SAMPLE_STEP: f32 = 0.75;
/// Depth steps by which two observations of one surface may differ before they contradict each other.
const CONFLICT_STEPS: f32 = 2.0;
/// Blocks per allocation and per parallel task (256 KiB).
const SLAB_BLOCKS: usize = 64;

/// A hashed TSDF volume.
pub struct Volume {
    config: VolumeConfig,
    level: Level,
    table: BlockTable,
    keys: Vec<u64>,
    /// Number of the last frame that touched the block.
    touched_in: Vec<u32>,
    slabs: Vec<Vec<Block>>,
    frontier: Frontier,
    frame: FrameDepth,
    frame_number: u32,
    refused_count: u64,
}

/// What one call of [`Volume::integrate`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct IntegrateStats {
    /// Blocks made in this frame.
    pub blocks_allocated: usize,
    /// Requests for blocks refused in this frame: at the limit, or beyond ±2²⁰ blocks.
    pub blocks_refused: usize,
    /// Blocks in the band of this frame, updated or tested.
    pub blocks_visible: usize,
}

/// A voxel's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voxel {
    /// Signed distance in truncations, positive in free space.
    pub tsdf: f32,
    /// Accumulated weight; 0 = never observed.
    pub weight: f32,
}

impl Volume {
    /// An empty volume, using the fastest instructions of this machine.
    pub fn new(config: VolumeConfig) -> Result<Self, FusionError> {
        Self::with_level(config, Level::detect())
    }

    /// An empty volume that updates voxels with the given instructions; results are equal bit for bit.
    pub fn with_level(config: VolumeConfig, level: Level) -> Result<Self, FusionError> {
        config.check()?;
        Ok(Self {
            config,
            level,
            table: BlockTable::default(),
            keys: Vec::new(),
            touched_in: Vec::new(),
            slabs: Vec::new(),
            frontier: Frontier::default(),
            frame: FrameDepth::default(),
            frame_number: 0,
            refused_count: 0,
        })
    }

    /// The settings.
    pub fn config(&self) -> &VolumeConfig {
        &self.config
    }

    /// Number of allocated blocks.
    pub fn block_count(&self) -> usize {
        self.keys.len()
    }

    /// Requests for blocks refused since the volume exists.
    pub fn refused_count(&self) -> u64 {
        self.refused_count
    }

    /// Fuses one depth image.
    ///
    /// `depth`: metres along z, row-major, one value per pixel of `camera`; 0 and non-finite mean no
    /// measurement. Lens distortion in `camera` is undone first by nearest-pixel resampling (the map is
    /// kept while the camera stays the same). A block is allocated when a second ray meets it, in this
    /// frame or a later one. The same input gives the same volume for any number of threads.
    pub fn integrate(
        &mut self,
        depth: &[f32],
        camera: &Intrinsics,
        world_from_camera: &Pose,
    ) -> Result<IntegrateStats, FusionError> {
        let expected = camera.width() as usize * camera.height() as usize;
        if depth.len() != expected {
            let (width, height) = (camera.width(), camera.height());
            return Err(FusionError::DepthSize {
                width,
                height,
                expected,
                got: depth.len(),
            });
        }
        // A depth below the near plane of the kernel would allocate blocks that are never written.
        let min_depth = self.config.min_depth.max(geometry::camera::Z_NEAR as f32);
        self.frame
            .load(depth, camera, min_depth..=self.config.max_depth);
        self.frame_number += 1;

        let projection = Projection::new(camera, world_from_camera, &self.config);
        let touched = touched_blocks(self.frame.view(), &projection.block_rays(&self.config));
        let mut stats = self.allocate(&touched.keys);
        stats.blocks_refused += touched.out_of_range_count;
        self.refused_count += stats.blocks_refused as u64;
        self.update_blocks(&projection);
        Ok(stats)
    }

    /// The voxel at integer coordinates, `None` where no block is.
    pub fn voxel(&self, voxel: [i32; 3]) -> Option<Voxel> {
        let (block, index) = split_voxel(voxel);
        let block = self.block(self.table.get(pack(block)?)?);
        Some(Voxel {
            tsdf: block.tsdf[index],
            weight: block.weight[index],
        })
    }

    /// Indices of all blocks in the order of their keys: by x, y, z, whatever the order of allocation.
    pub(crate) fn sorted_blocks(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.keys.len() as u32).collect();
        order.par_sort_unstable_by_key(|&index| self.keys[index as usize]);
        order
    }

    /// Coordinates of a block.
    pub(crate) fn block_coordinates(&self, index: u32) -> [i32; 3] {
        unpack(self.keys[index as usize])
    }

    /// Index of the block at coordinates.
    pub(crate) fn block_index(&self, coordinates: [i32; 3]) -> Option<u32> {
        self.table.get(pack(coordinates)?)
    }

    /// A block by index.
    pub(crate) fn block(&self, index: u32) -> &Block {
        &self.slabs[index as usize / SLAB_BLOCKS][index as usize % SLAB_BLOCKS]
    }

    /// Makes missing blocks and marks those of this frame.
    fn allocate(&mut self, touched: &[u64]) -> IntegrateStats {
        let mut stats = IntegrateStats::default();
        for &key in touched {
            if let Some(index) = self.table.get(key) {
                let stamp = &mut self.touched_in[index as usize];
                stats.blocks_visible += usize::from(*stamp != self.frame_number);
                *stamp = self.frame_number;
            } else if self.frontier.is_known(key) {
                if self.keys.len() < self.config.block_limit.min(u32::MAX as usize) {
                    self.push_block(key);
                    stats.blocks_allocated += 1;
                    stats.blocks_visible += 1;
                } else {
                    stats.blocks_refused += 1;
                }
            }
        }
        stats
    }

    fn push_block(&mut self, key: u64) {
        let index = self.keys.len();
        if index.is_multiple_of(SLAB_BLOCKS) {
            self.slabs.push(Vec::with_capacity(SLAB_BLOCKS));
        }
        self.slabs[index / SLAB_BLOCKS].push(Block::EMPTY);
        self.table.insert(key, index as u32);
        self.keys.push(key);
        self.touched_in.push(self.frame_number);
    }

    /// Each block is written by one task, so the result does not depend on their order.
    fn update_blocks(&mut self, projection: &Projection) {
        let config = &self.config;
        let rule = UpdateRule {
            truncation: config.truncation(),
            weight_at_one_metre: config.reference_depth * config.reference_depth,
            weight_cap: config.weight_cap,
            conflict: 1.0 / config.truncation_voxels,
            conflict_at_one_metre: CONFLICT_STEPS * config.depth_step / config.truncation(),
        };
        let (level, frame, frame_number) = (self.level, &self.frame, self.frame_number);
        self.slabs
            .par_iter_mut()
            .zip(self.keys.par_chunks(SLAB_BLOCKS))
            .zip(self.touched_in.par_chunks(SLAB_BLOCKS))
            .for_each(|((slab, keys), touched_in)| {
                let mut conflicts = Conflicts::NONE;
                let mut places = (0..slab.len())
                    .filter(|&place| touched_in[place] == frame_number)
                    .peekable();
                while let Some(place) = places.next() {
                    let mut view = projection.block_view(unpack(keys[place]));
                    let Some(bounds) = frame.bounds(&view) else {
                        continue;
                    };
                    view.farthest = bounds.farthest + rule.truncation;
                    view.nearest = bounds.nearest - rule.truncation;
                    view.is_inside = bounds.is_inside;
                    let (before, after) = slab.split_at_mut(place + 1);
                    let block = &mut before[place];
                    let ahead = places.peek().map(|next| &after[next - place - 1]);
                    integrate_block(
                        level,
                        block,
                        ahead,
                        frame.view(),
                        &view,
                        &rule,
                        &mut conflicts,
                    );
                }
            });
    }
}

/// A camera relative to the volume, in f64.
struct Projection {
    camera_from_volume: DMat3,
    /// Camera centre relative to the volume origin, metres.
    eye: DVec3,
    focal: geometry::DVec2,
    center: geometry::DVec2,
    /// Columns and rows.
    size: geometry::DVec2,
    voxel_size: f64,
}

impl Projection {
    fn new(camera: &Intrinsics, world_from_camera: &Pose, config: &VolumeConfig) -> Self {
        Self {
            camera_from_volume: world_from_camera.matrix().transpose(),
            eye: world_from_camera.translation() - config.origin,
            focal: camera.focal(),
            center: camera.center(),
            size: geometry::DVec2::new(f64::from(camera.width()), f64::from(camera.height())),
            voxel_size: f64::from(config.voxel_size),
        }
    }

    /// Homogeneous pixel (u·z, v·z, z) of a vector in camera axes.
    fn homogeneous(&self, v: DVec3) -> [f32; 3] {
        let u = self.focal.x * v.x + self.center.x * v.z;
        let w = self.focal.y * v.y + self.center.y * v.z;
        [u as f32, w as f32, v.z as f32]
    }

    /// The view of a block, without depth bounds.
    fn block_view(&self, block: [i32; 3]) -> BlockView {
        let first_voxel =
            DVec3::from_array(block.map(|c| f64::from(c) * BLOCK_EDGE as f64)) * self.voxel_size;
        let from_eye = first_voxel - self.eye;
        let middle = from_eye + DVec3::splat(3.5 * self.voxel_size);
        let to_camera = (-middle).normalize_or_zero();
        BlockView {
            start: self.homogeneous(self.camera_from_volume * from_eye),
            step: [0, 1, 2]
                .map(|axis| self.homogeneous(self.camera_from_volume.col(axis) * self.voxel_size)),
            to_camera: to_camera.as_vec3().to_array(),
            farthest: f32::INFINITY,
            nearest: f32::NEG_INFINITY,
            is_inside: false,
        }
    }

    fn block_rays(&self, config: &VolumeConfig) -> BlockRays {
        let block_size = self.voxel_size * BLOCK_EDGE as f64;
        let eye = self.eye / block_size;
        let anchor = eye.floor();
        let volume_from_camera = self.camera_from_volume.transpose();
        let ray = |x: f64, y: f64, z: f64| {
            (volume_from_camera * DVec3::new(x / self.focal.x, y / self.focal.y, z) / block_size)
                .as_vec3a()
        };
        let corners = [0, 1, 2, 3].map(|n| {
            let (x, y) = (f64::from(n & 1), f64::from(n >> 1));
            ray(
                x * self.size.x - self.center.x,
                y * self.size.y - self.center.y,
                1.0,
            )
        });
        let longest_ray = corners
            .into_iter()
            .fold(0.0, |longest: f32, ray| longest.max(ray.length()));
        let half_samples =
            (config.truncation() * longest_ray / LONGEST_SAMPLE_STEP).ceil() as usize;
        BlockRays {
            // A cast saturates: a camera beyond every block stays there and its requests are refused.
            anchor: anchor.to_array().map(|c| c as i32),
            eye: (eye - anchor).as_vec3a(),
            forward: ray(-self.center.x, -self.center.y, 1.0),
            right: ray(1.0, 0.0, 0.0),
            down: ray(0.0, 1.0, 0.0),
            truncation: config.truncation(),
            truncation_in_blocks: config.truncation_voxels / BLOCK_EDGE as f32,
            half_samples,
            sample_step: config.truncation() / half_samples as f32,
        }
    }
}
