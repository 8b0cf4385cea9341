//! Starting and stopping the streams (protocol section 5).

use std::collections::VecDeque;

use ps1080::color::ColorFormat;
use ps1080::firmware::Firmware;
use ps1080::host::Request;
use ps1080::mode::StreamMode;
use ps1080::parameter::Parameter;
use ps1080::stream::StreamKind;
use ps1080::usb::{TransferKind, alternate_setting, endpoint};

use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::MILLI_NANOS;
use crate::ps1080::modes::{ExposurePlan, Wanted, knows};
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

/// Endpoints of depth and colour.
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
    pub(super) fn configure(
        &mut self,
        wanted: &Wanted,
        format: ColorFormat,
        firmware: Firmware,
    ) -> Result<(), CameraError> {
        // What an earlier program left on.
        self.set(Parameter::Stream0Mode, StreamMode::Off as u16)?;
        self.set(Parameter::Stream1Mode, StreamMode::Off as u16)?;
        let depth_gain = match self.get(Parameter::DepthGain) {
            Err(error) if error.is_gone() => return Err(error),
            Ok(gain) => gain,
            Err(_) => USUAL_DEPTH_GAIN,
        };
        let depth = wanted.depth_parameters(depth_gain);
        for (parameter, value) in depth.into_iter().chain(wanted.color_parameters(format)) {
            if knows(firmware, parameter) {
                self.set(parameter, value)?;
            }
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

    /// What switches the streams on, to be sent while reads are in flight: depth, colour, frame sync, the rest.
    pub(super) fn switches(&self, wanted: &Wanted, firmware: Firmware) -> VecDeque<Job> {
        let delays = self.delays();
        let is_auto = u16::from(!matches!(wanted.exposure, ExposurePlan::Manual { .. }));
        let switches = [
            (
                Parameter::Stream1Mode,
                StreamMode::Depth as u16,
                delays.depth_mode_millis,
            ),
            (
                Parameter::Stream0Mode,
                StreamMode::Color as u16,
                delays.stream_mode_millis,
            ),
            (Parameter::FrameSync, 1, 0),
            (Parameter::CloseRange, u16::from(wanted.is_close), 0),
            (Parameter::DepthCropMode, 0, 0),
            (Parameter::ImageCropMode, 0, 0),
            (Parameter::AutoExposure, is_auto, 0),
            (Parameter::AutoWhiteBalance, is_auto, 0),
        ];
        let known = switches
            .into_iter()
            .filter(|(parameter, ..)| knows(firmware, *parameter));
        known
            .map(|(parameter, value, millis)| Job {
                request: Request::set(parameter, value),
                after_nanos: i64::from(millis) * MILLI_NANOS,
            })
            .collect()
    }

    /// Switches everything off; what cannot be done because the camera is gone is done.
    pub(super) fn stop_streams(&mut self, endpoints: Endpoints) {
        self.set_streaming(false);
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
