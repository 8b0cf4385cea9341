//! Parameters as the camera holds them, and what it refuses of them (protocol sections 4 and 5).

use ps1080::blocks::CmosPreset;
use ps1080::color::ColorFormat;
use ps1080::firmware::Feature;
use ps1080::host::Nack;
use ps1080::mode::{CameraMode, Resolution, StreamMode};
use ps1080::parameter::Parameter;
use ps1080::samples::{InfraredRows, SampleFormat};
use ps1080::stream::Padding;

use crate::personality::Personality;
use crate::shot::Shot;

/// Ids that exist: 0 to 85.
const PARAMETER_COUNT: usize = 86;
/// Parameter that guards the flash; the host must never write 0.
const FILE_SYSTEM_LOCK: u16 = 85;
const PACKED_10: u16 = SampleFormat::Packed10 as u16;
const DEFAULTS: [(Parameter, u16); 17] = [
    (Parameter::ImageFormat, 1),
    (Parameter::ImageFps, 30),
    (Parameter::ImageGain, 100),
    (Parameter::ImageQuality, 7),
    (Parameter::DepthFormat, 3),
    (Parameter::DepthFps, 30),
    (Parameter::DepthGain, 42),
    (Parameter::DepthHoleFilter, 1),
    (Parameter::DepthMirror, 1),
    (Parameter::InfraredFps, 30),
    (Parameter::SelfCorrection, 1),
    (Parameter::DepthWhiteBalance, 1),
    (Parameter::LaserPowerControl, 1),
    (Parameter::ImageMirror, 1),
    (Parameter::ImageSharpness, 50),
    (Parameter::AutoWhiteBalance, 1),
    (Parameter::AutoExposure, 1),
];

#[derive(Clone, Debug)]
pub(crate) struct Settings {
    values: [u16; PARAMETER_COUNT],
    /// The emitter, which no parameter switches.
    is_lit: bool,
}

impl Settings {
    pub(crate) fn new() -> Self {
        let mut values = [0; PARAMETER_COUNT];
        for (parameter, value) in DEFAULTS {
            values[parameter as usize] = value;
        }
        values[usize::from(FILE_SYSTEM_LOCK)] = 1;
        Self {
            values,
            is_lit: true,
        }
    }

    /// As after plugging in, but for the emitter: whether a reset lights it nobody has seen, and a host must not rely on
    /// it.
    pub(crate) fn reset(&mut self) {
        *self = Self {
            is_lit: self.is_lit,
            ..Self::new()
        };
    }

    pub(crate) fn is_lit(&self) -> bool {
        self.is_lit
    }

    /// Switches the emitter.
    pub(crate) fn light(&mut self, on: u16) -> Result<(), Nack> {
        self.is_lit = match on {
            0 => false,
            1 => true,
            _ => return Err(Nack::BadParameters),
        };
        Ok(())
    }

    pub(crate) fn get(&self, parameter: Parameter) -> u16 {
        self.values[parameter as usize]
    }

    /// The value of an id that this firmware has.
    pub(crate) fn read(&self, id: u16, unit: &Personality) -> Result<u16, Nack> {
        let value = self.values.get(usize::from(id));
        value
            .filter(|_| exists(id, unit))
            .copied()
            .ok_or(Nack::BadParameters)
    }

    /// Writes one value, or says why not.
    pub(crate) fn write(&mut self, id: u16, value: u16, unit: &Personality) -> Result<(), Nack> {
        if !exists(id, unit) || !self.allows(id, value, unit) {
            return Err(Nack::BadParameters);
        }
        let place = self.values.get_mut(usize::from(id));
        *place.ok_or(Nack::BadParameters)? = value;
        Ok(())
    }

    pub(crate) fn image_mode(&self) -> u16 {
        self.get(Parameter::Stream0Mode)
    }

    pub(crate) fn has_depth(&self) -> bool {
        self.get(Parameter::Stream1Mode) != 0
    }

    pub(crate) fn all_off(&mut self) {
        for parameter in [
            Parameter::Stream0Mode,
            Parameter::Stream1Mode,
            Parameter::Stream2Mode,
        ] {
            self.values[parameter as usize] = 0;
        }
    }

    fn allows(&self, id: u16, value: u16, unit: &Personality) -> bool {
        use Parameter::*;
        let Some(parameter) = Parameter::from_id(id) else {
            return id != FILE_SYSTEM_LOCK || value != 0;
        };
        let is_same = self.get(parameter) == value;
        let image = self.image_mode();
        parameter.accepts(value)
            && match parameter {
                ImageFormat | ImageResolution | ImageFps => {
                    is_same || image != StreamMode::Color as u16
                }
                InfraredFormat | InfraredResolution | InfraredFps => {
                    is_same || image != StreamMode::Infrared as u16
                }
                DepthFormat | DepthResolution | DepthFps => is_same || !self.has_depth(),
                ImageCropMode | DepthCropMode | InfraredCropMode => value == 0,
                Stream0Mode => is_same || self.allows_image(value, unit),
                Stream1Mode => is_same || value == 0 || self.allows_depth(unit),
                _ => true,
            }
    }

    /// Colour and infrared change over through off; a mode must be one that is served.
    fn allows_image(&self, mode: u16, unit: &Personality) -> bool {
        if mode == 0 {
            return true;
        }
        if self.image_mode() != 0 || unit.mode != CameraMode::Normal {
            return false;
        }
        if mode == StreamMode::Color as u16 {
            let wanted = CmosPreset {
                format: self.get(Parameter::ImageFormat),
                resolution: self.get(Parameter::ImageResolution),
                fps: self.get(Parameter::ImageFps),
            };
            return unit.color_presets.contains(&wanted);
        }
        self.allows_infrared(unit)
    }

    fn allows_infrared(&self, unit: &Personality) -> bool {
        let resolution = self.get(Parameter::InfraredResolution);
        let fps = self.get(Parameter::InfraredFps);
        let is_served = match Resolution::from_code(resolution) {
            Some(Resolution::Qvga) => matches!(fps, 30 | 60),
            Some(Resolution::Vga) => fps == 30,
            Some(Resolution::Sxga) => fps == 30 && unit.has(Feature::SxgaInfrared),
            _ => false,
        };
        is_served && (!self.has_depth() || self.fits_depth(resolution, fps, unit))
    }

    /// Whether infrared may run beside the depth that runs.
    fn fits_depth(&self, resolution: u16, fps: u16, unit: &Personality) -> bool {
        let depth = self.get(Parameter::DepthResolution);
        let is_wide = (resolution, depth) == (Resolution::Sxga.code(), Resolution::Vga.code());
        let is_early = !unit.has(Feature::CloseRange);
        fps == self.get(Parameter::DepthFps) && (resolution == depth || is_wide && is_early)
    }

    /// Beside infrared, depth must have been started first.
    fn allows_depth(&self, unit: &Personality) -> bool {
        let fps = self.get(Parameter::DepthFps);
        let has_25 = fps == 25 && unit.has(Feature::Fps25);
        let is_served = match Resolution::from_code(self.get(Parameter::DepthResolution)) {
            Some(Resolution::Qvga) => matches!(fps, 30 | 60) || has_25,
            Some(Resolution::Vga) => fps == 30 || has_25,
            Some(Resolution::Qqvga) => fps == 30 && unit.has(Feature::QqvgaDepth),
            _ => false,
        };
        is_served
            && self.get(Parameter::DepthFormat) != PACKED_10
            && self.image_mode() != StreamMode::Infrared as u16
            && unit.mode == CameraMode::Normal
    }

    /// What the stream of depth sends now.
    pub(crate) fn depth_shot(&self, unit: &Personality) -> Option<(Shot, u32)> {
        let is_registered = self.get(Parameter::Registration) == 1;
        let padding = if is_registered {
            unit.padding
        } else {
            Padding::default()
        };
        let shot = Shot::Depth {
            format: SampleFormat::from_code(self.get(Parameter::DepthFormat))?,
            resolution: Resolution::from_code(self.get(Parameter::DepthResolution))?,
            is_mirrored: self.get(Parameter::DepthMirror) == 1,
            is_registered,
            before: padding.before,
            after: padding.after,
            is_lit: self.is_lit,
        };
        Some((shot, u32::from(self.get(Parameter::DepthFps))))
    }

    /// What the stream of colour or infrared sends now.
    pub(crate) fn image_shot(&self, unit: &Personality) -> Option<(Shot, u32)> {
        if self.image_mode() == StreamMode::Infrared as u16 {
            let resolution = Resolution::from_code(self.get(Parameter::InfraredResolution))?;
            let rows = InfraredRows::of(unit.fixed.depth_sensor(), resolution);
            let shot = Shot::infrared(resolution, rows, self.is_lit);
            return Some((shot, u32::from(self.get(Parameter::InfraredFps))));
        }
        let shot = Shot::Color {
            format: ColorFormat::from_code(self.get(Parameter::ImageFormat))?,
            resolution: Resolution::from_code(self.get(Parameter::ImageResolution))?,
            is_mirrored: self.get(Parameter::ImageMirror) == 1,
        };
        Some((shot, u32::from(self.get(Parameter::ImageFps))))
    }
}

/// Whether the firmware has a parameter of this id.
fn exists(id: u16, unit: &Personality) -> bool {
    use Parameter::*;
    match Parameter::from_id(id) {
        Some(CloseRange) => unit.has(Feature::CloseRange),
        Some(
            ImageSharpness
            | AutoWhiteBalance
            | ColorTemperature
            | BacklightCompensation
            | AutoExposure
            | ExposureBar
            | LowLightCompensation,
        ) => unit.has(Feature::SerialNumber),
        _ => usize::from(id) < PARAMETER_COUNT,
    }
}
