//! Transfers of one endpoint, with what came of them.
#![expect(unsafe_code, reason = "calls into a C library")]

use std::cell::{Cell, RefCell};
use std::ffi::{c_int, c_uchar, c_uint, c_void};
use std::rc::Rc;

use crate::api::{Library, Opaque, call};

const TYPE_ISO: c_uchar = 1;
const TYPE_BULK: c_uchar = 2;

#[repr(C)]
struct IsoPacket {
    length: c_uint,
    actual_length: c_uint,
    status: c_int,
}

#[repr(C)]
struct Transfer {
    handle: Opaque,
    flags: u8,
    endpoint: c_uchar,
    kind: c_uchar,
    timeout: c_uint,
    status: c_int,
    length: c_int,
    actual_length: c_int,
    callback: extern "C" fn(*mut Transfer),
    user_data: *mut c_void,
    buffer: *mut c_uchar,
    iso_packet_count: c_int,
    iso_packets: [IsoPacket; 0],
}

/// Status and data, in the order of the callbacks.
type Ends = RefCell<Vec<(c_int, Vec<u8>)>>;

/// Transfers of one endpoint.
pub(crate) struct Queue {
    library: &'static Library,
    handle: Opaque,
    endpoint: u8,
    ends: Rc<Ends>,
    transfers: Vec<*mut Transfer>,
    buffers: Vec<Vec<u8>>,
    submitted: Cell<usize>,
}

extern "C" fn note_end(transfer: *mut Transfer) {
    // SAFETY: the queue waits for the callbacks of what it has submitted; libusb has filled the structure in.
    unsafe {
        let ended = &*transfer;
        let ends = &*ended.user_data.cast::<Ends>();
        let mut data = Vec::new();
        if ended.kind == TYPE_ISO {
            let packets = (&raw const (*transfer).iso_packets).cast::<IsoPacket>();
            let mut place = 0;
            for index in 0..ended.iso_packet_count as usize {
                let packet = &*packets.add(index);
                let start = ended.buffer.add(place);
                data.extend_from_slice(std::slice::from_raw_parts(
                    start,
                    packet.actual_length as usize,
                ));
                place += packet.length as usize;
            }
        } else {
            let bytes = std::slice::from_raw_parts(ended.buffer, ended.actual_length as usize);
            data.extend_from_slice(bytes);
        }
        ends.borrow_mut().push((ended.status, data));
    }
}

impl Queue {
    pub(crate) fn new(library: &'static Library, handle: Opaque, endpoint: u8) -> Self {
        Self {
            library,
            handle,
            endpoint,
            ends: Rc::default(),
            transfers: Vec::new(),
            buffers: Vec::new(),
            submitted: Cell::new(0),
        }
    }

    fn submit(
        &mut self,
        length: usize,
        timeout: c_uint,
        packets: Option<(c_int, c_uint)>,
    ) -> c_int {
        let count = packets.map_or(0, |(count, _)| count);
        let transfer = call!(
            self.library,
            c"libusb_alloc_transfer",
            fn(c_int) -> *mut Transfer,
            count
        );
        let mut buffer = vec![0; length];
        // SAFETY: the structure is ours until it is submitted, with room for the packets that were asked for.
        unsafe {
            (*transfer).handle = self.handle;
            (*transfer).endpoint = self.endpoint;
            (*transfer).kind = if packets.is_some() {
                TYPE_ISO
            } else {
                TYPE_BULK
            };
            (*transfer).timeout = timeout;
            (*transfer).length = length as c_int;
            (*transfer).callback = note_end;
            (*transfer).user_data = Rc::as_ptr(&self.ends).cast_mut().cast();
            (*transfer).buffer = buffer.as_mut_ptr();
            (*transfer).iso_packet_count = count;
            let first = (&raw mut (*transfer).iso_packets).cast::<IsoPacket>();
            for index in 0..count as usize {
                (*first.add(index)).length = packets.map_or(0, |(_, room)| room);
            }
        }
        let code = call!(
            self.library,
            c"libusb_submit_transfer",
            fn(*mut Transfer) -> c_int,
            transfer
        );
        self.buffers.push(buffer);
        self.transfers.push(transfer);
        self.submitted
            .set(self.submitted.get() + usize::from(code == 0));
        code
    }

    pub(crate) fn submit_bulk(&mut self, length: usize, timeout_millis: c_uint) {
        assert_eq!(self.submit(length, timeout_millis, None), 0);
    }

    pub(crate) fn try_submit_bulk(&mut self, length: usize) -> c_int {
        self.submit(length, 0, None)
    }

    pub(crate) fn submit_iso(&mut self, count: c_int, room: c_uint) {
        let length = count as usize * room as usize;
        assert_eq!(self.submit(length, 0, Some((count, room))), 0);
    }

    pub(crate) fn cancel_all(&self) {
        for &transfer in &self.transfers {
            call!(
                self.library,
                c"libusb_cancel_transfer",
                fn(*mut Transfer) -> c_int,
                transfer
            );
        }
    }

    pub(crate) fn is_done(&self) -> bool {
        self.ends.borrow().len() == self.submitted.get()
    }

    pub(crate) fn ended(&self) -> Vec<(c_int, Vec<u8>)> {
        self.ends.borrow().clone()
    }
}

impl Drop for Queue {
    fn drop(&mut self) {
        for &transfer in &self.transfers {
            call!(
                self.library,
                c"libusb_free_transfer",
                fn(*mut Transfer),
                transfer
            );
        }
    }
}
