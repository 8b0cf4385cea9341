//! Control transfers as USB has them.

use ps1080::usb::{REQUEST_TYPE_IN, REQUEST_TYPE_OUT};

/// The eight bytes that begin a control transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// `bmRequestType`; bit 7 set: data come from the camera.
    pub request_type: u8,
    /// `bRequest`.
    pub request: u8,
    /// `wValue`.
    pub value: u16,
    /// `wIndex`.
    pub index: u16,
    /// `wLength`, bytes of the data stage at most.
    pub length: u16,
}

impl Setup {
    /// Of a request of the host protocol in `length` bytes.
    pub fn vendor_out(length: u16) -> Self {
        Self::vendor(REQUEST_TYPE_OUT, length)
    }

    /// That asks for a reply.
    pub fn vendor_in(length: u16) -> Self {
        Self::vendor(REQUEST_TYPE_IN, length)
    }

    fn vendor(request_type: u8, length: u16) -> Self {
        Self {
            request_type,
            request: 0,
            value: 0,
            index: 0,
            length,
        }
    }

    /// Whether data come from the camera.
    pub fn is_in(self) -> bool {
        self.request_type & 0x80 != 0
    }
}

/// How a control transfer ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// After this many bytes of the data stage; 0 of a reply means that it is not ready.
    Done(usize),
    /// The camera does not know the request.
    Stall,
    /// Not at all: the host's timeout ends it.
    NoAnswer,
    /// The camera has been unplugged.
    Gone,
}

/// Standard requests to device, interface and endpoint.
pub(crate) mod standard {
    pub(crate) const GET_STATUS: u8 = 0;
    pub(crate) const CLEAR_FEATURE: u8 = 1;
    pub(crate) const SET_FEATURE: u8 = 3;
    pub(crate) const GET_DESCRIPTOR: u8 = 6;
    pub(crate) const GET_CONFIGURATION: u8 = 8;
    pub(crate) const SET_CONFIGURATION: u8 = 9;
    pub(crate) const GET_INTERFACE: u8 = 10;
    pub(crate) const SET_INTERFACE: u8 = 11;
}
