//! Transfers with a callback.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::alloc::{Layout, alloc_zeroed, dealloc};
use std::ffi::c_int;
use std::mem::size_of;
use std::{ptr, slice};

use ps1080::usb::TransferKind;
use virtual_carmine::{Control, Setup, TransferStatus};

use crate::abi::{
    CONTROL_SETUP_BYTES, ERROR_BUSY, ERROR_INVALID_PARAM, ERROR_NO_DEVICE, ERROR_NOT_FOUND,
    FLAG_FREE_BUFFER, FLAG_FREE_TRANSFER, IsoPacket, SUCCESS, TRANSFER_COMPLETED, TYPE_CONTROL,
    TYPE_ISOCHRONOUS, Transfer,
};
use crate::exports::{control, number};
use crate::world::{Ended, Order, Waiter, now_nanos, status_code, wake_all, with_world};

/// Before each structure stands the size of the allocation, in a place that keeps the structure aligned.
const HEAD_BYTES: usize = 16;

unsafe extern "C" {
    /// The C library's: a buffer that is to be freed with its transfer was allocated by its `malloc`.
    fn free(memory: *mut std::ffi::c_void);
}

fn layout(iso_packet_count: usize) -> Option<Layout> {
    let packets = iso_packet_count.checked_mul(size_of::<IsoPacket>())?;
    let bytes = packets.checked_add(HEAD_BYTES + size_of::<Transfer>())?;
    Layout::from_size_align(bytes, HEAD_BYTES).ok()
}

#[unsafe(no_mangle)]
extern "C" fn libusb_alloc_transfer(iso_packet_count: c_int) -> *mut Transfer {
    let layout = usize::try_from(iso_packet_count).ok().and_then(layout);
    let Some(layout) = layout else {
        return ptr::null_mut();
    };
    // SAFETY: the layout is not empty; the head has room for a size, the structure is behind it.
    unsafe {
        let memory = alloc_zeroed(layout);
        if memory.is_null() {
            return ptr::null_mut();
        }
        memory.cast::<usize>().write(layout.size());
        memory.add(HEAD_BYTES).cast()
    }
}

/// # Safety
/// `transfer` is null or comes from [`libusb_alloc_transfer`], is not under way and not used again.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_free_transfer(transfer: *mut Transfer) {
    if transfer.is_null() {
        return;
    }
    // SAFETY: the structure is the caller's, who asks by the flag for a buffer of `malloc` (or null) to be freed.
    unsafe {
        if (*transfer).flags & FLAG_FREE_BUFFER != 0 {
            free((*transfer).buffer.cast());
        }
    }
    // SAFETY: the size stands where `libusb_alloc_transfer` has written it; it is that of a layout, and nobody uses the
    // memory after this.
    unsafe {
        let memory = transfer.cast::<u8>().sub(HEAD_BYTES);
        let size = memory.cast::<usize>().read();
        if let Ok(layout) = Layout::from_size_align(size, HEAD_BYTES) {
            dealloc(memory, layout);
        }
    }
}

/// # Safety
/// `transfer` comes from [`libusb_alloc_transfer`] and is filled in; it and its buffer stay until the callback.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_submit_transfer(transfer: *mut Transfer) -> c_int {
    // SAFETY: until it is submitted the structure is the caller's, who is here.
    let order = unsafe {
        (*transfer).actual_length = 0;
        &*transfer
    };
    if order.kind == TYPE_CONTROL {
        // SAFETY: the caller's promise about the buffer.
        return unsafe { submit_control(transfer) };
    }
    let Ok(length) = usize::try_from(order.length) else {
        return ERROR_INVALID_PARAM;
    };
    if order.endpoint & 0x80 == 0 {
        return ERROR_NOT_FOUND;
    }
    let is_iso = order.kind == TYPE_ISOCHRONOUS;
    // SAFETY: there are as many packets as the caller has asked for and says.
    let packets: Vec<usize> = unsafe { iso_packets(transfer) }
        .iter()
        .map(|packet| packet.length as usize)
        .collect();
    if is_iso && (packets.is_empty() || packets.iter().sum::<usize>() > length) {
        return ERROR_INVALID_PARAM;
    }
    let what = if is_iso {
        Order::Isochronous(&packets)
    } else {
        Order::Bulk(length)
    };
    let code = queue(order, transfer.expose_provenance(), &what);
    wake_all();
    code
}

/// Queues the transfer of the structure at `address`.
fn queue(order: &Transfer, address: usize, what: &Order<'_>) -> c_int {
    let now = now_nanos();
    with_world(|world| {
        world.pump(now);
        let Some(&handle) = world.handles.get(&number(order.handle)) else {
            return ERROR_NO_DEVICE;
        };
        let Some(camera) = world.cameras.get(handle.camera) else {
            return ERROR_NO_DEVICE;
        };
        if camera.bus.camera().is_gone() {
            return ERROR_NO_DEVICE;
        }
        let is_iso_setting = camera.bus.camera().transfer_kind() == Some(TransferKind::Isochronous);
        if matches!(what, Order::Isochronous(_)) != is_iso_setting {
            // What the kernel says of a transfer that is not of the endpoint's kind.
            return ERROR_INVALID_PARAM;
        }
        if world.is_queued(address) {
            return ERROR_BUSY;
        }
        let waiter = Waiter::Callback(address);
        world.submit(
            now,
            handle,
            order.endpoint,
            what,
            waiter,
            order.timeout_millis,
        );
        SUCCESS
    })
}

/// A control transfer takes no time: it ends at once, its callback comes with the next events.
///
/// # Safety
/// As of [`libusb_submit_transfer`]; the buffer begins with the set-up.
unsafe fn submit_control(transfer: *mut Transfer) -> c_int {
    // SAFETY: the structure is the caller's.
    let order = unsafe { &*transfer };
    let length = usize::try_from(order.length).unwrap_or(0);
    if order.buffer.is_null() || length < CONTROL_SETUP_BYTES {
        return ERROR_INVALID_PARAM;
    }
    // SAFETY: the caller's buffer has that many bytes and is not used by anybody else.
    let buffer = unsafe { slice::from_raw_parts_mut(order.buffer, length) };
    let (&mut [kind, request, v0, v1, i0, i1, l0, l1], data) =
        match buffer.split_first_chunk_mut::<CONTROL_SETUP_BYTES>() {
            Some(parts) => parts,
            None => return ERROR_INVALID_PARAM,
        };
    let setup = Setup {
        request_type: kind,
        request,
        value: u16::from_le_bytes([v0, v1]),
        index: u16::from_le_bytes([i0, i1]),
        length: u16::from_le_bytes([l0, l1]),
    };
    let (count, status) = match control::perform(order.handle, setup, data) {
        Control::Done(count) => (count, TransferStatus::Completed),
        Control::Stall => (0, TransferStatus::Stall),
        Control::NoAnswer => (0, TransferStatus::Cancelled),
        Control::Gone => return ERROR_NO_DEVICE,
    };
    // The data are where they belong; the callback's copy puts them there once more.
    let copy = data.get(..count).unwrap_or_default().to_vec();
    with_world(|world| {
        let Some(&handle) = world.handles.get(&number(order.handle)) else {
            return ERROR_NO_DEVICE;
        };
        world.end_at_once(
            handle,
            Ended {
                address: transfer.expose_provenance(),
                has_timed_out: status == TransferStatus::Cancelled,
                camera: handle.camera,
                transfer: virtual_carmine::Transfer {
                    token: 0,
                    status,
                    data: copy,
                    packet_bytes: Vec::new(),
                    ended_nanos: now_nanos(),
                },
            },
        );
        SUCCESS
    })
}

/// # Safety
/// `transfer` comes from [`libusb_alloc_transfer`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_cancel_transfer(transfer: *mut Transfer) -> c_int {
    let now = now_nanos();
    let was_queued = with_world(|world| world.cancel(now, transfer.addr()));
    wake_all();
    if was_queued { SUCCESS } else { ERROR_NOT_FOUND }
}

/// Fills in the structure of a transfer that has ended and calls its callback.
pub(super) fn finish(ended: Ended) {
    let transfer = ptr::with_exposed_provenance_mut::<Transfer>(ended.address);
    // SAFETY: a submitted structure and its buffer stay until the callback, which has not been called yet; the bus never
    // fills more than was asked for.
    let (flags, callback) = unsafe {
        (*transfer).status = status_code(ended.transfer.status, ended.has_timed_out);
        let data = ended.transfer.data.as_slice();
        let kind = (*transfer).kind;
        if kind == TYPE_ISOCHRONOUS {
            spread(transfer, &ended.transfer);
        } else {
            let setup_bytes = if kind == TYPE_CONTROL {
                CONTROL_SETUP_BYTES
            } else {
                0
            };
            let place = (*transfer).buffer.add(setup_bytes);
            place.copy_from_nonoverlapping(data.as_ptr(), data.len());
            (*transfer).actual_length = data.len() as c_int;
        }
        ((*transfer).flags, (*transfer).callback)
    };
    with_world(|world| world.recycle(ended.camera, ended.transfer));
    if let Some(callback) = callback {
        callback(transfer);
    }
    if flags & FLAG_FREE_TRANSFER != 0 {
        // SAFETY: by the flag the submitter leaves the structure to the library; it is no longer under way.
        unsafe { libusb_free_transfer(transfer) };
    }
}

/// Puts isochronous packets where they belong: each at the place that its room begins at.
///
/// # Safety
/// As of [`finish`].
unsafe fn spread(transfer: *mut Transfer, ended: &virtual_carmine::Transfer) {
    // SAFETY: the structure stays until the callback.
    let (packets, buffer) = unsafe { (iso_packets(transfer), (*transfer).buffer) };
    let mut data = ended.data.as_slice();
    let mut place = 0;
    for (index, packet) in packets.iter_mut().enumerate() {
        let count = ended.packet_bytes.get(index).copied();
        let (bytes, rest) = data.split_at(count.unwrap_or(0).min(data.len()));
        data = rest;
        // SAFETY: the bus puts no more into a packet than its room, and the rooms are within the buffer.
        unsafe {
            let to = buffer.add(place);
            to.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
        }
        place += packet.length as usize;
        packet.actual_length = bytes.len() as u32;
        packet.status = match count {
            Some(_) => TRANSFER_COMPLETED,
            None => status_code(ended.status, false),
        };
    }
}

/// The packets of an isochronous transfer; none of another.
///
/// # Safety
/// `transfer` was allocated with at least as many packets as it says.
unsafe fn iso_packets<'a>(transfer: *mut Transfer) -> &'a mut [IsoPacket] {
    // SAFETY: the packets stand behind the structure, as many as it was allocated with.
    unsafe {
        if (*transfer).kind != TYPE_ISOCHRONOUS {
            return &mut [];
        }
        let count = usize::try_from((*transfer).iso_packet_count).unwrap_or(0);
        let first = (&raw mut (*transfer).iso_packets).cast::<IsoPacket>();
        slice::from_raw_parts_mut(first, count)
    }
}
