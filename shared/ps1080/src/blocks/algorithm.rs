//! Blocks of ALGORITHM_PARAMS (protocol sections 3 and 8.3).

use crate::bytes::{u16_at, u32_at};
use crate::stream::TickRate;

/// The constant shift, in pixels, of a block of [`crate::host::AlgorithmKind::DepthInfo`].
pub fn decode_constant_shift(block: &[u8; 2]) -> u16 {
    u16::from_le_bytes(*block)
}

/// The rate of a block of [`crate::host::AlgorithmKind::Frequency`]; `None` for what is no rate.
pub fn decode_tick_rate(block: &[u8; 4]) -> Option<TickRate> {
    TickRate::from_ticks_per_microsecond(f32::from_le_bytes(*block))
}

/// The block of a rate.
pub fn encode_tick_rate(rate: TickRate) -> [u8; 4] {
    // Rounded to f32, as the camera holds it.
    ((rate.hz() as f64 / 1e6) as f32).to_le_bytes()
}

/// From units of blanking to time, for one sensor: microseconds = slope * units + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlankingBlock {
    /// Slope and offset for colour, then for depth.
    pub lines: [(f32, f32); 2],
}

impl BlankingBlock {
    /// Bytes of the block.
    pub const BYTES: usize = 16;

    /// From the bytes of the block.
    pub fn decode(block: &[u8; Self::BYTES]) -> Self {
        let mut lines = [(0.0, 0.0); 2];
        for (line, &[a, b, c, d, e, f, g, h]) in lines.iter_mut().zip(block.as_chunks().0) {
            *line = (
                f32::from_le_bytes([a, b, c, d]),
                f32::from_le_bytes([e, f, g, h]),
            );
        }
        Self { lines }
    }

    /// The bytes of the block.
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let mut block = [0; Self::BYTES];
        let values = self
            .lines
            .iter()
            .flat_map(|&(slope, offset)| [slope, offset]);
        for (bytes, value) in block.as_chunks_mut().0.iter_mut().zip(values) {
            *bytes = value.to_le_bytes();
        }
        block
    }
}

/// Lines that the camera adds and drops when it registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PaddingBlock {
    /// Lines without depth above.
    pub start_lines: u16,
    /// Lines without depth below.
    pub end_lines: u16,
    /// Lines that are cropped.
    pub cropping_lines: u16,
}

impl PaddingBlock {
    /// Bytes of the block.
    pub const BYTES: usize = 6;

    /// From the bytes of the block.
    pub fn decode(block: &[u8; Self::BYTES]) -> Self {
        let word = |at| u16_at(block, at).unwrap_or(0);
        Self {
            start_lines: word(0),
            end_lines: word(2),
            cropping_lines: word(4),
        }
    }

    /// The bytes of the block.
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let [a, b] = self.start_lines.to_le_bytes();
        let [c, d] = self.end_lines.to_le_bytes();
        let [e, f] = self.cropping_lines.to_le_bytes();
        [a, b, c, d, e, f]
    }
}

/// Coefficients of [`RegistrationBlock`], in the order of the block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[expect(
    missing_docs,
    reason = "the names are the protocol's; section 8.3 explains them"
)]
pub enum RegistrationField {
    DxCenter,
    Ax,
    Bx,
    Cx,
    Dx,
    DxStart,
    Ay,
    By,
    Cy,
    Dy,
    DyStart,
    DxBetaStart,
    DyBetaStart,
    RolloutBlank,
    RolloutSize,
    DxBetaInc,
    DyBetaInc,
    DxdxStart,
    DxdyStart,
    DydxStart,
    DydyStart,
    DxdxdxStart,
    DydxdxStart,
    DxdxdyStart,
    DydxdyStart,
    BackComp1,
    DydydxStart,
    BackComp2,
    DydydyStart,
}

impl RegistrationField {
    /// Bits of the field that count, and by how much they are shifted up.
    fn format(self) -> (u32, u32) {
        use RegistrationField::*;
        match self {
            DxBetaInc | DyBetaInc => (24, 0),
            DxStart | DyStart => (19, 9),
            DxdxStart | DxdyStart | DydxStart | DydyStart => (21, 8),
            DxdxdxStart | DydxdxStart | DxdxdyStart | DydxdyStart | DydydxStart | DydydyStart => {
                (27, 8)
            }
            DxBetaStart | DyBetaStart => (17, 7),
            _ => (32, 0),
        }
    }
}

/// Coefficients of the registration of depth to colour, as sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegistrationBlock {
    /// In the order of [`RegistrationField`].
    pub fields: [i32; Self::FIELD_COUNT],
}

impl RegistrationBlock {
    /// Fields of the block.
    pub const FIELD_COUNT: usize = 29;
    /// Bytes of the block.
    pub const BYTES: usize = 4 * Self::FIELD_COUNT;

    /// From the bytes of the block.
    pub fn decode(block: &[u8; Self::BYTES]) -> Self {
        let mut fields = [0; Self::FIELD_COUNT];
        for (index, field) in fields.iter_mut().enumerate() {
            *field = u32_at(block, 4 * index).unwrap_or(0).cast_signed();
        }
        Self { fields }
    }

    /// The bytes of the block.
    pub fn encode(&self) -> [u8; Self::BYTES] {
        let mut block = [0; Self::BYTES];
        for (bytes, field) in block.as_chunks_mut().0.iter_mut().zip(self.fields) {
            *bytes = field.to_le_bytes();
        }
        block
    }

    /// A coefficient as the arithmetic takes it: the low bits that count, with their sign, shifted up.
    pub fn coefficient(&self, field: RegistrationField) -> i64 {
        let (bits, up) = field.format();
        let unused = 32 - bits;
        let value = self.fields[field as usize] << unused >> unused;
        i64::from(value) << up
    }
}
