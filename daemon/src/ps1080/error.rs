//! Why a camera cannot be used.

use ps1080::blocks::BlockError;
use ps1080::firmware::Firmware;
use ps1080::host::{Nack, Opcode, ReplyError};

use crate::ps1080::usb::UsbError;

/// What goes wrong between plugging in and the first frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// On the level of USB.
    #[error("{request:?}: {error}")]
    Usb {
        /// What was asked.
        request: Opcode,
        /// What happened.
        error: UsbError,
    },
    /// Of an endpoint or a setting.
    #[error("{what}: {error}")]
    Endpoint {
        /// What was tried.
        what: &'static str,
        /// What happened.
        error: UsbError,
    },
    /// The camera refuses.
    #[error("{request:?}: the camera says {nack}")]
    Refused {
        /// What was asked.
        request: Opcode,
        /// Why not.
        nack: Nack,
    },
    /// A reply that is none.
    #[error("{request:?}: {error}")]
    Reply {
        /// What was asked.
        request: Opcode,
        /// What came.
        error: ReplyError,
    },
    /// No reply.
    #[error("{request:?}: no answer for {seconds} s; unplug the camera and plug it in again")]
    Silent {
        /// What was asked.
        request: Opcode,
        /// How long was waited.
        seconds: i64,
    },
    /// A block of numbers that is none.
    #[error("{what}: {error}")]
    Block {
        /// Which.
        what: &'static str,
        /// What is wrong with its parts.
        error: BlockError,
    },
    /// Numbers that cannot be.
    #[error("the camera's {what} cannot be used")]
    Numbers {
        /// Which.
        what: &'static str,
    },
    /// The version is none.
    #[error("the camera's version cannot be read")]
    Version,
    /// A firmware that speaks another language.
    #[error(
        "firmware {0} is not known: glintd speaks 5.1 to 5.8; update the camera with its maker's tool"
    )]
    Firmware(Firmware),
    /// Damaged flash.
    #[error("the camera is in safe mode: its flash is damaged, and glintd does not repair it")]
    SafeMode,
    /// Another mode.
    #[error("the camera is in mode {0} instead of the normal one; unplug it and plug it in again")]
    Mode(u16),
    /// A mode of colour that is not offered.
    #[error("the camera does not offer this colour: {wanted}; it has {offered}")]
    NotOffered {
        /// What was asked for.
        wanted: String,
        /// What there is.
        offered: String,
    },
    /// Wishes that no camera of this kind fulfils together.
    #[error("{0}")]
    Contradiction(&'static str),
    /// A projector that this firmware does not switch.
    #[error(
        "firmware {0} cannot switch the emitter: that needs 5.8.15; cover the projector, or leave `emitter=off` out"
    )]
    EmitterSwitch(Firmware),
}

impl CameraError {
    /// Whether the camera has been unplugged.
    pub fn is_gone(&self) -> bool {
        matches!(
            self,
            Self::Usb {
                error: UsbError::Gone,
                ..
            } | Self::Endpoint {
                error: UsbError::Gone,
                ..
            }
        )
    }
}
