//! One request and its reply, in steps that do not block: data that stream meanwhile must be looked after.

use ps1080::host::{
    MAX_HOST_PACKET_BYTES, MAX_REPLY_DATA_BYTES, Nack, Opcode, Received, ReplyReader, Request,
};

use crate::ps1080::error::CameraError;
use crate::ps1080::usb::{UsbError, UsbTransport};

/// A millisecond.
pub(super) const MILLI_NANOS: i64 = 1_000_000;
/// A second.
pub(super) const SECOND_NANOS: i64 = 1_000 * MILLI_NANOS;

/// Tries to send on timeouts, and the wait between them.
const SEND_TRIES: u32 = 5;
const SEND_RETRY_NANOS: i64 = 100 * MILLI_NANOS;
/// A reply is waited for so long.
const REPLY_NANOS: i64 = 5 * SECOND_NANOS;
/// While bytes come that are no reply, so long.
const GARBAGE_NANOS: i64 = 20 * SECOND_NANOS;
const GARBAGE_RETRY_NANOS: i64 = 10 * MILLI_NANOS;
/// A camera that is not ready is asked so often in all, so far apart.
const READY_TRIES: u32 = 3;
const READY_RETRY_NANOS: i64 = SECOND_NANOS;

/// How patient an exchange is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Patience {
    /// Between two looks for the reply.
    pub(super) receive_nanos: i64,
    /// Before the request is sent.
    pub(super) before_send_nanos: i64,
    /// After it.
    pub(super) after_send_nanos: i64,
    /// Longest time that one transfer may block: short while data stream.
    pub(super) transfer_nanos: i64,
    /// Longest wait for the reply.
    pub(super) reply_nanos: i64,
}

impl Patience {
    /// Of protocol section 2, before anything is known of the camera.
    pub(super) const FIRST: Self = Self {
        receive_nanos: 100 * MILLI_NANOS,
        before_send_nanos: MILLI_NANOS,
        after_send_nanos: 10 * MILLI_NANOS,
        transfer_nanos: REPLY_NANOS,
        reply_nanos: REPLY_NANOS,
    };
}

/// The data of a reply.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer {
    data: [u8; MAX_REPLY_DATA_BYTES],
    length: usize,
}

impl Answer {
    /// The data.
    pub(super) fn data(&self) -> &[u8] {
        self.data.get(..self.length).unwrap_or_default()
    }

    fn of(data: &[u8]) -> Box<Self> {
        let mut answer = Box::new(Self {
            data: [0; MAX_REPLY_DATA_BYTES],
            length: data.len().min(MAX_REPLY_DATA_BYTES),
        });
        // As long as the reader lets through.
        answer.data[..answer.length].copy_from_slice(&data[..answer.length]);
        answer
    }
}

/// What came of a step.
#[derive(Debug)]
pub(super) enum Step {
    /// To be stepped again at this time, not before.
    Again(i64),
    /// The reply.
    Done(Box<Answer>),
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Send {
        tries: u32,
    },
    Receive {
        until_nanos: i64,
        garbage_until_nanos: i64,
    },
}

/// A request under way.
#[derive(Debug)]
pub(super) struct Exchange {
    request: Request,
    packet: [u8; MAX_HOST_PACKET_BYTES],
    packet_bytes: usize,
    id: u16,
    patience: Patience,
    reader: ReplyReader,
    phase: Phase,
    ready_tries: u32,
    next_nanos: i64,
}

impl Exchange {
    /// Of `request` under `id`, to begin at `now_nanos`.
    pub(super) fn new(request: Request, id: u16, patience: Patience, now_nanos: i64) -> Self {
        let mut packet = [0; MAX_HOST_PACKET_BYTES];
        let packet_bytes = request.encode(id, &mut packet);
        Self {
            request,
            packet,
            packet_bytes,
            id,
            patience,
            reader: ReplyReader::new(request.opcode(), id),
            phase: Phase::Send { tries: 0 },
            ready_tries: 0,
            next_nanos: now_nanos + patience.before_send_nanos,
        }
    }

    fn opcode(&self) -> Opcode {
        self.request.opcode()
    }

    /// Goes on, if it is time.
    pub(super) fn step(&mut self, usb: &mut dyn UsbTransport) -> Result<Step, CameraError> {
        if usb.now_nanos() < self.next_nanos {
            return Ok(Step::Again(self.next_nanos));
        }
        match self.phase {
            Phase::Send { tries } => self.send(tries, usb),
            Phase::Receive {
                until_nanos,
                garbage_until_nanos,
            } => self.receive(until_nanos, garbage_until_nanos, usb),
        }
    }

    fn again(&mut self, usb: &dyn UsbTransport, wait_nanos: i64) -> Step {
        self.next_nanos = usb.now_nanos() + wait_nanos;
        Step::Again(self.next_nanos)
    }

    fn usb_error(&self, error: UsbError) -> CameraError {
        CameraError::Usb {
            request: self.opcode(),
            error,
        }
    }

    fn send(&mut self, tries: u32, usb: &mut dyn UsbTransport) -> Result<Step, CameraError> {
        let packet = &self.packet[..self.packet_bytes];
        match usb.control_out(packet, self.patience.transfer_nanos) {
            Ok(()) => {
                let now_nanos = usb.now_nanos();
                self.phase = Phase::Receive {
                    until_nanos: now_nanos + self.patience.reply_nanos,
                    garbage_until_nanos: now_nanos + GARBAGE_NANOS,
                };
                self.reader = ReplyReader::new(self.opcode(), self.id);
                Ok(self.again(usb, self.patience.after_send_nanos))
            }
            Err(UsbError::Timeout) if tries + 1 < SEND_TRIES => {
                self.phase = Phase::Send { tries: tries + 1 };
                Ok(self.again(usb, SEND_RETRY_NANOS))
            }
            Err(error) => Err(self.usb_error(error)),
        }
    }

    fn receive(
        &mut self,
        until_nanos: i64,
        garbage_until_nanos: i64,
        usb: &mut dyn UsbTransport,
    ) -> Result<Step, CameraError> {
        let mut transfer = [0; MAX_HOST_PACKET_BYTES];
        let length = match usb.control_in(&mut transfer, self.patience.transfer_nanos) {
            Ok(length) => length,
            Err(UsbError::Timeout) => 0,
            Err(error) => return Err(self.usb_error(error)),
        };
        let now_nanos = usb.now_nanos();
        let request = self.opcode();
        let received = self
            .reader
            .receive(&transfer[..length])
            .map_err(|error| CameraError::Reply { request, error })?;
        let (wait_nanos, deadline_nanos) = match received {
            Received::Data(data) => return Ok(Step::Done(Answer::of(data))),
            Received::Refused(Nack::NotReady) if self.ready_tries + 1 < READY_TRIES => {
                self.ready_tries += 1;
                self.phase = Phase::Send { tries: 0 };
                return Ok(self.again(usb, READY_RETRY_NANOS));
            }
            Received::Refused(nack) => return Err(CameraError::Refused { request, nack }),
            Received::NotYet => (self.patience.receive_nanos, until_nanos),
            Received::Garbage => (GARBAGE_RETRY_NANOS, garbage_until_nanos),
            Received::Stale { .. } | Received::Partial => (0, garbage_until_nanos),
        };
        if now_nanos >= deadline_nanos {
            return Err(CameraError::Silent {
                request,
                seconds: (self.patience.reply_nanos / SECOND_NANOS).max(1),
            });
        }
        Ok(self.again(usb, wait_nanos))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use ps1080::usb::TransferKind;

    use super::*;
    use crate::ps1080::usb::{Arrival, QueueShape};

    /// Answers as it is told, and keeps what is sent.
    #[derive(Default)]
    struct Script {
        now_nanos: i64,
        sent: Vec<Vec<u8>>,
        outs: VecDeque<UsbError>,
        replies: VecDeque<Result<Vec<u8>, UsbError>>,
    }

    impl UsbTransport for Script {
        fn now_nanos(&self) -> i64 {
            self.now_nanos
        }

        fn pause(&mut self, nanos: i64) {
            self.now_nanos += nanos;
        }

        fn control_out(&mut self, packet: &[u8], _: i64) -> Result<(), UsbError> {
            self.sent.push(packet.to_vec());
            self.outs.pop_front().map_or(Ok(()), Err)
        }

        fn control_in(&mut self, packet: &mut [u8], _: i64) -> Result<usize, UsbError> {
            let reply = self.replies.pop_front().unwrap_or(Ok(Vec::new()))?;
            packet[..reply.len()].copy_from_slice(&reply);
            Ok(reply.len())
        }

        fn set_alternate(&mut self, _: u8) -> Result<(), UsbError> {
            Ok(())
        }

        fn endpoint_kind(&self, _: u8, _: u8) -> Option<TransferKind> {
            None
        }

        fn start(&mut self, _: u8, _: QueueShape) -> Result<(), UsbError> {
            Ok(())
        }

        fn stop(&mut self, _: u8) {}

        fn reap(&mut self, _: i64, _: &mut dyn FnMut(Arrival<'_>)) -> Result<(), UsbError> {
            Ok(())
        }
    }

    /// GET_PARAM(19) with id 32, and its reply 0: protocol section 2, measured.
    const REQUEST: [u8; 10] = [0x47, 0x4D, 1, 0, 2, 0, 0x20, 0, 0x13, 0];
    const REPLY: [u8; 12] = [0x52, 0x42, 2, 0, 2, 0, 0x20, 0, 0, 0, 0, 0];

    /// What came of it, and how long it took, milliseconds.
    fn run(script: &mut Script) -> (Result<Vec<u8>, CameraError>, i64) {
        let patience = Patience {
            receive_nanos: MILLI_NANOS,
            before_send_nanos: 0,
            after_send_nanos: 0,
            ..Patience::FIRST
        };
        let mut exchange = Exchange::new(Request::GetParam { id: 19 }, 32, patience, 0);
        loop {
            match exchange.step(script) {
                Ok(Step::Again(at_nanos)) => script.now_nanos = script.now_nanos.max(at_nanos),
                Ok(Step::Done(answer)) => {
                    return (Ok(answer.data().to_vec()), script.now_nanos / MILLI_NANOS);
                }
                Err(error) => return (Err(error), script.now_nanos / MILLI_NANOS),
            }
        }
    }

    fn refused(code: u8) -> Vec<u8> {
        vec![0x52, 0x42, 1, 0, 2, 0, 0x20, 0, code, 0]
    }

    #[test]
    fn the_measured_bytes_are_sent_and_understood() {
        let mut script = Script {
            replies: [Ok(REPLY.to_vec())].into(),
            ..Script::default()
        };
        assert_eq!(run(&mut script), (Ok(vec![0, 0]), 0));
        assert_eq!(script.sent, [REQUEST]);
    }

    #[test]
    fn it_waits_for_what_is_not_ready_and_skips_what_is_not_meant() {
        let mut stale = REPLY;
        stale[6] = 0x1F;
        let mut late = vec![7; 5];
        late.extend(REPLY);
        let mut script = Script {
            replies: [
                Ok(Vec::new()),
                Err(UsbError::Timeout),
                Ok(vec![1, 2, 3]),
                Ok(stale.to_vec()),
                Ok(late),
            ]
            .into(),
            ..Script::default()
        };
        // A millisecond for each that is not ready, ten for garbage.
        assert_eq!(run(&mut script), (Ok(vec![0, 0]), 12));
        assert_eq!(script.sent.len(), 1);
    }

    #[test]
    fn it_sends_again_after_timeouts_and_when_the_camera_is_not_ready() {
        let mut script = Script {
            outs: [UsbError::Timeout; 4].into(),
            replies: [Ok(refused(13)), Ok(refused(13)), Ok(REPLY.to_vec())].into(),
            ..Script::default()
        };
        assert_eq!(run(&mut script), (Ok(vec![0, 0]), 2400));
        assert_eq!(script.sent.len(), 7);
    }

    #[test]
    fn it_gives_up_in_time() {
        let mut dead = Script {
            outs: [UsbError::Timeout; 5].into(),
            ..Script::default()
        };
        let (result, millis) = run(&mut dead);
        assert!(matches!(
            result,
            Err(CameraError::Usb {
                error: UsbError::Timeout,
                ..
            })
        ));
        assert_eq!((millis, dead.sent.len()), (400, 5));
        let (result, millis) = run(&mut Script::default());
        assert!(
            matches!(result, Err(CameraError::Silent { .. })),
            "{result:?}"
        );
        assert!((5000..5010).contains(&millis), "{millis}");
        let mut never_ready = Script {
            replies: [Ok(refused(13)), Ok(refused(13)), Ok(refused(13))].into(),
            ..Script::default()
        };
        let (result, _) = run(&mut never_ready);
        let refusal = CameraError::Refused {
            request: Opcode::GetParam,
            nack: Nack::NotReady,
        };
        assert_eq!(result, Err(refusal));
        let mut stalled = Script {
            outs: [UsbError::Stall].into(),
            ..Script::default()
        };
        assert!(run(&mut stalled).0.is_err());
        assert_eq!(stalled.sent.len(), 1);
    }
}
