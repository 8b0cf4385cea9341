//! Queued transfers, filled when hardware would fill them.

use std::collections::{BTreeMap, VecDeque};

use ps1080::usb::TransferKind;

use crate::camera::{Read, VirtualCarmine};
use crate::usb::{Control, Setup};

/// A microframe of USB 2, in which an isochronous endpoint sends once.
const MICROFRAME_NANOS: i64 = 125_000;

/// How a transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransferStatus {
    /// Full, or ended by the camera.
    Completed,
    /// Taken back by the host; what had come until then is there.
    Cancelled,
    /// The endpoint does not exist in the active setting.
    Stall,
    /// The camera has been unplugged; what had come until then is there.
    NoDevice,
}

/// A transfer that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Transfer {
    /// As given to [`Bus::submit`].
    pub token: u64,
    /// How it ended.
    pub status: TransferStatus,
    /// What came. Of an isochronous transfer the packets, one after the other.
    pub data: Vec<u8>,
    /// Bytes of each packet of an isochronous transfer; empty for bulk.
    pub packet_bytes: Vec<usize>,
    /// When it ended, in the host's time: not when it was noticed.
    pub ended_nanos: i64,
}

struct Pending {
    token: u64,
    buffer: Vec<u8>,
    filled: usize,
    /// Bytes of the packets of an isochronous transfer: room, then what came.
    packets: Vec<usize>,
    packets_done: usize,
    /// Not before this time do data go into it.
    from_nanos: i64,
}

/// A camera behind queues of transfers, one for each endpoint, as a host controller has them.
///
/// Data go into queued transfers at the time at which they are ready in the camera, however late [`Bus::advance`] is
/// called; what no transfer is queued for waits in the camera's FIFO and is lost when that is full. So a host that keeps
/// enough transfers queued loses nothing even if it is slow to look, and one that does not loses what it would lose on
/// a real bus.
pub struct Bus {
    camera: VirtualCarmine,
    queues: BTreeMap<u8, VecDeque<Pending>>,
    /// Until when an isochronous endpoint has been polled.
    polled_nanos: BTreeMap<u8, i64>,
    done: VecDeque<Transfer>,
    spare: Vec<Vec<u8>>,
    now_nanos: i64,
}

impl Bus {
    /// A bus with a camera on it.
    pub fn new(camera: VirtualCarmine) -> Self {
        Self {
            camera,
            queues: BTreeMap::new(),
            polled_nanos: BTreeMap::new(),
            done: VecDeque::new(),
            spare: Vec::new(),
            now_nanos: i64::MIN,
        }
    }

    /// The camera, to ask what it counted.
    pub fn camera(&self) -> &VirtualCarmine {
        &self.camera
    }

    /// Pulls the plug at `now_nanos`.
    pub fn unplug(&mut self, now_nanos: i64) {
        self.advance(now_nanos);
        self.camera.unplug();
        self.advance(now_nanos);
    }

    /// A control transfer at `now_nanos`, see [`VirtualCarmine::control`].
    pub fn control(&mut self, now_nanos: i64, setup: Setup, data: &mut [u8]) -> Control {
        self.advance(now_nanos);
        let control = self.camera.control(now_nanos, setup, data);
        self.look_again();
        control
    }

    /// Chooses the alternate setting, see [`VirtualCarmine::set_alt_setting`].
    pub fn set_alt_setting(&mut self, now_nanos: i64, setting: u8) -> bool {
        self.advance(now_nanos);
        let is_there = self.camera.set_alt_setting(now_nanos, setting);
        self.look_again();
        is_there
    }

    /// What the camera said of its next data may no longer hold.
    fn look_again(&mut self) {
        for polled_nanos in self.polled_nanos.values_mut() {
            *polled_nanos = (*polled_nanos).min(self.now_nanos);
        }
        let now_nanos = self.now_nanos;
        self.advance(now_nanos);
    }

    /// Queues a bulk read of `length` bytes on `endpoint`. `token` is given back with it and should be the only one of
    /// its number.
    pub fn submit(&mut self, now_nanos: i64, endpoint: u8, token: u64, length: usize) {
        self.queue(now_nanos, endpoint, token, length, Vec::new());
    }

    /// Queues an isochronous read: one packet a microframe, each with room for its number of bytes.
    pub fn submit_iso(&mut self, now_nanos: i64, endpoint: u8, token: u64, packet_bytes: &[usize]) {
        let length = packet_bytes.iter().sum();
        self.queue(now_nanos, endpoint, token, length, packet_bytes.to_vec());
    }

    fn queue(
        &mut self,
        now_nanos: i64,
        endpoint: u8,
        token: u64,
        length: usize,
        packets: Vec<usize>,
    ) {
        self.advance(now_nanos);
        let mut buffer = self.spare.pop().unwrap_or_default();
        buffer.resize(length, 0);
        let queue = self.queues.entry(endpoint).or_default();
        queue.push_back(Pending {
            token,
            buffer,
            filled: 0,
            packets,
            packets_done: 0,
            from_nanos: now_nanos,
        });
        self.advance(now_nanos);
    }

    /// Takes a transfer back: it ends as [`TransferStatus::Cancelled`]. Whether it was still queued.
    pub fn cancel(&mut self, now_nanos: i64, token: u64) -> bool {
        self.advance(now_nanos);
        for queue in self.queues.values_mut() {
            let place = queue.iter().position(|pending| pending.token == token);
            if let Some(pending) = place.and_then(|place| queue.remove(place)) {
                let ended = pending.end(TransferStatus::Cancelled, now_nanos);
                self.done.push_back(ended);
                return true;
            }
        }
        false
    }

    /// Fills transfers with all that has come until `now_nanos`.
    pub fn advance(&mut self, now_nanos: i64) {
        let now_nanos = now_nanos.max(self.now_nanos);
        self.now_nanos = now_nanos;
        let endpoints: Vec<u8> = self.queues.keys().copied().collect();
        // Endpoints take turns by time, so that no read is before the camera's last one.
        while let Some((at_nanos, endpoint)) = endpoints
            .iter()
            .filter_map(|&endpoint| self.next_read_nanos(endpoint).map(|at| (at, endpoint)))
            .min()
            .filter(|&(at_nanos, _)| at_nanos <= now_nanos)
        {
            self.read(at_nanos, endpoint);
        }
        // Time passes for a camera that nobody reads from too.
        self.camera.pass_time(now_nanos);
        if self.camera.is_gone() {
            self.end_all(TransferStatus::NoDevice, now_nanos);
        }
    }

    /// The next transfer that has ended, in the order of the times at which they did.
    pub fn completed(&mut self) -> Option<Transfer> {
        self.done.pop_front()
    }

    /// Takes the memory of a transfer back for the next ones.
    pub fn recycle(&mut self, data: Vec<u8>) {
        self.spare.push(data);
    }

    /// When a transfer can end next, or something else happens that is to be looked at: a sleeper may sleep so long, and
    /// will not be late by more than its own delay. `None`: not before another call.
    pub fn next_nanos(&self) -> Option<i64> {
        if !self.done.is_empty() {
            return Some(self.now_nanos);
        }
        let is_iso = self.camera.transfer_kind() == Some(TransferKind::Isochronous);
        let ends = self.queues.iter().filter_map(|(&endpoint, queue)| {
            let pending = queue.front()?;
            if is_iso && !pending.packets.is_empty() {
                // At most some thousands of packets.
                let left = (pending.packets.len() - pending.packets_done) as i64;
                let next_nanos = self.next_read_nanos(endpoint)?;
                return Some(next_nanos.saturating_add((left - 1) * MICROFRAME_NANOS));
            }
            let missing = pending.buffer.len() - pending.filled;
            let ready_nanos = self.camera.ready_nanos(endpoint, missing)?;
            Some(ready_nanos.max(self.now_nanos))
        });
        let unplug = self
            .camera
            .unplug_nanos()
            .filter(|_| !self.camera.is_gone());
        ends.chain(unplug).min()
    }

    /// When the first queued transfer of an endpoint is to be read into next.
    fn next_read_nanos(&self, endpoint: u8) -> Option<i64> {
        let pending = self.queues.get(&endpoint)?.front()?;
        let polled = self.polled_nanos.get(&endpoint).copied();
        Some(pending.from_nanos.max(polled.unwrap_or(i64::MIN)))
    }

    fn read(&mut self, at_nanos: i64, endpoint: u8) {
        let is_iso = self.camera.transfer_kind() == Some(TransferKind::Isochronous);
        let Some(queue) = self.queues.get_mut(&endpoint) else {
            return;
        };
        let Some(pending) = queue.front_mut() else {
            return;
        };
        if is_iso && !pending.packets.is_empty() {
            self.polled_nanos
                .insert(endpoint, at_nanos + MICROFRAME_NANOS);
        }
        let ended = pending.read(at_nanos, endpoint, &mut self.camera);
        match ended {
            Progress::Goes => {}
            Progress::Waits(next_nanos) => {
                // Never, until a control transfer changes something.
                let next_nanos = next_nanos.unwrap_or(i64::MAX);
                self.polled_nanos
                    .insert(endpoint, next_nanos.max(at_nanos + 1));
            }
            Progress::Ends(status) => {
                if let Some(pending) = queue.pop_front() {
                    self.done.push_back(pending.end(status, at_nanos));
                }
            }
        }
    }

    fn end_all(&mut self, status: TransferStatus, now_nanos: i64) {
        for queue in self.queues.values_mut() {
            for pending in queue.drain(..) {
                self.done.push_back(pending.end(status, now_nanos));
            }
        }
    }
}

enum Progress {
    Goes,
    Waits(Option<i64>),
    Ends(TransferStatus),
}

impl Pending {
    fn read(&mut self, at_nanos: i64, endpoint: u8, camera: &mut VirtualCarmine) -> Progress {
        if !self.packets.is_empty() {
            return self.read_packet(at_nanos, endpoint, camera);
        }
        match camera.read(at_nanos, endpoint, &mut self.buffer[self.filled..]) {
            Read::Bytes { count, ends } => {
                self.filled += count;
                if ends || self.filled == self.buffer.len() {
                    Progress::Ends(TransferStatus::Completed)
                } else {
                    Progress::Goes
                }
            }
            Read::NotYet { at_nanos } => Progress::Waits(at_nanos),
            Read::Stall => Progress::Ends(TransferStatus::Stall),
            Read::Gone => Progress::Ends(TransferStatus::NoDevice),
        }
    }

    /// Fills one packet, with nothing where nothing is there.
    fn read_packet(
        &mut self,
        at_nanos: i64,
        endpoint: u8,
        camera: &mut VirtualCarmine,
    ) -> Progress {
        let room = self.packets[self.packets_done];
        let end = (self.filled + room).min(self.buffer.len());
        let count = match camera.read(at_nanos, endpoint, &mut self.buffer[self.filled..end]) {
            Read::Bytes { count, .. } => count,
            Read::NotYet { .. } => 0,
            Read::Stall => return Progress::Ends(TransferStatus::Stall),
            Read::Gone => return Progress::Ends(TransferStatus::NoDevice),
        };
        self.filled += count;
        self.packets[self.packets_done] = count;
        self.packets_done += 1;
        if self.packets_done == self.packets.len() {
            Progress::Ends(TransferStatus::Completed)
        } else {
            Progress::Goes
        }
    }

    fn end(mut self, status: TransferStatus, ended_nanos: i64) -> Transfer {
        self.buffer.truncate(self.filled);
        self.packets.truncate(self.packets_done);
        Transfer {
            token: self.token,
            status,
            data: self.buffer,
            packet_bytes: self.packets,
            ended_nanos,
        }
    }
}
