//! What is asked of the streams, and what of it the camera can do.

use ps1080::color::ColorFormat;
use ps1080::firmware::{Feature, Firmware};
use ps1080::mode::Resolution;
use ps1080::parameter::Parameter;
use ps1080::samples::SampleFormat;

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
}

/// What is asked of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Of depth.
    pub depth_resolution: Resolution,
    /// Of colour.
    pub color_resolution: Resolution,
    /// Of both, frames a second.
    pub fps: u16,
    /// How depth is packed on the bus; the samples are the same.
    pub depth_format: SampleFormat,
    /// How colour comes.
    pub color: ColorChoice,
    /// Depth warped to colour by the camera.
    pub is_registered: bool,
    /// For short distances, where the firmware has it.
    pub is_close: bool,
    /// Exposure.
    pub exposure: ExposurePlan,
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

    /// Which format of colour `unit` is to send.
    ///
    /// # Errors
    /// [`CameraError::NotOffered`] for one that it does not list.
    pub fn color_format(&self, unit: &Unit) -> Result<ColorFormat, CameraError> {
        let offers = |format: ColorFormat| {
            unit.color_presets.iter().any(|preset| {
                preset.color_mode() == Some((format, self.color_resolution))
                    && preset.fps == self.fps
            })
        };
        match self.color {
            ColorChoice::Best => {
                let preferred = [
                    ColorFormat::Bayer,
                    ColorFormat::CompressedBayer,
                    ColorFormat::CompressedYuv422,
                    ColorFormat::Uyvy,
                ];
                let listed = preferred.into_iter().find(|format| offers(*format));
                match listed {
                    Some(format) => Ok(format),
                    // Older firmware has no list, and this one.
                    None if unit.color_presets.is_empty() => Ok(ColorFormat::CompressedYuv422),
                    None => Err(self.not_offered("any lossless format", unit)),
                }
            }
            ColorChoice::Format(format) if unit.color_presets.is_empty() || offers(format) => {
                Ok(format)
            }
            ColorChoice::Format(format) => Err(self.not_offered(&format!("{format:?}"), unit)),
        }
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

    /// Parameters of depth, in the order in which they are to be written, before it is switched on.
    pub(super) fn depth_parameters(&self, depth_gain: u16) -> Vec<(Parameter, u16)> {
        // A quarter of the pixels at full rate is thinned out, not binned.
        let is_decimated = self.depth_resolution == Resolution::Qvga && self.fps != 60;
        vec![
            (Parameter::DepthFormat, self.depth_format.code()),
            (Parameter::DepthResolution, self.depth_resolution.code()),
            (Parameter::DepthFps, self.fps),
            (Parameter::DepthHoleFilter, 1),
            (Parameter::DepthGain, depth_gain),
            (Parameter::DepthDecimation, u16::from(is_decimated)),
            (Parameter::Registration, u16::from(self.is_registered)),
            (Parameter::DepthMirror, 0),
            (Parameter::SelfCorrection, 1),
            (Parameter::SelfCorrectionDebug, 0),
            (Parameter::WavelengthCorrection, 0),
            (Parameter::WavelengthCorrectionDebug, 0),
            (Parameter::DepthWhiteBalance, 1),
        ]
    }

    /// Parameters of colour, likewise.
    pub(super) fn color_parameters(&self, format: ColorFormat) -> Vec<(Parameter, u16)> {
        let mut parameters = vec![
            (Parameter::ImageFormat, format.code()),
            (Parameter::ImageResolution, self.color_resolution.code()),
            (Parameter::ImageFps, self.fps),
            (Parameter::ImageFlicker, 0),
        ];
        if format.is_jpeg() {
            parameters.push((Parameter::ImageQuality, BEST_JPEG));
        }
        parameters.push((Parameter::ImageMirror, 0));
        parameters
    }
}

const BEST_JPEG: u16 = 10;

/// Whether firmware knows a parameter that depth or colour writes.
pub(super) fn knows(firmware: Firmware, parameter: Parameter) -> bool {
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
