//! A truncated signed distance field in hashed blocks of 8³ voxels.
//!
//! Voxel `(i, j, k)` is a sample at `origin + voxel_size · (i, j, k)`; block `(a, b, c)` holds voxels
//! `8a..8a+8` and so on. Poses are taken relative to the origin in f64 before anything becomes f32
//! (hard-cases A14, D11).

mod allocate;
mod blocks;
mod config;
mod depth;
pub mod key;
mod march;
mod predict;
mod projection;
mod ranges;
mod sampler;
mod table;
#[cfg(test)]
mod tests;

use geometry::{Intrinsics, Pose};
use imaging::LinearPixel;
use rayon::prelude::*;

use self::allocate::{Frontier, Toucher};
use self::blocks::{BlockStore, Slab};
use self::depth::FrameDepth;
use self::key::{split_voxel, unpack};
use self::projection::Projection;
use crate::error::FusionError;
use crate::kernels::Level;
use crate::kernels::integrate::{
    Block, ColorBlock, ColorView, Conflicts, UpdateRule, integrate_block,
};

pub use self::config::{MIN_TRUNCATION_VOXELS, SETTLED_COLORS, VolumeConfig};
pub use self::table::BlockTable;

/// Depth steps by which two observations of one surface may differ before they contradict each other.
const CONFLICT_STEPS: f32 = 2.0;
/// Distance from the observed surface within which voxels get colour, in voxels. Meshing and prediction read
/// the eight voxels of a cell that the surface crosses, √3 away at most.
const COLOR_REACH_VOXELS: f32 = 2.0;

/// A hashed TSDF volume.
pub struct Volume {
    config: VolumeConfig,
    level: Level,
    store: BlockStore,
    frontier: Frontier,
    toucher: Toucher,
    frame: FrameDepth,
    refused_count: u64,
    /// Frames fused with colour.
    colored_count: u64,
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
    /// Whether [`VolumeConfig::memory_limit_bytes`] kept the volume from making a block, or from taking colour.
    pub limit_reached: bool,
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
            store: BlockStore::new(),
            frontier: Frontier::default(),
            toucher: Toucher::default(),
            frame: FrameDepth::default(),
            refused_count: 0,
            colored_count: 0,
        })
    }

    /// Takes the memory of so many blocks ahead, with or without colour, so that the first frames need not wait for
    /// it; at most half of what [`VolumeConfig::memory_limit_bytes`] leaves.
    pub fn reserve(&mut self, block_count: usize, with_color: bool) {
        let color = if with_color {
            size_of::<ColorBlock>()
        } else {
            0
        };
        let free = self
            .config
            .memory_limit_bytes
            .saturating_sub(self.memory_bytes());
        let most = free / (2 * (size_of::<Block>() + color));
        self.store.reserve(block_count.min(most), with_color);
    }

    /// The settings.
    pub fn config(&self) -> &VolumeConfig {
        &self.config
    }

    /// Number of allocated blocks.
    pub fn block_count(&self) -> usize {
        self.store.len()
    }

    /// Requests for blocks refused since the volume exists.
    pub fn refused_count(&self) -> u64 {
        self.refused_count
    }

    /// Whether voxels have room for colour: since the first [`Volume::integrate_colored`] that found memory.
    pub fn has_color(&self) -> bool {
        self.store.has_color()
    }

    /// Bytes held: blocks, colours, tables and the buffers of a frame.
    /// [`VolumeConfig::memory_limit_bytes`] bounds it.
    pub fn memory_bytes(&self) -> usize {
        self.store.bytes() + self.buffer_bytes()
    }

    /// Sets [`VolumeConfig::memory_limit_bytes`] anew; what is there stays.
    pub fn set_memory_limit(&mut self, bytes: usize) {
        self.config.memory_limit_bytes = bytes;
    }

    /// Fuses one depth image.
    ///
    /// `depth`: metres along z, row-major, one value per pixel of `camera`; 0 and non-finite mean no
    /// measurement. Lens distortion in `camera` is undone first by nearest-pixel resampling (the map is
    /// kept while the camera stays the same). A block is allocated when a second ray meets it, in this
    /// frame or a later one. The same input gives the same volume for any number of threads. Allocates
    /// nothing once warm, unless blocks are made.
    pub fn integrate(
        &mut self,
        depth: &[f32],
        camera: &Intrinsics,
        world_from_camera: &Pose,
    ) -> Result<IntegrateStats, FusionError> {
        self.fuse(depth, None, camera, world_from_camera)
    }

    /// Fuses one depth image and the colour of its surface.
    ///
    /// As [`Volume::integrate`]; `color` holds one linear pixel per depth, seen by the same camera, invalid where
    /// there is none. Voxels within two voxels of the observed surface take it. Saturated samples count only
    /// where there is no other. When the memory limit leaves no room for colour, depth alone is fused, and the
    /// stats say so.
    pub fn integrate_colored(
        &mut self,
        depth: &[f32],
        color: &[LinearPixel],
        camera: &Intrinsics,
        world_from_camera: &Pose,
    ) -> Result<IntegrateStats, FusionError> {
        self.fuse(depth, Some(color), camera, world_from_camera)
    }

    fn fuse(
        &mut self,
        depth: &[f32],
        color: Option<&[LinearPixel]>,
        camera: &Intrinsics,
        world_from_camera: &Pose,
    ) -> Result<IntegrateStats, FusionError> {
        check_size(depth.len(), color.map(<[_]>::len), camera)?;
        // A depth below the near plane of the kernel would allocate blocks that are never written.
        let min_depth = self.config.min_depth.max(geometry::camera::Z_NEAR as f32);
        self.frame
            .load(depth, color, camera, min_depth..=self.config.max_depth);

        let projection = Projection::new(camera, world_from_camera, &self.config);
        self.toucher
            .touch(self.frame.view(), &projection.block_rays(&self.config));
        let mut stats = IntegrateStats::default();
        if color.is_some() && !self.store.has_color() {
            if self.memory_bytes() + self.store.color_bytes() <= self.config.memory_limit_bytes {
                self.store.add_color();
            } else {
                stats.limit_reached = true;
            }
        }
        self.allocate(&mut stats);
        self.refused_count += stats.blocks_refused as u64;
        self.update_blocks(&projection, color.filter(|_| self.store.has_color()));
        Ok(stats)
    }

    /// The voxel at integer coordinates, `None` where no block is.
    pub fn voxel(&self, voxel: [i32; 3]) -> Option<Voxel> {
        let (block, index) = split_voxel(voxel);
        let block = self.block(self.store.index_at(block)?);
        Some(Voxel {
            tsdf: block.tsdf[index],
            weight: block.weight[index],
        })
    }

    /// Linear radiance of the voxel at integer coordinates, and whether it is a lower bound because every
    /// sample was saturated; `None` without colour.
    pub fn voxel_radiance(&self, voxel: [i32; 3]) -> Option<([f32; 3], bool)> {
        let (block, index) = split_voxel(voxel);
        self.color(self.store.index_at(block)?)?.radiance(index)
    }

    /// Indices of all blocks in the order of their keys: by x, y, z, whatever the order of allocation.
    pub(crate) fn sorted_blocks(&self) -> Vec<u32> {
        self.store.sorted()
    }

    /// Coordinates of a block.
    pub(crate) fn block_coordinates(&self, index: u32) -> [i32; 3] {
        self.store.coordinates(index)
    }

    /// Index of the block at coordinates.
    pub(crate) fn block_index(&self, coordinates: [i32; 3]) -> Option<u32> {
        self.store.index_at(coordinates)
    }

    /// A block by index.
    pub(crate) fn block(&self, index: u32) -> &Block {
        self.store.block(index)
    }

    /// Colour of a block by index; `None` in a volume without colour.
    pub(crate) fn color(&self, index: u32) -> Option<&ColorBlock> {
        self.store.color(index)
    }

    fn buffer_bytes(&self) -> usize {
        self.frontier.bytes() + self.toucher.bytes() + self.frame.bytes()
    }

    /// Makes missing blocks and marks those of this frame.
    fn allocate(&mut self, stats: &mut IntegrateStats) {
        let buffer_bytes = self.buffer_bytes();
        let limit = self.config.memory_limit_bytes.saturating_sub(buffer_bytes);
        for (key, is_repeated) in self.toucher.keys() {
            let index = if let Some(index) = self.store.find(key) {
                index
            } else if is_repeated || self.frontier.is_known(key) {
                if self.store.bytes_for_next() > limit || self.store.len() >= u32::MAX as usize {
                    stats.blocks_refused += 1;
                    stats.limit_reached = true;
                    continue;
                }
                stats.blocks_allocated += 1;
                self.store.push(key)
            } else {
                continue;
            };
            stats.blocks_visible += usize::from(self.store.touch(index));
        }
        stats.blocks_refused += self.toucher.out_of_range_count();
    }

    /// Each block is written by one task, so the result does not depend on their order.
    fn update_blocks(&mut self, projection: &Projection, color: Option<&[LinearPixel]>) {
        let config = &self.config;
        let rule = UpdateRule {
            truncation: config.truncation(),
            weight_at_one_metre: config.reference_depth * config.reference_depth,
            weight_cap: config.weight_cap,
            conflict: 1.0 / config.truncation_voxels,
            conflict_at_one_metre: CONFLICT_STEPS * config.depth_step / config.truncation(),
        };
        let frame = &self.frame;
        self.colored_count += u64::from(color.is_some());
        let update = SlabUpdate {
            level: self.level,
            frame,
            projection,
            rule,
            colors: color.map(|color| ColorView {
                pixels: frame.color_view(color),
                reach: COLOR_REACH_VOXELS / config.truncation_voxels,
            }),
            color_turn: self.colored_count,
            color_stride: config.settled_color_stride.get().into(),
        };
        self.store
            .slabs_mut()
            .par_iter_mut()
            .filter(|slab| slab.touched != 0)
            .for_each(|slab| update.apply(slab));
    }
}

/// Refuses images that do not have one value per pixel.
fn check_size(depth: usize, color: Option<usize>, camera: &Intrinsics) -> Result<(), FusionError> {
    let (width, height) = (camera.width(), camera.height());
    let expected = width as usize * height as usize;
    if depth != expected {
        return Err(FusionError::DepthSize {
            width,
            height,
            expected,
            got: depth,
        });
    }
    match color {
        Some(got) if got != expected => Err(FusionError::ColorSize {
            width,
            height,
            expected,
            got,
        }),
        _ => Ok(()),
    }
}

/// One frame, as the blocks of a slab take it.
struct SlabUpdate<'a> {
    level: Level,
    frame: &'a FrameDepth,
    projection: &'a Projection,
    rule: UpdateRule,
    colors: Option<ColorView<'a>>,
    /// Number of this coloured frame.
    color_turn: u64,
    /// See [`VolumeConfig::settled_color_stride`].
    color_stride: u64,
}

impl SlabUpdate<'_> {
    /// Updates the touched blocks and takes their marks off.
    fn apply(&self, slab: &mut Slab) {
        let mut conflicts = Conflicts::NONE;
        let mut left = std::mem::take(&mut slab.touched);
        while left != 0 {
            let place = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut view = self.projection.block_view(unpack(slab.keys[place]));
            let Some(bounds) = self.frame.bounds(&view) else {
                continue;
            };
            view.farthest = bounds.farthest + self.rule.truncation;
            view.nearest = bounds.nearest - self.rule.truncation;
            view.is_inside = bounds.is_inside;
            let (before, after) = slab.blocks.split_at_mut(place + 1);
            let next = left.trailing_zeros() as usize;
            let color_count = &mut slab.color_counts[place];
            let colors = self
                .colors
                .filter(|_| self.takes_color(place, *color_count));
            let color = colors.zip(slab.colors.get_mut(place));
            *color_count = color_count.saturating_add(u8::from(color.is_some()));
            slab.behind[place] |= integrate_block(
                self.level,
                &mut before[place],
                color.map(|(colors, color)| (color, colors)),
                after.get(next.wrapping_sub(place + 1)),
                self.frame.view(),
                &view,
                &self.rule,
                &mut conflicts,
            );
        }
    }

    /// Whether a block that took `color_count` colours takes one of this frame. Settled blocks take turns by their
    /// place in the slab, so that no frame is dearer than the next.
    fn takes_color(&self, place: usize, color_count: u8) -> bool {
        color_count < SETTLED_COLORS
            || (self.color_turn + place as u64).is_multiple_of(self.color_stride)
    }
}
