//! Encoded records in a ring of bytes, between the record thread and the disk.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use ringbuf::traits::{Consumer as _, Observer as _, Producer as _, Split as _};
use ringbuf::{HeapCons, HeapProd, HeapRb};
use sequence::layout::{FrameHeader, GapHeader};
use zerocopy::byteorder::little_endian::{I64, U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::latency::Work;

/// What a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum MessageKind {
    /// Frame header and payload.
    Frame = 1,
    /// A table of depth codes.
    Table = 2,
    /// Gap header and words.
    Gap = 3,
    /// A histogram as JSON.
    Histogram = 4,
    /// Nothing follows.
    End = 5,
    /// Entries of a poses record.
    Poses = 6,
    /// An event's JSON.
    Event = 7,
}

/// The beginning of a message.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct MessageHead {
    kind: U16,
    /// Stream.
    pub stream: U16,
    /// Bytes that follow.
    pub bytes: U32,
    wall_nanos: U64,
    core_nanos: U64,
    /// Device time of a frame, nanoseconds; else that of the newest frame before.
    pub device_nanos: I64,
}

/// Bytes of a head.
pub const HEAD_BYTES: usize = size_of::<MessageHead>();

impl MessageHead {
    /// What it took so far.
    pub fn work(&self) -> Work {
        Work {
            wall_nanos: self.wall_nanos.get(),
            core_nanos: self.core_nanos.get(),
        }
    }

    /// What the message is.
    pub fn kind(&self) -> MessageKind {
        match self.kind.get() {
            1 => MessageKind::Frame,
            2 => MessageKind::Table,
            3 => MessageKind::Gap,
            4 => MessageKind::Histogram,
            6 => MessageKind::Poses,
            7 => MessageKind::Event,
            _ => MessageKind::End,
        }
    }
}

/// The end that the record thread, or the fuse thread, has.
pub struct MessageSender {
    ring: HeapProd<u8>,
    newest_nanos: Arc<AtomicI64>,
}

/// The end that the disk has.
pub struct MessageReceiver {
    ring: HeapCons<u8>,
    newest_nanos: Arc<AtomicI64>,
}

/// A ring of `bytes`. Its pages are touched here, so that memory does not grow while recording.
pub fn ring(bytes: usize) -> (MessageSender, MessageReceiver) {
    let (mut sender, mut receiver) = HeapRb::<u8>::new(bytes).split();
    let zeros = [0; 4096];
    while sender.push_slice(&zeros) > 0 {}
    receiver.clear();
    let newest_nanos = Arc::new(AtomicI64::new(i64::MIN));
    let sender = MessageSender {
        ring: sender,
        newest_nanos: Arc::clone(&newest_nanos),
    };
    let receiver = MessageReceiver {
        ring: receiver,
        newest_nanos,
    };
    (sender, receiver)
}

impl MessageSender {
    /// Bytes that can be sent at once.
    pub fn vacant_bytes(&self) -> usize {
        self.ring.vacant_len()
    }

    /// Whether anybody receives.
    pub fn is_connected(&self) -> bool {
        self.ring.read_is_held()
    }

    /// Share of the ring that is in use, 0 to 1.
    pub fn fill_fraction(&self) -> f64 {
        self.ring.occupied_len() as f64 / self.ring.capacity().get() as f64
    }

    /// Sends a message whole; false, and nothing is sent, when it does not fit.
    pub fn send(&mut self, kind: MessageKind, stream: u16, work: Work, parts: [&[u8]; 2]) -> bool {
        let bytes = parts[0].len() + parts[1].len();
        let Ok(length) = u32::try_from(bytes) else {
            return false;
        };
        if self.vacant_bytes() < HEAD_BYTES + bytes {
            return false;
        }
        if kind == MessageKind::Frame
            && let Some((header, _)) = frame_parts(parts[0])
        {
            self.newest_nanos
                .store(header.device_nanos.get(), Ordering::Relaxed);
        }
        let head = MessageHead {
            kind: (kind as u16).into(),
            stream: stream.into(),
            bytes: length.into(),
            wall_nanos: work.wall_nanos.into(),
            core_nanos: work.core_nanos.into(),
            device_nanos: self.newest_nanos.load(Ordering::Relaxed).into(),
        };
        self.ring.push_slice(head.as_bytes());
        self.ring.push_slice(parts[0]);
        self.ring.push_slice(parts[1]);
        true
    }
}

impl MessageReceiver {
    /// The head of the next message; `None` when none is whole yet.
    pub fn next_head(&self) -> Option<MessageHead> {
        let mut head = [0; HEAD_BYTES];
        if self.ring.occupied_len() < HEAD_BYTES || self.ring.peek_slice(&mut head) < HEAD_BYTES {
            return None;
        }
        let head = MessageHead::read_from_bytes(&head).ok()?;
        // The sender pushes a message in parts.
        let is_whole = self.ring.occupied_len() >= HEAD_BYTES + head.bytes.get() as usize;
        is_whole.then_some(head)
    }

    /// Device time of the newest frame that was sent, nanoseconds.
    pub fn newest_nanos(&self) -> i64 {
        self.newest_nanos.load(Ordering::Relaxed)
    }

    /// Whether anybody sends.
    pub fn is_connected(&self) -> bool {
        self.ring.write_is_held()
    }

    /// Bytes that wait.
    pub fn waiting_bytes(&self) -> usize {
        self.ring.occupied_len()
    }

    /// The next message, its bytes in `payload`; `None` when none is whole yet.
    pub fn receive(&mut self, payload: &mut Vec<u8>) -> Option<MessageHead> {
        let head = self.next_head()?;
        let bytes = head.bytes.get() as usize;
        self.ring.skip(HEAD_BYTES);
        payload.resize(bytes, 0);
        self.ring.pop_slice(payload);
        Some(head)
    }

    /// Whether nothing is there.
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }
}

/// Header and image of a frame message.
pub fn frame_parts(payload: &[u8]) -> Option<(&FrameHeader, &[u8])> {
    FrameHeader::ref_from_prefix(payload).ok()
}

/// Header and words of a gap message.
pub fn gap_parts(payload: &[u8]) -> Option<(&GapHeader, &[u8])> {
    GapHeader::ref_from_prefix(payload).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_whole_and_in_order_over_the_seam() {
        let (mut sender, mut receiver) = ring(200);
        let mut payload = Vec::new();
        for round in 0..50_u8 {
            let body = vec![round; 60];
            assert!(sender.send(
                MessageKind::Frame,
                2,
                Work::default(),
                [&body[..20], &body[20..]]
            ));
            assert!(sender.send(MessageKind::Table, 1, Work::default(), [&[round], &[]]));
            assert!(!sender.send(MessageKind::Frame, 2, Work::default(), [&[0; 120], &[]]));
            let head = receiver.receive(&mut payload).unwrap();
            assert_eq!((head.kind(), head.stream.get()), (MessageKind::Frame, 2));
            assert_eq!(payload, body);
            let head = receiver.receive(&mut payload).unwrap();
            assert_eq!(
                (head.kind(), payload.as_slice()),
                (MessageKind::Table, &[round][..])
            );
            assert!(receiver.receive(&mut payload).is_none());
        }
    }
}
