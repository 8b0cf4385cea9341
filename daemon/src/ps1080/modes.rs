//! What is asked of the streams, what of it the camera can do, and what is therefore written to it.

use ps1080::color::ColorFormat;
use ps1080::firmware::{Feature, Firmware};
use ps1080::mode::{Resolution, StreamMode};
use ps1080::parameter::Parameter;
use ps1080::samples::SampleFormat;
use ps1080::shift::ReferencePattern;

use crate::ps1080::error::CameraError;
use crate::ps1080::open::Unit;

/// Colour as the user wants it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorChoice {
    /// Bayer where the camera lists it, else YUV in differences: both lossless.
    #[default]
    Best,
    /// This one.
    Format(ColorFormat),
    /// No colour: what the sensor of depth sees, in its place.
    Infrared,
}

/// What comes beside depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageMode {
    /// Colour.
    Color(ColorFormat),
    /// Infrared.
    Infrared,
}

/// What becomes of the projector of infrared dots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EmitterPlan {
    /// It is not spoken of: it is on, unless an earlier program left it off.
    #[default]
    Untouched,
    /// On.
    On,
    /// Off while the camera records: nothing is measured, and infrared shows no dots.
    Off,
}

/// What is asked of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Of depth.
    pub depth_resolution: Resolution,
    /// Of colour or infrared.
    pub color_resolution: Resolution,
    /// Of both, frames a second.
    pub fps: u16,
    /// How depth is packed on the bus; the samples are the same.
    pub depth_format: SampleFormat,
    /// How colour comes, or infrared.
    pub color: ColorChoice,
    /// Depth warped to colour by the camera.
    pub is_registered: bool,
    /// For short distances, where the firmware has it.
    pub is_close: bool,
    /// Exposure of colour; infrared has none to set.
    pub exposure: ExposurePlan,
    /// The projector.
    pub emitter: EmitterPlan,
}

/// What one camera is to do, settled once it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plan {
    /// What was asked for.
    pub(super) wanted: Wanted,
    /// What comes beside depth.
    pub(super) image: ImageMode,
    /// How to speak to it.
    pub(super) firmware: Firmware,
}

/// What becomes of exposure, gain and white balance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExposurePlan {
    /// The camera finds them, then they are locked: radiance can be compared over the recording.
    #[default]
    Lock,
    /// These, locked. In the camera's units.
    Manual {
        /// Value of "exposure bar".
        exposure: u16,
        /// Value of "image gain".
        gain: u16,
    },
    /// Whatever the camera does, frame by frame.
    Auto,
}

impl Default for Wanted {
    fn default() -> Self {
        Self {
            depth_resolution: Resolution::Vga,
            color_resolution: Resolution::Vga,
            fps: 30,
            depth_format: SampleFormat::Packed11,
            color: ColorChoice::Best,
            is_registered: false,
            is_close: false,
            exposure: ExposurePlan::default(),
            emitter: EmitterPlan::default(),
        }
    }
}

impl Wanted {
    /// The same with pictures of one size.
    #[must_use]
    pub fn of_size(self, resolution: Resolution) -> Self {
        Self {
            depth_resolution: resolution,
            color_resolution: resolution,
            ..self
        }
    }

    /// Why no camera of this kind can do this, in a sentence (protocol section 5, "Constraints").
    pub fn contradiction(&self) -> Option<&'static str> {
        if self.color != ColorChoice::Infrared {
            return None;
        }
        let is_offered = matches!(
            (self.color_resolution, self.fps),
            (Resolution::Qvga, 30 | 60) | (Resolution::Vga, 30)
        );
        if self.depth_resolution != self.color_resolution {
            Some("depth and infrared come from one sensor and have one size")
        } else if !is_offered {
            Some("infrared comes as vga at 30 frames a second, or as qvga at 30 or 60")
        } else if self.is_registered {
            Some(
                "color=infrared and registration=on do not go together: infrared has the pixels of depth already",
            )
        } else {
            None
        }
    }

    /// All of it for `unit`.
    ///
    /// # Errors
    /// What this unit, or any, cannot do.
    pub(super) fn plan(&self, unit: &Unit) -> Result<Plan, CameraError> {
        let firmware = unit.firmware();
        if let Some(why) = self.contradiction() {
            return Err(CameraError::Contradiction(why));
        }
        if self.emitter == EmitterPlan::Off && !firmware.has(Feature::EmitterSwitch) {
            return Err(CameraError::EmitterSwitch(firmware));
        }
        let image = match self.color {
            ColorChoice::Infrared => ImageMode::Infrared,
            ColorChoice::Best => ImageMode::Color(self.best_color(unit)?),
            ColorChoice::Format(format) => ImageMode::Color(self.listed_color(format, unit)?),
        };
        Ok(Plan {
            wanted: *self,
            image,
            firmware,
        })
    }

    fn offers(&self, format: ColorFormat, unit: &Unit) -> bool {
        unit.color_presets.iter().any(|preset| {
            preset.color_mode() == Some((format, self.color_resolution)) && preset.fps == self.fps
        })
    }

    fn best_color(&self, unit: &Unit) -> Result<ColorFormat, CameraError> {
        let preferred = [
            ColorFormat::Bayer,
            ColorFormat::CompressedBayer,
            ColorFormat::CompressedYuv422,
            ColorFormat::Uyvy,
        ];
        let mut preferred = preferred.into_iter();
        match preferred.find(|format| self.offers(*format, unit)) {
            Some(format) => Ok(format),
            // Older firmware has no list, and this one.
            None if unit.color_presets.is_empty() => Ok(ColorFormat::CompressedYuv422),
            None => Err(self.not_offered("any lossless format", unit)),
        }
    }

    fn listed_color(&self, format: ColorFormat, unit: &Unit) -> Result<ColorFormat, CameraError> {
        if unit.color_presets.is_empty() || self.offers(format, unit) {
            return Ok(format);
        }
        Err(self.not_offered(&format!("{format:?}"), unit))
    }

    fn not_offered(&self, format: &str, unit: &Unit) -> CameraError {
        let offered = unit.color_presets.iter().filter_map(|preset| {
            let (format, resolution) = preset.color_mode()?;
            Some(format!("{format:?} {resolution:?} {}", preset.fps))
        });
        CameraError::NotOffered {
            wanted: format!("{format} {:?} {}", self.color_resolution, self.fps),
            offered: offered.collect::<Vec<_>>().join(", "),
        }
    }
}

impl Plan {
    /// Parameters of depth and of what comes beside it, in the order in which they are to be written, before any stream
    /// is switched on.
    pub(super) fn parameters(&self, depth_gain: u16) -> Vec<(Parameter, u16)> {
        let mut parameters = self.depth_parameters(depth_gain);
        match self.image {
            ImageMode::Color(format) => self.add_color(format, &mut parameters),
            ImageMode::Infrared => parameters.extend([
                (Parameter::InfraredResolution, self.image_resolution_code()),
                (Parameter::InfraredFps, self.wanted.fps),
                (Parameter::InfraredMirror, 0),
            ]),
        }
        parameters.retain(|(parameter, _)| knows(self.firmware, *parameter));
        parameters
    }

    fn depth_parameters(&self, depth_gain: u16) -> Vec<(Parameter, u16)> {
        let wanted = &self.wanted;
        // A quarter of the pixels at full rate is thinned out, not binned.
        let is_decimated = wanted.depth_resolution == Resolution::Qvga && wanted.fps != 60;
        vec![
            (Parameter::DepthFormat, wanted.depth_format.code()),
            (Parameter::DepthResolution, wanted.depth_resolution.code()),
            (Parameter::DepthFps, wanted.fps),
            (Parameter::DepthHoleFilter, 1),
            (Parameter::DepthGain, depth_gain),
            (Parameter::DepthDecimation, u16::from(is_decimated)),
            (Parameter::Registration, u16::from(wanted.is_registered)),
            (Parameter::DepthMirror, 0),
            (Parameter::SelfCorrection, 1),
            (Parameter::SelfCorrectionDebug, 0),
            (Parameter::WavelengthCorrection, 0),
            (Parameter::WavelengthCorrectionDebug, 0),
            (Parameter::DepthWhiteBalance, 1),
        ]
    }

    fn add_color(&self, format: ColorFormat, parameters: &mut Vec<(Parameter, u16)>) {
        parameters.extend([
            (Parameter::ImageFormat, format.code()),
            (Parameter::ImageResolution, self.image_resolution_code()),
            (Parameter::ImageFps, self.wanted.fps),
            (Parameter::ImageFlicker, 0),
        ]);
        if format.is_jpeg() {
            parameters.push((Parameter::ImageQuality, BEST_JPEG));
        }
        parameters.push((Parameter::ImageMirror, 0));
    }

    fn image_resolution_code(&self) -> u16 {
        self.wanted.color_resolution.code()
    }

    /// What is set once depth and the other stream run, in this order. Frame sync ties colour to depth; infrared is of
    /// the same sensor.
    pub(super) fn settings_of_running_streams(&self) -> Vec<(Parameter, u16)> {
        let wanted = &self.wanted;
        let is_color = self.image != ImageMode::Infrared;
        let mut settings = vec![
            (Parameter::FrameSync, u16::from(is_color)),
            (Parameter::CloseRange, u16::from(wanted.is_close)),
            (Parameter::DepthCropMode, 0),
        ];
        if is_color {
            let is_auto = u16::from(!matches!(wanted.exposure, ExposurePlan::Manual { .. }));
            settings.extend([
                (Parameter::ImageCropMode, 0),
                (Parameter::AutoExposure, is_auto),
                (Parameter::AutoWhiteBalance, is_auto),
            ]);
        } else {
            settings.push((Parameter::InfraredCropMode, 0));
        }
        settings.retain(|(parameter, _)| knows(self.firmware, *parameter));
        settings
    }

    /// The mode of the stream beside depth.
    pub(super) fn image_stream_mode(&self) -> StreamMode {
        match self.image {
            ImageMode::Color(_) => StreamMode::Color,
            ImageMode::Infrared => StreamMode::Infrared,
        }
    }

    /// Whether the emitter is to be switched, and how. Firmware without the switch has it on.
    pub(super) fn emitter(&self) -> Option<bool> {
        let has_switch = self.firmware.has(Feature::EmitterSwitch);
        match self.wanted.emitter {
            EmitterPlan::Untouched => None,
            EmitterPlan::On => has_switch.then_some(true),
            EmitterPlan::Off => Some(false),
        }
    }

    /// What becomes of the exposure: infrared has none to set.
    pub(super) fn exposure(&self) -> ExposurePlan {
        match self.image {
            ImageMode::Color(_) => self.wanted.exposure,
            ImageMode::Infrared => ExposurePlan::Auto,
        }
    }

    /// The size of the reference pattern that depth is measured by.
    pub(super) fn pattern(&self) -> ReferencePattern {
        let is_beside_infrared = self.image == ImageMode::Infrared;
        let is_small = self.wanted.color_resolution == Resolution::Qvga;
        if self.wanted.fps == 60 || is_beside_infrared && is_small {
            ReferencePattern::Vga
        } else {
            ReferencePattern::OwnSize
        }
    }

    /// Bytes of a frame beside depth, as it is recorded; of JPEG the most.
    pub(super) fn most_image_bytes(&self) -> usize {
        let (width, height) = self.wanted.color_resolution.size();
        let pixel_count = usize::from(width) * usize::from(height);
        match self.image {
            ImageMode::Infrared => 2 * pixel_count,
            ImageMode::Color(format) => match format.line_bytes(width) {
                Some(line_bytes) => line_bytes * usize::from(height),
                None => JPEG_BYTES_A_PIXEL * pixel_count,
            },
        }
    }
}

/// Bytes of a JPEG frame, as a share of its pixels: far more than the best quality takes.
const JPEG_BYTES_A_PIXEL: usize = 2;
const BEST_JPEG: u16 = 10;

/// Whether firmware knows a parameter that depth or colour writes.
fn knows(firmware: Firmware, parameter: Parameter) -> bool {
    match parameter {
        Parameter::WavelengthCorrection | Parameter::WavelengthCorrectionDebug => {
            firmware >= Firmware::new(5, 2, 0)
        }
        Parameter::CloseRange => firmware.has(Feature::CloseRange),
        Parameter::AutoExposure | Parameter::AutoWhiteBalance => {
            firmware.has(Feature::ImageParameters)
        }
        _ => true,
    }
}
