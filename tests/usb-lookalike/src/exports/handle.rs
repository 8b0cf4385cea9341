//! Opening, claiming, settings.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::c_int;
use std::ptr;

use crate::abi::{
    ERROR_ACCESS, ERROR_BUSY, ERROR_INVALID_PARAM, ERROR_NO_DEVICE, ERROR_NOT_FOUND,
    ERROR_NOT_SUPPORTED, Opaque, SUCCESS,
};
use crate::exports::{device, device_parts, number, opaque};
use crate::world::{Camera, now_nanos, wake_all, with_world};

/// # Safety
/// `handle` is a place for a pointer.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_open(device: Opaque, handle: *mut Opaque) -> c_int {
    let (context, camera) = device_parts(device);
    let opened = with_world(|world| {
        let found = world.cameras.get(camera).ok_or(ERROR_NO_DEVICE)?;
        if found.bus.camera().is_gone() {
            return Err(ERROR_NO_DEVICE);
        }
        if found.config.is_forbidden {
            return Err(ERROR_ACCESS);
        }
        Ok(world.open(camera, context))
    });
    match opened {
        // SAFETY: the caller gives a place for the handle.
        Ok(opened) => unsafe {
            handle.write(opaque(opened));
            SUCCESS
        },
        Err(code) => code,
    }
}

#[unsafe(no_mangle)]
extern "C" fn libusb_open_device_with_vid_pid(
    _context: Opaque,
    _vendor: u16,
    _product: u16,
) -> Opaque {
    ptr::null_mut()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_close(handle: Opaque) {
    with_world(|world| world.close(number(handle)));
    wake_all();
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_device(handle: Opaque) -> Opaque {
    with_world(|world| {
        let handle = world.handles.get(&number(handle));
        handle.map_or(ptr::null_mut(), |handle| {
            device(handle.context, handle.camera)
        })
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_claim_interface(handle: Opaque, interface: c_int) -> c_int {
    let own = number(handle);
    with_camera(handle, |camera| {
        if interface != 0 {
            return SUCCESS;
        }
        let is_taken = camera.claimed_by.is_some_and(|claimed| claimed != own);
        if is_taken || camera.config.is_busy || camera.has_kernel_driver {
            return ERROR_BUSY;
        }
        camera.claimed_by = Some(own);
        SUCCESS
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_release_interface(handle: Opaque, interface: c_int) -> c_int {
    let own = number(handle);
    with_camera(handle, |camera| {
        if interface == 0
            && camera
                .claimed_by
                .take_if(|claimed| *claimed == own)
                .is_none()
        {
            return ERROR_NOT_FOUND;
        }
        SUCCESS
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_set_interface_alt_setting(
    handle: Opaque,
    interface: c_int,
    setting: c_int,
) -> c_int {
    let own = number(handle);
    let code = with_camera(handle, |camera| {
        let Ok(setting) = u8::try_from(setting) else {
            return ERROR_INVALID_PARAM;
        };
        if interface != 0 || camera.claimed_by != Some(own) {
            return ERROR_NOT_FOUND;
        }
        if !camera.bus.set_alt_setting(now_nanos(), setting) {
            return ERROR_NOT_FOUND;
        }
        camera.alt_setting = setting;
        SUCCESS
    });
    wake_all();
    code
}

/// # Safety
/// `value` is a place for a number.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_configuration(handle: Opaque, value: *mut c_int) -> c_int {
    let code = with_camera(handle, |_| SUCCESS);
    if code == SUCCESS {
        // SAFETY: the caller gives a place for the number.
        unsafe { value.write(1) };
    }
    code
}

#[unsafe(no_mangle)]
extern "C" fn libusb_set_configuration(handle: Opaque, value: c_int) -> c_int {
    with_camera(
        handle,
        |_| {
            if value == 1 { SUCCESS } else { ERROR_NOT_FOUND }
        },
    )
}

#[unsafe(no_mangle)]
extern "C" fn libusb_clear_halt(handle: Opaque, _endpoint: u8) -> c_int {
    with_camera(handle, |_| SUCCESS)
}

#[unsafe(no_mangle)]
extern "C" fn libusb_reset_device(handle: Opaque) -> c_int {
    let code = with_camera(handle, |camera| {
        camera.bus.set_alt_setting(now_nanos(), 0);
        camera.alt_setting = 0;
        SUCCESS
    });
    wake_all();
    code
}

#[unsafe(no_mangle)]
extern "C" fn libusb_kernel_driver_active(handle: Opaque, interface: c_int) -> c_int {
    with_camera(handle, |camera| {
        c_int::from(interface == 0 && camera.has_kernel_driver)
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_detach_kernel_driver(handle: Opaque, interface: c_int) -> c_int {
    with_camera(handle, |camera| {
        if interface != 0 || !camera.has_kernel_driver {
            return ERROR_NOT_FOUND;
        }
        camera.has_kernel_driver = false;
        SUCCESS
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_attach_kernel_driver(handle: Opaque, _interface: c_int) -> c_int {
    with_camera(handle, |_| ERROR_NOT_FOUND)
}

#[unsafe(no_mangle)]
extern "C" fn libusb_set_auto_detach_kernel_driver(handle: Opaque, enable: c_int) -> c_int {
    with_camera(handle, |camera| {
        // Detached at once instead of at the claim: there is nobody to see the difference.
        camera.has_kernel_driver &= enable == 0;
        SUCCESS
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_wrap_sys_device(
    _context: Opaque,
    _file: isize,
    _handle: *mut Opaque,
) -> c_int {
    ERROR_NOT_SUPPORTED
}

fn with_camera(handle: Opaque, action: impl FnOnce(&mut Camera) -> c_int) -> c_int {
    with_world(|world| match world.camera_of(number(handle)) {
        Some(camera) if !camera.bus.camera().is_gone() => action(camera),
        _ => ERROR_NO_DEVICE,
    })
}
