//! The conversation with a camera: requests one after the other, each until its reply.

use ps1080::blocks::BlockCollector;
use ps1080::firmware::Firmware;
use ps1080::host::{AlgorithmKind, Nack, Request};
use ps1080::parameter::Parameter;
use ps1080::timing::{Delays, UsbCore};

use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::{Answer, Exchange, MILLI_NANOS, Patience, SECOND_NANOS, Step};
use crate::ps1080::usb::{UsbError, UsbTransport};

/// Tries to set a parameter.
const SET_TRIES: u32 = 5;
/// The first request after plugging in is sometimes not answered: then it is sent again after this time.
const FIRST_RETRY_NANOS: i64 = 2 * SECOND_NANOS;
/// Longest transfer while data stream: half of what the queues hold.
const STREAMING_TRANSFER_NANOS: i64 = 20 * MILLI_NANOS;

/// A camera that is spoken to, and how fast it answers.
pub struct Session {
    pub(super) usb: Box<dyn UsbTransport>,
    next_id: u16,
    delays: Option<Delays>,
    is_streaming: bool,
}

impl Session {
    /// Over `usb`, before the first request.
    pub fn new(usb: Box<dyn UsbTransport>) -> Self {
        Self {
            usb,
            next_id: 0,
            delays: None,
            is_streaming: false,
        }
    }

    /// From here on the camera is as fast as its firmware is known to be.
    pub(super) fn know(&mut self, firmware: Firmware, core: UsbCore) {
        self.delays = Some(Delays::of(firmware, core));
    }

    /// Data stream from now on, or no longer.
    pub(super) fn set_streaming(&mut self, is_streaming: bool) {
        self.is_streaming = is_streaming;
    }

    /// Waits of the camera's firmware.
    pub(super) fn delays(&self) -> Delays {
        self.delays
            .unwrap_or_else(|| Delays::of(Firmware::new(5, 1, 0), UsbCore::Jungo))
    }

    /// Waits.
    pub(super) fn pause_millis(&mut self, millis: u32) {
        self.usb.pause(i64::from(millis) * MILLI_NANOS);
    }

    fn patience(&self) -> Patience {
        let Some(delays) = self.delays else {
            return Patience::FIRST;
        };
        let nanos = |millis: u32| i64::from(millis) * MILLI_NANOS;
        Patience {
            receive_nanos: nanos(delays.receive_millis),
            before_send_nanos: nanos(delays.before_send_millis),
            after_send_nanos: nanos(delays.after_send_millis),
            transfer_nanos: if self.is_streaming {
                STREAMING_TRANSFER_NANOS
            } else {
                Patience::FIRST.transfer_nanos
            },
            reply_nanos: Patience::FIRST.reply_nanos,
        }
    }

    /// A request to be stepped by the caller.
    pub(super) fn begin(&mut self, request: Request) -> Exchange {
        let id = self.next_id;
        self.next_id = id.wrapping_add(1);
        Exchange::new(request, id, self.patience(), self.usb.now_nanos())
    }

    /// Asks and waits for the reply.
    ///
    /// # Errors
    /// A refusal, silence, a camera that is gone.
    pub(super) fn ask(&mut self, request: Request) -> Result<Box<Answer>, CameraError> {
        let exchange = self.begin(request);
        self.finish(exchange)
    }

    /// As [`ask`](Self::ask), for a reply that may never come: waits no longer than `reply_nanos`.
    pub(super) fn ask_briefly(
        &mut self,
        request: Request,
        reply_nanos: i64,
    ) -> Result<Box<Answer>, CameraError> {
        let id = self.next_id;
        self.next_id = id.wrapping_add(1);
        let patience = Patience {
            reply_nanos,
            ..self.patience()
        };
        let exchange = Exchange::new(request, id, patience, self.usb.now_nanos());
        self.finish(exchange)
    }

    fn finish(&mut self, mut exchange: Exchange) -> Result<Box<Answer>, CameraError> {
        loop {
            match exchange.step(self.usb.as_mut())? {
                Step::Done(answer) => return Ok(answer),
                Step::Again(at_nanos) => {
                    let wait_nanos = at_nanos - self.usb.now_nanos();
                    if wait_nanos > 0 {
                        self.usb.pause(wait_nanos);
                    }
                }
            }
        }
    }

    /// The first request of all.
    pub(super) fn ask_first(&mut self, request: Request) -> Result<Box<Answer>, CameraError> {
        match self.ask(request) {
            Err(
                CameraError::Silent { .. }
                | CameraError::Usb {
                    error: UsbError::Timeout,
                    ..
                },
            ) => {
                tracing::info!("the camera did not answer the first request; trying again");
                self.usb.pause(FIRST_RETRY_NANOS);
                self.ask(request)
            }
            result => result,
        }
    }

    /// Value of a parameter.
    pub(super) fn get(&mut self, parameter: Parameter) -> Result<u16, CameraError> {
        let answer = self.ask(Request::get(parameter))?;
        let (&word, _) = answer
            .data()
            .split_first_chunk()
            .ok_or(CameraError::Numbers { what: "parameter" })?;
        Ok(u16::from_le_bytes(word))
    }

    /// Sets a parameter.
    pub(super) fn set(&mut self, parameter: Parameter, value: u16) -> Result<(), CameraError> {
        let mut tries = 1;
        loop {
            let error = match self.ask(Request::set(parameter, value)) {
                Ok(_) => return Ok(()),
                Err(error) => error,
            };
            if tries == SET_TRIES || is_final(&error) {
                tracing::debug!("{parameter:?} := {value}: {error}");
                return Err(error);
            }
            tries += 1;
        }
    }

    /// The fixed parameters, or another block of [`Request::GetFixedParams`].
    pub(super) fn fixed_block<const BYTES: usize>(&mut self) -> Result<[u8; BYTES], CameraError> {
        let collector = BlockCollector::of_double_words();
        self.block("fixed parameters", collector, |offset| {
            Request::GetFixedParams { offset }
        })
    }

    /// An algorithm block.
    pub(super) fn algorithm_block<const BYTES: usize>(
        &mut self,
        what: &'static str,
        kind: AlgorithmKind,
        resolution: u16,
        fps: u16,
    ) -> Result<[u8; BYTES], CameraError> {
        self.block(what, BlockCollector::of_words(), |offset| {
            Request::algorithm(kind, resolution, fps, offset)
        })
    }

    fn block<const BYTES: usize>(
        &mut self,
        what: &'static str,
        mut collector: BlockCollector<BYTES>,
        request: impl Fn(u16) -> Request,
    ) -> Result<[u8; BYTES], CameraError> {
        while let Some(offset) = collector.next_offset() {
            let answer = self.ask(request(offset))?;
            collector
                .push(answer.data())
                .map_err(|error| CameraError::Block { what, error })?;
        }
        collector
            .block()
            .copied()
            .ok_or(CameraError::Numbers { what })
    }
}

/// Whether trying again is of no use.
pub(super) fn is_final(error: &CameraError) -> bool {
    error.is_gone()
        || matches!(
            error,
            CameraError::Refused {
                nack: Nack::BadParameters | Nack::InvalidCommand,
                ..
            }
        )
}
