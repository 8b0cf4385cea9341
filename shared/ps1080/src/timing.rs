//! How long to wait where (protocol section 2). This crate has no clock: these are numbers for those who have.

use crate::firmware::Firmware;

/// What runs the USB side of the camera, by GET_USB_CORE_TYPE; no answer counts as [`UsbCore::Jungo`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum UsbCore {
    /// 0.
    #[default]
    Jungo,
    /// 1, slower.
    GadgetFs,
}

/// Waits in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Delays {
    /// Between two looks for a reply.
    pub receive_millis: u32,
    /// Before a request is sent.
    pub before_send_millis: u32,
    /// After it is sent.
    pub after_send_millis: u32,
    /// After a soft reset.
    pub soft_reset_millis: u32,
    /// After the mode of stream 1 (depth) is set.
    pub depth_mode_millis: u32,
    /// After the mode of another stream is set.
    pub stream_mode_millis: u32,
    /// After the parameter "flicker" is set.
    pub flicker_millis: u32,
}

impl Delays {
    /// Of a camera.
    pub fn of(firmware: Firmware, core: UsbCore) -> Self {
        let is_slow = firmware < Firmware::new(5, 3, 16);
        let slow = Self {
            receive_millis: 100,
            before_send_millis: 1,
            after_send_millis: 10,
            soft_reset_millis: 800,
            depth_mode_millis: 300,
            stream_mode_millis: 1,
            flicker_millis: if firmware == Firmware::new(5, 3, 15) {
                300
            } else {
                3000
            },
        };
        if is_slow {
            return slow;
        }
        let (receive_millis, before_send_millis, after_send_millis) = match core {
            UsbCore::Jungo => (1, 0, 0),
            UsbCore::GadgetFs => (100, 1, 10),
        };
        Self {
            receive_millis,
            before_send_millis,
            after_send_millis,
            soft_reset_millis: 1,
            depth_mode_millis: 1,
            stream_mode_millis: 1,
            flicker_millis: 1,
        }
    }
}
