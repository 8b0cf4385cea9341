//! The list of devices and what is known of them without opening.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::c_int;
use std::ptr;

use crate::abi::{ERROR_NOT_FOUND, Opaque};
use crate::exports::{context_number, device, device_parts};
use crate::world::with_world;

const FIRST_ADDRESS: u8 = 7;
const ERROR_OVERFLOW: c_int = -8;

/// # Safety
/// `list` is a place for a pointer.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_device_list(context: Opaque, list: *mut *mut Opaque) -> isize {
    let context = context_number(context);
    let mut devices: Vec<Opaque> = with_world(|world| {
        let cameras = world.cameras.iter().enumerate();
        let there = cameras.filter(|(_, camera)| !camera.bus.camera().is_gone());
        there.map(|(index, _)| device(context, index)).collect()
    });
    let count = devices.len();
    devices.push(ptr::null_mut());
    let devices = Box::into_raw(devices.into_boxed_slice());
    // SAFETY: the caller gives a place for the list, which it gives back to `libusb_free_device_list`.
    unsafe { list.write(devices.cast()) };
    count.cast_signed()
}

/// # Safety
/// `list` is null or comes from [`libusb_get_device_list`] and is not used again.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_free_device_list(list: *mut Opaque, _unref: c_int) {
    if list.is_null() {
        return;
    }
    let mut count = 0;
    // SAFETY: the list ends with a null pointer, as it was made, and is freed as what it was allocated as.
    unsafe {
        while !list.add(count).read().is_null() {
            count += 1;
        }
        drop(Box::from_raw(ptr::slice_from_raw_parts_mut(
            list,
            count + 1,
        )));
    }
}

/// Devices live as long as the process: nothing to count.
#[unsafe(no_mangle)]
extern "C" fn libusb_ref_device(device: Opaque) -> Opaque {
    device
}

#[unsafe(no_mangle)]
extern "C" fn libusb_unref_device(_device: Opaque) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_parent(_device: Opaque) -> Opaque {
    ptr::null_mut()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_bus_number(device: Opaque) -> u8 {
    let (_, camera) = device_parts(device);
    with_world(|world| {
        world
            .cameras
            .get(camera)
            .map_or(0, |camera| camera.config.bus)
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_device_address(device: Opaque) -> u8 {
    let (_, camera) = device_parts(device);
    // A bus has at most 127 devices.
    FIRST_ADDRESS.wrapping_add(camera as u8)
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_device_speed(device: Opaque) -> c_int {
    let (_, camera) = device_parts(device);
    with_world(|world| {
        world
            .cameras
            .get(camera)
            .map_or(0, |camera| camera.config.speed)
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_port_number(device: Opaque) -> u8 {
    ports(device).last().copied().unwrap_or(0)
}

/// # Safety
/// `out` has room for `length` bytes.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_port_numbers(device: Opaque, out: *mut u8, length: c_int) -> c_int {
    let ports = ports(device);
    if usize::try_from(length).unwrap_or(0) < ports.len() {
        return ERROR_OVERFLOW;
    }
    // SAFETY: there is room, as was just compared.
    unsafe { ptr::copy_nonoverlapping(ports.as_ptr(), out, ports.len()) };
    // A path has at most seven ports.
    ports.len() as c_int
}

/// # Safety
/// As of [`libusb_get_port_numbers`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_port_path(
    _context: Opaque,
    device: Opaque,
    out: *mut u8,
    length: u8,
) -> c_int {
    // SAFETY: the same promise.
    unsafe { libusb_get_port_numbers(device, out, c_int::from(length)) }
}

fn ports(device: Opaque) -> Vec<u8> {
    let (_, camera) = device_parts(device);
    with_world(|world| {
        let camera = world.cameras.get(camera);
        camera.map_or_else(Vec::new, |camera| camera.config.ports.clone())
    })
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_max_packet_size(device: Opaque, endpoint: u8) -> c_int {
    max_packet(device, endpoint).map_or(ERROR_NOT_FOUND, c_int::from)
}

#[unsafe(no_mangle)]
extern "C" fn libusb_get_max_iso_packet_size(device: Opaque, endpoint: u8) -> c_int {
    let size = max_packet(device, endpoint);
    size.map_or(ERROR_NOT_FOUND, |size| {
        c_int::from(size & 0x7FF) * (1 + c_int::from(size >> 11 & 3))
    })
}

/// `wMaxPacketSize` in the setting that is active.
fn max_packet(device: Opaque, endpoint: u8) -> Option<u16> {
    let (_, camera) = device_parts(device);
    with_world(|world| {
        let camera = world.cameras.get(camera)?;
        let configuration = camera.bus.camera().descriptor(0x0200)?;
        super::descriptors::max_packet(&configuration, camera.alt_setting, endpoint)
    })
}
