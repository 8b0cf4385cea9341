//! Settings of live tracking and fusion.

use std::num::NonZeroU32;

use geometry::{Intrinsics, Pose};

use crate::tracking::{DepthNoise, Gates, IcpConfig, KeyframeConfig};
use crate::volume::VolumeConfig;

/// At 30 frames a second a surface is seen a hundred times before it leaves the image: every second photograph is
/// fused …
const COLOR_STRIDE: NonZeroU32 = NonZeroU32::new(2).unwrap();
/// … and every second of those where there is colour already.
const SETTLED_COLOR_STRIDE: NonZeroU32 = NonZeroU32::new(2).unwrap();

/// The cameras.
#[derive(Clone, Copy, Debug)]
pub struct LiveRig {
    /// Pinhole of the depth images.
    pub depth_camera: Intrinsics,
    /// Camera of the photographs, where there is one.
    pub color_camera: Option<Intrinsics>,
    /// Colour camera from depth camera.
    pub color_from_depth: Pose,
}

/// Settings.
#[derive(Clone, Debug)]
pub struct LiveConfig {
    /// The volume of each map.
    pub volume: VolumeConfig,
    /// Blocks whose memory the first map takes ahead ([`crate::Volume::reserve`]).
    pub reserved_blocks: usize,
    /// Of so many photographs of fused frames one is fused.
    pub color_stride: NonZeroU32,
    /// Alignment.
    pub icp: IcpConfig,
    /// Noise of depth.
    pub noise: DepthNoise,
    /// Sizes below the full image.
    pub level_count: usize,
    /// Size at which the model is predicted: 0 = half, 1 = quarter, 2 = eighth, 3 = sixteenth of the full image. An
    /// eighth tracks as well as a quarter (RedKitchen 21.9 against 22.0 mm, tum-fr1-rpy 16.3 and 15.8, mitsuba-dev 0.59
    /// and 0.53) in three fifths of the time: a surfel stands for its plane.
    pub view_level: usize,
    /// When a frame that follows another is believed.
    pub gates: Gates,
    /// When a recognised place is believed.
    pub relocalising: Gates,
    /// When frames are kept to find the way back.
    pub keyframes: KeyframeConfig,
    /// Frames in a row that must agree before a recognised place counts.
    pub probation: u32,
    /// Keyframes that are tried for a lost frame.
    pub candidates: usize,
    /// Lost frames with enough depth after which a new map begins.
    pub new_map_after: u32,
}

impl Default for LiveConfig {
    fn default() -> Self {
        Self {
            volume: VolumeConfig {
                settled_color_stride: SETTLED_COLOR_STRIDE,
                ..VolumeConfig::default()
            },
            reserved_blocks: 0,
            color_stride: COLOR_STRIDE,
            icp: IcpConfig::default(),
            noise: DepthNoise::default(),
            level_count: 4,
            view_level: 2,
            gates: Gates::TRACKING,
            relocalising: Gates::RELOCALISING,
            keyframes: KeyframeConfig::default(),
            probation: 2,
            candidates: 3,
            new_map_after: 90,
        }
    }
}

/// What gives way when time is short, first to last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// The model is predicted at half the usual width and height.
    pub coarse_view: bool,
    /// The finest pass of the alignment is left out.
    pub skip_finest: bool,
    /// Colour is not fused.
    pub skip_color: bool,
}
