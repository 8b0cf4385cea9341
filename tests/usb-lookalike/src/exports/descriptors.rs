//! Descriptors as the structures of C.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::c_int;
use std::ptr;

use crate::abi::{
    ConfigDescriptor, DeviceDescriptor, ERROR_INVALID_PARAM, ERROR_NO_DEVICE, ERROR_NOT_FOUND,
    EndpointDescriptor, Interface, InterfaceDescriptor, Opaque, SUCCESS,
};
use crate::exports::{device_parts, number};
use crate::world::with_world;

const DEVICE: u16 = 0x0100;
const CONFIGURATION: u16 = 0x0200;
const STRING: u16 = 0x0300;
const INTERFACE_KIND: u8 = 4;
const ENDPOINT_KIND: u8 = 5;

/// A configuration with all it points to; the descriptor is first, so that its address is that of the whole.
#[repr(C)]
struct Tree {
    configuration: ConfigDescriptor,
    interfaces: Vec<Interface>,
    settings: Vec<Vec<InterfaceDescriptor>>,
    endpoints: Vec<Vec<EndpointDescriptor>>,
}

/// The descriptors in the bytes of a configuration, one after the other.
fn pieces(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let length = usize::from(*rest.first()?);
        let (piece, after) = rest.split_at_checked(length).filter(|_| length >= 2)?;
        rest = after;
        Some(piece)
    })
}

/// `wMaxPacketSize` of an endpoint of interface 0 in a setting.
pub(super) fn max_packet(bytes: &[u8], setting: u8, endpoint: u8) -> Option<u16> {
    let mut is_there = false;
    for piece in pieces(bytes) {
        match *piece {
            [_, INTERFACE_KIND, interface, alternate, ..] => {
                is_there = (interface, alternate) == (0, setting);
            }
            [_, ENDPOINT_KIND, address, _, size0, size1, ..] if is_there && address == endpoint => {
                return Some(u16::from_le_bytes([size0, size1]));
            }
            _ => {}
        }
    }
    None
}

impl Tree {
    fn new(bytes: &[u8]) -> Option<Box<Self>> {
        let &[
            length,
            kind,
            t0,
            t1,
            count,
            value,
            text,
            attributes,
            power,
            ..,
        ] = bytes
        else {
            return None;
        };
        let mut settings: Vec<Vec<InterfaceDescriptor>> = Vec::new();
        let mut endpoints: Vec<Vec<EndpointDescriptor>> = Vec::new();
        for piece in pieces(bytes) {
            if let Some(setting) = interface(piece) {
                if setting.alternate == 0 {
                    settings.push(Vec::new());
                }
                endpoints.push(Vec::new());
                settings.last_mut()?.push(setting);
            } else if let Some(one) = endpoint(piece) {
                endpoints.last_mut()?.push(one);
            }
        }
        let all = settings.iter_mut().flatten();
        for (setting, endpoints) in all.zip(&endpoints) {
            setting.endpoints = endpoints.as_ptr();
        }
        let interfaces: Vec<Interface> = settings
            .iter()
            .map(|settings| Interface {
                settings: settings.as_ptr(),
                // At most three.
                setting_count: settings.len() as c_int,
            })
            .collect();
        Some(Box::new(Self {
            configuration: ConfigDescriptor {
                length,
                descriptor_type: kind,
                total_length: u16::from_le_bytes([t0, t1]),
                interface_count: count,
                value,
                text_index: text,
                attributes,
                max_power: power,
                interfaces: interfaces.as_ptr(),
                extra: ptr::null(),
                extra_length: 0,
            },
            interfaces,
            settings,
            endpoints,
        }))
    }
}

fn interface(piece: &[u8]) -> Option<InterfaceDescriptor> {
    let &[
        length,
        kind @ INTERFACE_KIND,
        number,
        alternate,
        count,
        class,
        sub,
        protocol,
        text,
        ..,
    ] = piece
    else {
        return None;
    };
    Some(InterfaceDescriptor {
        length,
        descriptor_type: kind,
        number,
        alternate,
        endpoint_count: count,
        class,
        subclass: sub,
        protocol,
        text_index: text,
        endpoints: ptr::null(),
        extra: ptr::null(),
        extra_length: 0,
    })
}

fn endpoint(piece: &[u8]) -> Option<EndpointDescriptor> {
    let &[
        length,
        kind @ ENDPOINT_KIND,
        address,
        attributes,
        size0,
        size1,
        interval,
        ..,
    ] = piece
    else {
        return None;
    };
    Some(EndpointDescriptor {
        length,
        descriptor_type: kind,
        address,
        attributes,
        max_packet_size: u16::from_le_bytes([size0, size1]),
        interval,
        refresh: 0,
        synch_address: 0,
        extra: ptr::null(),
        extra_length: 0,
    })
}

fn bytes_of(device: Opaque, value: u16) -> Option<Vec<u8>> {
    let (_, camera) = device_parts(device);
    with_world(|world| world.cameras.get(camera)?.bus.camera().descriptor(value))
}

/// # Safety
/// `out` is a place for a descriptor.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_device_descriptor(
    device: Opaque,
    out: *mut DeviceDescriptor,
) -> c_int {
    let bytes = bytes_of(device, DEVICE).unwrap_or_default();
    let &[
        l,
        k,
        u0,
        u1,
        class,
        sub,
        protocol,
        packet,
        v0,
        v1,
        p0,
        p1,
        d0,
        d1,
        m,
        p,
        s,
        count,
    ] = bytes.as_slice()
    else {
        return ERROR_NO_DEVICE;
    };
    let descriptor = DeviceDescriptor {
        length: l,
        descriptor_type: k,
        usb_version: u16::from_le_bytes([u0, u1]),
        class,
        subclass: sub,
        protocol,
        max_packet_size0: packet,
        vendor: u16::from_le_bytes([v0, v1]),
        product: u16::from_le_bytes([p0, p1]),
        device_version: u16::from_le_bytes([d0, d1]),
        manufacturer_index: m,
        product_index: p,
        serial_number_index: s,
        configuration_count: count,
    };
    // SAFETY: the caller gives a place for a descriptor.
    unsafe { out.write(descriptor) };
    SUCCESS
}

/// # Safety
/// `out` is a place for a pointer.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_active_config_descriptor(
    device: Opaque,
    out: *mut *const ConfigDescriptor,
) -> c_int {
    let tree = bytes_of(device, CONFIGURATION).and_then(|bytes| Tree::new(&bytes));
    let Some(tree) = tree else {
        return ERROR_NO_DEVICE;
    };
    // SAFETY: the caller gives a place for the descriptor, which it gives back to `libusb_free_config_descriptor`.
    unsafe { out.write(Box::into_raw(tree).cast()) };
    SUCCESS
}

/// # Safety
/// As of [`libusb_get_active_config_descriptor`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_config_descriptor(
    device: Opaque,
    index: u8,
    out: *mut *const ConfigDescriptor,
) -> c_int {
    if index != 0 {
        return ERROR_NOT_FOUND;
    }
    // SAFETY: the same promise.
    unsafe { libusb_get_active_config_descriptor(device, out) }
}

/// # Safety
/// As of [`libusb_get_active_config_descriptor`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_config_descriptor_by_value(
    device: Opaque,
    value: u8,
    out: *mut *const ConfigDescriptor,
) -> c_int {
    if value != 1 {
        return ERROR_NOT_FOUND;
    }
    // SAFETY: the same promise.
    unsafe { libusb_get_active_config_descriptor(device, out) }
}

/// # Safety
/// `configuration` is null or comes from here and is not used again.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_free_config_descriptor(configuration: *mut ConfigDescriptor) {
    if !configuration.is_null() {
        // SAFETY: it is the first field of a boxed tree.
        drop(unsafe { Box::from_raw(configuration.cast::<Tree>()) });
    }
}

/// # Safety
/// `out` has room for `length` bytes.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_string_descriptor_ascii(
    handle: Opaque,
    index: u8,
    out: *mut u8,
    length: c_int,
) -> c_int {
    let text = with_world(|world| {
        let camera = world.camera_of(number(handle))?;
        if camera.bus.camera().is_gone() {
            return None;
        }
        Some(camera.bus.camera().descriptor(STRING | u16::from(index)))
    });
    let bytes = match text {
        None => return ERROR_NO_DEVICE,
        Some(None) => return ERROR_INVALID_PARAM,
        Some(Some(bytes)) => bytes,
    };
    let units = bytes.get(2..).unwrap_or_default().chunks_exact(2);
    let room = usize::try_from(length).unwrap_or(0).saturating_sub(1);
    let text: Vec<u8> = units
        .map(|unit| if unit[1] == 0 { unit[0] } else { b'?' })
        .take(room)
        .chain([0])
        .collect();
    if length < 1 {
        return ERROR_INVALID_PARAM;
    }
    // SAFETY: at most `length` bytes, the zero included.
    unsafe { out.copy_from_nonoverlapping(text.as_ptr(), text.len()) };
    text.len() as c_int - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use virtual_carmine::{Faults, Personality, TestPattern, VirtualCarmine};

    #[test]
    fn the_tree_has_every_setting_and_endpoint() {
        let film = Box::new(TestPattern::new(0));
        let camera = VirtualCarmine::new(Personality::carmine_1_09(), film, Faults::default());
        let bytes = camera.descriptor(CONFIGURATION).unwrap();
        let tree = Tree::new(&bytes).unwrap();
        assert_eq!((tree.interfaces.len(), tree.endpoints.len()), (2, 4));
        assert_eq!(tree.interfaces[0].setting_count, 3);
        assert_eq!(tree.settings[0][1].alternate, 1);
        let addresses: Vec<u8> = tree.endpoints[2].iter().map(|one| one.address).collect();
        assert_eq!(addresses, [0x81, 0x82]);
        assert_eq!(max_packet(&bytes, 0, 0x82), Some(512));
        assert_eq!(max_packet(&bytes, 2, 0x81), Some(1020));
        assert_eq!(max_packet(&bytes, 0, 0x83), None);
    }
}
