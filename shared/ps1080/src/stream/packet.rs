//! The 12 bytes before every piece of a stream.

use crate::bytes::{u16_at, u32_at};
use crate::stream::DeviceTicks;

/// Bytes of a packet's header.
pub const HEADER_BYTES: usize = 12;
/// Bytes of the largest packet, its header included.
pub const MAX_PACKET_BYTES: usize = u16::MAX as usize;
/// The first two bytes of every packet ("RB").
pub const PACKET_MAGIC: [u8; 2] = [0x52, 0x42];

/// Whose packets they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StreamKind {
    /// Shifts.
    Depth,
    /// Colour or infrared: both are the camera's stream 0.
    Image,
}

/// Which part of a frame a packet carries. All three may have payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PartKind {
    /// Opens a frame.
    Start,
    /// Goes on with it.
    Buffer,
    /// Closes it; its stamp is the frame's.
    End,
}

/// Type of a packet (protocol section 6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PacketKind {
    /// Part of a frame of depth, colour or infrared.
    Frame(StreamKind, PartKind),
    /// 0x9200: sound, of firmware before 5.6.
    Audio,
    /// 0xA200, 0xB200, 0xB500, 0xC200, 0xD200, 0xD201, 0xDB01, 0xDB02: numbers about calibration and temperature.
    Telemetry(u16),
    /// 0xDEAD: the projector has failed.
    ProjectorFault,
    /// 0xF31F: the camera is too hot.
    Overheat,
}

const TELEMETRY: [u16; 8] = [
    0xA200, 0xB200, 0xB500, 0xC200, 0xD200, 0xD201, 0xDB01, 0xDB02,
];

impl PacketKind {
    /// The kind of a type word, `None` for those nobody knows.
    pub fn from_code(code: u16) -> Option<Self> {
        use {PartKind::*, StreamKind::*};
        Some(match code {
            0x7100 => Self::Frame(Depth, Start),
            0x7200 => Self::Frame(Depth, Buffer),
            0x7500 => Self::Frame(Depth, End),
            0x8100 => Self::Frame(Image, Start),
            0x8200 => Self::Frame(Image, Buffer),
            0x8500 => Self::Frame(Image, End),
            0x9200 => Self::Audio,
            0xDEAD => Self::ProjectorFault,
            0xF31F => Self::Overheat,
            _ if TELEMETRY.contains(&code) => Self::Telemetry(code),
            _ => return None,
        })
    }

    /// The type word.
    pub fn code(self) -> u16 {
        match self {
            Self::Frame(stream, part) => {
                let stream = match stream {
                    StreamKind::Depth => 0x7000,
                    StreamKind::Image => 0x8000,
                };
                let part = match part {
                    PartKind::Start => 0x100,
                    PartKind::Buffer => 0x200,
                    PartKind::End => 0x500,
                };
                stream + part
            }
            Self::Audio => 0x9200,
            Self::Telemetry(code) => code,
            Self::ProjectorFault => 0xDEAD,
            Self::Overheat => 0xF31F,
        }
    }
}

/// Pixels without depth that a frame does not send: the START packet of depth announces them in place of a stamp
/// (used with registration and cropping by the camera).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Padding {
    /// Pixels before the first that is sent.
    pub before: u16,
    /// Pixels after the last.
    pub after: u16,
}

impl Padding {
    /// From the last field of a header: high half before, low half after.
    pub fn from_field(field: u32) -> Self {
        Self {
            before: (field >> 16) as u16,
            after: field as u16,
        }
    }

    /// The field of the header.
    pub fn field(self) -> u32 {
        u32::from(self.before) << 16 | u32::from(self.after)
    }
}

/// Header of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketHeader {
    /// What follows.
    pub kind: PacketKind,
    /// Counts up per stream, wraps at 65 536.
    pub id: u16,
    /// Bytes that follow the header, at most [`MAX_PACKET_BYTES`] - [`HEADER_BYTES`].
    pub payload_bytes: u16,
    /// The last field: a stamp, or padding; see [`PacketHeader::ticks`] and [`PacketHeader::padding`].
    pub field: u32,
}

impl PacketHeader {
    /// The header in 12 bytes; `None` without the magic, of an unknown type, or of a size below its own.
    pub fn decode(bytes: &[u8; HEADER_BYTES]) -> Option<Self> {
        let rest = bytes.strip_prefix(&PACKET_MAGIC)?;
        // The only field that is big-endian.
        let size = u16_at(rest, 4)?.swap_bytes();
        Some(Self {
            kind: PacketKind::from_code(u16_at(rest, 0)?)?,
            id: u16_at(rest, 2)?,
            payload_bytes: size.checked_sub(HEADER_BYTES as u16)?,
            field: u32_at(rest, 6)?,
        })
    }

    /// The 12 bytes; a payload that does not fit the size field is `None`.
    pub fn encode(&self) -> Option<[u8; HEADER_BYTES]> {
        let size = self.payload_bytes.checked_add(HEADER_BYTES as u16)?;
        let [magic0, magic1] = PACKET_MAGIC;
        let [kind0, kind1] = self.kind.code().to_le_bytes();
        let [id0, id1] = self.id.to_le_bytes();
        let [size0, size1] = size.to_be_bytes();
        let [a, b, c, d] = self.field.to_le_bytes();
        Some([
            magic0, magic1, kind0, kind1, id0, id1, size0, size1, a, b, c, d,
        ])
    }

    /// The stamp; `None` in a START packet of depth, which has padding there.
    pub fn ticks(&self) -> Option<DeviceTicks> {
        (!self.has_padding()).then_some(DeviceTicks(self.field))
    }

    /// The padding; none but in a START packet of depth.
    pub fn padding(&self) -> Padding {
        if self.has_padding() {
            Padding::from_field(self.field)
        } else {
            Padding::default()
        }
    }

    fn has_padding(&self) -> bool {
        self.kind == PacketKind::Frame(StreamKind::Depth, PartKind::Start)
    }
}
