//! Waiting for what has ended, calling back.
#![expect(unsafe_code, reason = "the interface of a C library")]

use std::ffi::c_int;
use std::ptr;

use crate::abi::{ERROR_INVALID_PARAM, Opaque, SUCCESS, Timeval};
use crate::exports::{context_number, transfers};
use crate::world::{Ended, now_nanos, wait_for, wake_all, with_world};

/// What libusb takes where no time is given.
const DEFAULT_WAIT_NANOS: i64 = 60_000_000_000;

/// # Safety
/// `completed` is null or a number that another thread may set.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_handle_events_timeout_completed(
    context: Opaque,
    timeout: *const Timeval,
    completed: *mut c_int,
) -> c_int {
    let wait_nanos = if timeout.is_null() {
        DEFAULT_WAIT_NANOS
    } else {
        // SAFETY: the caller gives a time where it gives any.
        let time = unsafe { timeout.read() };
        if time.seconds < 0 || !(0..1_000_000).contains(&time.microseconds) {
            return ERROR_INVALID_PARAM;
        }
        (time.seconds.saturating_mul(1_000_000_000)).saturating_add(time.microseconds * 1_000)
    };
    // SAFETY: the caller's number, which callbacks write while nobody else does.
    let is_completed = || unsafe { !completed.is_null() && completed.read_volatile() != 0 };
    let context = context_number(context);
    let until_nanos = now_nanos().saturating_add(wait_nanos);
    let first: Option<Ended> = wait_for(|world, now| {
        world.pump(now);
        if is_completed() {
            return Ok(None);
        }
        if let Some(ended) = world.take_ended(context) {
            return Ok(Some(ended));
        }
        if now >= until_nanos || world.take_interruption(context) {
            return Ok(None);
        }
        Err(world.next_nanos().unwrap_or(i64::MAX).min(until_nanos))
    });
    let mut next = first;
    while let Some(ended) = next {
        transfers::finish(ended);
        next = with_world(|world| world.take_ended(context));
    }
    // Others may wait for what a callback did.
    wake_all();
    SUCCESS
}

/// # Safety
/// `timeout` is null or a time.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_handle_events_timeout(
    context: Opaque,
    timeout: *const Timeval,
) -> c_int {
    // SAFETY: the same promise; no number.
    unsafe { libusb_handle_events_timeout_completed(context, timeout, ptr::null_mut()) }
}

/// # Safety
/// As of [`libusb_handle_events_timeout`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_handle_events_locked(
    context: Opaque,
    timeout: *const Timeval,
) -> c_int {
    // SAFETY: the same promise; no number.
    unsafe { libusb_handle_events_timeout_completed(context, timeout, ptr::null_mut()) }
}

#[unsafe(no_mangle)]
extern "C" fn libusb_handle_events(context: Opaque) -> c_int {
    // SAFETY: neither a time nor a number is given.
    unsafe { libusb_handle_events_timeout_completed(context, ptr::null(), ptr::null_mut()) }
}

/// # Safety
/// As of [`libusb_handle_events_timeout_completed`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_handle_events_completed(
    context: Opaque,
    completed: *mut c_int,
) -> c_int {
    // SAFETY: the same promise.
    unsafe { libusb_handle_events_timeout_completed(context, ptr::null(), completed) }
}

#[unsafe(no_mangle)]
extern "C" fn libusb_interrupt_event_handler(context: Opaque) {
    with_world(|world| world.interrupt(context_number(context)));
    wake_all();
}

/// There is no lock to hold: every call may handle events.
#[unsafe(no_mangle)]
extern "C" fn libusb_try_lock_events(_context: Opaque) -> c_int {
    0
}

#[unsafe(no_mangle)]
extern "C" fn libusb_lock_events(_context: Opaque) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_unlock_events(_context: Opaque) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_event_handling_ok(_context: Opaque) -> c_int {
    1
}

#[unsafe(no_mangle)]
extern "C" fn libusb_event_handler_active(_context: Opaque) -> c_int {
    0
}

#[unsafe(no_mangle)]
extern "C" fn libusb_lock_event_waiters(_context: Opaque) {}

#[unsafe(no_mangle)]
extern "C" fn libusb_unlock_event_waiters(_context: Opaque) {}

/// # Safety
/// As of [`libusb_handle_events_timeout`].
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_wait_for_event(context: Opaque, timeout: *const Timeval) -> c_int {
    // SAFETY: the same promise.
    unsafe { libusb_handle_events_timeout(context, timeout) }
}

/// Times are handled with the events.
#[unsafe(no_mangle)]
extern "C" fn libusb_pollfds_handle_timeouts(_context: Opaque) -> c_int {
    1
}

/// # Safety
/// `timeout` is a place for a time.
#[unsafe(no_mangle)]
unsafe extern "C" fn libusb_get_next_timeout(_context: Opaque, timeout: *mut Timeval) -> c_int {
    let Some(next_nanos) = with_world(|world| world.next_nanos()) else {
        return 0;
    };
    let wait_nanos = (next_nanos - now_nanos()).max(0);
    // SAFETY: the caller gives a place for the time.
    unsafe {
        timeout.write(Timeval {
            seconds: wait_nanos / 1_000_000_000,
            microseconds: wait_nanos % 1_000_000_000 / 1_000,
        });
    }
    1
}
