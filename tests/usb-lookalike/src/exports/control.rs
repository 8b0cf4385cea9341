//! Control transfers, and reads that wait.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::{c_int, c_uint};
use std::slice;
use std::time::Duration;

use virtual_carmine::{Control, Setup, TransferStatus};

use crate::abi::{
    ERROR_INVALID_PARAM, ERROR_NO_DEVICE, ERROR_NOT_FOUND, ERROR_PIPE, ERROR_TIMEOUT, Opaque,
    SUCCESS,
};
use crate::exports::number;
use crate::world::{Order, Waiter, now_nanos, wait_for, wake_all, with_world};

/// What a transfer without a timeout waits that would wait for ever.
const LONGEST_WAIT_MILLIS: u32 = 5_000;
/// How long a waiting call sleeps at most between two looks.
const LONGEST_SLEEP_NANOS: i64 = 100_000_000;

/// # Safety
/// `data` has `length` bytes, or is null where that is 0.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_control_transfer(
    handle: Opaque,
    request_type: u8,
    request: u8,
    value: u16,
    index: u16,
    data: *mut u8,
    length: u16,
    timeout_millis: c_uint,
) -> c_int {
    let setup = Setup {
        request_type,
        request,
        value,
        index,
        length,
    };
    let data = if data.is_null() || length == 0 {
        &mut []
    } else {
        // SAFETY: the caller's buffer has that many bytes and is its own until this function returns.
        unsafe { slice::from_raw_parts_mut(data, usize::from(length)) }
    };
    match perform(handle, setup, data) {
        // At most 65 535.
        Control::Done(count) => count as c_int,
        Control::Stall => ERROR_PIPE,
        Control::Gone => ERROR_NO_DEVICE,
        Control::NoAnswer => {
            let wait_millis = match timeout_millis {
                0 => LONGEST_WAIT_MILLIS,
                timeout_millis => timeout_millis,
            };
            std::thread::sleep(Duration::from_millis(u64::from(wait_millis)));
            ERROR_TIMEOUT
        }
    }
}

/// Runs a control transfer now.
pub(super) fn perform(handle: Opaque, setup: Setup, data: &mut [u8]) -> Control {
    let now_nanos = now_nanos();
    let control = with_world(|world| {
        world.pump(now_nanos);
        let Some(camera) = world.camera_of(number(handle)) else {
            return Control::Gone;
        };
        let control = camera.bus.control(now_nanos, setup, data);
        const SET_INTERFACE: (u8, u8, u16) = (0x01, 11, 0);
        if (setup.request_type, setup.request, setup.index) == SET_INTERFACE
            && matches!(control, Control::Done(_))
        {
            // There are at most three settings.
            camera.alt_setting = setup.value as u8;
        }
        control
    });
    wake_all();
    control
}

/// # Safety
/// `data` has `length` bytes; `transferred` is null or a place for a number.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_bulk_transfer(
    handle: Opaque,
    endpoint: u8,
    data: *mut u8,
    length: c_int,
    transferred: *mut c_int,
    timeout_millis: c_uint,
) -> c_int {
    let Ok(room) = usize::try_from(length) else {
        return ERROR_INVALID_PARAM;
    };
    if endpoint & 0x80 == 0 {
        return ERROR_NOT_FOUND;
    }
    let now = now_nanos();
    let submitted = with_world(|world| {
        let known = *world.handles.get(&number(handle))?;
        let order = Order::Bulk(room);
        let submitted = world.submit(now, known, endpoint, &order, Waiter::Call, timeout_millis);
        Some((submitted, known.camera))
    });
    let Some((submitted, camera)) = submitted else {
        return ERROR_NO_DEVICE;
    };
    wake_all();
    let (ended, has_timed_out) = wait_for(|world, now| {
        world.pump(now);
        let next = world.next_nanos().unwrap_or(i64::MAX);
        let latest = now + LONGEST_SLEEP_NANOS;
        world.take_waited(submitted).ok_or(next.min(latest))
    });
    // SAFETY: the bus fills at most `length` bytes; the caller's buffer has them.
    unsafe {
        data.copy_from_nonoverlapping(ended.data.as_ptr(), ended.data.len());
        if !transferred.is_null() {
            transferred.write(ended.data.len() as c_int);
        }
    }
    let code = match ended.status {
        TransferStatus::Completed => SUCCESS,
        TransferStatus::Cancelled if has_timed_out => ERROR_TIMEOUT,
        TransferStatus::Cancelled | TransferStatus::NoDevice => ERROR_NO_DEVICE,
        TransferStatus::Stall => ERROR_PIPE,
    };
    with_world(|world| world.recycle(camera, ended));
    code
}

/// # Safety
/// As of [`libusb_bulk_transfer`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_interrupt_transfer(
    handle: Opaque,
    endpoint: u8,
    data: *mut u8,
    length: c_int,
    transferred: *mut c_int,
    timeout_millis: c_uint,
) -> c_int {
    // SAFETY: the same promise.
    unsafe { libusb_bulk_transfer(handle, endpoint, data, length, transferred, timeout_millis) }
}
