//! Requests, with what they carry.

use core::fmt;

use crate::host::Opcode;
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

    pub(super) fn decode(payload: &[u8]) -> Option<Self> {
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
}
