//! A rig file from a recording's cameras: what an export writes and an import reads.

use geometry::{Distortion, Intrinsics};
use sequence::Streams;

use super::rig::{
    ColorFileFormat, ColorRig, DepthFormat, DepthRig, ExposureRig, PoseCamera, PoseStamps, Rig,
    ShutterSync,
};
use super::transform::RigTransform;

impl Rig {
    /// The rig of a recording.
    ///
    /// `frame_rate` in frames a second is for layouts without times.
    pub fn of(
        streams: &Streams,
        poses: PoseCamera,
        pose_stamps: PoseStamps,
        frame_rate: Option<f64>,
    ) -> Self {
        let (depth, color) = (&streams.depth, &streams.color);
        let (depth_lens, color_lens) = (Lens::of(&depth.intrinsics), Lens::of(&color.intrinsics));
        Self {
            frame_rate,
            sync: ShutterSync::Unknown,
            poses,
            pose_stamps,
            color: ColorRig {
                width: color_lens.width,
                height: color_lens.height,
                format: ColorFileFormat::of(color.encoding),
                fx: color_lens.focal[0],
                fy: color_lens.focal[1],
                cx: color_lens.center[0],
                cy: color_lens.center[1],
                distortion: color_lens.distortion,
                white_level: None,
                yuv: color.yuv.clone(),
                response: Some(color.response_curve().clone()),
                vignetting: Some(color.vignetting_curve().clone()),
                exposure: Some(ExposureRig {
                    // A recording says what the exposure was, not that it was locked.
                    fixed: false,
                    relative: f64::from(color.relative_exposure),
                }),
                noise: None,
            },
            depth: DepthRig {
                width: depth_lens.width,
                height: depth_lens.height,
                format: DepthFormat::Png16,
                registered: depth.is_registered,
                scale: depth.depth_scale,
                range: Some([*depth.depth_range.start(), *depth.depth_range.end()]),
                fx: depth_lens.focal[0],
                fy: depth_lens.focal[1],
                cx: depth_lens.center[0],
                cy: depth_lens.center[1],
                distortion: depth_lens.distortion,
                color_from_depth: Some(RigTransform::of(&streams.color_from_depth)),
                depth_from_color: None,
                sensor: None,
            },
        }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// None that a rig of a recording meets: TOML holds all its values.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

/// A pinhole camera as a rig file writes it.
struct Lens {
    width: u32,
    height: u32,
    focal: [f64; 2],
    center: [f64; 2],
    distortion: Vec<f64>,
}

impl Lens {
    fn of(intrinsics: &Intrinsics) -> Self {
        let Distortion { k1, k2, p1, p2, k3 } = intrinsics.distortion();
        let all = [k1, k2, p1, p2, k3];
        Self {
            width: intrinsics.width(),
            height: intrinsics.height(),
            focal: intrinsics.focal().to_array(),
            center: intrinsics.center().to_array(),
            distortion: if all == [0.0; 5] {
                Vec::new()
            } else {
                all.to_vec()
            },
        }
    }
}
