//! A camera as a source of frames.

use ps1080::color::ColorDecoder;
use ps1080::host::Request;
use ps1080::samples::SampleDecoder;
use ps1080::stream::{LossCounts, TickRate};
use ps1080::usb::TransferKind;
use sequence::{Event, GapCause, Streams};
use serde_json::{Value, json};

use crate::clock::HostClock;
use crate::ps1080::assemble::{Assembler, Remark, Surroundings};
use crate::ps1080::control::Control;
use crate::ps1080::describe::streams_of;
use crate::ps1080::error::CameraError;
use crate::ps1080::exchange::{MILLI_NANOS, SECOND_NANOS};
use crate::ps1080::exposure::ExposureControl;
use crate::ps1080::frame_clock::{FrameClock, Origin};
use crate::ps1080::modes::{ImageMode, Plan, Wanted};
use crate::ps1080::open::Unit;
use crate::ps1080::samples::{Brightness, Picture, Shifts};
use crate::ps1080::session::Session;
use crate::ps1080::streams::Endpoints;
use crate::ps1080::usb::{Arrival, UsbError, UsbTransport};
use crate::source::{FrameSource, SourceEnds, SourceReport};
use crate::status::{EndReason, Status, StopFlag};

/// Longest wait between two looks at the stop flag.
const LOOK_NANOS: i64 = 20 * MILLI_NANOS;
/// A stream that sends nothing for so long is switched off and on.
const SILENCE_NANOS: i64 = 3 * SECOND_NANOS;
/// So often in vain.
const MOST_RESTARTS: u32 = 3;

/// A camera that is open and configured; its streams run while it is [run](FrameSource::run).
pub struct Camera {
    session: Session,
    unit: Unit,
    plan: Plan,
    tick_rate: TickRate,
    endpoints: Endpoints,
    kind: TransferKind,
    streams: Streams,
}

impl Camera {
    /// Opens the camera behind `usb`, whose product is `product` and which is plugged in at `path`, in the mode
    /// `wanted`.
    ///
    /// # Errors
    /// A camera that does not answer, is damaged, or cannot do what is wanted.
    pub fn open(
        usb: Box<dyn UsbTransport>,
        wanted: Wanted,
        product: &str,
        path: &str,
    ) -> anyhow::Result<Self> {
        let mut session = Session::new(usb);
        let mut unit = session.open()?;
        let firmware = unit.firmware();
        let with_firmware = |error: CameraError| {
            anyhow::Error::new(error).context(format!("camera with firmware {firmware}"))
        };
        let plan = wanted.plan(&unit).map_err(with_firmware)?;
        let kind = session.choose_setting(firmware).map_err(with_firmware)?;
        session.configure(&plan).map_err(with_firmware)?;
        // It may change with the mode.
        let tick_rate = session.ask_tick_rate().map_err(with_firmware)?;
        unit.tick_rate = tick_rate;
        let streams = streams_of(&unit, &plan, product, path)?;
        tracing::info!(
            "{product} {}, firmware {firmware}, {:?}: depth {:?} {:?}, {:?} {:?}, {} frames a second, {kind:?}",
            unit.serial,
            unit.version.hardware(),
            wanted.depth_resolution,
            wanted.depth_format,
            plan.image,
            wanted.color_resolution,
            wanted.fps,
        );
        Ok(Self {
            session,
            endpoints: Endpoints::of(firmware),
            unit,
            plan,
            tick_rate,
            kind,
            streams,
        })
    }

    /// What the camera said of itself.
    pub fn unit(&self) -> &Unit {
        &self.unit
    }

    /// How data come over USB.
    pub fn transfer_kind(&self) -> TransferKind {
        self.kind
    }

    fn assemblers(&self) -> Result<(Assembler<Shifts>, Assembler<Picture>), CameraError> {
        let Plan { wanted, image, .. } = self.plan;
        let clock = || {
            FrameClock::new(self.tick_rate, wanted.fps)
                .ok_or(CameraError::Numbers { what: "frequency" })
        };
        let (width, height) = wanted.depth_resolution.size();
        let pixel_count = usize::from(width) * usize::from(height);
        let shifts = Shifts(SampleDecoder::new(wanted.depth_format, pixel_count));
        let resolution = wanted.color_resolution;
        let picture = match image {
            ImageMode::Color(format) => {
                let (width, height) = resolution.size();
                let decoder = ColorDecoder::new(format, width, height);
                Picture::Color {
                    decoder: decoder.ok_or(CameraError::Numbers { what: "width" })?,
                    frame_bytes: self.plan.most_image_bytes(),
                }
            }
            ImageMode::Infrared => {
                let sensor = self.unit.fixed.depth_sensor();
                Picture::Infrared(Brightness::new(sensor, resolution))
            }
        };
        Ok((
            Assembler::new(shifts, clock()?),
            Assembler::new(picture, clock()?),
        ))
    }
}

impl FrameSource for Camera {
    fn streams(&self) -> &Streams {
        &self.streams
    }

    fn waits(&self) -> bool {
        self.session.usb.time_waits()
    }

    fn is_device(&self) -> bool {
        !self.waits()
    }

    fn most_color_bytes(&self) -> usize {
        self.plan.most_image_bytes()
    }

    fn widest_pair_nanos(&self) -> i64 {
        SECOND_NANOS / 2 / i64::from(self.plan.wanted.fps.max(1))
    }

    fn period_nanos(&self) -> Option<i64> {
        (!self.waits()).then(|| SECOND_NANOS / i64::from(self.plan.wanted.fps.max(1)))
    }

    fn run(
        &mut self,
        ends: SourceEnds,
        _: HostClock,
        status: &Status,
        stop: &StopFlag,
    ) -> anyhow::Result<SourceReport> {
        let (depth, color) = self.assemblers()?;
        let plan = self.plan;
        let mut running = Running {
            plan,
            depth,
            color,
            ends,
            origin: Origin::default(),
            waits: self.waits(),
            endpoints: self.endpoints,
            remarks: Vec::with_capacity(4),
            restart_count: 0,
            frames_at_restart: 0,
        };
        let session = &mut self.session;
        let mut exposure = ExposureControl::new(plan.exposure(), &self.unit);
        let result = match session.queue_reads(self.endpoints) {
            Ok(()) => {
                let switches = session.switches(&plan);
                let mut control = Control::new(switches, session.usb.now_nanos());
                running.stream(session, &mut control, &mut exposure, status, stop)
            }
            Err(error) => Err(error),
        };
        let is_gone = result.as_ref().is_err_and(CameraError::is_gone);
        running.finish(is_gone, &*session.usb);
        if is_gone {
            stop.stop(EndReason::Unplugged);
        } else if result.is_err() {
            stop.stop(EndReason::Stopped);
        }
        // Those behind can end before the camera is switched off.
        let has_frames = running.has_frames();
        drop(running);
        if !is_gone {
            session.stop_streams(self.endpoints, &plan);
        }
        match result {
            Err(error) if !has_frames && !is_gone => Err(error.into()),
            Err(error) if !is_gone => {
                tracing::error!("the recording ends: {error}");
                Ok(SourceReport::default())
            }
            _ => Ok(SourceReport::default()),
        }
    }
}

/// Streams that run.
struct Running {
    plan: Plan,
    depth: Assembler<Shifts>,
    /// Colour or infrared.
    color: Assembler<Picture>,
    ends: SourceEnds,
    origin: Origin,
    waits: bool,
    endpoints: Endpoints,
    remarks: Vec<Remark>,
    restart_count: u32,
    /// Frames that had come when the streams were switched off and on last.
    frames_at_restart: u64,
}

impl Running {
    /// Until `stop` is set, or an error.
    fn stream(
        &mut self,
        session: &mut Session,
        control: &mut Control,
        exposure: &mut ExposureControl,
        status: &Status,
        stop: &StopFlag,
    ) -> Result<(), CameraError> {
        let mut silent_since = session.usb.now_nanos();
        while !stop.is_set() {
            let color_count = self.color.sent_count();
            let next_nanos = control.step(session, exposure, color_count)?;
            if let Some(details) = exposure.report() {
                tracing::info!("{details}");
                self.say(sequence::COLOR_STREAM, details, session.usb.now_nanos());
            }
            if let Some(is_on) = control.take_switched_emitter() {
                let word = if is_on { "on" } else { "off" };
                tracing::info!("the emitter is {word}");
                let details = json!({"event": "settings", "emitter": word});
                self.say(0, details, session.usb.now_nanos());
            }
            let now_nanos = session.usb.now_nanos();
            let until_nanos = next_nanos.min(now_nanos + LOOK_NANOS).max(now_nanos);
            self.reap(session, until_nanos, status, stop)?;
            self.make_remarks(session.usb.now_nanos(), stop);
            if !control.is_switching() {
                let last = self.latest_nanos().unwrap_or(silent_since);
                silent_since = silent_since.max(last);
                if session.usb.now_nanos() - silent_since >= SILENCE_NANOS {
                    self.restart(session, control)?;
                    silent_since = session.usb.now_nanos();
                }
            } else {
                silent_since = session.usb.now_nanos();
            }
        }
        Ok(())
    }

    fn reap(
        &mut self,
        session: &mut Session,
        until_nanos: i64,
        status: &Status,
        stop: &StopFlag,
    ) -> Result<(), CameraError> {
        let Self {
            depth,
            color,
            ends,
            origin,
            waits,
            endpoints,
            remarks,
            ..
        } = self;
        let reaped = session.usb.reap(until_nanos, &mut |arrival: Arrival<'_>| {
            let mut around = Surroundings {
                ends: &mut *ends,
                status,
                stop,
                origin: &mut *origin,
                waits: *waits,
            };
            let remark = if arrival.endpoint == endpoints.depth {
                depth.take(&arrival, &mut around)
            } else {
                color.take(&arrival, &mut around)
            };
            remarks.extend(remark);
        });
        reaped.map_err(|error: UsbError| CameraError::Endpoint {
            what: "reading",
            error,
        })
    }

    /// When the stream spoke last that has been silent for longer; depth may be silent while the emitter is off.
    fn latest_nanos(&self) -> Option<i64> {
        let (depth, color) = (
            self.depth.last_arrival_nanos(),
            self.color.last_arrival_nanos(),
        );
        match (depth, color) {
            _ if self.plan.emitter() == Some(false) => color,
            (Some(depth), Some(color)) => Some(depth.min(color)),
            _ => None,
        }
    }

    fn has_frames(&self) -> bool {
        self.depth.sent_count() + self.color.sent_count() > 0
    }

    fn restart(&mut self, session: &mut Session, control: &mut Control) -> Result<(), CameraError> {
        let frames = self.depth.sent_count() + self.color.sent_count();
        if frames > self.frames_at_restart {
            self.restart_count = 0;
        }
        self.frames_at_restart = frames;
        if self.restart_count == MOST_RESTARTS {
            return Err(CameraError::Silent {
                request: Request::set(ps1080::parameter::Parameter::Stream1Mode, 0).opcode(),
                seconds: SILENCE_NANOS / SECOND_NANOS * i64::from(MOST_RESTARTS + 1),
            });
        }
        self.restart_count += 1;
        let message = "a stream was silent for 3 s; both are switched off and on";
        tracing::warn!("{message}");
        let details = json!({"event": "warning", "message": message});
        self.say(0, details, session.usb.now_nanos());
        self.depth.note_restart();
        self.color.note_restart();
        control.restart(session.switches(&self.plan));
        Ok(())
    }

    fn make_remarks(&mut self, now_nanos: i64, stop: &StopFlag) {
        for remark in std::mem::take(&mut self.remarks) {
            let (stream, details) = match remark {
                Remark::Fault(kind) => {
                    tracing::error!("the camera reports {kind:?}; the recording ends");
                    stop.stop(EndReason::Stopped);
                    (0, warning(&format!("the camera reports {kind:?}")))
                }
                Remark::Doubt { stream, number } => (
                    stream,
                    warning(&format!("the last pixels of frame {number} are in doubt")),
                ),
            };
            self.say(stream, details, now_nanos);
        }
    }

    fn say(&self, stream: u16, details: Value, host_nanos: i64) {
        self.ends.say(Event {
            stream,
            host_nanos,
            details,
        });
    }

    /// What is missing at the end, and what was counted.
    fn finish(&mut self, is_gone: bool, usb: &dyn UsbTransport) {
        let cause = is_gone.then_some(GapCause::Unplug);
        self.depth.finish(cause, &mut self.ends.drops);
        self.color.finish(cause, &mut self.ends.drops);
        let details = json!({
            "event": "camera-counts",
            "depth": counts(self.depth.counts()),
            "color": counts(self.color.counts()),
            "longest_absence_ms": usb.longest_absence_nanos() as f64 / 1e6,
        });
        self.say(0, details, usb.now_nanos());
        self.ends.drops.flush_all();
    }
}

fn warning(message: &str) -> Value {
    json!({"event": "warning", "message": message})
}

fn counts(counts: LossCounts) -> Value {
    json!({
        "frames_begun": counts.started_count,
        "frames_ended": counts.ended_count,
        "losses": counts.lost_count,
        "packets_missing": counts.missing_packet_count,
        "packets_repeated": counts.repeated_packet_count,
        "packets_of_other_kinds": counts.foreign_packet_count,
        "garbage_bytes": counts.garbage_bytes,
    })
}
