//! Names and sentences of errors.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::{CStr, c_char, c_int};

fn name(code: c_int) -> &'static CStr {
    match code {
        0 => c"LIBUSB_SUCCESS",
        -1 => c"LIBUSB_ERROR_IO",
        -2 => c"LIBUSB_ERROR_INVALID_PARAM",
        -3 => c"LIBUSB_ERROR_ACCESS",
        -4 => c"LIBUSB_ERROR_NO_DEVICE",
        -5 => c"LIBUSB_ERROR_NOT_FOUND",
        -6 => c"LIBUSB_ERROR_BUSY",
        -7 => c"LIBUSB_ERROR_TIMEOUT",
        -8 => c"LIBUSB_ERROR_OVERFLOW",
        -9 => c"LIBUSB_ERROR_PIPE",
        -10 => c"LIBUSB_ERROR_INTERRUPTED",
        -11 => c"LIBUSB_ERROR_NO_MEM",
        -12 => c"LIBUSB_ERROR_NOT_SUPPORTED",
        -99 => c"LIBUSB_ERROR_OTHER",
        _ => c"**UNKNOWN**",
    }
}

fn sentence(code: c_int) -> &'static CStr {
    match code {
        0 => c"Success",
        -1 => c"Input/Output Error",
        -2 => c"Invalid parameter",
        -3 => c"Access denied (insufficient permissions)",
        -4 => c"No such device (it may have been disconnected)",
        -5 => c"Entity not found",
        -6 => c"Resource busy",
        -7 => c"Operation timed out",
        -8 => c"Overflow",
        -9 => c"Pipe error",
        -10 => c"System call interrupted (perhaps due to signal)",
        -11 => c"Insufficient memory",
        -12 => c"Operation not supported or unimplemented on this platform",
        _ => c"Other error",
    }
}

#[unsafe(no_mangle)]
extern "C" fn libusb_error_name(code: c_int) -> *const c_char {
    name(code).as_ptr()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_strerror(code: c_int) -> *const c_char {
    sentence(code).as_ptr()
}
