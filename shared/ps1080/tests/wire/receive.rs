//! A host in small: receives a stream in pieces and decodes it.

use ps1080::Damage;
use ps1080::samples::{SampleDecoder, SampleFormat};
use ps1080::stream::{
    DeviceTicks, FrameEvent, FrameReceiver, LossCause, PacketKind, Packetiser, Padding, StreamKind,
};

/// What became of the frames of a stream, in order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Outcome {
    Frame(DeviceTicks, Vec<u16>),
    Damaged(Damage),
    Lost(LossCause, u64),
    Fault(PacketKind),
}

/// A receiver of depth with its decoder.
pub(crate) struct Host {
    pub(crate) receiver: FrameReceiver,
    decoder: SampleDecoder,
    codes: Vec<u16>,
    pub(crate) outcomes: Vec<Outcome>,
}

impl Host {
    pub(crate) fn new(format: SampleFormat, count: usize) -> Self {
        Self {
            receiver: FrameReceiver::new(StreamKind::Depth),
            decoder: SampleDecoder::new(format, count),
            // No code that a frame has by chance everywhere.
            codes: vec![0x5A5A; count],
            outcomes: Vec::new(),
        }
    }

    pub(crate) fn transfer(&mut self, mut transfer: &[u8]) {
        while let Some(event) = self.receiver.next(&mut transfer) {
            let outcome = match event {
                FrameEvent::Started(padding) => {
                    self.decoder.begin(padding);
                    self.codes.fill(0x5A5A);
                    continue;
                }
                FrameEvent::Data(bytes) => {
                    // Damage shows at the end.
                    let _ = self.decoder.push(bytes, &mut self.codes);
                    continue;
                }
                FrameEvent::Ended(ticks) => match self.decoder.finish(&mut self.codes) {
                    Ok(()) => Outcome::Frame(ticks, self.codes.clone()),
                    Err(damage) => Outcome::Damaged(damage),
                },
                FrameEvent::Lost(loss) => Outcome::Lost(loss.cause, loss.payload_bytes),
                FrameEvent::Fault(kind) => Outcome::Fault(kind),
            };
            self.outcomes.push(outcome);
        }
    }
}

/// The packets of frames of payload, each packet for itself; stamps 1000, 2000, and so on.
pub(crate) fn packets(payloads: &[Vec<u8>], packet_bytes: usize) -> Vec<Vec<u8>> {
    let mut packetiser = Packetiser::new(StreamKind::Depth, packet_bytes).unwrap();
    let mut packets = Vec::new();
    for (index, payload) in payloads.iter().enumerate() {
        let ticks = ticks_of(index);
        for packet in packetiser.frame(payload, Padding::default(), ticks) {
            packets.push([&packet.header, packet.payload].concat());
        }
    }
    packets
}

pub(crate) fn ticks_of(index: usize) -> DeviceTicks {
    DeviceTicks(1000 * (index as u32 + 1))
}
