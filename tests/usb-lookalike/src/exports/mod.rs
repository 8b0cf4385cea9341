//! The functions of libusb, by what they are about. Each takes and gives what its namesake does; what there is to know
//! of them is in libusb's own documentation.

mod absent;
mod context;
mod control;
mod descriptors;
mod device;
mod events;
mod handle;
mod text;
mod transfers;

use std::ptr;

use crate::abi::Opaque;
use crate::world::DEFAULT_CONTEXT;

/// Bits of a device's number that say which camera it is; the rest is the context.
const CAMERA_BITS: u32 = 16;

fn opaque(number: u64) -> Opaque {
    // A number that comes back as it went out: machines with smaller pointers never get that far.
    ptr::without_provenance_mut(usize::try_from(number).unwrap_or(0))
}

fn number(opaque: Opaque) -> u64 {
    opaque.addr() as u64
}

fn context_number(context: Opaque) -> u64 {
    if context.is_null() {
        DEFAULT_CONTEXT
    } else {
        number(context)
    }
}

fn device(context: u64, camera: usize) -> Opaque {
    opaque(context << CAMERA_BITS | (camera as u64 + 1))
}

/// Context and camera of a device.
fn device_parts(device: Opaque) -> (u64, usize) {
    let number = number(device);
    let camera = number & ((1 << CAMERA_BITS) - 1);
    // Null and what is no device of ours is a camera that does not exist.
    (number >> CAMERA_BITS, camera.wrapping_sub(1) as usize)
}
