//! Settings of a volume.

use std::num::NonZeroU32;

use geometry::DVec3;

use crate::error::FusionError;

/// Least truncation in voxels: below √3 a surface has holes, below 4 a noisy one does (hard-cases D06).
pub const MIN_TRUNCATION_VOXELS: f32 = 4.0;
/// Most truncation in voxels: each ray is sampled along its band, and the band holds the blocks.
const MAX_TRUNCATION_VOXELS: f32 = 64.0;
/// Largest depth that can be asked for, metres: far beyond any depth camera, and block coordinates and
/// weights stay far from the limits of their numbers.
const MAX_DEPTH: f32 = 1000.0;
/// Reference depths that leave weights far from underflow and overflow, metres.
const REFERENCE_DEPTHS: std::ops::RangeInclusive<f32> = 1e-3..=1e3;
/// Caps beyond this stop a running average in f32: steps of 1/cap round away (hard-cases D01, D05).
const MAX_WEIGHT_CAP: f32 = 1e6;

/// Colours after which that of a block is settled: as many as half a second holds, so that a surface has been looked
/// at while the camera moved on.
pub const SETTLED_COLORS: u8 = 16;

/// Settings of a [`super::Volume`].
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeConfig {
    /// Voxel edge, metres.
    pub voxel_size: f32,
    /// Truncation distance in voxels, at least [`MIN_TRUNCATION_VOXELS`]. Distance is measured along the view:
    /// at a slant of θ the band is cos θ as deep, and 6 voxels keep a surface whole up to 60°. A thing thinner than twice the
    /// truncation is kept by the two-sided rule of the update (D07), not by distance.
    pub truncation_voxels: f32,
    /// Largest weight of a voxel, at most 1e6. Later frames keep a share of `1 / weight_cap`.
    pub weight_cap: f32,
    /// Depth at which one observation weighs 1, metres; weight = (`reference_depth` / z)², because the
    /// depth step of a triangulating sensor grows with z², so its inverse variance falls with z⁴ and half
    /// of that is spent on systematic errors that repeat from frame to frame. 1 mm to 1 km.
    pub reference_depth: f32,
    /// Resolution of the sensor at 1 m, metres; it grows with z². Differences below two such steps are noise
    /// and never a second surface (D07). The default is that of a sensor with 75 mm baseline and 1/8 pixel
    /// of disparity; 0 for exact depth.
    pub depth_step: f32,
    /// Of so many coloured frames a block takes the colour of one, once it has taken [`SETTLED_COLORS`]: its average
    /// then moves little, and a colour costs as much as a distance. 1 = of every frame.
    pub settled_color_stride: NonZeroU32,
    /// Nearest depth that is used, metres.
    pub min_depth: f32,
    /// Farthest depth that is used, metres, at most 1000.
    pub max_depth: f32,
    /// Most bytes that the volume holds: blocks (4 KiB each for 8³ voxels, 8 KiB with colour), tables and the
    /// buffers of a frame. Requests for blocks beyond it are refused and counted (D17).
    pub memory_limit_bytes: usize,
    /// World position of voxel (0, 0, 0), metres. Near the scene: mesh positions are f32 relative to it.
    pub origin: DVec3,
}

impl Default for VolumeConfig {
    fn default() -> Self {
        Self {
            voxel_size: 0.004,
            truncation_voxels: 6.0,
            weight_cap: 128.0,
            reference_depth: 1.0,
            depth_step: 0.0029,
            settled_color_stride: NonZeroU32::MIN,
            min_depth: 0.3,
            max_depth: 4.0,
            memory_limit_bytes: 2 << 30,
            origin: DVec3::ZERO,
        }
    }
}

impl VolumeConfig {
    /// Truncation distance, metres.
    pub fn truncation(&self) -> f32 {
        self.voxel_size * self.truncation_voxels
    }

    /// Whether a part `thickness` metres thick is thinner than twice the truncation: its two sides then
    /// share voxels, and the two-sided rule decides which observation stands (D06, D07).
    pub fn sides_interact(&self, thickness: f32) -> bool {
        2.0 * self.truncation() > thickness
    }

    /// Whether a volume can have these settings.
    ///
    /// # Errors
    /// The first that cannot be.
    pub fn check(&self) -> Result<(), FusionError> {
        let Self {
            voxel_size,
            truncation_voxels,
            weight_cap,
            reference_depth,
            depth_step,
            min_depth,
            max_depth,
            ..
        } = *self;
        if !(2e-4..=1.0).contains(&voxel_size) {
            return Err(FusionError::VoxelSize { voxel_size });
        }
        if !(MIN_TRUNCATION_VOXELS..=MAX_TRUNCATION_VOXELS).contains(&truncation_voxels) {
            return Err(FusionError::Truncation { truncation_voxels });
        }
        let cap_is_usable = weight_cap > 0.0 && weight_cap <= MAX_WEIGHT_CAP;
        if !(cap_is_usable && REFERENCE_DEPTHS.contains(&reference_depth)) {
            return Err(FusionError::Weight {
                weight_cap,
                reference_depth,
            });
        }
        if !(0.0..=1.0).contains(&depth_step) {
            return Err(FusionError::DepthStep { depth_step });
        }
        if !(min_depth >= 0.0 && max_depth > min_depth && max_depth <= MAX_DEPTH) {
            return Err(FusionError::DepthGate {
                min_depth,
                max_depth,
            });
        }
        if !self.origin.is_finite() {
            return Err(FusionError::Origin);
        }
        Ok(())
    }
}
