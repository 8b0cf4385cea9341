//! What these cameras do not have: USB 3, streams, hot-plug notices, files to poll. The functions are there so that
//! programs that are linked to them start.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::{c_int, c_uchar, c_void};
use std::ptr;

use crate::abi::{ERROR_NOT_FOUND, ERROR_NOT_SUPPORTED, ERROR_OTHER, Opaque, Pollfd, Transfer};

#[unsafe(no_mangle)]
extern "C" fn libusb_get_bos_descriptor(_handle: Opaque, _out: *mut *mut c_void) -> c_int {
    ERROR_NOT_FOUND
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_bos_descriptor(_descriptor: *mut c_void) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_ss_endpoint_companion_descriptor(
    _context: Opaque,
    _endpoint: *const c_void,
    _out: *mut *mut c_void,
) -> c_int {
    ERROR_NOT_FOUND
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_ss_endpoint_companion_descriptor(_descriptor: *mut c_void) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_usb_2_0_extension_descriptor(
    _context: Opaque,
    _capability: *mut c_void,
    _out: *mut *mut c_void,
) -> c_int {
    ERROR_NOT_FOUND
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_usb_2_0_extension_descriptor(_descriptor: *mut c_void) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_ss_usb_device_capability_descriptor(
    _context: Opaque,
    _capability: *mut c_void,
    _out: *mut *mut c_void,
) -> c_int {
    ERROR_NOT_FOUND
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_ss_usb_device_capability_descriptor(_descriptor: *mut c_void) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_container_id_descriptor(
    _context: Opaque,
    _capability: *mut c_void,
    _out: *mut *mut c_void,
) -> c_int {
    ERROR_NOT_FOUND
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_container_id_descriptor(_descriptor: *mut c_void) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_alloc_streams(
    _handle: Opaque,
    _count: u32,
    _endpoints: *mut c_uchar,
    _endpoint_count: c_int,
) -> c_int {
    ERROR_NOT_SUPPORTED
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_streams(
    _handle: Opaque,
    _endpoints: *mut c_uchar,
    _endpoint_count: c_int,
) -> c_int {
    ERROR_NOT_SUPPORTED
}

#[unsafe(no_mangle)]
extern "C" fn libusb_transfer_set_stream_id(_transfer: *mut Transfer, _stream: u32) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_transfer_get_stream_id(_transfer: *mut Transfer) -> u32 {
    0
}

/// Memory of the kernel for transfers: programs go on with their own.
#[unsafe(no_mangle)]
extern "C" fn libusb_dev_mem_alloc(_handle: Opaque, _length: usize) -> *mut c_uchar {
    ptr::null_mut()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_dev_mem_free(_handle: Opaque, _memory: *mut c_uchar, _length: usize) -> c_int {
    ERROR_OTHER
}

#[unsafe(no_mangle)]
extern "C" fn libusb_hotplug_register_callback(
    _context: Opaque,
    _events: c_int,
    _flags: c_int,
    _vendor: c_int,
    _product: c_int,
    _class: c_int,
    _callback: *mut c_void,
    _user_data: *mut c_void,
    _out: *mut c_int,
) -> c_int {
    ERROR_NOT_SUPPORTED
}

#[unsafe(no_mangle)]
extern "C" fn libusb_hotplug_deregister_callback(_context: Opaque, _callback: c_int) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_hotplug_get_user_data(_context: Opaque, _callback: c_int) -> *mut c_void {
    ptr::null_mut()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_pollfds(_context: Opaque) -> *const *const Pollfd {
    ptr::null()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_free_pollfds(_files: *const *const Pollfd) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_set_pollfd_notifiers(
    _context: Opaque,
    _added: *mut c_void,
    _removed: *mut c_void,
    _user_data: *mut c_void,
) {
}
