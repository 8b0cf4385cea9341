//! The modes that a sensor offers (GET_CMOS_PRESETS).

use crate::color::ColorFormat;
use crate::mode::Resolution;

/// A mode, in the numbers of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CmosPreset {
    /// Value of the parameter "image format" or "depth format".
    pub format: u16,
    /// Number of a [`Resolution`].
    pub resolution: u16,
    /// Frames a second.
    pub fps: u16,
}

impl CmosPreset {
    /// Bytes of a preset.
    pub const BYTES: usize = 6;

    /// Format and resolution of a preset of colour, if both are known.
    pub fn color_mode(&self) -> Option<(ColorFormat, Resolution)> {
        let format = ColorFormat::from_code(self.format)?;
        Some((format, Resolution::from_code(self.resolution)?))
    }

    /// The bytes of the preset.
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let [a, b] = self.format.to_le_bytes();
        let [c, d] = self.resolution.to_le_bytes();
        let [e, f] = self.fps.to_le_bytes();
        [a, b, c, d, e, f]
    }
}

/// Presets of a reply, in its order, without those of 0 frames a second, which firmware sends by mistake.
#[derive(Clone, Debug)]
pub struct Presets<'a> {
    rest: &'a [u8],
}

impl<'a> Presets<'a> {
    /// Of the reply's data; what is left over at their end is ignored.
    pub fn decode(data: &'a [u8]) -> Self {
        Self { rest: data }
    }
}

impl Iterator for Presets<'_> {
    type Item = CmosPreset;

    fn next(&mut self) -> Option<CmosPreset> {
        loop {
            let (&[a, b, c, d, e, f], rest) = self.rest.split_first_chunk()?;
            self.rest = rest;
            let preset = CmosPreset {
                format: u16::from_le_bytes([a, b]),
                resolution: u16::from_le_bytes([c, d]),
                fps: u16::from_le_bytes([e, f]),
            };
            if preset.fps != 0 {
                return Some(preset);
            }
        }
    }
}
