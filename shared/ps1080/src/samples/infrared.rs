//! Rows of an infrared picture that are sent and that are shown (protocol section 7.9).

use crate::mode::Resolution;

/// The depth and infrared sensor, field 14 of the fixed parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DepthSensor {
    /// MT9M001.
    Mt9m001,
    /// AR0130.
    Ar0130,
    /// None, or one that the protocol document does not know.
    Other(u32),
}

impl DepthSensor {
    /// Of the field's value.
    pub fn from_code(code: u32) -> Self {
        match code {
            1 => Self::Mt9m001,
            2 => Self::Ar0130,
            other => Self::Other(other),
        }
    }

    /// The field's value.
    pub fn code(self) -> u32 {
        match self {
            Self::Mt9m001 => 1,
            Self::Ar0130 => 2,
            Self::Other(other) => other,
        }
    }
}

/// How many rows of an infrared picture come and how many it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InfraredRows {
    /// Rows in the payload: those above `shown` are to be dropped.
    pub sent: u16,
    /// Rows of the picture: those that are not sent are to be filled up.
    pub shown: u16,
}

impl InfraredRows {
    /// Of a whole picture; one that the camera crops has no rows of this kind.
    pub fn of(sensor: DepthSensor, resolution: Resolution) -> Self {
        let (_, shown) = resolution.size();
        let sent = match (sensor, resolution) {
            (DepthSensor::Mt9m001, Resolution::Qvga | Resolution::Vga) => shown + 8,
            (DepthSensor::Ar0130, Resolution::Sxga) => 960,
            _ => shown,
        };
        Self { sent, shown }
    }
}
