//! Devices and recordings behind the OpenNI2 library as a source of frames (feature `openni2`).
//!
//! `library` the C interface, the only unsafe code · `describe` cameras and constants · [`OpenNi2`] the source. A `.oni`
//! file is played frame by frame and waits for the recorder; a camera does not wait.

mod describe;
mod library;

use std::time::Duration;

use openni2_sys as sys;
use sequence::{COLOR_STREAM, DEPTH_STREAM, Event, FrameTimes, GapCause, Streams};
use serde_json::json;

pub use library::OpenNiError;

use crate::clock::HostClock;
use crate::drops::Drop as Dropped;
use crate::openni2::describe::{shift_constants, streams_of};
use crate::openni2::library::{Device, Frame, Sensor, VideoMode};
use crate::pair::Sent;
use crate::source::{FrameSource, SourceEnds, SourceReport, take};
use crate::source_spec::OpenNi2Spec;
use crate::status::{EndReason, Status, StopFlag};

/// Longest wait between two looks at the stop flag.
const LOOK: Duration = Duration::from_millis(20);
/// A camera that sends nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);
/// A recording that gives nothing for so long, though frames are left, has ended.
const FILE_SILENCE: Duration = Duration::from_secs(10);
/// Bytes of a JPEG frame, as a share of its pixels: far more than the best quality takes.
const JPEG_BYTES_A_PIXEL: usize = 2;

/// A device or a recording that is open.
pub struct OpenNi2 {
    device: Device,
    streams: Streams,
    modes: [Option<VideoMode>; 2],
    is_file: bool,
    /// Frames of a recording: depth, colour.
    frame_counts: [Option<i32>; 2],
    is_synced: bool,
}

const SENSORS: [Sensor; 2] = [Sensor::Depth, Sensor::Color];

impl OpenNi2 {
    /// Opens what `spec` names. A camera is asked for 640 x 480 at 30 Hz, raw shifts where it has them, colour without
    /// loss, no mirroring, shutters tied together.
    ///
    /// # Errors
    /// What the library refuses, and streams that cannot be recorded.
    pub fn open(spec: &OpenNi2Spec) -> anyhow::Result<Self> {
        let mut device = Device::open(spec.uri.as_deref())?;
        let is_file = device.is_file();
        let (mut is_registered, mut is_synced) = (false, false);
        if is_file {
            // By hand: each frame is read before the next is decoded. And once only.
            device.set(sys::ONI_DEVICE_PROPERTY_PLAYBACK_SPEED, -1.0_f32);
            device.set(sys::ONI_DEVICE_PROPERTY_PLAYBACK_REPEAT_ENABLED, 0_i32);
        } else {
            choose_modes(&mut device);
            for sensor in SENSORS {
                device.set_of(sensor, sys::ONI_STREAM_PROPERTY_MIRRORING, 0_i32);
            }
            is_registered = spec.is_registered
                && device.can_register()
                && device.set(
                    sys::ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION,
                    sys::ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR,
                );
            is_synced = device.sync();
        }
        let modes = SENSORS.map(|sensor| device.mode(sensor));
        let uri = spec.uri.as_deref().unwrap_or("openni2");
        let [depth, color] = modes;
        let streams = streams_of(&device, depth, color, is_registered, uri)?;
        let count = |sensor| device.get_of(sensor, sys::ONI_STREAM_PROPERTY_NUMBER_OF_FRAMES);
        let frame_counts = SENSORS.map(|sensor| if is_file { count(sensor) } else { None });
        tracing::info!(
            "{}: depth {depth:?}, colour {color:?}, registered {is_registered}, synced {is_synced}",
            device.name()
        );
        Ok(Self {
            device,
            streams,
            modes,
            is_file,
            frame_counts,
            is_synced,
        })
    }

    fn is_wanted(&self, stream: usize, read: &[i32; 2]) -> bool {
        self.modes[stream].is_some()
            && self.frame_counts[stream].is_none_or(|count| read[stream] < count)
    }
}

/// VGA at 30 Hz, shifts before millimetres, raw YUV before RGB; a mode that the camera does not have stays as it is.
fn choose_modes(device: &mut Device) {
    let has_constants = shift_constants(device).is_some();
    let depth = |mode: VideoMode| match mode.format {
        sys::ONI_PIXEL_FORMAT_SHIFT_9_2 if has_constants => 2,
        sys::ONI_PIXEL_FORMAT_DEPTH_1_MM => 1,
        _ => 0,
    };
    let color = |mode: VideoMode| match mode.format {
        sys::ONI_PIXEL_FORMAT_YUV422 => 3,
        sys::ONI_PIXEL_FORMAT_YUYV => 2,
        sys::ONI_PIXEL_FORMAT_RGB888 => 1,
        _ => 0,
    };
    let ranks: [(Sensor, &dyn Fn(VideoMode) -> u32); 2] =
        [(Sensor::Depth, &depth), (Sensor::Color, &color)];
    for (sensor, rank) in ranks {
        let is_vga = |mode: &VideoMode| (mode.width, mode.height, mode.fps) == (640, 480, 30);
        let mut modes: Vec<VideoMode> = device.modes(sensor).into_iter().filter(is_vga).collect();
        if sensor == Sensor::Depth && has_constants {
            // The driver of PrimeSense cameras takes it without listing it.
            modes.push(VideoMode {
                format: sys::ONI_PIXEL_FORMAT_SHIFT_9_2,
                width: 640,
                height: 480,
                fps: 30,
            });
        }
        modes.sort_by_key(|mode| std::cmp::Reverse(rank(*mode)));
        // The best one that is taken: drivers list modes that they then refuse.
        let _ = modes
            .into_iter()
            .filter(|mode| rank(*mode) > 0)
            .any(|mode| device.set_mode(sensor, mode));
    }
}

impl FrameSource for OpenNi2 {
    fn streams(&self) -> &Streams {
        &self.streams
    }

    fn waits(&self) -> bool {
        self.is_file
    }

    fn is_device(&self) -> bool {
        !self.is_file
    }

    fn most_color_bytes(&self) -> usize {
        let camera = &self.streams.color.intrinsics;
        let pixel_count = camera.width() as usize * camera.height() as usize;
        match self.streams.color.encoding.lossless() {
            Some(format) => format
                .frame_bytes(camera.width(), camera.height())
                .unwrap_or(3 * pixel_count),
            None => JPEG_BYTES_A_PIXEL * pixel_count,
        }
    }

    fn widest_pair_nanos(&self) -> i64 {
        let rate_hz = self.streams.depth_timing.rate_hz;
        (0.5e9
            / rate_hz
                .or(self.streams.color_timing.rate_hz)
                .unwrap_or(30.0)) as i64
    }

    fn period_nanos(&self) -> Option<i64> {
        (!self.is_file).then(|| 2 * self.widest_pair_nanos())
    }

    fn run(
        &mut self,
        ends: SourceEnds,
        clock: HostClock,
        status: &Status,
        stop: &StopFlag,
    ) -> anyhow::Result<SourceReport> {
        self.device.start()?;
        let mut running = Running {
            ends,
            clock,
            encodings: self.streams.clone(),
            waits: self.is_file,
            first: [None; 2],
            next: [0; 2],
        };
        if !self.is_file && !self.is_synced {
            running.say("the device does not tie its shutters together");
        }
        let mut read = [0; 2];
        let mut silent = Duration::ZERO;
        while !stop.is_set() {
            let wanted: Vec<Sensor> = SENSORS
                .into_iter()
                .enumerate()
                .filter(|(stream, _)| self.is_wanted(*stream, &read))
                .map(|(_, sensor)| sensor)
                .collect();
            if wanted.is_empty() {
                break;
            }
            let is_file = self.is_file;
            let came = self.device.next(&wanted, LOOK, |sensor, frame| {
                read[sensor as usize] += 1;
                running.take(sensor, &frame, status, stop);
            })?;
            silent = if came.is_some() {
                Duration::ZERO
            } else {
                silent + LOOK
            };
            let longest = if is_file { FILE_SILENCE } else { SILENCE };
            if self.device.is_gone() || silent >= longest {
                if is_file {
                    running.say("the file gives fewer frames than it announces");
                } else {
                    stop.stop(EndReason::Unplugged);
                }
                break;
            }
        }
        running.ends.drops.flush_all();
        Ok(SourceReport::default())
    }
}

/// Streams that run.
struct Running {
    ends: SourceEnds,
    clock: HostClock,
    encodings: Streams,
    waits: bool,
    /// The driver's count of the first frame: depth, colour.
    first: [Option<i32>; 2],
    /// The number that should come next.
    next: [u64; 2],
}

impl Running {
    fn take(&mut self, sensor: Sensor, frame: &Frame<'_>, status: &Status, stop: &StopFlag) {
        let now = (self.clock.monotonic)();
        let stream = match sensor {
            Sensor::Depth => DEPTH_STREAM,
            Sensor::Color => COLOR_STREAM,
        };
        let slot = sensor as usize;
        let first = *self.first[slot].get_or_insert(frame.index);
        // A driver that starts to count anew goes on where it was.
        let counted = u64::try_from(frame.index.wrapping_sub(first)).unwrap_or(0);
        let number = counted.max(self.next[slot]);
        if number > self.next[slot] {
            self.lose(
                stream,
                self.next[slot],
                number - self.next[slot],
                GapCause::Source,
            );
        }
        self.next[slot] = number + 1;
        status.add_in(1);
        let times = FrameTimes {
            number,
            device_ticks: Some(frame.timestamp_us),
            device_nanos: i64::try_from(frame.timestamp_us)
                .unwrap_or(i64::MAX)
                .saturating_mul(1000),
            host_nanos: Some([now, now]),
            is_repeat: false,
        };
        let sent = match sensor {
            Sensor::Depth => self.depth(frame, times, stop),
            Sensor::Color => self.color(frame, times, stop),
        };
        match sent {
            Ok(sent) => self.ends.send(sent, stream),
            Err(cause) => self.lose(stream, number, 1, cause),
        }
    }

    fn lose(&mut self, stream: u16, first_number: u64, count: u64, cause: GapCause) {
        self.ends.drops.add(Dropped {
            stream,
            first_number,
            count,
            cause,
        });
    }

    fn depth(
        &mut self,
        frame: &Frame<'_>,
        times: FrameTimes,
        stop: &StopFlag,
    ) -> Result<Sent, GapCause> {
        let free = &mut self.ends.depth_frames;
        let mut sent =
            take(free, &self.ends.parker, self.waits, stop).ok_or(GapCause::PoolEmpty)?;
        let camera = &self.encodings.depth.intrinsics;
        let samples = sent.samples.as_mut_slice();
        let copied = rows(frame, camera.width(), camera.height(), 2).map(|rows| {
            let bytes = rows.flat_map(|row| row.as_chunks::<2>().0);
            for (sample, bytes) in samples.iter_mut().zip(bytes) {
                *sample = u16::from_ne_bytes(*bytes);
            }
        });
        if copied.is_none() {
            free.put_back(sent);
            return Err(GapCause::Corrupt);
        }
        sent.times = times;
        Ok(Sent::Depth(sent))
    }

    fn color(
        &mut self,
        frame: &Frame<'_>,
        times: FrameTimes,
        stop: &StopFlag,
    ) -> Result<Sent, GapCause> {
        let free = &mut self.ends.color_frames;
        let mut sent =
            take(free, &self.ends.parker, self.waits, stop).ok_or(GapCause::PoolEmpty)?;
        let camera = &self.encodings.color.intrinsics;
        let (width, height) = (camera.width(), camera.height());
        sent.bytes.clear();
        let copied = match frame.format {
            sys::ONI_PIXEL_FORMAT_JPEG => {
                sent.bytes.extend_from_slice(frame.bytes);
                Some(())
            }
            sys::ONI_PIXEL_FORMAT_GRAY8 => rows(frame, width, height, 1).map(|rows| {
                sent.bytes
                    .extend(rows.flatten().flat_map(|&gray| [gray; 3]));
            }),
            sys::ONI_PIXEL_FORMAT_RGB888 => rows(frame, width, height, 3).map(|rows| {
                rows.for_each(|row| sent.bytes.extend_from_slice(row));
            }),
            _ => rows(frame, width, height, 2).map(|rows| {
                rows.for_each(|row| sent.bytes.extend_from_slice(row));
            }),
        };
        if copied.is_none() {
            free.put_back(sent);
            return Err(GapCause::Corrupt);
        }
        sent.times = times;
        Ok(Sent::Color(sent))
    }

    fn say(&self, message: &str) {
        tracing::warn!("{message}");
        self.ends.say(Event {
            stream: 0,
            host_nanos: (self.clock.monotonic)(),
            details: json!({"event": "warning", "message": message}),
        });
    }
}

/// The rows of a frame without their padding; `None` when it is not of this size.
fn rows<'a>(
    frame: &Frame<'a>,
    width: u32,
    height: u32,
    pixel_bytes: usize,
) -> Option<impl Iterator<Item = &'a [u8]>> {
    let row_bytes = width as usize * pixel_bytes;
    let stride = frame.stride.max(row_bytes);
    let needed = stride * (height as usize).saturating_sub(1) + row_bytes;
    let is_whole = (frame.width, frame.height) == (width, height) && frame.bytes.len() >= needed;
    let bytes = frame.bytes;
    is_whole.then(move || {
        bytes
            .chunks(stride)
            .take(height as usize)
            .map(move |row| &row[..row_bytes])
    })
}
