//! A host that does what a driver does, in no time of its own.

use ps1080::host::{MAX_HOST_PACKET_BYTES, Nack, Received, ReplyReader, Request};
use ps1080::parameter::Parameter;
use ps1080::samples::{SampleDecoder, SampleFormat};
use ps1080::stream::{DeviceTicks, FrameEvent, FrameReceiver, StreamKind};
use virtual_carmine::{
    Bus, Control, Faults, Personality, Setup, TestPattern, TransferStatus, VirtualCarmine,
};

pub(crate) const MILLISECOND: i64 = 1_000_000;
pub(crate) const SECOND: i64 = 1_000 * MILLISECOND;
pub(crate) const SEED: u64 = 11;
const TRANSFER_COUNT: u64 = 16;
const TRANSFER_BYTES: usize = 20_480;

pub(crate) struct Host {
    pub(crate) bus: Bus,
    pub(crate) now_nanos: i64,
    next_id: u16,
}

/// A frame as it came: stamp and payload.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Got {
    pub(crate) ticks: DeviceTicks,
    pub(crate) payload: Vec<u8>,
}

impl Host {
    pub(crate) fn new(unit: Personality, faults: Faults) -> Self {
        let film = Box::new(TestPattern::new(SEED));
        Self {
            bus: Bus::new(VirtualCarmine::new(unit, film, faults)),
            now_nanos: 5 * SECOND,
            next_id: 1,
        }
    }

    /// Sends a request and fetches its reply, a millisecond between looks; `None` when none comes in five seconds.
    pub(crate) fn ask(&mut self, request: Request) -> Option<Result<Vec<u8>, Nack>> {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        let mut packet = [0; MAX_HOST_PACKET_BYTES];
        let length = request.encode(id, &mut packet);
        let out = Setup::vendor_out(length as u16);
        if self.bus.control(self.now_nanos, out, &mut packet[..length]) != Control::Done(length) {
            return None;
        }
        let mut reader = ReplyReader::new(request.opcode(), id);
        for _ in 0..5_000 {
            self.now_nanos += MILLISECOND;
            let setup = Setup::vendor_in(512);
            let Control::Done(length) = self.bus.control(self.now_nanos, setup, &mut packet) else {
                return None;
            };
            match reader.receive(&packet[..length]).unwrap() {
                Received::Data(data) => return Some(Ok(data.to_vec())),
                Received::Refused(nack) => return Some(Err(nack)),
                _ => {}
            }
        }
        None
    }

    #[track_caller]
    pub(crate) fn set(&mut self, parameter: Parameter, value: u16) {
        let answer = self.ask(Request::set(parameter, value));
        assert_eq!(answer, Some(Ok(Vec::new())), "{parameter:?} := {value}");
    }

    #[track_caller]
    pub(crate) fn refuses(&mut self, parameter: Parameter, value: u16) {
        let answer = self.ask(Request::set(parameter, value));
        assert_eq!(
            answer,
            Some(Err(Nack::BadParameters)),
            "{parameter:?} := {value}"
        );
    }

    /// Reads an endpoint for so long with a full queue: all transfers in order.
    pub(crate) fn transfers(&mut self, endpoints: &[u8], length_nanos: i64) -> Vec<(u8, Vec<u8>)> {
        let until_nanos = self.now_nanos + length_nanos;
        let mut token = 0;
        for _ in 0..TRANSFER_COUNT {
            for &endpoint in endpoints {
                token += 1;
                let own = token << 8 | u64::from(endpoint);
                self.bus
                    .submit(self.now_nanos, endpoint, own, TRANSFER_BYTES);
            }
        }
        let mut transfers = Vec::new();
        while self.now_nanos < until_nanos {
            self.now_nanos += MILLISECOND;
            self.bus.advance(self.now_nanos);
            while let Some(done) = self.bus.completed() {
                let endpoint = done.token as u8;
                transfers.push((endpoint, done.data));
                if done.status == TransferStatus::Completed {
                    token += 1;
                    let own = token << 8 | u64::from(endpoint);
                    self.bus
                        .submit(self.now_nanos, endpoint, own, TRANSFER_BYTES);
                }
            }
        }
        transfers
    }
}

/// The whole frames in transfers, and how many were lost.
pub(crate) fn frames(
    kind: StreamKind,
    endpoint: u8,
    transfers: &[(u8, Vec<u8>)],
) -> (Vec<Got>, usize) {
    let mut receiver = FrameReceiver::new(kind);
    let (mut frames, mut lost_count, mut payload) = (Vec::new(), 0, Vec::new());
    for (_, data) in transfers.iter().filter(|(from, _)| *from == endpoint) {
        let mut transfer = data.as_slice();
        while let Some(event) = receiver.next(&mut transfer) {
            match event {
                FrameEvent::Started(_) => payload.clear(),
                FrameEvent::Data(bytes) => payload.extend_from_slice(bytes),
                FrameEvent::Ended(ticks) => frames.push(Got {
                    ticks,
                    payload: std::mem::take(&mut payload),
                }),
                FrameEvent::Lost(_) => lost_count += 1,
                FrameEvent::Fault(_) => panic!("no fault was asked for"),
            }
        }
    }
    (frames, lost_count)
}

/// The codes of a payload.
pub(crate) fn codes(format: SampleFormat, count: usize, payload: &[u8]) -> Vec<u16> {
    let mut decoder = SampleDecoder::new(format, count);
    let mut codes = vec![0; count];
    decoder.begin(Default::default());
    decoder.push(payload, &mut codes).unwrap();
    decoder.finish(&mut codes).unwrap();
    codes
}
