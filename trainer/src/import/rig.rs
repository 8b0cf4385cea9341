//! The rig file: what the cameras are, in TOML. Unknown keys are errors that list the known ones.

use std::path::Path;

use geometry::Pose;
use sequence::{
    ColorCamera, ColorEncoding, DepthCamera, ResponseCurve, StreamTiming, Streams, VignettingCurve,
    YuvMeaning,
};
use serde::{Deserialize, Serialize};

use super::error::{ImportError, read_text};
use super::judge::{Judge, RawCamera};
use super::transform::RigTransform;

/// A rig file as it is written. Pixel (0, 0) is the centre of the first pixel; metres, seconds.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// Frames a second; used where the folder has no times.
    pub frame_rate: Option<f64>,
    /// Whether the shutters of both cameras are tied together.
    #[serde(default)]
    pub sync: ShutterSync,
    /// The camera that the poses belong to.
    #[serde(default)]
    pub poses: PoseCamera,
    /// What the times of the poses are, where the poses have times of their own (TUM).
    #[serde(default)]
    pub pose_stamps: PoseStamps,
    /// The colour camera.
    pub color: ColorRig,
    /// The depth camera.
    pub depth: DepthRig,
}

/// How the shutters are tied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShutterSync {
    /// At the same instant.
    Hardware,
    /// Each by its own clock.
    None,
    /// Not known.
    #[default]
    Unknown,
}

/// A camera of the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseCamera {
    /// The depth camera.
    #[default]
    Depth,
    /// The colour camera.
    Color,
}

/// What the times in a list of poses are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseStamps {
    /// Those of the device that measured the poses: a frame gets a pose between two of them.
    #[default]
    Own,
    /// Those of the frames that the poses belong to: a frame without its stamp has no pose.
    Frames,
}

/// The colour camera.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorRig {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) format: ColorFileFormat,
    pub(super) fx: f64,
    pub(super) fy: f64,
    pub(super) cx: f64,
    pub(super) cy: f64,
    /// Empty, or k1, k2, p1, p2, k3 of Brown and Conrady.
    #[serde(default)]
    pub(super) distortion: Vec<f64>,
    /// The code of linear 1.0; only 255.
    pub(super) white_level: Option<f64>,
    /// What YUV samples mean, where it is known.
    pub(super) yuv: Option<YuvMeaning>,
    pub(super) response: Option<ResponseCurve>,
    pub(super) vignetting: Option<VignettingCurve>,
    pub(super) exposure: Option<ExposureRig>,
    pub(super) noise: Option<NoiseRig>,
}

/// What the colour images are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum ColorFileFormat {
    /// JPEG.
    Jpeg,
    /// PNG of 8 bits a channel.
    Png,
    /// The raw mosaic, even rows G R G R …, odd rows B G B G …, as PNG of 8 bits grey.
    BayerGrbg,
    /// Raw YUV 4:2:2, U Y V Y, rows without padding and nothing else, in files called `.yuv`.
    Uyvy,
    /// The same as Y U Y V.
    Yuyv,
    /// No colour: infrared as the depth camera sees it, 0 to 1023 as PNG of 16 bits grey.
    Infrared10,
}

impl ColorFileFormat {
    /// How a recording keeps them.
    pub(super) fn encoding(self) -> ColorEncoding {
        match self {
            Self::Jpeg => ColorEncoding::Jpeg,
            Self::Png => ColorEncoding::Rgb8,
            Self::BayerGrbg => ColorEncoding::BayerGrbg,
            Self::Uyvy => ColorEncoding::Uyvy,
            Self::Yuyv => ColorEncoding::Yuyv,
            Self::Infrared10 => ColorEncoding::Infrared10,
        }
    }

    /// The files that a recording's colour makes.
    pub(super) fn of(encoding: ColorEncoding) -> Self {
        match encoding {
            ColorEncoding::Jpeg => Self::Jpeg,
            ColorEncoding::Rgb8 => Self::Png,
            ColorEncoding::BayerGrbg => Self::BayerGrbg,
            ColorEncoding::Uyvy => Self::Uyvy,
            ColorEncoding::Yuyv => Self::Yuyv,
            ColorEncoding::Infrared10 => Self::Infrared10,
        }
    }
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ExposureRig {
    pub(super) fixed: bool,
    pub(super) relative: f64,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoiseRig {
    full_well: f64,
    read: f64,
}

/// The depth camera.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthRig {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) format: DepthFormat,
    /// Depth pixels are colour pixels: whoever made the images has registered them.
    #[serde(default)]
    pub(super) registered: bool,
    /// Metres a unit.
    pub(super) scale: f64,
    /// Nearest and farthest depth, metres.
    pub(super) range: Option<[f32; 2]>,
    pub(super) fx: f64,
    pub(super) fy: f64,
    pub(super) cx: f64,
    pub(super) cy: f64,
    #[serde(default)]
    pub(super) distortion: Vec<f64>,
    pub(super) color_from_depth: Option<RigTransform>,
    pub(super) depth_from_color: Option<RigTransform>,
    pub(super) sensor: Option<DepthSensorRig>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum DepthFormat {
    Png16,
}

/// How the measurement was made.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DepthSensorRig {
    disparity_focal: Option<f64>,
    baseline: Option<f64>,
    disparity_step: Option<f64>,
    disparity_noise: Option<f64>,
    min_depth: Option<f64>,
    max_depth: Option<f64>,
}

/// Depths accepted where the rig file names none, metres: a PrimeSense-like sensor at its widest.
const DEFAULT_DEPTH_RANGE: [f32; 2] = [0.2, 10.0];

impl Rig {
    /// Reads a rig file. The numbers are judged by [`Rig::streams`].
    pub fn read(path: &Path) -> Result<Self, ImportError> {
        let text = read_text(path)?;
        toml::from_str(&text).map_err(|error| ImportError::Text {
            path: path.to_path_buf(),
            line: error
                .span()
                .and_then(|span| text.get(..span.start))
                .map(|before| 1 + before.matches('\n').count()),
            message: error.message().replace('\n', " "),
        })
    }

    /// The cameras for a recording, every number judged; `path` names the rig file in errors.
    pub fn streams(&self, path: &Path) -> Result<Streams, ImportError> {
        let judge = Judge { path };
        if let Some(rate) = self.frame_rate {
            judge.within("frame_rate", rate, 0.01..=1000.0, "frames a second")?;
        }
        self.check_sensors(&judge)?;
        let describe = |source| ImportError::Description {
            path: path.to_path_buf(),
            source,
        };
        let (color, depth) = (&self.color, &self.depth);
        let [near, far] = depth.range();
        let depth_camera = DepthCamera::new(
            judge.camera("depth", depth.intrinsics())?,
            depth.scale,
            near..=far,
        )
        .map_err(describe)?;
        let mut color_camera = ColorCamera::new(
            judge.camera("color", color.intrinsics())?,
            color.format.encoding(),
            color.exposure.map_or(1.0, |exposure| exposure.relative) as f32,
            color.response.clone().unwrap_or(ResponseCurve::Identity),
            color.vignetting.clone().unwrap_or(VignettingCurve::None),
        )
        .map_err(describe)?;
        color_camera.yuv = color.yuv_meaning(&judge)?;
        if let Some(format) = color_camera.encoding.lossless() {
            let size = format.frame_bytes(color.width, color.height);
            size.map_err(|error| describe(error.into()))?;
        }
        let streams = Streams {
            depth: DepthCamera {
                is_registered: depth.registered,
                ..depth_camera
            },
            color: color_camera,
            color_from_depth: self.color_from_depth(path)?,
            // Only a folder without times is known to have a rate: the importer sets it.
            depth_timing: StreamTiming::default(),
            color_timing: StreamTiming::default(),
            device: None,
        };
        let is_one_camera = streams.depth.intrinsics == streams.color.intrinsics
            && streams.color_from_depth == Pose::IDENTITY;
        if depth.registered && !is_one_camera {
            return Err(ImportError::RigRegistered {
                path: path.to_path_buf(),
            });
        }
        Ok(streams)
    }

    /// What the recording does not hold of this rig, and what it was not told, for the report.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.color.response.is_none() {
            notes.push("no response curve: codes are taken for linear".to_owned());
        }
        if self.color.vignetting.is_none() {
            notes.push("no vignetting: taken for none".to_owned());
        }
        if !self.color.exposure.is_some_and(|exposure| exposure.fixed) {
            notes.push("exposure not fixed: radiance may differ between frames".to_owned());
        }
        if self.sync == ShutterSync::None {
            notes.push("shutters not tied: colour and depth of a frame differ in time".to_owned());
        }
        if self.color.noise.is_some() || self.depth.sensor.is_some() {
            notes.push("noise model and depth sensor constants are not kept".to_owned());
        }
        notes
    }

    fn color_from_depth(&self, path: &Path) -> Result<Pose, ImportError> {
        match (&self.depth.color_from_depth, &self.depth.depth_from_color) {
            (Some(color_from_depth), None) => color_from_depth.pose(path),
            (None, Some(depth_from_color)) => Ok(depth_from_color.pose(path)?.inverse()),
            _ => Err(ImportError::RigExtrinsic {
                path: path.to_path_buf(),
            }),
        }
    }

    fn check_sensors(&self, judge: &Judge) -> Result<(), ImportError> {
        if let Some(level) = self.color.white_level {
            judge.within("color.white_level", level, 255.0..=255.0, "255")?;
        }
        if let Some(noise) = self.color.noise {
            judge.within(
                "color.noise.full_well",
                noise.full_well,
                1.0..=1e9,
                "1 to 1e9",
            )?;
            judge.within("color.noise.read", noise.read, 0.0..=1.0, "0 to 1")?;
        }
        let Some(sensor) = self.depth.sensor else {
            return Ok(());
        };
        let positive = [
            ("depth.sensor.disparity_focal", sensor.disparity_focal),
            ("depth.sensor.baseline", sensor.baseline),
            ("depth.sensor.disparity_step", sensor.disparity_step),
            ("depth.sensor.disparity_noise", sensor.disparity_noise),
            ("depth.sensor.min_depth", sensor.min_depth),
            ("depth.sensor.max_depth", sensor.max_depth),
        ];
        for (key, value) in positive {
            if let Some(value) = value {
                judge.within(key, value, 0.0..=1e6, "0 to 1e6")?;
            }
        }
        Ok(())
    }
}

impl ColorRig {
    fn intrinsics(&self) -> RawCamera<'_> {
        let Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            ..
        } = *self;
        RawCamera {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion: &self.distortion,
        }
    }

    /// What YUV samples mean; refuses words that a recording does not have, and samples that are no YUV.
    fn yuv_meaning(&self, judge: &Judge) -> Result<Option<YuvMeaning>, ImportError> {
        let Some(yuv) = &self.yuv else {
            return Ok(None);
        };
        let is_yuv = matches!(self.format, ColorFileFormat::Uyvy | ColorFileFormat::Yuyv);
        let known = [
            (&yuv.matrix, ["bt601", "bt709"]),
            (&yuv.range, ["full", "limited"]),
            (&yuv.siting, ["left", "center"]),
        ];
        if is_yuv
            && known
                .iter()
                .all(|(word, words)| words.contains(&word.as_str()))
        {
            return Ok(Some(yuv.clone()));
        }
        Err(ImportError::RigYuv {
            path: judge.path.to_path_buf(),
        })
    }
}

impl DepthRig {
    fn intrinsics(&self) -> RawCamera<'_> {
        let Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            ..
        } = *self;
        RawCamera {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion: &self.distortion,
        }
    }

    fn range(&self) -> [f32; 2] {
        let [near, far] = DEFAULT_DEPTH_RANGE;
        let of_sensor = |choose: fn(&DepthSensorRig) -> Option<f64>, otherwise: f32| {
            self.sensor
                .as_ref()
                .and_then(choose)
                .map_or(otherwise, |depth| depth as f32)
        };
        self.range.unwrap_or_else(|| {
            [
                of_sensor(|sensor| sensor.min_depth, near),
                of_sensor(|sensor| sensor.max_depth, far),
            ]
        })
    }
}
