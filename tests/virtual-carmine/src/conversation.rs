//! Requests and replies on the control endpoint, with what goes wrong between them.

use std::collections::VecDeque;

use ps1080::host::{
    HOST_HEADER_BYTES, MAX_HOST_PACKET_BYTES, Nack, Request, RequestError, encode_reply,
};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use crate::answers::{Effect, Memory};
use crate::counters::Counters;
use crate::faults::Faults;

/// How far a reply is split or cut at least: behind header and error word.
const REPLY_HEAD_BYTES: usize = HOST_HEADER_BYTES + 2;
/// How far off the id of a stale reply is.
const STALE_STEP: u16 = 17;

/// Replies that wait to be fetched.
#[derive(Debug, Default)]
pub(crate) struct Conversation {
    /// What the next reads of the control endpoint give.
    pending: VecDeque<Vec<u8>>,
    ready_nanos: i64,
}

impl Conversation {
    /// Takes a request; `None` when the transfer itself finds no answer.
    pub(crate) fn request(
        &mut self,
        now_nanos: i64,
        packet: &[u8],
        memory: &mut Memory,
        faults: &mut Faults,
        random: &mut Pcg64Mcg,
        counters: &mut Counters,
    ) -> Option<Effect> {
        counters.request_count += 1;
        // There is one place for a reply: a new request takes it.
        self.pending.clear();
        if take_one(&mut faults.dead_requests) {
            return None;
        }
        if take_one(&mut faults.unanswered_requests) {
            return Some(Effect::None);
        }
        let (opcode, id, answer) = match Request::decode(packet) {
            Ok((id, request)) => {
                let opcode = request.opcode().code();
                let refusal = refusal(faults, opcode).map_or(Ok(()), Err);
                (opcode, id, refusal.and_then(|()| memory.answer(&request)))
            }
            // Nobody to answer to.
            Err(RequestError::NotARequest) => return Some(Effect::None),
            Err(RequestError::Size { opcode, id }) => (opcode, id, Err(Nack::BadPacketSize)),
            Err(RequestError::Unknown { opcode, id }) => (opcode, id, Err(Nack::InvalidCommand)),
            Err(RequestError::Payload { opcode, id }) => (opcode, id, Err(Nack::BadCommandSize)),
        };
        counters.refused_count += u64::from(answer.is_err());
        let (data, effect) = match answer {
            Ok((data, effect)) => (Ok(data), effect),
            Err(nack) => (Err(nack), Effect::None),
        };
        let data = data.as_deref().map_err(|&nack| nack);
        self.ready_nanos = now_nanos + memory.unit.reply_nanos;
        self.pending = replies(opcode, id, data, faults, random);
        Some(effect)
    }

    /// What a read of the control endpoint gives: how many bytes of `out`.
    pub(crate) fn reply(
        &mut self,
        now_nanos: i64,
        out: &mut [u8],
        counters: &mut Counters,
    ) -> usize {
        let is_ready = now_nanos >= self.ready_nanos;
        let reply = self.pending.pop_front_if(|_| is_ready).unwrap_or_default();
        counters.empty_reply_count += u64::from(reply.is_empty());
        let length = reply.len().min(out.len());
        out[..length].copy_from_slice(&reply[..length]);
        length
    }
}

/// The refusal that is due for this opcode.
fn refusal(faults: &mut Faults, opcode: u16) -> Option<Nack> {
    let due = faults.refusals.iter_mut().find(|refusal| {
        refusal.count > 0 && refusal.opcode.is_none_or(|refused| refused == opcode)
    })?;
    due.count -= 1;
    Nack::from_code(due.error)
}

/// The reply as a sequence of reads, the wanted faults before, in and between them.
fn replies(
    opcode: u16,
    id: u16,
    answer: Result<&[u8], Nack>,
    faults: &mut Faults,
    random: &mut Pcg64Mcg,
) -> VecDeque<Vec<u8>> {
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    // An answer of ours is never too long; if it were, the host would wait in vain.
    let length = encode_reply(opcode, id, answer, &mut packet).unwrap_or(0);
    let mut reads: VecDeque<Vec<u8>> = (0..faults.empty_replies).map(|_| Vec::new()).collect();
    if take_one(&mut faults.stale_replies) {
        let mut stale = packet;
        stale[6..8].copy_from_slice(&id.wrapping_sub(STALE_STEP).to_le_bytes());
        reads.push_back(stale[..length].to_vec());
    }
    let mut whole = vec![0xA5; faults.garbage_bytes.min(MAX_HOST_PACKET_BYTES - length)];
    let garbage_bytes = whole.len();
    whole.extend_from_slice(&packet[..length]);
    let head = garbage_bytes + REPLY_HEAD_BYTES;
    let can_split = whole.len() > head;
    if can_split && take_one(&mut faults.cut_replies) {
        whole.truncate(random.random_range(head..whole.len()));
    } else if can_split && take_one(&mut faults.split_replies) {
        let rest = whole.split_off(random.random_range(head..whole.len()));
        reads.push_back(whole);
        whole = rest;
    }
    reads.push_back(whole);
    reads
}

/// Counts down; whether there was something left.
fn take_one(count: &mut u32) -> bool {
    let left = count.checked_sub(1);
    *count = left.unwrap_or(0);
    left.is_some()
}
