//! Finds packets in transfers that end anywhere, in a header or in a magic as well.

use crate::stream::packet::{HEADER_BYTES, PACKET_MAGIC, PacketHeader};

/// What [`PacketParser::next`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Piece<'a> {
    /// A packet begins.
    Header(PacketHeader),
    /// Part of the payload of the packet that began last; never empty.
    Payload(&'a [u8]),
    /// The packet is complete.
    Complete,
    /// So many bytes belong to no packet; never 0. One stretch may come in several pieces.
    Garbage(usize),
}

/// The state machine: look for a header byte by byte, take its payload, look again.
///
/// A header counts only with a known type and a size of at least its own, so that a magic by chance in garbage
/// seldom costs a packet. What follows a false magic is looked through again from its second byte on.
#[derive(Clone, Debug, Default)]
pub struct PacketParser {
    /// Bytes that may be the beginning of a header: all of them match so far.
    header: [u8; HEADER_BYTES],
    header_bytes: usize,
    payload_left: usize,
    in_packet: bool,
}

impl PacketParser {
    /// Before the first byte of an endpoint.
    pub fn new() -> Self {
        Self::default()
    }

    /// The next piece of `transfer`, from which it is taken off; `None` when all of it is taken. Every call but the
    /// last takes something or ends a packet.
    pub fn next<'a>(&mut self, transfer: &mut &'a [u8]) -> Option<Piece<'a>> {
        if self.in_packet {
            return self.next_of_packet(transfer);
        }
        let mut garbage = 0;
        while let Some((&byte, rest)) = transfer.split_first() {
            // Within bounds: a full header is taken at once.
            if let Some(place) = self.header.get_mut(self.header_bytes) {
                *place = byte;
                self.header_bytes += 1;
                *transfer = rest;
            }
            garbage += self.drop_what_is_no_header();
            if self.header_bytes < HEADER_BYTES {
                if self.header_bytes == 0 {
                    garbage += skip_to_magic(transfer);
                }
                continue;
            }
            if garbage > 0 {
                return Some(Piece::Garbage(garbage));
            }
            return self.take_header();
        }
        // A header that was complete behind garbage waits for its turn.
        if garbage == 0 && self.header_bytes == HEADER_BYTES {
            return self.take_header();
        }
        (garbage > 0).then_some(Piece::Garbage(garbage))
    }

    /// Forgets an unfinished packet, as when the endpoint starts anew.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    fn take_header(&mut self) -> Option<Piece<'static>> {
        let header = PacketHeader::decode(&self.header)?;
        self.header_bytes = 0;
        self.payload_left = usize::from(header.payload_bytes);
        self.in_packet = true;
        Some(Piece::Header(header))
    }

    fn next_of_packet<'a>(&mut self, transfer: &mut &'a [u8]) -> Option<Piece<'a>> {
        if self.payload_left == 0 {
            self.in_packet = false;
            return Some(Piece::Complete);
        }
        let (payload, rest) = transfer.split_at(self.payload_left.min(transfer.len()));
        *transfer = rest;
        self.payload_left -= payload.len();
        (!payload.is_empty()).then_some(Piece::Payload(payload))
    }

    /// Takes bytes off the front of the candidate until the rest may begin a header; how many.
    fn drop_what_is_no_header(&mut self) -> usize {
        let mut dropped = 0;
        while self.header_bytes > 0 && !self.may_begin_a_header() {
            self.header.copy_within(1.., 0);
            self.header_bytes -= 1;
            dropped += 1;
        }
        dropped
    }

    fn may_begin_a_header(&self) -> bool {
        match self.header_bytes {
            1 => self.header[0] == PACKET_MAGIC[0],
            HEADER_BYTES => PacketHeader::decode(&self.header).is_some(),
            _ => self.header.starts_with(&PACKET_MAGIC),
        }
    }
}

/// Takes bytes off that cannot begin a magic; how many.
fn skip_to_magic(transfer: &mut &[u8]) -> usize {
    let found = transfer.iter().position(|&byte| byte == PACKET_MAGIC[0]);
    let (skipped, rest) = transfer.split_at(found.unwrap_or(transfer.len()));
    *transfer = rest;
    skipped.len()
}
