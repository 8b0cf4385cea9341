//! The packet stream of a data endpoint (protocol section 6): frames cut into packets, packets found again in
//! transfers that end anywhere.
//!
//! [`PacketParser`] finds packets, [`FrameReceiver`] makes frames of them and says what was lost and why,
//! [`Packetiser`] is the camera's side.

mod frames;
mod packet;
mod packetiser;
mod parser;
mod ticks;

pub use frames::{FrameEvent, FrameReceiver, Loss, LossCause, LossCounts};
pub use packet::{
    HEADER_BYTES, MAX_PACKET_BYTES, PACKET_MAGIC, PacketHeader, PacketKind, Padding, PartKind,
    StreamKind,
};
pub use packetiser::{FramePackets, Packet, Packetiser};
pub use parser::{PacketParser, Piece};
pub use ticks::{DeviceTicks, TickRate};
