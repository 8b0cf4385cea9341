//! Frames that were dropped on the way: each thread says which and why, the record thread writes it down.

use crossbeam::channel::{Receiver, Sender, bounded};
use sequence::{Gap, GapCause};

/// Frames of one stream that are missing, in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drop {
    /// Stream.
    pub stream: u16,
    /// First number.
    pub first_number: u64,
    /// How many.
    pub count: u64,
    /// Why.
    pub cause: GapCause,
}

/// Where a thread says what it dropped. Neighbours become one; nothing said is ever lost.
#[derive(Debug)]
pub struct DropLog {
    sender: Sender<Drop>,
    /// One a stream.
    pending: Vec<Drop>,
}

/// Room in the channel: when it is full, drops wait in their logs, merged.
const CHANNEL_DROPS: usize = 256;

/// The channel for drops.
pub fn channel() -> (Sender<Drop>, Receiver<Drop>) {
    bounded(CHANNEL_DROPS)
}

impl DropLog {
    /// A log that sends to `sender`.
    pub fn new(sender: Sender<Drop>) -> Self {
        Self {
            sender,
            pending: Vec::with_capacity(usize::from(sequence::layout::MOST_STREAMS)),
        }
    }

    /// Says that frames are dropped.
    pub fn add(&mut self, drop: Drop) {
        let same_stream = |pending: &&mut Drop| pending.stream == drop.stream;
        match self.pending.iter_mut().find(same_stream) {
            Some(pending)
                if pending.cause == drop.cause
                    && pending.first_number + pending.count == drop.first_number =>
            {
                pending.count += drop.count;
            }
            Some(pending) => {
                let earlier = std::mem::replace(pending, drop);
                // Waits only when hundreds of separate gaps are not written down yet. A receiver that is gone
                // has ended with an error of its own.
                let _ = self.sender.send(earlier);
            }
            None => self.pending.push(drop),
        }
    }

    /// Passes on what was said of a stream: a frame follows, or the end.
    pub fn flush(&mut self, stream: u16) {
        if let Some(position) = self.pending.iter().position(|drop| drop.stream == stream) {
            let _ = self.sender.send(self.pending.swap_remove(position));
        }
    }

    /// Passes everything on.
    pub fn flush_all(&mut self) {
        for drop in self.pending.drain(..) {
            let _ = self.sender.send(drop);
        }
    }
}

impl Drop {
    /// The gap record; the times are filled in by who knows them.
    pub fn gap(&self) -> Gap {
        Gap {
            stream: self.stream,
            first_number: self.first_number,
            count: self.count,
            from_nanos: None,
            to_nanos: None,
            cause: Some(self.cause),
            note: String::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_become_one_and_causes_stay_apart() {
        let (sender, receiver) = channel();
        let mut log = DropLog::new(sender);
        let drop = |number, cause| Drop {
            stream: 1,
            first_number: number,
            count: 1,
            cause,
        };
        for number in 3..6 {
            log.add(drop(number, GapCause::PoolEmpty));
        }
        log.add(drop(6, GapCause::RingFull));
        log.flush(1);
        let merged = Drop {
            count: 3,
            ..drop(3, GapCause::PoolEmpty)
        };
        assert_eq!(receiver.try_recv(), Ok(merged));
        assert_eq!(receiver.try_recv(), Ok(drop(6, GapCause::RingFull)));
        assert!(receiver.try_recv().is_err());
    }
}
