//! Contexts, version, options.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::{c_int, c_void};

use crate::abi::{CAP_HAS_CAPABILITY, CAP_SUPPORTS_DETACH_KERNEL_DRIVER, Opaque, SUCCESS, Version};
use crate::exports::{context_number, opaque};
use crate::world::with_world;

struct Static<T>(T);

// SAFETY: the pointers in it are to texts that never change.
unsafe impl<T> Sync for Static<T> {}

/// The version whose header `abi` follows.
static VERSION: Static<Version> = Static(Version {
    major: 1,
    minor: 0,
    micro: 26,
    nano: 11724,
    rc: c"".as_ptr(),
    describe: c"virtual cameras".as_ptr(),
});

#[unsafe(no_mangle)]
extern "C" fn libusb_get_version() -> *const Version {
    &raw const VERSION.0
}

#[unsafe(no_mangle)]
extern "C" fn libusb_has_capability(capability: u32) -> c_int {
    c_int::from(matches!(
        capability,
        CAP_HAS_CAPABILITY | CAP_SUPPORTS_DETACH_KERNEL_DRIVER
    ))
}

/// # Safety
/// `context` is null or a place for a pointer.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_init(context: *mut Opaque) -> c_int {
    let number = with_world(|world| {
        if context.is_null() {
            crate::world::DEFAULT_CONTEXT
        } else {
            world.add_context()
        }
    });
    if !context.is_null() {
        // SAFETY: the caller gives a place for a pointer where it gives any.
        unsafe { context.write(opaque(number)) };
    }
    SUCCESS
}

/// # Safety
/// As of [`libusb_init`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_init_context(
    context: *mut Opaque,
    _options: *const c_void,
    _option_count: c_int,
) -> c_int {
    // SAFETY: the same promise.
    unsafe { libusb_init(context) }
}

#[unsafe(no_mangle)]
extern "C" fn libusb_exit(context: Opaque) {
    with_world(|world| world.remove_context(context_number(context)));
}

#[unsafe(no_mangle)]
extern "C" fn libusb_set_debug(_context: Opaque, _level: c_int) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_set_log_cb(_context: Opaque, _callback: *mut c_void, _mode: c_int) {}

/// In C it takes any number of arguments; those that follow are never looked at.
#[unsafe(no_mangle)]
extern "C" fn libusb_set_option(_context: Opaque, _option: u32) -> c_int {
    SUCCESS
}

#[unsafe(no_mangle)]
extern "C" fn libusb_setlocale(_locale: *const std::ffi::c_char) -> c_int {
    SUCCESS
}
