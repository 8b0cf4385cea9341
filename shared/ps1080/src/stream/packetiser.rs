//! The camera's side: a frame cut into packets.

use crate::stream::packet::{
    HEADER_BYTES, MAX_PACKET_BYTES, PacketHeader, PacketKind, Padding, PartKind, StreamKind,
};
use crate::stream::ticks::DeviceTicks;

/// Numbers the packets of one stream and cuts its frames.
#[derive(Clone, Debug)]
pub struct Packetiser {
    kind: StreamKind,
    packet_bytes: usize,
    next_id: u16,
}

/// A packet as it goes out: the payload after the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// The header's 12 bytes.
    pub header: [u8; HEADER_BYTES],
    /// What they announce.
    pub payload: &'a [u8],
}

impl Packetiser {
    /// For packets of at most `packet_bytes`, their header included; `None` where that leaves no payload or does not
    /// fit the size field.
    pub fn new(kind: StreamKind, packet_bytes: usize) -> Option<Self> {
        (HEADER_BYTES + 1..=MAX_PACKET_BYTES)
            .contains(&packet_bytes)
            .then_some(Self {
                kind,
                packet_bytes,
                next_id: 0,
            })
    }

    /// The packets of a frame: one START, as many BUFFER as it takes, one END, which is empty where START had room for
    /// all. `padding` counts for depth only. The ids go on from those of the frame before when all packets are
    /// taken; packets that are left out are ids that never come.
    pub fn frame<'p, 'a>(
        &'p mut self,
        payload: &'a [u8],
        padding: Padding,
        ticks: DeviceTicks,
    ) -> FramePackets<'p, 'a> {
        FramePackets {
            packetiser: self,
            payload,
            padding,
            ticks,
            next: Some(PartKind::Start),
        }
    }

    /// The id of the next packet.
    pub fn next_id(&self) -> u16 {
        self.next_id
    }

    /// Lets ids pass as if that many packets had been sent and lost, as when the camera's memory overruns.
    pub fn skip_ids(&mut self, count: u16) {
        self.next_id = self.next_id.wrapping_add(count);
    }
}

/// Packets of one frame, in order.
#[derive(Debug)]
pub struct FramePackets<'p, 'a> {
    packetiser: &'p mut Packetiser,
    payload: &'a [u8],
    padding: Padding,
    ticks: DeviceTicks,
    next: Option<PartKind>,
}

impl<'a> Iterator for FramePackets<'_, 'a> {
    type Item = Packet<'a>;

    fn next(&mut self) -> Option<Packet<'a>> {
        let part = self.next?;
        let room = self.packetiser.packet_bytes - HEADER_BYTES;
        let (payload, rest) = self.payload.split_at(room.min(self.payload.len()));
        self.payload = rest;
        self.next = match part {
            PartKind::End => None,
            _ if rest.len() <= room => Some(PartKind::End),
            _ => Some(PartKind::Buffer),
        };
        let kind = self.packetiser.kind;
        let has_padding = (kind, part) == (StreamKind::Depth, PartKind::Start);
        let header = PacketHeader {
            kind: PacketKind::Frame(kind, part),
            id: self.packetiser.next_id,
            // At most `packet_bytes`, which fits.
            payload_bytes: payload.len() as u16,
            field: if has_padding {
                self.padding.field()
            } else {
                self.ticks.0
            },
        };
        self.packetiser.next_id = self.packetiser.next_id.wrapping_add(1);
        Some(Packet {
            header: header.encode()?,
            payload,
        })
    }
}
