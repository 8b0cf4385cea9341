//! Replies: found in what the control endpoint gives, checked, put together.

use core::fmt;

use crate::bytes::{FieldWriter, u16_at};
use crate::host::{HOST_HEADER_BYTES, MAX_HOST_PACKET_BYTES, Nack, Opcode, REPLY_MAGIC};

/// Most data of a reply in one packet: the header and the error word take the rest.
pub const MAX_REPLY_DATA_BYTES: usize = MAX_HOST_PACKET_BYTES - HOST_HEADER_BYTES - 2;

/// What a transfer brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received<'a> {
    /// Nothing: the camera is not ready; to be read again after the receive delay.
    NotYet,
    /// No reply in it; to be read again after 10 ms.
    Garbage,
    /// The reply to another request, left out; to be read again.
    Stale {
        /// Id of that request.
        id: u16,
    },
    /// A part; the rest comes with the next reads, without a header.
    Partial,
    /// The data, complete.
    Data(&'a [u8]),
    /// The camera refuses.
    Refused(Nack),
}

/// Why what came cannot be the reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReplyError {
    /// It has our id but is about another request.
    Opcode {
        /// What was asked.
        expected: u16,
        /// What the reply is about.
        got: u16,
    },
    /// It has no room for its own error word.
    NoErrorWord,
    /// It announces more than a packet.
    TooLong {
        /// Words announced.
        word_count: u16,
    },
}

impl fmt::Display for ReplyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Opcode { expected, got } => {
                write!(f, "reply about request {got} instead of {expected}")
            }
            Self::NoErrorWord => f.write_str("reply without an error word"),
            Self::TooLong { word_count } => write!(f, "reply of {word_count} words"),
        }
    }
}

impl core::error::Error for ReplyError {}

#[derive(Clone, Copy)]
struct ReplyHeader {
    word_count: u16,
    opcode: u16,
    id: u16,
}

impl ReplyHeader {
    fn decode(reply: &[u8]) -> Option<Self> {
        let fields = reply.strip_prefix(&REPLY_MAGIC)?;
        Some(Self {
            word_count: u16_at(fields, 0)?,
            opcode: u16_at(fields, 2)?,
            id: u16_at(fields, 4)?,
        })
    }
}

/// Waits for the reply to one request, of which it holds the packet.
#[derive(Clone, Debug)]
pub struct ReplyReader {
    opcode: u16,
    id: u16,
    packet: [u8; MAX_HOST_PACKET_BYTES],
    /// Bytes that are there, and bytes announced, of what follows the header; 0 before a header.
    there: usize,
    announced: usize,
}

impl ReplyReader {
    /// For the reply to a request of this opcode and id.
    pub fn new(opcode: Opcode, id: u16) -> Self {
        Self {
            opcode: opcode.code(),
            id,
            packet: [0; MAX_HOST_PACKET_BYTES],
            there: 0,
            announced: 0,
        }
    }

    /// Takes what one transfer of [`crate::usb::REQUEST_TYPE_IN`] brought.
    ///
    /// Bytes before the magic are skipped. Bytes after the reply are ignored.
    ///
    /// # Errors
    /// A reply that cannot be the one; another may still come.
    pub fn receive(&mut self, transfer: &[u8]) -> Result<Received<'_>, ReplyError> {
        if transfer.is_empty() {
            return Ok(Received::NotYet);
        }
        if self.announced > 0 {
            return Ok(self.take(transfer));
        }
        let Some((reply, header)) = self.find(transfer) else {
            return Ok(Received::Garbage);
        };
        let ReplyHeader {
            word_count,
            opcode,
            id,
        } = header;
        if id != self.id {
            return Ok(Received::Stale { id });
        }
        if opcode != self.opcode {
            return Err(ReplyError::Opcode {
                expected: self.opcode,
                got: opcode,
            });
        }
        let announced = 2 * usize::from(word_count);
        if announced == 0 {
            return Err(ReplyError::NoErrorWord);
        }
        if announced > MAX_HOST_PACKET_BYTES - HOST_HEADER_BYTES {
            return Err(ReplyError::TooLong { word_count });
        }
        (self.announced, self.there) = (announced, 0);
        let body = reply.get(HOST_HEADER_BYTES..).unwrap_or_default();
        Ok(self.take(body))
    }

    /// The reply that is waited for, wherever it begins in the transfer; else the first with a header.
    fn find<'t>(&self, transfer: &'t [u8]) -> Option<(&'t [u8], ReplyHeader)> {
        let mut replies = (0..transfer.len()).filter_map(|at| {
            let reply = transfer.get(at..)?;
            ReplyHeader::decode(reply).map(|header| (reply, header))
        });
        let first = replies.next()?;
        let is_ours = |(_, header): &(&[u8], ReplyHeader)| {
            (header.opcode, header.id) == (self.opcode, self.id)
        };
        if is_ours(&first) {
            return Some(first);
        }
        Some(replies.find(is_ours).unwrap_or(first))
    }

    fn take(&mut self, bytes: &[u8]) -> Received<'_> {
        let taken = bytes.len().min(self.announced - self.there);
        let end = self.there + taken;
        // Within the packet: what is announced is.
        if let (Some(place), Some(bytes)) =
            (self.packet.get_mut(self.there..end), bytes.get(..taken))
        {
            place.copy_from_slice(bytes);
        }
        self.there = end;
        if self.there < self.announced {
            return Received::Partial;
        }
        self.announced = 0;
        let body = self.packet.get(..end).unwrap_or_default();
        match u16_at(body, 0).and_then(Nack::from_code) {
            Some(nack) => Received::Refused(nack),
            None => Received::Data(body.get(2..).unwrap_or_default()),
        }
    }
}

/// The reply of a camera, with data or a refusal: how many bytes of `packet`. An odd byte of data is followed by a 0.
/// `None` for more than [`MAX_REPLY_DATA_BYTES`]: OpenNI2 has no room for more.
pub fn encode_reply(
    opcode: u16,
    id: u16,
    answer: Result<&[u8], Nack>,
    packet: &mut [u8; MAX_HOST_PACKET_BYTES],
) -> Option<usize> {
    let data = answer.unwrap_or_default();
    if data.len() > MAX_REPLY_DATA_BYTES {
        return None;
    }
    let mut fields = FieldWriter::new(packet);
    fields.bytes(&REPLY_MAGIC)?;
    // At most 252 words.
    fields.u16(1 + data.len().div_ceil(2) as u16)?;
    fields.u16(opcode)?;
    fields.u16(id)?;
    fields.u16(answer.err().map_or(0, Nack::code))?;
    fields.bytes(data)?;
    if !data.len().is_multiple_of(2) {
        fields.bytes(&[0])?;
    }
    Some(fields.filled())
}
