//! One asynchronous read, as a state: what is in flight cannot be looked at, and is not freed.

use std::ptr::NonNull;
use std::sync::atomic::{AtomicBool, Ordering};

use ps1080::usb::TransferKind;
use rusb::ffi;
use rusb::ffi::constants::{
    LIBUSB_ERROR_NO_DEVICE, LIBUSB_TRANSFER_CANCELLED, LIBUSB_TRANSFER_COMPLETED,
    LIBUSB_TRANSFER_NO_DEVICE, LIBUSB_TRANSFER_STALL, LIBUSB_TRANSFER_TYPE_BULK,
    LIBUSB_TRANSFER_TYPE_ISOCHRONOUS,
};

use crate::ps1080::usb::UsbError;

/// An open device, as libusb knows it. Whoever holds a transfer must keep it open.
pub(super) type RawHandle = *mut ffi::libusb_device_handle;

/// How a transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    /// With what came.
    Completed,
    /// Taken back.
    Cancelled,
    /// The endpoint is halted.
    Stall,
    /// The device is gone.
    Gone,
    /// An error on the bus.
    Damaged,
}

/// What libusb and we share. Freed by the state [`Idle`] alone.
struct Parts {
    transfer: NonNull<ffi::libusb_transfer>,
    buffer: NonNull<[u8]>,
    done: NonNull<AtomicBool>,
}

impl Drop for Parts {
    #[expect(unsafe_code, reason = "memory of a C library")]
    fn drop(&mut self) {
        // SAFETY: Parts are dropped as part of `Idle` only, when libusb does not hold the transfer; the three come from
        // `libusb_alloc_transfer` and `Box::into_raw` in `Idle::new` and are freed once.
        unsafe {
            ffi::libusb_free_transfer(self.transfer.as_ptr());
            drop(Box::from_raw(self.buffer.as_ptr()));
            drop(Box::from_raw(self.done.as_ptr()));
        }
    }
}

#[expect(unsafe_code, reason = "memory of a C library")]
// SAFETY: nobody else has the pointers but libusb, which may be called from any thread.
unsafe impl Send for Parts {}

/// A transfer that is ours: it can be read and submitted.
pub(super) struct Idle {
    parts: Parts,
    iso_packet_count: i32,
}

/// A transfer that is libusb's until [`try_finish`](Self::try_finish) gives it back. Dropped before, its memory is
/// never freed: libusb may still write to it.
pub(super) struct InFlight {
    idle: std::mem::ManuallyDrop<Idle>,
}

impl Idle {
    /// A read of `endpoint`: of `bulk_bytes`, or of `iso_packet_count` packets of `packet_bytes`.
    ///
    /// `None` when there is no memory.
    #[expect(unsafe_code, reason = "a C library")]
    pub(super) fn new(
        handle: RawHandle,
        endpoint: u8,
        kind: TransferKind,
        bulk_bytes: usize,
        iso: (usize, usize),
    ) -> Option<Self> {
        let (iso_packet_count, packet_bytes) = match kind {
            TransferKind::Bulk => (0, 0),
            TransferKind::Isochronous => iso,
        };
        let length = match kind {
            TransferKind::Bulk => bulk_bytes,
            TransferKind::Isochronous => iso_packet_count * packet_bytes,
        };
        let count = i32::try_from(iso_packet_count).ok()?;
        let (length_number, packet_number) = (
            i32::try_from(length).ok()?,
            u32::try_from(packet_bytes).ok()?,
        );
        // SAFETY: allocates; null is handled.
        let transfer = NonNull::new(unsafe { ffi::libusb_alloc_transfer(count) })?;
        let buffer = NonNull::from(Box::leak(vec![0_u8; length].into_boxed_slice()));
        let done = NonNull::from(Box::leak(Box::new(AtomicBool::new(false))));
        let parts = Parts {
            transfer,
            buffer,
            done,
        };
        // SAFETY: the transfer is valid, has room for `count` packets, and is not in flight; the buffer has `length`
        // bytes and lives as long as `parts`.
        unsafe {
            let fields = transfer.as_ptr();
            (*fields).dev_handle = handle;
            (*fields).flags = 0;
            (*fields).endpoint = endpoint;
            (*fields).timeout = 0;
            (*fields).length = length_number;
            (*fields).buffer = buffer.as_ptr().cast();
            (*fields).user_data = done.as_ptr().cast();
            (*fields).callback = note_end;
            (*fields).num_iso_packets = count;
            (*fields).transfer_type = match kind {
                TransferKind::Bulk => LIBUSB_TRANSFER_TYPE_BULK,
                TransferKind::Isochronous => LIBUSB_TRANSFER_TYPE_ISOCHRONOUS,
            };
            let packets = packets_of(fields);
            for index in 0..iso_packet_count {
                (*packets.add(index)).length = packet_number;
            }
        }
        Some(Self {
            parts,
            iso_packet_count: count,
        })
    }

    /// Hands the transfer to libusb.
    ///
    /// # Errors
    /// The transfer, and why libusb does not take it.
    #[expect(unsafe_code, reason = "a C library")]
    pub(super) fn submit(self) -> Result<InFlight, UsbError> {
        // SAFETY: `done` lives as long as the parts, and nobody else looks at it now.
        unsafe { self.parts.done.as_ref() }.store(false, Ordering::Relaxed);
        // SAFETY: the transfer is complete (see `new`), not in flight, and its device is open.
        let code = unsafe { ffi::libusb_submit_transfer(self.parts.transfer.as_ptr()) };
        match code {
            0 => Ok(InFlight {
                idle: std::mem::ManuallyDrop::new(self),
            }),
            LIBUSB_ERROR_NO_DEVICE => Err(UsbError::Gone),
            code => Err(UsbError::Other(code)),
        }
    }

    /// How it ended.
    #[expect(unsafe_code, reason = "a C library")]
    pub(super) fn ended(&self) -> Ended {
        // SAFETY: valid and not in flight.
        match unsafe { (*self.parts.transfer.as_ptr()).status } {
            LIBUSB_TRANSFER_COMPLETED => Ended::Completed,
            LIBUSB_TRANSFER_CANCELLED => Ended::Cancelled,
            LIBUSB_TRANSFER_STALL => Ended::Stall,
            LIBUSB_TRANSFER_NO_DEVICE => Ended::Gone,
            _ => Ended::Damaged,
        }
    }

    /// The bytes that came, in order; of an isochronous transfer packet by packet. The flag says that bytes before were
    /// lost.
    #[expect(unsafe_code, reason = "a C library")]
    pub(super) fn for_each_piece(&self, mut take: impl FnMut(&[u8], bool)) {
        // SAFETY: not in flight, so nobody writes to the buffer, which has this length.
        let buffer: &[u8] = unsafe { self.parts.buffer.as_ref() };
        let fields = self.parts.transfer.as_ptr();
        if self.iso_packet_count == 0 {
            // SAFETY: valid and not in flight.
            let length = usize::try_from(unsafe { (*fields).actual_length }).unwrap_or(0);
            let is_damaged = self.ended() == Ended::Damaged;
            return take(buffer.get(..length).unwrap_or(buffer), is_damaged);
        }
        let mut offset = 0;
        for index in 0..self.iso_packet_count {
            // SAFETY: as many descriptors as the transfer was made with, of which this is one.
            let packet = unsafe { &*packets_of(fields).add(index.unsigned_abs() as usize) };
            let (room, length) = (packet.length as usize, packet.actual_length as usize);
            let bytes = buffer.get(offset..offset + length.min(room));
            take(
                bytes.unwrap_or_default(),
                packet.status != LIBUSB_TRANSFER_COMPLETED,
            );
            offset += room;
        }
    }
}

impl InFlight {
    /// Whether it has ended.
    #[expect(unsafe_code, reason = "memory shared with a C library")]
    pub(super) fn is_done(&self) -> bool {
        // SAFETY: `done` lives as long as the parts; it is only touched as an atomic.
        unsafe { self.idle.parts.done.as_ref() }.load(Ordering::Acquire)
    }

    /// The transfer, if it has ended.
    pub(super) fn try_finish(self) -> Result<Idle, Self> {
        if self.is_done() {
            Ok(std::mem::ManuallyDrop::into_inner(self.idle))
        } else {
            Err(self)
        }
    }

    /// Asks for it back; it ends soon.
    #[expect(unsafe_code, reason = "a C library")]
    pub(super) fn cancel(&self) {
        // SAFETY: the transfer is valid; one that has ended already is refused, which is fine.
        let _ = unsafe { ffi::libusb_cancel_transfer(self.idle.parts.transfer.as_ptr()) };
    }
}

/// The packets of an isochronous transfer, which follow its fields.
///
/// # Safety
/// `transfer` comes from `libusb_alloc_transfer` and was not freed.
#[expect(unsafe_code, reason = "a C structure with an array of open length")]
unsafe fn packets_of(
    transfer: *mut ffi::libusb_transfer,
) -> *mut ffi::libusb_iso_packet_descriptor {
    // SAFETY: the caller's transfer is valid; only the address of the field is taken.
    unsafe { (&raw mut (*transfer).iso_packet_desc).cast() }
}

/// Called by libusb in the thread that handles events.
#[expect(unsafe_code, reason = "called by a C library")]
extern "system" fn note_end(transfer: *mut ffi::libusb_transfer) {
    // SAFETY: libusb gives back the transfer that was submitted, whose `user_data` is the flag of its parts; they live
    // until the flag has been seen.
    let done = unsafe { &*(*transfer).user_data.cast::<AtomicBool>() };
    done.store(true, Ordering::Release);
}
