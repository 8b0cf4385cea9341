//! What can be asked, and how it is refused.

use core::fmt;

/// Requests that glint sends or a virtual camera answers. Those that write the flash are not even named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
#[expect(
    missing_docs,
    reason = "the names are the protocol's; section 3 explains them"
)]
pub enum Opcode {
    GetVersion = 0,
    KeepAlive = 1,
    GetParam = 2,
    SetParam = 3,
    GetFixedParams = 4,
    GetMode = 5,
    SetMode = 6,
    GetLog = 7,
    I2cWrite = 10,
    I2cRead = 11,
    ReadAhb = 20,
    WriteAhb = 21,
    AlgorithmParams = 22,
    SetCmosBlanking = 34,
    GetCmosBlanking = 35,
    GetCmosPresets = 36,
    GetSerialNumber = 37,
    GetPlatformString = 39,
    GetUsbCoreType = 40,
    SetLedState = 41,
    EnableEmitter = 42,
}

impl Opcode {
    /// All, ascending.
    pub const ALL: [Self; 21] = [
        Self::GetVersion,
        Self::KeepAlive,
        Self::GetParam,
        Self::SetParam,
        Self::GetFixedParams,
        Self::GetMode,
        Self::SetMode,
        Self::GetLog,
        Self::I2cWrite,
        Self::I2cRead,
        Self::ReadAhb,
        Self::WriteAhb,
        Self::AlgorithmParams,
        Self::SetCmosBlanking,
        Self::GetCmosBlanking,
        Self::GetCmosPresets,
        Self::GetSerialNumber,
        Self::GetPlatformString,
        Self::GetUsbCoreType,
        Self::SetLedState,
        Self::EnableEmitter,
    ];

    /// The opcode of a number.
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|opcode| opcode.code() == code)
    }

    /// The number.
    pub fn code(self) -> u16 {
        self as u16
    }
}

/// Why the camera refuses (protocol section 2). 0 is no refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Nack {
    /// 1.
    Unknown,
    /// 2: there is no such opcode.
    InvalidCommand,
    /// 3.
    BadCrc,
    /// 4.
    BadPacketSize,
    /// 5: a value that the camera does not serve, or not now.
    BadParameters,
    /// 6: a sensor does not answer.
    I2cFailed,
    /// 12.
    BadCommandSize,
    /// 13: to be asked again after a second, three times in all.
    NotReady,
    /// 14.
    Overflow,
    /// 15.
    OverlayNotLoaded,
    /// 7 to 11 and 16, about files, and numbers that the protocol document does not know.
    Other(u16),
}

impl Nack {
    /// The refusal of an error word; `None` for 0.
    pub fn from_code(code: u16) -> Option<Self> {
        Some(match code {
            0 => return None,
            1 => Self::Unknown,
            2 => Self::InvalidCommand,
            3 => Self::BadCrc,
            4 => Self::BadPacketSize,
            5 => Self::BadParameters,
            6 => Self::I2cFailed,
            12 => Self::BadCommandSize,
            13 => Self::NotReady,
            14 => Self::Overflow,
            15 => Self::OverlayNotLoaded,
            other => Self::Other(other),
        })
    }

    /// The error word.
    pub fn code(self) -> u16 {
        match self {
            Self::Unknown => 1,
            Self::InvalidCommand => 2,
            Self::BadCrc => 3,
            Self::BadPacketSize => 4,
            Self::BadParameters => 5,
            Self::I2cFailed => 6,
            Self::BadCommandSize => 12,
            Self::NotReady => 13,
            Self::Overflow => 14,
            Self::OverlayNotLoaded => 15,
            Self::Other(code) => code,
        }
    }
}

impl fmt::Display for Nack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Self::Unknown => "unknown error",
            Self::InvalidCommand => "invalid command",
            Self::BadCrc => "bad checksum",
            Self::BadPacketSize => "bad packet size",
            Self::BadParameters => "bad parameters",
            Self::I2cFailed => "sensor does not answer",
            Self::BadCommandSize => "bad command size",
            Self::NotReady => "not ready",
            Self::Overflow => "overflow",
            Self::OverlayNotLoaded => "overlay not loaded",
            Self::Other(_) => "other error",
        };
        write!(f, "{name} ({})", self.code())
    }
}
