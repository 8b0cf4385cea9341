//! The description of a recording as JSON.

use geometry::{DQuat, DVec3, Distortion, Intrinsics, Pose, PoseError};
use serde::{Deserialize, Serialize};

use crate::cameras::{
    ColorCamera, ColorCodec, DepthCamera, ResponseCurve, Streams, VignettingCurve,
};
use crate::error::SequenceError;
use crate::split::Split;

/// What the description section holds.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Description {
    depth: DepthText,
    color: ColorText,
    color_from_depth: TransformText,
    /// Names of the pose tables, in their order.
    pub(crate) pose_sets: Vec<String>,
    /// The split.
    pub(crate) split: Split,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraText {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// k1, k2, p1, p2, k3.
    distortion: [f64; 5],
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthText {
    codec: DepthCodec,
    camera: CameraText,
    scale_m: f64,
    range_m: [f32; 2],
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum DepthCodec {
    Png16,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ColorText {
    codec: ColorCodec,
    camera: CameraText,
    relative_exposure: f32,
    response: ResponseCurve,
    vignetting: VignettingCurve,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransformText {
    /// Unit quaternion x, y, z, w.
    rotation: [f64; 4],
    /// Metres.
    translation: [f64; 3],
}

impl Description {
    pub(crate) fn new(streams: &Streams, pose_sets: Vec<String>, split: Split) -> Self {
        let Streams {
            depth,
            color,
            color_from_depth,
        } = streams;
        Self {
            depth: DepthText {
                codec: DepthCodec::Png16,
                camera: CameraText::from(&depth.intrinsics),
                scale_m: depth.depth_scale,
                range_m: [*depth.depth_range.start(), *depth.depth_range.end()],
            },
            color: ColorText {
                codec: color.codec,
                camera: CameraText::from(&color.intrinsics),
                relative_exposure: color.relative_exposure,
                response: color.response_curve().clone(),
                vignetting: color.vignetting_curve().clone(),
            },
            color_from_depth: TransformText {
                rotation: color_from_depth.rotation().to_array(),
                translation: color_from_depth.translation().to_array(),
            },
            pose_sets,
            split,
        }
    }

    pub(crate) fn from_json(bytes: &[u8]) -> Result<Self, SequenceError> {
        Ok(serde_json::from_slice(bytes)?)
    }

    pub(crate) fn to_json(&self) -> Result<Vec<u8>, SequenceError> {
        let mut bytes = serde_json::to_vec_pretty(self)?;
        bytes.push(b'\n');
        Ok(bytes)
    }

    /// The streams, every number checked.
    pub(crate) fn streams(&self) -> Result<Streams, SequenceError> {
        let [near, far] = self.depth.range_m;
        let depth = DepthCamera::new(
            self.depth.camera.intrinsics("depth")?,
            self.depth.scale_m,
            near..=far,
        )?;
        let color = ColorCamera::new(
            self.color.camera.intrinsics("color")?,
            self.color.codec,
            self.color.relative_exposure,
            self.color.response.clone(),
            self.color.vignetting.clone(),
        )?;
        let TransformText {
            rotation,
            translation,
        } = self.color_from_depth;
        let color_from_depth =
            pose_from_numbers(rotation, translation).map_err(|source| SequenceError::Pose {
                set: "color_from_depth".to_owned(),
                index: 0,
                source,
            })?;
        Ok(Streams {
            depth,
            color,
            color_from_depth,
        })
    }
}

/// A pose of a stored unit quaternion (x, y, z, w) and a translation in metres.
pub(crate) fn pose_from_numbers(
    rotation: [f64; 4],
    translation: [f64; 3],
) -> Result<Pose, PoseError> {
    Pose::new(DQuat::from_array(rotation), DVec3::from_array(translation))
}

impl CameraText {
    fn from(intrinsics: &Intrinsics) -> Self {
        let (focal, center) = (intrinsics.focal(), intrinsics.center());
        let Distortion { k1, k2, p1, p2, k3 } = intrinsics.distortion();
        Self {
            width: intrinsics.width(),
            height: intrinsics.height(),
            fx: focal.x,
            fy: focal.y,
            cx: center.x,
            cy: center.y,
            distortion: [k1, k2, p1, p2, k3],
        }
    }

    fn intrinsics(&self, stream: &'static str) -> Result<Intrinsics, SequenceError> {
        let [k1, k2, p1, p2, k3] = self.distortion;
        Intrinsics::new(
            self.width,
            self.height,
            self.fx,
            self.fy,
            self.cx,
            self.cy,
            Distortion { k1, k2, p1, p2, k3 },
        )
        .map_err(|source| SequenceError::Camera { stream, source })
    }
}
