//! What is written about held-out photographs, `composition` in `metrics.json`.

use imaging::{Mask, Rgb8Image};
use serde::{Deserialize, Serialize};

use super::angle::AngleMetrics;

/// Error of one way to predict photographs: 8-bit codes as [0, 1], over the mask (effects-and-tradeoffs.md C2).
/// A figure that has nothing to be taken from is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewError {
    /// Mean absolute difference over pixels and channels.
    pub l1: f64,
    /// 10 log₁₀(1/MSE), MSE pooled over frames, at most 100.
    pub psnr: f64,
    /// Structural similarity of luma, outside the mask filled with the photograph; mean over frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ssim: Option<f64>,
    /// LPIPS (AlexNet), outside the mask grey, cropped to the mask; mean over frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips: Option<f64>,
    /// Light above diffuse alone, predicted over photographed, pooled over frames: below 1 highlights are muted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub highlight_ratio: Option<f64>,
    /// Mean absolute difference over all pixels that see the surface, masked or not: elsewhere nothing is
    /// predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub l1_full: Option<f64>,
}

/// Figures over all held-out frames.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CompositionMetrics {
    /// Where the mask came from.
    pub mask: String,
    /// Masked pixels.
    pub pixel_count: usize,
    /// Held-out frames.
    pub frame_count: usize,
    /// Frames with an LPIPS: those whose masked crop is large enough for the network.
    #[serde(default)]
    pub lpips_frame_count: usize,
    /// D + gain · (V · SRM + (1 − V) · first bounce).
    pub composition: ViewError,
    /// The median texture alone.
    pub diffuse_only: ViewError,
    /// The nearest training photograph, reprojected through the mesh, holes filled by diffuse.
    pub nearest_view: ViewError,
    /// Share of masked pixels that the nearest photograph did not see.
    pub nearest_hole_fraction: f64,
    /// LPIPS against the angle to the nearest training view.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips_by_angle: Option<AngleMetrics>,
    /// One row a frame.
    pub frames: Vec<FrameError>,
}

/// One held-out frame. Figures of an empty mask are absent.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct FrameError {
    /// Index in the recording.
    pub frame: usize,
    /// Nearest training frame.
    pub nearest: usize,
    /// Angle at the object between the two cameras, degrees.
    pub angle_deg: f64,
    /// Masked L1 of the composition.
    pub l1: Option<f64>,
    /// Masked L1 of diffuse alone.
    pub l1_diffuse: Option<f64>,
    /// Masked L1 of the nearest view.
    pub l1_nearest: Option<f64>,
    /// SSIM of the composition.
    #[serde(default)]
    pub ssim: Option<f64>,
    /// SSIM of diffuse alone.
    #[serde(default)]
    pub ssim_diffuse: Option<f64>,
    /// SSIM of the nearest view.
    #[serde(default)]
    pub ssim_nearest: Option<f64>,
    /// LPIPS of the composition.
    #[serde(default)]
    pub lpips: Option<f64>,
    /// LPIPS of diffuse alone.
    #[serde(default)]
    pub lpips_diffuse: Option<f64>,
    /// LPIPS of the nearest view.
    #[serde(default)]
    pub lpips_nearest: Option<f64>,
}

/// Pictures of one held-out frame for the report.
pub struct Strip {
    /// Index in the recording.
    pub frame: usize,
    /// The photograph.
    pub photograph: Rgb8Image,
    /// The composition.
    pub composition: Rgb8Image,
    /// Diffuse alone.
    pub diffuse_only: Rgb8Image,
    /// The nearest view.
    pub nearest_view: Rgb8Image,
    /// The mask.
    pub mask: Mask,
}
