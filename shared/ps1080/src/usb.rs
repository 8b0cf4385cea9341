//! How the camera looks on the bus (protocol section 1).

use crate::firmware::{Feature, Firmware};
use crate::stream::StreamKind;

/// Vendor of all these cameras.
pub const VENDOR_ID: u16 = 0x1d27;
/// Products that speak this protocol. They do not tell a Carmine 1.08 from a 1.09.
pub const PRODUCT_IDS: [u16; 4] = [0x0500, 0x0600, 0x0601, 0x0609];
/// The interface with the data endpoints.
pub const INTERFACE: u8 = 0;

/// `bmRequestType` of a request: vendor, to the device. All other fields of the set-up are 0.
pub const REQUEST_TYPE_OUT: u8 = 0x40;
/// `bmRequestType` of a reply: vendor, from the device.
pub const REQUEST_TYPE_IN: u8 = 0xC0;

/// How data come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TransferKind {
    /// Lossless, without a promised rate.
    Bulk,
    /// At a promised rate, lossy.
    Isochronous,
}

/// Address of the endpoint of a stream; colour and infrared share one.
pub fn endpoint(firmware: Firmware, stream: StreamKind) -> u8 {
    let is_first = firmware.has(Feature::DepthOnFirstEndpoint) == (stream == StreamKind::Depth);
    if is_first { 0x81 } else { 0x82 }
}

/// Alternate setting of [`INTERFACE`] in which the endpoints are of `kind`.
pub fn alternate_setting(firmware: Firmware, kind: TransferKind) -> u8 {
    let is_zero = firmware.has(Feature::BulkIsSetting0) == (kind == TransferKind::Bulk);
    u8::from(!is_zero)
}
