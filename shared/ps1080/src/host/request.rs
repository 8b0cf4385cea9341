//! Requests, with what they carry.

use core::fmt;

use crate::bytes::{FieldWriter, u16_at, u32_at};
use crate::host::{HOST_HEADER_BYTES, MAX_HOST_PACKET_BYTES, Opcode, REQUEST_MAGIC};
use crate::parameter::Parameter;

/// A few words of a request's payload.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct WordList {
    words: [u16; Self::MAX_COUNT],
    count: usize,
}

impl WordList {
    /// Words that it can hold: eight parameters with their values.
    pub const MAX_COUNT: usize = 16;

    /// A list; `None` for more than [`Self::MAX_COUNT`].
    pub fn new(words: &[u16]) -> Option<Self> {
        let mut list = Self::default();
        list.words.get_mut(..words.len())?.copy_from_slice(words);
        list.count = words.len();
        Some(list)
    }

    /// The words.
    pub fn as_slice(&self) -> &[u16] {
        self.words.get(..self.count).unwrap_or_default()
    }

    fn decode(payload: &[u8]) -> Option<Self> {
        let mut list = Self::default();
        for (index, word) in payload.as_chunks().0.iter().enumerate() {
            *list.words.get_mut(index)? = u16::from_le_bytes(*word);
            list.count = index + 1;
        }
        Some(list)
    }
}

/// Blocks of ALGORITHM_PARAMS; see [`crate::blocks`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum AlgorithmKind {
    /// The constant shift.
    DepthInfo = 0,
    /// Coefficients of registration.
    Registration = 2,
    /// Lines that registration adds and drops.
    Padding = 3,
    /// From units of blanking to microseconds.
    Blanking = 6,
    /// Name of the device.
    DeviceInfo = 7,
    /// Ticks per microsecond.
    Frequency = 0x80,
}

impl AlgorithmKind {
    /// The kind of a number.
    pub fn from_code(code: u16) -> Option<Self> {
        [
            Self::DepthInfo,
            Self::Registration,
            Self::Padding,
            Self::Blanking,
            Self::DeviceInfo,
            Self::Frequency,
        ]
        .into_iter()
        .find(|kind| *kind as u16 == code)
    }
}

/// A request. Numbers whose meaning the other side judges are as on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(
    missing_docs,
    reason = "the fields are the protocol's; section 3 explains them"
)]
pub enum Request {
    GetVersion,
    KeepAlive,
    GetParam {
        id: u16,
    },
    /// Ids and values by turns.
    SetParam {
        pairs: WordList,
    },
    /// From `offset`, in 32-bit units.
    GetFixedParams {
        offset: u16,
    },
    GetMode,
    SetMode {
        mode: u16,
    },
    GetLog,
    I2cWrite {
        bus: u16,
        slave: u16,
        words: WordList,
    },
    I2cRead {
        bus: u16,
        slave: u16,
        read_count: u16,
        words: WordList,
    },
    ReadAhb {
        address: u32,
    },
    WriteAhb {
        address: u32,
        value: u32,
        mask: u32,
    },
    /// As from firmware 5.1 on; from `offset`, in words.
    AlgorithmParams {
        kind: u16,
        resolution: u16,
        fps: u16,
        offset: u16,
    },
    SetCmosBlanking {
        units: u16,
        cmos: u16,
        frames: u16,
    },
    GetCmosBlanking {
        cmos: u16,
    },
    GetCmosPresets {
        cmos: u16,
    },
    GetSerialNumber,
    GetPlatformString,
    GetUsbCoreType,
    SetLedState {
        led: u16,
        state: u16,
    },
    EnableEmitter {
        on: u16,
    },
}

/// Why a packet is no request. What is known of it is there for the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestError {
    /// No header of a request.
    NotARequest,
    /// The size field does not agree with the bytes.
    Size {
        /// As sent.
        opcode: u16,
        /// As sent.
        id: u16,
    },
    /// The opcode is not known here.
    Unknown {
        /// As sent.
        opcode: u16,
        /// As sent.
        id: u16,
    },
    /// The payload is not that of the opcode.
    Payload {
        /// As sent.
        opcode: u16,
        /// As sent.
        id: u16,
    },
}

impl fmt::Display for RequestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotARequest => f.write_str("not a request"),
            Self::Size { opcode, .. } => write!(f, "request {opcode} of a wrong size"),
            Self::Unknown { opcode, .. } => write!(f, "unknown request {opcode}"),
            Self::Payload { opcode, .. } => write!(f, "request {opcode} with a wrong payload"),
        }
    }
}

impl core::error::Error for RequestError {}

impl Request {
    /// Reads one parameter.
    pub fn get(parameter: Parameter) -> Self {
        Self::GetParam { id: parameter.id() }
    }

    /// Writes one parameter.
    pub fn set(parameter: Parameter, value: u16) -> Self {
        let mut pairs = WordList::default();
        pairs.words[0] = parameter.id();
        pairs.words[1] = value;
        pairs.count = 2;
        Self::SetParam { pairs }
    }

    /// Writes several parameters in one request, as cropping must be written; `None` for more than eight.
    pub fn set_all(values: &[(Parameter, u16)]) -> Option<Self> {
        let mut pairs = WordList::default();
        for (place, (parameter, value)) in values.iter().enumerate() {
            *pairs.words.get_mut(2 * place)? = parameter.id();
            *pairs.words.get_mut(2 * place + 1)? = *value;
            pairs.count = 2 * place + 2;
        }
        Some(Self::SetParam { pairs })
    }

    /// Asks for a block from `offset` (words) on.
    pub fn algorithm(kind: AlgorithmKind, resolution: u16, fps: u16, offset: u16) -> Self {
        Self::AlgorithmParams {
            kind: kind as u16,
            resolution,
            fps,
            offset,
        }
    }

    /// What is asked.
    pub fn opcode(&self) -> Opcode {
        match self {
            Self::GetVersion => Opcode::GetVersion,
            Self::KeepAlive => Opcode::KeepAlive,
            Self::GetParam { .. } => Opcode::GetParam,
            Self::SetParam { .. } => Opcode::SetParam,
            Self::GetFixedParams { .. } => Opcode::GetFixedParams,
            Self::GetMode => Opcode::GetMode,
            Self::SetMode { .. } => Opcode::SetMode,
            Self::GetLog => Opcode::GetLog,
            Self::I2cWrite { .. } => Opcode::I2cWrite,
            Self::I2cRead { .. } => Opcode::I2cRead,
            Self::ReadAhb { .. } => Opcode::ReadAhb,
            Self::WriteAhb { .. } => Opcode::WriteAhb,
            Self::AlgorithmParams { .. } => Opcode::AlgorithmParams,
            Self::SetCmosBlanking { .. } => Opcode::SetCmosBlanking,
            Self::GetCmosBlanking { .. } => Opcode::GetCmosBlanking,
            Self::GetCmosPresets { .. } => Opcode::GetCmosPresets,
            Self::GetSerialNumber => Opcode::GetSerialNumber,
            Self::GetPlatformString => Opcode::GetPlatformString,
            Self::GetUsbCoreType => Opcode::GetUsbCoreType,
            Self::SetLedState { .. } => Opcode::SetLedState,
            Self::EnableEmitter { .. } => Opcode::EnableEmitter,
        }
    }

    /// The packet, for the data stage of [`crate::usb::REQUEST_TYPE_OUT`]: how many bytes of `packet`.
    pub fn encode(&self, id: u16, packet: &mut [u8; MAX_HOST_PACKET_BYTES]) -> usize {
        let mut payload = [0; 64];
        // The largest payload is a list with three words before it.
        let payload_bytes = self.encode_payload(&mut payload).unwrap_or(0);
        let payload = payload.get(..payload_bytes).unwrap_or_default();
        let mut fields = FieldWriter::new(packet);
        let header = [payload_bytes as u16 / 2, self.opcode().code(), id];
        let written = fields.bytes(&REQUEST_MAGIC).and_then(|()| {
            header.iter().try_for_each(|&word| fields.u16(word))?;
            fields.bytes(payload)
        });
        written.map_or(0, |()| fields.filled())
    }

    fn encode_payload(&self, payload: &mut [u8]) -> Option<usize> {
        let mut fields = FieldWriter::new(payload);
        let mut words = |words: &[u16]| words.iter().try_for_each(|&word| fields.u16(word));
        match *self {
            Self::GetVersion
            | Self::KeepAlive
            | Self::GetMode
            | Self::GetLog
            | Self::GetSerialNumber
            | Self::GetPlatformString
            | Self::GetUsbCoreType => {}
            Self::GetParam { id: word }
            | Self::GetFixedParams { offset: word }
            | Self::SetMode { mode: word }
            | Self::GetCmosBlanking { cmos: word }
            | Self::GetCmosPresets { cmos: word }
            | Self::EnableEmitter { on: word } => words(&[word])?,
            Self::SetParam { ref pairs } => words(pairs.as_slice())?,
            Self::I2cWrite {
                bus,
                slave,
                words: ref data,
            } => {
                words(&[bus, slave])?;
                words(data.as_slice())?;
            }
            Self::I2cRead {
                bus,
                slave,
                read_count,
                words: ref data,
            } => {
                words(&[bus, slave, read_count])?;
                words(data.as_slice())?;
            }
            Self::AlgorithmParams {
                kind,
                resolution,
                fps,
                offset,
            } => {
                // The second word is a format that is always 0.
                words(&[kind, 0, resolution, fps, offset])?;
            }
            Self::SetCmosBlanking {
                units,
                cmos,
                frames,
            } => words(&[units, cmos, frames])?,
            Self::SetLedState { led, state } => words(&[led, state])?,
            Self::ReadAhb { address } => fields.u32(address)?,
            Self::WriteAhb {
                address,
                value,
                mask,
            } => {
                [address, value, mask]
                    .iter()
                    .try_for_each(|&word| fields.u32(word))?;
            }
        }
        Some(fields.filled())
    }

    /// Id and request of a packet.
    ///
    /// # Errors
    /// What is wrong with it: the camera answers [`crate::host::Nack::BadPacketSize`],
    /// [`crate::host::Nack::InvalidCommand`] or [`crate::host::Nack::BadCommandSize`].
    pub fn decode(packet: &[u8]) -> Result<(u16, Self), RequestError> {
        let header = |at| u16_at(packet, at).ok_or(RequestError::NotARequest);
        let (size, opcode, id) = (header(2)?, header(4)?, header(6)?);
        if !packet.starts_with(&REQUEST_MAGIC) {
            return Err(RequestError::NotARequest);
        }
        let payload = packet
            .get(HOST_HEADER_BYTES..)
            .filter(|payload| payload.len() == 2 * usize::from(size))
            .ok_or(RequestError::Size { opcode, id })?;
        let known = Opcode::from_code(opcode).ok_or(RequestError::Unknown { opcode, id })?;
        let request = Self::decode_payload(known, payload);
        Ok((id, request.ok_or(RequestError::Payload { opcode, id })?))
    }

    fn decode_payload(opcode: Opcode, payload: &[u8]) -> Option<Self> {
        let word = |index: usize| u16_at(payload, 2 * index);
        let list_from = |index: usize| WordList::decode(payload.get(2 * index..)?);
        let request = match opcode {
            Opcode::GetVersion => Self::GetVersion,
            Opcode::KeepAlive => Self::KeepAlive,
            Opcode::GetParam => Self::GetParam { id: word(0)? },
            Opcode::SetParam => {
                let pairs = list_from(0)?;
                if pairs.count == 0 || !pairs.count.is_multiple_of(2) {
                    return None;
                }
                Self::SetParam { pairs }
            }
            Opcode::GetFixedParams => Self::GetFixedParams { offset: word(0)? },
            Opcode::GetMode => Self::GetMode,
            Opcode::SetMode => Self::SetMode { mode: word(0)? },
            Opcode::GetLog => Self::GetLog,
            Opcode::I2cWrite => Self::I2cWrite {
                bus: word(0)?,
                slave: word(1)?,
                words: list_from(2)?,
            },
            Opcode::I2cRead => Self::I2cRead {
                bus: word(0)?,
                slave: word(1)?,
                read_count: word(2)?,
                words: list_from(3)?,
            },
            Opcode::ReadAhb => Self::ReadAhb {
                address: u32_at(payload, 0)?,
            },
            Opcode::WriteAhb => Self::WriteAhb {
                address: u32_at(payload, 0)?,
                value: u32_at(payload, 4)?,
                mask: u32_at(payload, 8)?,
            },
            Opcode::AlgorithmParams => Self::AlgorithmParams {
                kind: word(0)?,
                resolution: word(2)?,
                fps: word(3)?,
                offset: word(4)?,
            },
            Opcode::SetCmosBlanking => Self::SetCmosBlanking {
                units: word(0)?,
                cmos: word(1)?,
                frames: word(2)?,
            },
            Opcode::GetCmosBlanking => Self::GetCmosBlanking { cmos: word(0)? },
            Opcode::GetCmosPresets => Self::GetCmosPresets { cmos: word(0)? },
            Opcode::GetSerialNumber => Self::GetSerialNumber,
            Opcode::GetPlatformString => Self::GetPlatformString,
            Opcode::GetUsbCoreType => Self::GetUsbCoreType,
            Opcode::SetLedState => Self::SetLedState {
                led: word(0)?,
                state: word(1)?,
            },
            Opcode::EnableEmitter => Self::EnableEmitter { on: word(0)? },
        };
        // Nothing more than what the request has.
        let mut again = [0; 64];
        let byte_count = request.encode_payload(&mut again)?;
        (byte_count == payload.len()).then_some(request)
    }
}
