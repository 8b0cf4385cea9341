//! Requests while data stream: a step at a time, so that no transfer waits for a reply.

use std::collections::VecDeque;

use ps1080::host::{Opcode, Request};
use ps1080::mode::StreamMode;
use ps1080::parameter::Parameter;

use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::{Exchange, Step};
use crate::ps1080::exposure::ExposureControl;
use crate::ps1080::session::{Session, is_final};
use crate::ps1080::streams::Job;

/// Tries of a request that sets something.
const TRIES: u32 = 5;

/// The conversation while streams run: switches first, then exposure.
pub(super) struct Control {
    switches: VecDeque<Job>,
    exchange: Option<Exchange>,
    /// The request under way is of the exposure.
    is_of_exposure: bool,
    tries: u32,
    /// Nothing is sent before.
    next_nanos: i64,
    /// The emitter has been switched on or off, and nobody has asked yet.
    switched_emitter: Option<bool>,
}

impl Control {
    pub(super) fn new(switches: VecDeque<Job>, now_nanos: i64) -> Self {
        Self {
            switches,
            exchange: None,
            is_of_exposure: false,
            tries: 0,
            next_nanos: now_nanos,
            switched_emitter: None,
        }
    }

    /// Once after each time that the camera has switched the emitter as it was told: whether it is on. There is no
    /// request that reads it back; that the camera agreed is all that is known.
    pub(super) fn take_switched_emitter(&mut self) -> Option<bool> {
        self.switched_emitter.take()
    }

    /// Whether streams are being switched on.
    pub(super) fn is_switching(&self) -> bool {
        !self.switches.is_empty()
    }

    /// Both streams off, then `switches`.
    pub(super) fn restart(&mut self, switches: VecDeque<Job>) {
        self.exchange = None;
        self.switches = [Parameter::Stream1Mode, Parameter::Stream0Mode]
            .map(|parameter| Job {
                request: Request::set(parameter, StreamMode::Off as u16),
                after_nanos: 0,
            })
            .into();
        self.switches.extend(switches);
    }

    /// Goes on, and says when it wants to again.
    ///
    /// # Errors
    /// A switch that the camera refuses; a camera that is gone.
    pub(super) fn step(
        &mut self,
        session: &mut Session,
        exposure: &mut ExposureControl,
        color_count: u64,
    ) -> Result<i64, CameraError> {
        let now_nanos = session.usb.now_nanos();
        if now_nanos < self.next_nanos {
            return Ok(self.next_nanos);
        }
        if self.exchange.is_none() {
            let request = match self.switches.front() {
                Some(job) => Some(job.request),
                None => exposure.next(color_count),
            };
            let Some(request) = request else {
                return Ok(i64::MAX);
            };
            self.is_of_exposure = self.switches.is_empty();
            self.exchange = Some(session.begin(request));
        }
        let Some(exchange) = &mut self.exchange else {
            return Ok(i64::MAX);
        };
        let result = match exchange.step(session.usb.as_mut()) {
            Ok(Step::Again(at_nanos)) => return Ok(at_nanos),
            Ok(Step::Done(answer)) => Ok(answer),
            Err(error) => Err(error),
        };
        self.exchange = None;
        self.tries += 1;
        if let Err(error) = &result {
            if error.is_gone() {
                return Err(error.clone());
            }
            if self.tries < TRIES && !is_final(error) {
                return Ok(now_nanos);
            }
        }
        self.tries = 0;
        if self.is_of_exposure {
            exposure.done(result.as_deref());
        } else {
            let job = self.switches.pop_front();
            let after_nanos = job.map_or(0, |job| job.after_nanos);
            self.next_nanos = session.usb.now_nanos() + after_nanos;
            match result {
                Err(error) if job.is_some_and(|job| is_needed(&job.request)) => return Err(error),
                Err(error) => tracing::warn!("{error}"),
                Ok(_) => {
                    if let Some(Request::EnableEmitter { on }) = job.map(|job| job.request) {
                        self.switched_emitter = Some(on != 0);
                    }
                }
            }
        }
        Ok(self.next_nanos.max(now_nanos))
    }
}

/// Whether the recording is not what was asked for without it.
fn is_needed(request: &Request) -> bool {
    match request {
        Request::SetParam { pairs } => pairs.as_slice().first().is_some_and(|id| {
            [Parameter::Stream0Mode.id(), Parameter::Stream1Mode.id()].contains(id)
        }),
        Request::EnableEmitter { on } => *on == 0,
        _ => request.opcode() != Opcode::SetParam,
    }
}
