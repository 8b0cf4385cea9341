//! Starting and stopping the streams (protocol section 5).

use std::collections::VecDeque;

use ps1080::firmware::Firmware;
use ps1080::host::Request;
use ps1080::mode::StreamMode;
use ps1080::parameter::Parameter;
use ps1080::stream::StreamKind;
use ps1080::usb::{TransferKind, alternate_setting, endpoint};

use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::MILLI_NANOS;
use crate::ps1080::modes::Plan;
use crate::ps1080::session::Session;
use crate::ps1080::usb::QueueShape;

/// Gain of depth where the camera does not say its own: what the firmware of a real one had.
const USUAL_DEPTH_GAIN: u16 = 42;

/// Longest wait for a reply when all is to end.
const STOP_REPLY_NANOS: i64 = 300 * MILLI_NANOS;

/// A request that is sent while data stream, and the wait after it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job {
    pub(super) request: Request,
    pub(super) after_nanos: i64,
}

/// Endpoints of depth, and of colour or infrared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Endpoints {
    pub(super) depth: u8,
    pub(super) image: u8,
}

impl Endpoints {
    pub(super) fn of(firmware: Firmware) -> Self {
        Self {
            depth: endpoint(firmware, StreamKind::Depth),
            image: endpoint(firmware, StreamKind::Image),
        }
    }
}

impl Session {
    /// Chooses the alternate setting whose endpoints are bulk, or isochronous where that is not to be had.
    ///
    /// # Errors
    /// When neither is.
    pub(super) fn choose_setting(
        &mut self,
        firmware: Firmware,
    ) -> Result<TransferKind, CameraError> {
        let endpoint = Endpoints::of(firmware).depth;
        let mut last = None;
        for kind in [TransferKind::Bulk, TransferKind::Isochronous] {
            // The rule, then what the descriptors say.
            let rule = alternate_setting(firmware, kind);
            for setting in [rule, 1 - rule] {
                if self.usb.endpoint_kind(setting, endpoint) != Some(kind) {
                    continue;
                }
                match self.usb.set_alternate(setting) {
                    Ok(()) => return Ok(kind),
                    Err(error) => last = Some(error),
                }
            }
        }
        Err(CameraError::Endpoint {
            what: "choosing the alternate setting",
            error: last.unwrap_or(crate::ps1080::usb::UsbError::NotFound),
        })
    }

    /// Writes everything but the switches: nothing streams yet.
    ///
    /// # Errors
    /// What the camera refuses.
    pub(super) fn configure(&mut self, plan: &Plan) -> Result<(), CameraError> {
        // What an earlier program left on.
        self.set(Parameter::Stream0Mode, StreamMode::Off as u16)?;
        self.set(Parameter::Stream1Mode, StreamMode::Off as u16)?;
        let depth_gain = match self.get(Parameter::DepthGain) {
            Err(error) if error.is_gone() => return Err(error),
            Ok(gain) => gain,
            Err(_) => USUAL_DEPTH_GAIN,
        };
        for (parameter, value) in plan.parameters(depth_gain) {
            self.set(parameter, value)?;
            if parameter == Parameter::ImageFlicker {
                self.pause_millis(self.delays().flicker_millis);
            }
        }
        Ok(())
    }

    /// Keeps reads in flight on both endpoints: before the camera sends.
    ///
    /// # Errors
    /// When none can be queued.
    pub(super) fn queue_reads(&mut self, endpoints: Endpoints) -> Result<(), CameraError> {
        for endpoint in [endpoints.depth, endpoints.image] {
            let started = self.usb.start(endpoint, QueueShape::default());
            started.map_err(|error| CameraError::Endpoint {
                what: "queueing reads",
                error,
            })?;
        }
        self.set_streaming(true);
        Ok(())
    }

    /// What switches the streams on, to be sent while reads are in flight: depth, which must be first, what comes beside
    /// it, the emitter, the rest.
    pub(super) fn switches(&self, plan: &Plan) -> VecDeque<Job> {
        let delays = self.delays();
        let after = |request, millis: u32| Job {
            request,
            after_nanos: i64::from(millis) * MILLI_NANOS,
        };
        let mode = |parameter, mode: StreamMode| Request::set(parameter, mode as u16);
        let mut jobs = VecDeque::from([
            after(
                mode(Parameter::Stream1Mode, StreamMode::Depth),
                delays.depth_mode_millis,
            ),
            after(
                mode(Parameter::Stream0Mode, plan.image_stream_mode()),
                delays.stream_mode_millis,
            ),
        ]);
        jobs.extend(plan.emitter().map(|is_on| after(emitter(is_on), 0)));
        let settings = plan.settings_of_running_streams().into_iter();
        jobs.extend(settings.map(|(parameter, value)| after(Request::set(parameter, value), 0)));
        jobs
    }

    /// Switches the emitter on that the recording had switched off.
    fn restore_emitter(&mut self) {
        if let Err(error) = self.ask_briefly(emitter(true), STOP_REPLY_NANOS)
            && !error.is_gone()
        {
            tracing::warn!("the emitter stays off until the camera is plugged in anew: {error}");
        }
    }

    /// Switches everything off; what cannot be done because the camera is gone is done.
    pub(super) fn stop_streams(&mut self, endpoints: Endpoints, plan: &Plan) {
        self.set_streaming(false);
        if plan.emitter() == Some(false) {
            self.restore_emitter();
        }
        for parameter in [Parameter::Stream1Mode, Parameter::Stream0Mode] {
            let request = Request::set(parameter, StreamMode::Off as u16);
            if let Err(error) = self.ask_briefly(request, STOP_REPLY_NANOS) {
                if error.is_gone() {
                    break;
                }
                tracing::warn!("stopping {parameter:?}: {error}");
            }
        }
        self.usb.stop(endpoints.depth);
        self.usb.stop(endpoints.image);
    }
}

fn emitter(is_on: bool) -> Request {
    Request::EnableEmitter {
        on: u16::from(is_on),
    }
}
