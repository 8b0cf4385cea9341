//! Structures and numbers of libusb-1.0, as its header has them. The names are libusb's without their prefix.

use std::ffi::{c_char, c_int, c_long, c_uchar, c_uint, c_ushort, c_void};

pub(crate) const SUCCESS: c_int = 0;
pub(crate) const ERROR_INVALID_PARAM: c_int = -2;
pub(crate) const ERROR_ACCESS: c_int = -3;
pub(crate) const ERROR_NO_DEVICE: c_int = -4;
pub(crate) const ERROR_NOT_FOUND: c_int = -5;
pub(crate) const ERROR_BUSY: c_int = -6;
pub(crate) const ERROR_TIMEOUT: c_int = -7;
pub(crate) const ERROR_PIPE: c_int = -9;
pub(crate) const ERROR_NOT_SUPPORTED: c_int = -12;
pub(crate) const ERROR_OTHER: c_int = -99;

pub(crate) const TRANSFER_COMPLETED: c_int = 0;
pub(crate) const TRANSFER_TIMED_OUT: c_int = 2;
pub(crate) const TRANSFER_CANCELLED: c_int = 3;
pub(crate) const TRANSFER_STALL: c_int = 4;
pub(crate) const TRANSFER_NO_DEVICE: c_int = 5;

pub(crate) const TYPE_CONTROL: c_uchar = 0;
pub(crate) const TYPE_ISOCHRONOUS: c_uchar = 1;

pub(crate) const FLAG_FREE_BUFFER: u8 = 1 << 1;
pub(crate) const FLAG_FREE_TRANSFER: u8 = 1 << 2;

pub(crate) const CAP_HAS_CAPABILITY: u32 = 0;
pub(crate) const CAP_SUPPORTS_DETACH_KERNEL_DRIVER: u32 = 0x0101;

/// A context, device or handle: a number in the shape of a pointer.
pub(crate) type Opaque = *mut c_void;

/// Bytes of the set-up in the buffer of a control transfer.
pub(crate) const CONTROL_SETUP_BYTES: usize = 8;

#[repr(C)]
pub(crate) struct Version {
    pub(crate) major: u16,
    pub(crate) minor: u16,
    pub(crate) micro: u16,
    pub(crate) nano: u16,
    pub(crate) rc: *const c_char,
    pub(crate) describe: *const c_char,
}

#[repr(C)]
pub(crate) struct Timeval {
    pub(crate) seconds: c_long,
    pub(crate) microseconds: c_long,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct DeviceDescriptor {
    pub(crate) length: u8,
    pub(crate) descriptor_type: u8,
    pub(crate) usb_version: u16,
    pub(crate) class: u8,
    pub(crate) subclass: u8,
    pub(crate) protocol: u8,
    pub(crate) max_packet_size0: u8,
    pub(crate) vendor: u16,
    pub(crate) product: u16,
    pub(crate) device_version: u16,
    pub(crate) manufacturer_index: u8,
    pub(crate) product_index: u8,
    pub(crate) serial_number_index: u8,
    pub(crate) configuration_count: u8,
}

#[repr(C)]
pub(crate) struct ConfigDescriptor {
    pub(crate) length: u8,
    pub(crate) descriptor_type: u8,
    pub(crate) total_length: u16,
    pub(crate) interface_count: u8,
    pub(crate) value: u8,
    pub(crate) text_index: u8,
    pub(crate) attributes: u8,
    pub(crate) max_power: u8,
    pub(crate) interfaces: *const Interface,
    pub(crate) extra: *const c_uchar,
    pub(crate) extra_length: c_int,
}

#[repr(C)]
pub(crate) struct Interface {
    pub(crate) settings: *const InterfaceDescriptor,
    pub(crate) setting_count: c_int,
}

#[repr(C)]
pub(crate) struct InterfaceDescriptor {
    pub(crate) length: u8,
    pub(crate) descriptor_type: u8,
    pub(crate) number: u8,
    pub(crate) alternate: u8,
    pub(crate) endpoint_count: u8,
    pub(crate) class: u8,
    pub(crate) subclass: u8,
    pub(crate) protocol: u8,
    pub(crate) text_index: u8,
    pub(crate) endpoints: *const EndpointDescriptor,
    pub(crate) extra: *const c_uchar,
    pub(crate) extra_length: c_int,
}

#[repr(C)]
pub(crate) struct EndpointDescriptor {
    pub(crate) length: u8,
    pub(crate) descriptor_type: u8,
    pub(crate) address: u8,
    pub(crate) attributes: u8,
    pub(crate) max_packet_size: u16,
    pub(crate) interval: u8,
    pub(crate) refresh: u8,
    pub(crate) synch_address: u8,
    pub(crate) extra: *const c_uchar,
    pub(crate) extra_length: c_int,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct IsoPacket {
    pub(crate) length: c_uint,
    pub(crate) actual_length: c_uint,
    pub(crate) status: c_int,
}

#[repr(C)]
pub(crate) struct Transfer {
    pub(crate) handle: Opaque,
    pub(crate) flags: u8,
    pub(crate) endpoint: c_uchar,
    pub(crate) kind: c_uchar,
    pub(crate) timeout_millis: c_uint,
    pub(crate) status: c_int,
    pub(crate) length: c_int,
    pub(crate) actual_length: c_int,
    pub(crate) callback: Option<extern "C" fn(*mut Transfer)>,
    pub(crate) user_data: *mut c_void,
    pub(crate) buffer: *mut c_uchar,
    pub(crate) iso_packet_count: c_int,
    /// As many as `alloc_transfer` was asked for.
    pub(crate) iso_packets: [IsoPacket; 0],
}

#[repr(C)]
pub(crate) struct Pollfd {
    pub(crate) fd: c_int,
    pub(crate) events: c_ushort,
}
