//! The host protocol on the control endpoint (protocol sections 2 and 3): requests, replies, both directions.
//!
//! One request is in flight at a time. The host encodes a [`Request`] with an id of its choice, sends it, and feeds
//! what it reads to a [`ReplyReader`] of that id; the camera decodes the request and answers with [`encode_reply`].

mod opcode;
mod reply;
mod request;
mod request_bytes;

pub use opcode::{Nack, Opcode};
pub use reply::{MAX_REPLY_DATA_BYTES, Received, ReplyError, ReplyReader, encode_reply};
pub use request::{AlgorithmKind, Request, RequestError, WordList};

/// Bytes of the largest packet, its header included.
pub const MAX_HOST_PACKET_BYTES: usize = 512;
/// Bytes of the header of request and reply.
pub const HOST_HEADER_BYTES: usize = 8;
/// First bytes of a request ("GM").
pub const REQUEST_MAGIC: [u8; 2] = [0x47, 0x4D];
/// First bytes of a reply ("RB").
pub const REPLY_MAGIC: [u8; 2] = [0x52, 0x42];
