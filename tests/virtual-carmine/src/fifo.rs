//! The memory between sensor and USB: bounded, so that a host that does not read loses data.

use std::collections::VecDeque;

/// Where a frame ends in the stream of bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameEnd {
    pub(crate) film_index: u64,
    pub(crate) ticks: u32,
    pub(crate) ready_nanos: i64,
    pub(crate) is_whole: bool,
}

#[derive(Debug)]
pub(crate) struct Fifo {
    bytes: VecDeque<u8>,
    capacity_bytes: usize,
    taken_bytes: u64,
    /// Ends of frames, by the count of bytes before them.
    ends: VecDeque<(u64, FrameEnd)>,
}

impl Fifo {
    pub(crate) fn new(capacity_bytes: usize) -> Self {
        Self {
            bytes: VecDeque::with_capacity(capacity_bytes),
            capacity_bytes,
            taken_bytes: 0,
            ends: VecDeque::new(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.bytes.len()
    }

    /// Stores a packet, or nothing of it where there is no room.
    pub(crate) fn push(&mut self, packet: &[u8]) -> bool {
        let has_room = self.bytes.len() + packet.len() <= self.capacity_bytes;
        if has_room {
            self.bytes.extend(packet);
        }
        has_room
    }

    /// Marks what has been stored as the end of a frame.
    pub(crate) fn end_frame(&mut self, end: FrameEnd) {
        self.ends
            .push_back((self.taken_bytes + self.bytes.len() as u64, end));
    }

    /// Takes as many bytes as `out` holds; the caller knows that they are there.
    pub(crate) fn take(&mut self, out: &mut [u8]) {
        let (first, second) = self.bytes.as_slices();
        let from_first = first.len().min(out.len());
        let (head, tail) = out.split_at_mut(from_first);
        head.copy_from_slice(&first[..from_first]);
        let from_second = second.len().min(tail.len());
        tail[..from_second].copy_from_slice(&second[..from_second]);
        self.bytes.drain(..from_first + from_second);
        self.taken_bytes += (from_first + from_second) as u64;
    }

    /// The next frame whose end has been taken.
    pub(crate) fn pop_ended(&mut self) -> Option<FrameEnd> {
        let &(at, end) = self.ends.front()?;
        (at <= self.taken_bytes).then(|| {
            self.ends.pop_front();
            end
        })
    }

    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_without_room_leaves_nothing_behind() {
        let mut fifo = Fifo::new(10);
        assert!(fifo.push(&[1; 6]));
        assert!(!fifo.push(&[2; 5]));
        assert!(fifo.push(&[3; 4]));
        let mut out = [0; 10];
        fifo.take(&mut out);
        assert_eq!(out, [1, 1, 1, 1, 1, 1, 3, 3, 3, 3]);
        assert_eq!(fifo.len(), 0);
    }
}
