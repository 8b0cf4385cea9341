//! The two streams of a recording: cameras, calibration, extrinsic.

use std::ops::RangeInclusive;

use geometry::{DVec2, Intrinsics, Pose};
use imaging::{
    ChromaSiting, ColorLayout, ImagingError, Response, Vignetting, YuvCoding, YuvMatrix, YuvRange,
};
use serde::{Deserialize, Serialize};

use crate::codecs::ColorFormat;
use crate::error::SequenceError;

/// What is known of the streams before the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Streams {
    /// The depth stream.
    pub depth: DepthCamera,
    /// The colour stream.
    pub color: ColorCamera,
    /// The colour camera seen from the depth camera: metres, rigid.
    pub color_from_depth: Pose,
    /// Rate and clock of the depth stream.
    pub depth_timing: StreamTiming,
    /// Rate and clock of the colour stream.
    pub color_timing: StreamTiming,
    /// The camera, where it is known.
    pub device: Option<Device>,
}

/// How often frames come and what counts their time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamTiming {
    /// Nominal frames a second, where the source promises a rate.
    pub rate_hz: Option<f64>,
    /// The raw device counter, where there is one.
    pub clock: Option<TickClock>,
}

impl StreamTiming {
    /// A promised rate, frames a second, without a counter.
    pub fn at_rate(rate_hz: f64) -> Self {
        Self {
            rate_hz: Some(rate_hz),
            clock: None,
        }
    }

    pub(crate) fn check(&self) -> Result<(), SequenceError> {
        if let Some(rate_hz) = self.rate_hz
            && !(rate_hz > 0.0 && rate_hz <= 1e5)
        {
            return Err(SequenceError::Value {
                name: "the rate of a stream",
                value: rate_hz,
                expected: "above 0 and at most 100000 frames a second",
            });
        }
        match self.clock {
            Some(TickClock { tick_hz, bits }) if tick_hz == 0 || !(8..=64).contains(&bits) => {
                Err(SequenceError::Value {
                    name: "the width of a device counter",
                    value: f64::from(bits),
                    expected: "8 to 64 bits, counting at 1 Hz or more",
                })
            }
            _ => Ok(()),
        }
    }
}

/// A counter of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TickClock {
    /// Counts a second.
    pub tick_hz: u64,
    /// Width: it wraps at 2^bits.
    pub bits: u32,
}

/// The camera that filmed, in words.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// Vendor and product.
    pub name: String,
    /// Serial number, may be empty.
    #[serde(default)]
    pub serial: String,
    /// Version of the firmware, may be empty.
    #[serde(default)]
    pub firmware: String,
    /// Where it is plugged in, may be empty.
    #[serde(default)]
    pub path: String,
}

/// The depth camera: 16-bit codes proportional to z along the optical axis; 0 and 65535 are no measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthCamera {
    /// Size, focal length, centre, distortion.
    pub intrinsics: Intrinsics,
    /// Metres a code unit.
    pub depth_scale: f64,
    /// Depths that the sensor can measure, metres; others are no measurement.
    pub depth_range: RangeInclusive<f32>,
    /// What the stored samples are.
    pub samples: DepthSamples,
    /// From shifts to depth, where the device said it.
    pub shift: Option<ShiftConstants>,
    /// Depth pixels are those of the colour camera: the device has registered them.
    pub is_registered: bool,
}

/// What a depth sample is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthSamples {
    /// Proportional to z, [`DepthCamera::depth_scale`] metres a unit.
    #[default]
    Values,
    /// The sensor's shifts.
    Codes,
}

/// Constants of a structured-light sensor and its table; see [`ShiftConstants::depth_mm`]. Firmware that counts all
/// lengths in centimetres (PS1080) is to be converted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShiftConstants {
    /// Distance of the reference plane, mm.
    pub zero_plane_mm: f64,
    /// Size of a pixel at the reference plane, mm.
    pub zero_plane_pixel_mm: f64,
    /// Distance from emitter to camera, cm.
    pub emitter_distance_cm: f64,
    /// Shifts a pixel.
    pub param_coefficient: f64,
    /// Shift of the reference plane, pixels.
    pub constant_shift: f64,
    /// Pixels of the sensor a pixel of the image.
    pub pixel_size_factor: f64,
    /// What is subtracted from the shift, pixels.
    #[serde(default = "usual_offset")]
    pub offset_pixels: f64,
    /// Depth of each shift in mm, 0 for none; may be empty.
    #[serde(default)]
    pub table_mm: Vec<u16>,
}

fn usual_offset() -> f64 {
    ShiftConstants::USUAL_OFFSET
}

impl DepthCamera {
    /// Refuses a scale outside (0, 1] m and a range that is empty or not within [0, 1000] m.
    pub fn new(
        intrinsics: Intrinsics,
        depth_scale: f64,
        depth_range: RangeInclusive<f32>,
    ) -> Result<Self, SequenceError> {
        if !(depth_scale > 0.0 && depth_scale <= 1.0) {
            return Err(SequenceError::Value {
                name: "the depth scale",
                value: depth_scale,
                expected: "above 0 and at most 1 metre a unit",
            });
        }
        let (near, far) = (*depth_range.start(), *depth_range.end());
        if !(near >= 0.0 && near < far && far <= 1000.0) {
            return Err(SequenceError::Value {
                name: "the nearest depth",
                value: f64::from(near),
                expected: "at least 0 and below the farthest depth, which is at most 1000 metres",
            });
        }
        Ok(Self {
            intrinsics,
            depth_scale,
            depth_range,
            samples: DepthSamples::Values,
            shift: None,
            is_registered: false,
        })
    }
}

/// How a colour payload is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorEncoding {
    /// JPEG; its bytes are the source's.
    Jpeg,
    /// Raw mosaic, lossless.
    BayerGrbg,
    /// YUV 4:2:2 as U Y V Y, lossless.
    Uyvy,
    /// YUV 4:2:2 as Y U Y V, lossless.
    Yuyv,
    /// Three channels, lossless.
    Rgb8,
    /// No colour: brightness in infrared as the depth camera sees it, 0 to 1023 in two bytes, lossless.
    Infrared10,
}

impl ColorEncoding {
    /// The word in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "jpeg",
            Self::BayerGrbg => "bayer-grbg",
            Self::Uyvy => "uyvy",
            Self::Yuyv => "yuyv",
            Self::Rgb8 => "rgb8",
            Self::Infrared10 => "infrared10",
        }
    }

    /// The lossless format, `None` for JPEG.
    pub fn lossless(self) -> Option<ColorFormat> {
        match self {
            Self::Jpeg => None,
            Self::BayerGrbg => Some(ColorFormat::BayerGrbg),
            Self::Uyvy => Some(ColorFormat::Uyvy),
            Self::Yuyv => Some(ColorFormat::Yuyv),
            Self::Rgb8 => Some(ColorFormat::Rgb8),
            Self::Infrared10 => Some(ColorFormat::Infrared10),
        }
    }
}

/// How YUV samples are meant.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct YuvMeaning {
    /// `bt601` or `bt709`.
    pub matrix: String,
    /// `full` (0 to 255) or `limited` (16 to 235).
    pub range: String,
    /// Where chroma is sampled: `left` or `center`.
    pub siting: String,
}

impl YuvMeaning {
    /// The choices behind the words.
    ///
    /// # Errors
    /// [`SequenceError::YuvWord`] for a word of a later version.
    pub fn coding(&self) -> Result<YuvCoding, SequenceError> {
        let unknown = |key, word: &str, expected| SequenceError::YuvWord {
            key,
            word: word.to_owned(),
            expected,
        };
        Ok(YuvCoding {
            matrix: match self.matrix.as_str() {
                "bt601" => YuvMatrix::Bt601,
                "bt709" => YuvMatrix::Bt709,
                word => return Err(unknown("the matrix", word, "bt601 and bt709")),
            },
            range: match self.range.as_str() {
                "limited" => YuvRange::Limited,
                "full" => YuvRange::Full,
                word => return Err(unknown("the range", word, "limited and full")),
            },
            siting: match self.siting.as_str() {
                "left" => ChromaSiting::Left,
                "center" => ChromaSiting::Center,
                word => return Err(unknown("the siting", word, "left and center")),
            },
        })
    }
}

/// From codes to linear radiance, as it is written in rig files and recordings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ResponseCurve {
    /// linear = code / 255.
    Identity,
    /// linear = (code / 255)^gamma, the same for all channels.
    Gamma {
        /// The exponent.
        gamma: f64,
    },
    /// The radiance of each of the 256 codes.
    Table {
        /// Red.
        red: Vec<f32>,
        /// Green.
        green: Vec<f32>,
        /// Blue.
        blue: Vec<f32>,
    },
}

impl ResponseCurve {
    /// The curve, ready to use. A table must rise strictly.
    pub fn build(&self) -> Result<Response, SequenceError> {
        let (red, green, blue) = match self {
            Self::Identity => return Ok(Response::identity()),
            Self::Gamma { gamma } => {
                return Response::gamma(*gamma).map_err(SequenceError::Calibration);
            }
            Self::Table { red, green, blue } => (red, green, blue),
        };
        let channel = |values: &Vec<f32>| {
            <[f32; 256]>::try_from(values.as_slice()).map_err(|_| SequenceError::Count {
                what: "values in a channel of the response table",
                count: values.len() as u64,
                expected: 256,
                of: "codes",
            })
        };
        let table = [channel(red)?, channel(green)?, channel(blue)?];
        let (response, repair) = Response::from_table(table).map_err(SequenceError::Calibration)?;
        if repair.is_none() {
            Ok(response)
        } else {
            Err(SequenceError::ResponseNotRising {
                changed_count: repair.changed_count.iter().sum(),
            })
        }
    }
}

/// Fall-off of the lens, as it is written in rig files and recordings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case", deny_unknown_fields)]
pub enum VignettingCurve {
    /// No fall-off, or none that is known.
    None,
    /// factor = 1 + a₁r² + a₂r⁴ + a₃r⁶ with r = distance from the centre in pixels / radius.
    EvenPolynomial {
        /// Centre (u, v), pixels.
        center: [f64; 2],
        /// Unit of r, pixels.
        radius: f64,
        /// a₁, a₂, a₃.
        a: [f64; 3],
    },
}

impl VignettingCurve {
    /// The fall-off, ready to use.
    pub fn build(&self) -> Result<Vignetting, ImagingError> {
        match *self {
            Self::None => Ok(Vignetting::none()),
            Self::EvenPolynomial { center, radius, a } => {
                Vignetting::even_polynomial(DVec2::from_array(center), radius, a)
            }
        }
    }
}

/// The colour camera.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorCamera {
    /// Size, focal length, centre, distortion.
    pub intrinsics: Intrinsics,
    /// Encoding of the payloads.
    pub encoding: ColorEncoding,
    /// What YUV samples mean, where the encoding has them.
    pub yuv: Option<YuvMeaning>,
    /// Exposure of the frames over the exposure at which radiance 1.0 is the white level.
    pub relative_exposure: f32,
    response_curve: ResponseCurve,
    vignetting_curve: VignettingCurve,
    response: Response,
    vignetting: Vignetting,
}

impl ColorCamera {
    /// Refuses curves that cannot be used and an exposure that is not a positive number.
    pub fn new(
        intrinsics: Intrinsics,
        encoding: ColorEncoding,
        relative_exposure: f32,
        response_curve: ResponseCurve,
        vignetting_curve: VignettingCurve,
    ) -> Result<Self, SequenceError> {
        if !(relative_exposure.is_normal() && relative_exposure > 0.0) {
            return Err(SequenceError::Value {
                name: "the relative exposure",
                value: f64::from(relative_exposure),
                expected: "a positive number",
            });
        }
        let response = response_curve.build()?;
        let vignetting = vignetting_curve
            .build()
            .map_err(SequenceError::Calibration)?;
        Ok(Self {
            intrinsics,
            encoding,
            yuv: None,
            relative_exposure,
            response_curve,
            vignetting_curve,
            response,
            vignetting,
        })
    }

    /// Layout of the raw frames, and of a decoded JPEG. YUV of which nothing is said is Rec. 601 of limited range
    /// with chroma at the left pixel, as webcams and the PrimeSense firmware send it.
    ///
    /// # Errors
    /// [`SequenceError::YuvWord`] for YUV that this version cannot develop, [`SequenceError::NoColors`] for infrared.
    pub fn layout(&self) -> Result<ColorLayout, SequenceError> {
        let coding = || match &self.yuv {
            Some(meaning) => meaning.coding(),
            None => Ok(YuvCoding::default()),
        };
        Ok(match self.encoding {
            ColorEncoding::Jpeg | ColorEncoding::Rgb8 => ColorLayout::Rgb8,
            ColorEncoding::BayerGrbg => ColorLayout::BayerGrbg,
            ColorEncoding::Uyvy => ColorLayout::Uyvy(coding()?),
            ColorEncoding::Yuyv => ColorLayout::Yuyv(coding()?),
            ColorEncoding::Infrared10 => return Err(SequenceError::NoColors),
        })
    }

    /// Code to linear radiance.
    pub fn response(&self) -> Response {
        self.response.clone()
    }

    /// The fall-off of the lens.
    pub fn vignetting(&self) -> Vignetting {
        self.vignetting
    }

    /// The response as it is written.
    pub fn response_curve(&self) -> &ResponseCurve {
        &self.response_curve
    }

    /// The fall-off as it is written.
    pub fn vignetting_curve(&self) -> &VignettingCurve {
        &self.vignetting_curve
    }
}
