//! The library as C programs see it: loaded by name, called through its symbols.

mod api;
mod queue;
mod symbols;

use std::ffi::c_int;

use api::{Library, Opaque, host_request};
use ps1080::host::Request;
use ps1080::parameter::Parameter;
use ps1080::stream::{FrameEvent, FrameReceiver, StreamKind};
use queue::Queue;

const ERROR_ACCESS: c_int = -3;
const ERROR_NO_DEVICE: c_int = -4;
const ERROR_NOT_FOUND: c_int = -5;
const ERROR_BUSY: c_int = -6;
const ERROR_TIMEOUT: c_int = -7;
const ERROR_PIPE: c_int = -9;
const COMPLETED: c_int = 0;
const TIMED_OUT: c_int = 2;
const CANCELLED: c_int = 3;
const NO_DEVICE: c_int = 5;

/// The cameras of this test, by what they are for.
#[derive(Clone, Copy)]
enum Which {
    Whole,
    Unplugged,
    Forbidden,
    Busy,
    Driven,
    Dead,
    Isochronous,
    Silent,
}

/// How many there are.
pub(crate) const CAMERA_COUNT: usize = 8;
pub(crate) const CONFIG: &str = r#"
[[camera]]
[[camera]]
ports = [3, 1]
[camera.faults]
unplug_after_nanos = 300000000
[[camera]]
is_forbidden = true
[[camera]]
is_busy = true
[[camera]]
has_kernel_driver = true
[[camera]]
[camera.faults]
dead_requests = 1
[[camera]]
[[camera]]
"#;

/// Opens a camera of its own context.
fn open(library: &Library, which: Which) -> (Opaque, Result<Opaque, c_int>) {
    let context = library.init();
    (context, library.open(context, which as usize))
}

/// Opens it with interface 0.
fn claim(library: &Library, which: Which) -> (Opaque, Opaque) {
    let (context, handle) = open(library, which);
    let handle = handle.unwrap();
    assert_eq!(library.claim(handle), 0);
    (context, handle)
}

fn start_depth(library: &Library, handle: Opaque) {
    let set = Request::set(Parameter::Stream1Mode, 2);
    assert_eq!(host_request(library, handle, set), Ok(Vec::new()));
}

#[test]
fn descriptors_name_the_camera() {
    let library = Library::load();
    let (context, handle) = open(library, Which::Whole);
    let handle = handle.unwrap();
    assert_eq!(
        library.product(context, Which::Whole as usize),
        (0x1d27, 0x0609)
    );
    assert_eq!(library.ports(context, Which::Unplugged as usize), [3, 1]);
    assert_eq!(library.text(handle, 2), "PrimeSense Device");
    // Interface 0 with three settings of two endpoints, and one for microphones.
    let (interfaces, settings, endpoints) = library.configuration(context, 0);
    assert_eq!((interfaces, settings, endpoints), (2, 3, 2));
}

#[test]
fn what_cannot_be_opened_or_claimed_says_why() {
    let library = Library::load();
    assert_eq!(open(library, Which::Forbidden).1, Err(ERROR_ACCESS));
    let (_, busy) = open(library, Which::Busy);
    assert_eq!(library.claim(busy.unwrap()), ERROR_BUSY);
    let driven = open(library, Which::Driven).1.unwrap();
    assert_eq!(library.kernel_driver(driven), 1);
    assert_eq!(library.claim(driven), ERROR_BUSY);
    assert_eq!(library.detach(driven), 0);
    assert_eq!(library.claim(driven), 0);
    // One program at a time.
    let second = open(library, Which::Driven).1.unwrap();
    assert_eq!(library.claim(second), ERROR_BUSY);
    library.close(driven);
    assert_eq!(library.claim(second), 0);
    assert_eq!(library.release(second), 0);
    assert_eq!(library.release(second), ERROR_NOT_FOUND);
}

#[test]
fn control_transfers_end_in_every_way() {
    let library = Library::load();
    let (_, handle) = claim(library, Which::Dead);
    // The first request is not taken; the second is.
    assert_eq!(
        host_request(library, handle, Request::KeepAlive),
        Err(ERROR_TIMEOUT)
    );
    assert_eq!(
        host_request(library, handle, Request::KeepAlive),
        Ok(Vec::new())
    );
    assert_eq!(
        library.control(handle, 0x80, 6, 0x0700, &mut [0; 8]),
        ERROR_PIPE
    );
    assert_eq!(library.set_alt_setting(handle, 9), ERROR_NOT_FOUND);
    assert_eq!(library.set_alt_setting(handle, 1), 0);
    let mut setting = [9];
    assert_eq!(library.control(handle, 0x81, 10, 0, &mut setting), 1);
    assert_eq!(setting, [1]);
}

#[test]
fn queued_transfers_bring_every_frame_and_end_when_they_are_told_to() {
    let library = Library::load();
    let (context, handle) = claim(library, Which::Whole);
    // Nothing comes before the stream is on: a time-out, a cancellation.
    let mut late = Queue::new(library, handle, 0x81);
    late.submit_bulk(512, 30);
    let mut taken_back = Queue::new(library, handle, 0x82);
    taken_back.submit_bulk(512, 0);
    taken_back.cancel_all();
    library.events_until(context, || late.is_done() && taken_back.is_done());
    assert_eq!(late.ended()[0].0, TIMED_OUT);
    assert_eq!(taken_back.ended()[0].0, CANCELLED);

    start_depth(library, handle);
    let mut queue = Queue::new(library, handle, 0x81);
    for _ in 0..32 {
        queue.submit_bulk(20_480, 0);
    }
    library.events_until(context, || queue.is_done());
    let mut receiver = FrameReceiver::new(StreamKind::Depth);
    let mut frame_count = 0;
    for (status, data) in queue.ended() {
        assert_eq!(status, COMPLETED);
        let mut transfer = data.as_slice();
        while let Some(event) = receiver.next(&mut transfer) {
            assert!(!matches!(event, FrameEvent::Lost(_)), "{event:?}");
            frame_count += usize::from(matches!(event, FrameEvent::Ended(_)));
        }
    }
    // QVGA in 11 bits: five transfers and a short one a frame.
    assert!(frame_count >= 5, "{frame_count} frames");
}

#[test]
fn reads_that_wait_get_data_or_time_out() {
    let library = Library::load();
    let (_, handle) = claim(library, Which::Silent);
    let mut buffer = [0; 512];
    assert_eq!(
        library.bulk(handle, 0x82, &mut buffer, 20),
        (ERROR_TIMEOUT, 0)
    );
    assert_eq!(library.bulk(handle, 0x85, &mut buffer, 20), (ERROR_PIPE, 0));
    assert_eq!(
        library.bulk(handle, 0x04, &mut buffer, 20).0,
        ERROR_NOT_FOUND
    );
}

#[test]
fn unplugging_ends_transfers_and_calls() {
    let library = Library::load();
    let (context, handle) = claim(library, Which::Unplugged);
    start_depth(library, handle);
    let mut queue = Queue::new(library, handle, 0x81);
    for _ in 0..64 {
        queue.submit_bulk(20_480, 0);
    }
    library.events_until(context, || queue.is_done());
    let ended = queue.ended();
    assert_eq!(ended[0].0, COMPLETED);
    assert_eq!(ended[63].0, NO_DEVICE);
    let again = host_request(library, handle, Request::GetMode);
    assert_eq!(again, Err(ERROR_NO_DEVICE));
    let mut queue = Queue::new(library, handle, 0x81);
    assert_eq!(queue.try_submit_bulk(512), ERROR_NO_DEVICE);
    assert_eq!(library.set_alt_setting(handle, 0), ERROR_NO_DEVICE);
    library.close(handle);
}

#[test]
fn isochronous_packets_stand_at_their_places() {
    let library = Library::load();
    let (context, handle) = claim(library, Which::Isochronous);
    assert_eq!(library.set_alt_setting(handle, 1), 0);
    assert_eq!(
        library.max_iso_packet(context, Which::Isochronous as usize),
        2040
    );
    start_depth(library, handle);
    let mut queue = Queue::new(library, handle, 0x81);
    assert_eq!(queue.try_submit_bulk(512), -2);
    for _ in 0..40 {
        queue.submit_iso(32, 2040);
    }
    library.events_until(context, || queue.is_done());
    let mut receiver = FrameReceiver::new(StreamKind::Depth);
    let mut frame_count = 0;
    for (status, data) in queue.ended() {
        assert_eq!(status, COMPLETED);
        let mut transfer = data.as_slice();
        while let Some(event) = receiver.next(&mut transfer) {
            assert!(!matches!(event, FrameEvent::Lost(_)), "{event:?}");
            frame_count += usize::from(matches!(event, FrameEvent::Ended(_)));
        }
    }
    // 160 ms at 30 frames a second, less the start.
    assert!(frame_count >= 2, "{frame_count} frames");
}
