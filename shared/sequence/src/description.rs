//! The description record: JSON (`docs/sequence-format.md` section 6.1).

use geometry::{DQuat, DVec3, Distortion, Intrinsics, Pose, PoseError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};

use crate::cameras::{
    ColorCamera, DepthCamera, Device, ResponseCurve, ShiftConstants, StreamTiming, Streams,
    TickClock, VignettingCurve, YuvMeaning,
};
use crate::checksum::FileId;
use crate::error::SequenceError;
use crate::layout::MOST_STREAMS;

/// Id of the depth stream in files that glint writes.
pub const DEPTH_STREAM: u16 = 1;
/// Id of the colour stream in files that glint writes.
pub const COLOR_STREAM: u16 = 2;

/// What a recording is made of, as it stands in every chunk.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Program and version, words.
    pub writer: String,
    /// When it was begun.
    pub created: Created,
    /// Which file of a recording that was split.
    pub part: Option<Part>,
    /// The streams.
    pub streams: Streams,
    /// Id of the depth stream.
    pub depth_id: u16,
    /// Id of the colour stream.
    pub color_id: u16,
}

/// Two clocks at one moment: a label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Created {
    /// Wall clock, nanoseconds since 1970 (UTC).
    pub unix_nanos: i64,
    /// Monotonic clock of the host, nanoseconds.
    pub host_nanos: i64,
}

/// A later file of a recording that was split by size or time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// 2 for the second file.
    pub number: u32,
    /// Id of the first file.
    pub first_file_id: FileId,
}

impl Description {
    /// The JSON of this description.
    pub fn to_json(&self) -> Result<Vec<u8>, SequenceError> {
        Ok(serde_json::to_vec(&DescriptionText::of(self))?)
    }

    /// Reads and checks JSON. Unknown keys and streams of unknown kinds are skipped.
    pub fn from_json(json: &[u8]) -> Result<Self, SequenceError> {
        serde_json::from_slice::<DescriptionText>(json)?.check()
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct DescriptionText {
    writer: String,
    created: CreatedText,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    part: Option<PartText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    device: Option<Device>,
    streams: Vec<StreamText>,
    color_from_depth: TransformText,
}

/// Integers beyond 2^53 are strings in JSON.
#[derive(Debug, Serialize, Deserialize)]
struct CreatedText {
    unix_nanos: String,
    host_nanos: String,
}

#[derive(Debug, Serialize, Deserialize)]
struct PartText {
    number: u32,
    first_file_id: String,
}

#[derive(Debug, Serialize, Deserialize)]
struct StreamText {
    id: u16,
    kind: String,
    format: String,
    width: u32,
    height: u32,
    #[serde(default)]
    rate_hz: Option<f64>,
    #[serde(default)]
    clock: Option<TickClock>,
    camera: CameraText,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    depth: Option<DepthText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    color: Option<ColorText>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct CameraText {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// k1, k2, p1, p2, k3.
    distortion: [f64; 5],
}

#[derive(Debug, Serialize, Deserialize)]
struct DepthText {
    scale_m: f64,
    range_m: [f32; 2],
    #[serde(default)]
    shift: Option<ShiftConstants>,
    #[serde(default)]
    registered_to: Option<u16>,
}

#[derive(Debug, Serialize, Deserialize)]
struct ColorText {
    relative_exposure: f32,
    #[serde(deserialize_with = "known_response")]
    response: ResponseCurve,
    #[serde(deserialize_with = "known_vignetting")]
    vignetting: VignettingCurve,
    #[serde(default)]
    yuv: Option<YuvMeaning>,
}

#[derive(Debug, Serialize, Deserialize)]
struct TransformText {
    /// Unit quaternion x, y, z, w.
    rotation: [f64; 4],
    /// Metres.
    translation: [f64; 3],
}

impl DescriptionText {
    fn of(description: &Description) -> Self {
        let Streams {
            depth,
            color,
            color_from_depth,
            depth_timing,
            color_timing,
            device,
        } = &description.streams;
        let depth_stream = StreamText {
            depth: Some(DepthText {
                scale_m: depth.depth_scale,
                range_m: [*depth.depth_range.start(), *depth.depth_range.end()],
                shift: depth.shift.clone(),
                registered_to: depth.is_registered.then_some(description.color_id),
            }),
            ..StreamText::of(
                description.depth_id,
                "depth",
                word(&depth.samples),
                &depth.intrinsics,
                *depth_timing,
            )
        };
        let color_stream = StreamText {
            color: Some(ColorText {
                relative_exposure: color.relative_exposure,
                response: color.response_curve().clone(),
                vignetting: color.vignetting_curve().clone(),
                yuv: color.yuv.clone(),
            }),
            ..StreamText::of(
                description.color_id,
                "color",
                word(&color.encoding),
                &color.intrinsics,
                *color_timing,
            )
        };
        Self {
            writer: description.writer.clone(),
            created: CreatedText {
                unix_nanos: description.created.unix_nanos.to_string(),
                host_nanos: description.created.host_nanos.to_string(),
            },
            part: description.part.map(|part| PartText {
                number: part.number,
                first_file_id: hex(part.first_file_id),
            }),
            device: device.clone(),
            streams: vec![depth_stream, color_stream],
            color_from_depth: TransformText {
                rotation: color_from_depth.rotation().to_array(),
                translation: color_from_depth.translation().to_array(),
            },
        }
    }

    fn check(&self) -> Result<Description, SequenceError> {
        let depth_stream = self.stream("depth")?;
        let color_stream = self.stream("color")?;
        let (Some(depth), Some(color)) = (&depth_stream.depth, &color_stream.color) else {
            return Err(SequenceError::NoStream {
                kind: "described depth and color",
            });
        };
        let [near, far] = depth.range_m;
        let depth_camera = DepthCamera {
            samples: parse(&depth_stream.format)?,
            shift: depth.shift.clone(),
            is_registered: depth.registered_to == Some(color_stream.id),
            ..DepthCamera::new(depth_stream.intrinsics("depth")?, depth.scale_m, near..=far)?
        };
        let mut color_camera = ColorCamera::new(
            color_stream.intrinsics("color")?,
            parse(&color_stream.format)?,
            color.relative_exposure,
            color.response.clone(),
            color.vignetting.clone(),
        )?;
        color_camera.yuv = color.yuv.clone();
        let TransformText {
            rotation,
            translation,
        } = self.color_from_depth;
        let color_from_depth =
            pose_from_numbers(rotation, translation).map_err(|source| SequenceError::Pose {
                set: "color_from_depth".to_owned(),
                number: 0,
                source,
            })?;
        Ok(Description {
            writer: self.writer.clone(),
            created: Created {
                unix_nanos: self.created.unix_nanos.parse().unwrap_or_default(),
                host_nanos: self.created.host_nanos.parse().unwrap_or_default(),
            },
            part: self.part.as_ref().and_then(PartText::part),
            streams: Streams {
                depth: depth_camera,
                color: color_camera,
                color_from_depth,
                depth_timing: depth_stream.timing()?,
                color_timing: color_stream.timing()?,
                device: self.device.clone(),
            },
            depth_id: depth_stream.id,
            color_id: color_stream.id,
        })
    }

    /// The first stream of a kind.
    fn stream(&self, kind: &'static str) -> Result<&StreamText, SequenceError> {
        self.streams
            .iter()
            .find(|stream| stream.kind == kind && (1..=MOST_STREAMS).contains(&stream.id))
            .ok_or(SequenceError::NoStream { kind })
    }
}

impl StreamText {
    fn of(
        id: u16,
        kind: &str,
        format: String,
        intrinsics: &Intrinsics,
        timing: StreamTiming,
    ) -> Self {
        let (focal, center) = (intrinsics.focal(), intrinsics.center());
        let Distortion { k1, k2, p1, p2, k3 } = intrinsics.distortion();
        Self {
            id,
            kind: kind.to_owned(),
            format,
            width: intrinsics.width(),
            height: intrinsics.height(),
            rate_hz: timing.rate_hz,
            clock: timing.clock,
            camera: CameraText {
                fx: focal.x,
                fy: focal.y,
                cx: center.x,
                cy: center.y,
                distortion: [k1, k2, p1, p2, k3],
            },
            depth: None,
            color: None,
        }
    }

    fn intrinsics(&self, stream: &'static str) -> Result<Intrinsics, SequenceError> {
        let CameraText {
            fx,
            fy,
            cx,
            cy,
            distortion: [k1, k2, p1, p2, k3],
        } = self.camera;
        let distortion = Distortion { k1, k2, p1, p2, k3 };
        Intrinsics::new(self.width, self.height, fx, fy, cx, cy, distortion)
            .map_err(|source| SequenceError::Camera { stream, source })
    }

    fn timing(&self) -> Result<StreamTiming, SequenceError> {
        let timing = StreamTiming {
            rate_hz: self.rate_hz,
            clock: self.clock,
        };
        timing.check()?;
        Ok(timing)
    }
}

impl PartText {
    fn part(&self) -> Option<Part> {
        let mut id = [0; 16];
        if self.first_file_id.len() != 32 || !self.first_file_id.is_ascii() {
            return None;
        }
        for (position, byte) in id.iter_mut().enumerate() {
            let digits = self.first_file_id.get(2 * position..2 * position + 2)?;
            *byte = u8::from_str_radix(digits, 16).ok()?;
        }
        Some(Part {
            number: self.number,
            first_file_id: FileId(id),
        })
    }
}

fn known_response<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ResponseCurve, D::Error> {
    known_keys(deserializer, &["type", "gamma", "red", "green", "blue"])
}

fn known_vignetting<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<VignettingCurve, D::Error> {
    known_keys(deserializer, &["type", "center", "radius", "a"])
}

/// A curve without the keys of later versions: rig files are strict, recordings are not.
fn known_keys<'de, D: Deserializer<'de>, T: DeserializeOwned>(
    deserializer: D,
    known: &[&str],
) -> Result<T, D::Error> {
    let mut object = serde_json::Map::deserialize(deserializer)?;
    object.retain(|key, _| known.contains(&key.as_str()));
    serde_json::from_value(object.into()).map_err(serde::de::Error::custom)
}

/// The 32 digits of an id.
pub(crate) fn hex(id: FileId) -> String {
    id.0.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The word that serde writes for a choice.
fn word(choice: &impl Serialize) -> String {
    match serde_json::to_value(choice) {
        Ok(serde_json::Value::String(word)) => word,
        // No choice of ours is written as anything but a word.
        _ => String::new(),
    }
}

fn parse<T: for<'a> Deserialize<'a>>(word: &str) -> Result<T, SequenceError> {
    Ok(serde_json::from_value(serde_json::Value::from(word))?)
}

/// A pose of a stored unit quaternion (x, y, z, w) and a translation in metres.
pub(crate) fn pose_from_numbers(
    rotation: [f64; 4],
    translation: [f64; 3],
) -> Result<Pose, PoseError> {
    Pose::new(DQuat::from_array(rotation), DVec3::from_array(translation))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn keys_of_later_versions_are_ignored() {
        let text = json!({
            "relative_exposure": 1.0,
            "response": {"type": "gamma", "gamma": 2.2, "later": 1},
            "vignetting": {"type": "none", "later": [1, 2]},
            "later": {},
        });
        let color: ColorText = serde_json::from_value(text).unwrap();
        assert_eq!(color.response, ResponseCurve::Gamma { gamma: 2.2 });
        assert_eq!(color.vignetting, VignettingCurve::None);
    }
}
