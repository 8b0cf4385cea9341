//! A recording in place of a camera.

use std::path::Path;
use std::time::{Duration, Instant};

use geometry::Pose;
use sequence::contents::StoredPoses;
use sequence::decode::StreamDecoders;
use sequence::recording::widest_pair_nanos;
use sequence::scan::RecordPlace;
use sequence::{FrameTimes, GapCause, Recording, SequenceError, Streams};

use crate::clock::HostClock;
use crate::disk::SOURCE_SET;
use crate::drops::Drop;
use crate::frame::{ColorFrame, DepthFrame};
use crate::latency::Work;
use crate::pair::Sent;
use crate::source::{FrameSource, SourceEnds, SourceReport, take};
use crate::source_spec::{ReplaySpec, Speed};
use crate::status::{Status, StopFlag};

/// Plays the frames of a recording, of both streams in the order of their times.
#[derive(Debug)]
pub struct Replay {
    recording: Recording,
    speed: Speed,
    repeats: bool,
    order: Vec<Step>,
    depth: Cycle,
    color: Cycle,
    most_color_bytes: usize,
    /// Device time from the first frame of a round to that of the next, nanoseconds.
    round_nanos: i64,
}

/// What comes next.
#[derive(Clone, Copy, Debug)]
enum Step {
    Depth(RecordPlace),
    Color(RecordPlace),
}

/// Numbers of a stream in a round.
#[derive(Clone, Copy, Debug, Default)]
struct Cycle {
    first: u64,
    /// Numbers a round takes.
    count: u64,
}

/// Frames whose memory in the map is let go at a time.
const RELEASE_STEPS: usize = 32;
/// Frames a second where the recording promises no rate.
pub(crate) const ASSUMED_RATE_HZ: f64 = 30.0;
/// Longest sleep between two looks at the stop flag.
const NAP: Duration = Duration::from_millis(20);

impl Replay {
    /// Opens the recording.
    pub fn open(spec: &ReplaySpec) -> Result<Self, SequenceError> {
        let recording = Recording::open(&spec.path)?;
        let description = recording.description();
        let depth = recording.contents().stream(description.depth_id);
        let color = recording.contents().stream(description.color_id);
        let mut order: Vec<Step> = depth.iter().copied().map(Step::Depth).collect();
        order.extend(color.iter().copied().map(Step::Color));
        order.sort_by_key(|step| (step.place().label.device_nanos, step.place().sequence));
        let span = match (order.first(), order.last()) {
            (Some(first), Some(last)) => last
                .place()
                .label
                .device_nanos
                .saturating_sub(first.place().label.device_nanos),
            _ => return Err(SequenceError::NoFrames.in_file(&spec.path)),
        };
        let rate_hz = description.streams.depth_timing.rate_hz;
        let period = rate_hz.map_or_else(
            || span / (depth.len().max(2) as i64 - 1),
            |rate_hz| (1e9 / rate_hz).round() as i64,
        );
        Ok(Self {
            speed: spec.speed,
            repeats: spec.repeats,
            depth: Cycle::of(depth),
            color: Cycle::of(color),
            round_nanos: span.saturating_add(period).max(1),
            order,
            most_color_bytes: most_color_bytes(&recording)?,
            recording,
        })
    }

    /// The recording that is played.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Frames of both streams in a round, `None` when it goes round for ever.
    pub fn frame_count(&self) -> Option<usize> {
        (!self.repeats).then_some(self.order.len())
    }

    /// Plays until the end or until `stop`; returns what decoding took.
    fn play_all(
        &self,
        mut ends: SourceEnds,
        clock: HostClock,
        status: &Status,
        stop: &StopFlag,
    ) -> Result<Work, SequenceError> {
        let mut decoders = StreamDecoders::new(self.recording.description())?;
        let mut decoding = Work::default();
        let begun = Instant::now();
        let first_nanos = self
            .order
            .first()
            .map_or(0, |step| step.place().label.device_nanos);
        let mut next = [self.depth.first, self.color.first];
        for round in 0_u64.. {
            for (index, step) in self.order.iter().enumerate() {
                let nanos = step.place().label.device_nanos;
                let played = i128::from(nanos) - i128::from(first_nanos)
                    + i128::from(round) * i128::from(self.round_nanos);
                self.wait_until(begun, played, stop);
                if stop.is_set() {
                    ends.drops.flush_all();
                    return Ok(decoding);
                }
                self.play(
                    step,
                    round,
                    &mut next,
                    &mut ends,
                    &mut decoders,
                    &mut decoding,
                    clock,
                    status,
                    stop,
                );
                if index % RELEASE_STEPS == RELEASE_STEPS - 1 {
                    self.recording.release();
                }
            }
            if !self.repeats {
                break;
            }
        }
        ends.drops.flush_all();
        Ok(decoding)
    }

    fn wait_until(&self, begun: Instant, played_nanos: i128, stop: &StopFlag) {
        let Speed::Times(times) = self.speed else {
            return;
        };
        // Exact to a microsecond for years.
        let due = Duration::from_secs_f64((played_nanos as f64 / 1e9 / times).max(0.0));
        while !stop.is_set() {
            match due.checked_sub(begun.elapsed()) {
                Some(rest) if !rest.is_zero() => std::thread::sleep(rest.min(NAP)),
                _ => return,
            }
        }
    }

    fn play(
        &self,
        step: &Step,
        round: u64,
        next: &mut [u64; 2],
        ends: &mut SourceEnds,
        decoders: &mut StreamDecoders,
        decoding: &mut Work,
        clock: HostClock,
        status: &Status,
        stop: &StopFlag,
    ) {
        let place = step.place();
        let (stream, cycle, slot) = match step {
            Step::Depth(_) => (sequence::DEPTH_STREAM, self.depth, 0),
            Step::Color(_) => (sequence::COLOR_STREAM, self.color, 1),
        };
        let number = place.label.number + round * cycle.count;
        let drop = |first_number: u64, count: u64, cause: GapCause| Drop {
            stream,
            first_number,
            count,
            cause,
        };
        // Taken first: a recording that ends while its source waits has not had this frame.
        let (mut depth_frame, mut color_frame) = (None, None);
        match step {
            Step::Depth(_) => {
                depth_frame = take(&mut ends.depth_frames, &ends.parker, self.waits(), stop);
            }
            Step::Color(_) => {
                color_frame = take(&mut ends.color_frames, &ends.parker, self.waits(), stop);
            }
        }
        if self.waits() && depth_frame.is_none() && color_frame.is_none() {
            return;
        }
        if number > next[slot] {
            ends.drops
                .add(drop(next[slot], number - next[slot], GapCause::Source));
        }
        next[slot] = number + 1;
        status.add_in(1);
        let times = |stored: FrameTimes| {
            let shift = (i128::from(round) * i128::from(self.round_nanos)) as i64;
            let now = (clock.monotonic)();
            FrameTimes {
                number,
                device_ticks: stored
                    .device_ticks
                    .map(|ticks| self.ticks(ticks, shift, stream)),
                device_nanos: stored.device_nanos.saturating_add(shift),
                host_nanos: Some([now, now]),
                is_repeat: false,
            }
        };
        let error = if let Some(mut frame) = depth_frame {
            let begun = Work::begin();
            let decoded = self.decode_depth(place, &mut frame, decoders);
            *decoding = decoding.and(begun.end());
            match decoded {
                Ok(stored) => {
                    frame.times = times(stored);
                    return ends.send(Sent::Depth(frame), stream);
                }
                Err(error) => {
                    ends.depth_frames.put_back(frame);
                    error
                }
            }
        } else if let Some(mut frame) = color_frame {
            let begun = Work::begin();
            let decoded = self.decode_color(place, &mut frame, decoders);
            *decoding = decoding.and(begun.end());
            match decoded {
                Ok(stored) => {
                    frame.times = times(stored);
                    return ends.send(Sent::Color(frame), stream);
                }
                Err(error) => {
                    ends.color_frames.put_back(frame);
                    error
                }
            }
        } else {
            return ends.drops.add(drop(number, 1, GapCause::PoolEmpty));
        };
        tracing::warn!("frame {number} of stream {stream}: {error}");
        ends.drops.add(drop(number, 1, GapCause::Corrupt));
    }

    fn decode_depth(
        &self,
        place: &RecordPlace,
        frame: &mut DepthFrame,
        decoders: &mut StreamDecoders,
    ) -> Result<FrameTimes, SequenceError> {
        let (times, payload) = self.recording.frame(place)?;
        let tables = &self.recording.contents().tables;
        decoders.depth_into(payload, place.label.stream, tables, &mut frame.samples)?;
        Ok(times)
    }

    fn decode_color(
        &self,
        place: &RecordPlace,
        frame: &mut ColorFrame,
        decoders: &mut StreamDecoders,
    ) -> Result<FrameTimes, SequenceError> {
        let (times, payload) = self.recording.frame(place)?;
        decoders.color_into(payload, &mut frame.bytes)?;
        Ok(times)
    }

    /// The counter of a later round: it goes on as the device's would.
    fn ticks(&self, ticks: u64, shift_nanos: i64, stream: u16) -> u64 {
        let streams = &self.recording.description().streams;
        let timing = if stream == sequence::DEPTH_STREAM {
            streams.depth_timing
        } else {
            streams.color_timing
        };
        let Some(clock) = timing.clock else {
            return ticks;
        };
        let shift = i128::from(shift_nanos) * i128::from(clock.tick_hz) / 1_000_000_000;
        let wrap = 1_i128 << clock.bits;
        (i128::from(ticks) + shift).rem_euclid(wrap) as u64
    }
}

impl FrameSource for Replay {
    fn streams(&self) -> &Streams {
        &self.recording.description().streams
    }

    fn waits(&self) -> bool {
        self.speed == Speed::Max
    }

    fn most_color_bytes(&self) -> usize {
        self.most_color_bytes
    }

    fn widest_pair_nanos(&self) -> i64 {
        widest_pair_nanos(self.recording.description())
    }

    fn period_nanos(&self) -> Option<i64> {
        let rate_hz = self.streams().depth_timing.rate_hz;
        match self.speed {
            Speed::Max => None,
            Speed::Times(times) => {
                Some((1e9 / rate_hz.unwrap_or(ASSUMED_RATE_HZ) / times).round() as i64)
            }
        }
    }

    fn source_poses(&self) -> Option<(StoredPoses, bool)> {
        let sets = &self.recording.contents().pose_sets;
        let stored = sets.iter().find(|set| set.head.name == SOURCE_SET)?;
        let is_color = stored.head.stream == self.recording.description().color_id;
        Some((stored.clone(), is_color))
    }

    fn first_pose(&self) -> Pose {
        let poses = self.recording.poses(SOURCE_SET).unwrap_or_default();
        poses
            .iter()
            .flatten()
            .next()
            .copied()
            .unwrap_or(Pose::IDENTITY)
    }

    fn run(
        &mut self,
        ends: SourceEnds,
        clock: HostClock,
        status: &Status,
        stop: &StopFlag,
    ) -> anyhow::Result<SourceReport> {
        Ok(SourceReport {
            decoding: self.play_all(ends, clock, status, stop)?,
            ..SourceReport::default()
        })
    }
}

/// Bytes of the largest colour frame as the camera sends it.
fn most_color_bytes(recording: &Recording) -> Result<usize, SequenceError> {
    let color = recording.color_camera();
    let (width, height) = (color.intrinsics.width(), color.intrinsics.height());
    match color.encoding.lossless() {
        Some(format) => Ok(format.frame_bytes(width, height)?),
        None => {
            let places = recording
                .contents()
                .stream(recording.description().color_id);
            let sizes = places.iter().map(|place| place.payload_bytes as usize);
            Ok(sizes.max().unwrap_or_default())
        }
    }
}

impl Step {
    fn place(&self) -> &RecordPlace {
        match self {
            Self::Depth(place) | Self::Color(place) => place,
        }
    }
}

impl Cycle {
    fn of(places: &[RecordPlace]) -> Self {
        match (places.first(), places.last()) {
            (Some(first), Some(last)) => Self {
                first: first.label.number,
                count: last.label.number - first.label.number + 1,
            },
            _ => Self::default(),
        }
    }
}

/// The name of a recording's camera for file names.
pub fn camera_name(path: &Path) -> String {
    path.file_stem().map_or_else(
        || "replay".to_owned(),
        |stem| stem.to_string_lossy().into_owned(),
    )
}
