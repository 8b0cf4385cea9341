//! Depth and infrared on the wire (protocol sections 7.1 to 7.4 and 7.9): streaming decoder, encoder.
//!
//! Codes go through as they are sent; [`measured_shift`] tells which of them are measurements.

mod compressed;
mod decoder;
mod encoder;
mod infrared;
mod packed;

pub use decoder::{NO_DEPTH, SampleDecoder};
pub use encoder::encode_samples;
pub use infrared::{DepthSensor, InfraredRows};

/// Shift that the camera sends where it measured nothing.
pub const NO_SHIFT: u16 = 2047;

/// How the 16-bit samples of depth (shifts) and infrared (brightness) are packed. The numbers are values of the
/// parameter "depth format".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum SampleFormat {
    /// 16 bits, little-endian.
    Raw16 = 0,
    /// Differences in half bytes; codes up to 32 767.
    Compressed = 1,
    /// 10 bits, the highest first, 4 samples in 5 bytes: infrared. No firmware sends depth so.
    Packed10 = 2,
    /// 11 bits, the highest first, 8 samples in 11 bytes.
    Packed11 = 3,
    /// 12 bits, the highest first, 2 samples in 3 bytes.
    Packed12 = 4,
}

impl SampleFormat {
    /// All, by their numbers.
    pub const ALL: [Self; 5] = [
        Self::Raw16,
        Self::Compressed,
        Self::Packed10,
        Self::Packed11,
        Self::Packed12,
    ];

    /// The format of a parameter's value.
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The parameter's value.
    pub fn code(self) -> u16 {
        self as u16
    }

    /// The greatest code that can be sent.
    pub fn max_code(self) -> u16 {
        match self {
            Self::Raw16 => u16::MAX,
            Self::Compressed => 0x7FFF,
            Self::Packed10 => 0x3FF,
            Self::Packed11 => 0x7FF,
            Self::Packed12 => 0xFFF,
        }
    }

    /// Bytes of `count` samples, the last one filled up with zero bits; compressed, the most it can take for lines of
    /// `width`.
    pub fn max_bytes(self, count: usize, width: usize) -> usize {
        match self.bits() {
            Some(bits) => count.saturating_mul(bits).div_ceil(8),
            None => {
                // Each sample a full value, a filler before each line, one at the end.
                let line_count = count.div_ceil(width.max(1));
                (count.saturating_mul(5) + line_count).div_ceil(2)
            }
        }
    }

    /// Bits of a packed sample.
    pub(crate) fn bits(self) -> Option<usize> {
        match self {
            Self::Raw16 => Some(16),
            Self::Compressed => None,
            Self::Packed10 => Some(10),
            Self::Packed11 => Some(11),
            Self::Packed12 => Some(12),
        }
    }
}

/// The shift of a code of depth where it is a measurement: 1 to 2046. 0, [`NO_SHIFT`] and what is above, which no table
/// has, are none (hard-cases B03).
pub fn measured_shift(code: u16) -> Option<u16> {
    (1..NO_SHIFT).contains(&code).then_some(code)
}
