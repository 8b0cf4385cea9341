//! The disk thread: encoded records go into the file; chunks are sealed, files rotated, a full disk ends all.

mod counts;
mod fused;
mod poses;
mod report;
mod sealing;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

use crossbeam::channel::Receiver;
use crossbeam::sync::Parker;
use sequence::chunk_writer::DiskLimits;
use sequence::codecs::CodeTable;
use sequence::contents::StoredPoses;
use sequence::description::Part;
use sequence::{
    Description, Event, FileId, FrameTimes, Gap, GapCause, Histogram, RecordingWriter,
    SequenceError,
};

use crate::capture::LONGEST_PARK;
use crate::clock::HostClock;
use crate::latency::Work;
use crate::message::{MessageKind, MessageReceiver, frame_parts, gap_parts};
use crate::service::{Pulse, Service};
use crate::status::{EndReason, Status, StopFlag};

pub use self::fused::{FuseMessages, LIVE_SET, SOURCE_SET};
use self::fused::{SourcePoses, Until};
use self::poses::PoseQueue;
pub use self::report::{DiskReport, LayerFactory, PreTrigger, Rotation};

/// What comes to the disk.
pub struct DiskEnds {
    /// From the record thread.
    pub records: MessageReceiver,
    /// From the fuse thread, where there is one.
    pub fuse: Option<FuseMessages>,
    /// What happens in the source.
    pub source_events: Receiver<Event>,
    /// Poses that a replay brings, and whether they are of the colour camera.
    pub source_poses: Option<(StoredPoses, bool)>,
}

/// Writes one recording, in one file or several.
pub struct Disk<'capture> {
    receiver: MessageReceiver,
    fuse: Option<FuseMessages>,
    fuse_payload: Vec<u8>,
    source_events: Receiver<Event>,
    live: PoseQueue,
    source: Option<SourcePoses>,
    make_layer: LayerFactory,
    description: Description,
    limits: DiskLimits,
    rotation: Rotation,
    clock: HostClock,
    /// Present until the trigger comes.
    pre_trigger: Option<PreTrigger>,
    status: &'capture Status,
    stop: &'capture StopFlag,
    path: PathBuf,
    writer: Option<RecordingWriter>,
    begun: Instant,
    first_file_id: FileId,
    table: Option<(u16, CodeTable)>,
    depth_work: Option<Work>,
    /// Since when a chunk is on its way to the disk.
    sealing_since: Option<Instant>,
    /// Host time at which the last byte of the last depth frame came, nanoseconds.
    depth_arrival: Option<i64>,
    /// Stream and number of the frames that are not durable yet.
    unsealed: Vec<(u16, u64)>,
    /// So many of them, the first, are in the chunk that is on its way.
    sealing_count: usize,
    report: DiskReport,
    pulse: Pulse,
}

impl<'capture> Disk<'capture> {
    /// Begins the recording `path`.
    pub fn new(
        ends: DiskEnds,
        mut make_layer: LayerFactory,
        path: &Path,
        description: &Description,
        limits: DiskLimits,
        rotation: Rotation,
        pre_trigger: Option<PreTrigger>,
        clock: HostClock,
        service: Service,
        status: &'capture Status,
        stop: &'capture StopFlag,
    ) -> Result<Self, SequenceError> {
        let begin = |make_layer: &mut LayerFactory| {
            let layer = make_layer(path)?;
            RecordingWriter::on(layer, FileId::random()?, path, description, limits)
        };
        let writer = begin(&mut make_layer).map_err(|error| match error {
            SequenceError::InFile { .. } => error,
            error => error.in_file(path),
        })?;
        Ok(Self {
            receiver: ends.records,
            fuse: ends.fuse,
            fuse_payload: Vec::with_capacity(1 << 16),
            source_events: ends.source_events,
            live: PoseQueue::new(LIVE_SET, description.writer.clone(), sequence::DEPTH_STREAM),
            source: ends
                .source_poses
                .map(|(stored, is_color)| SourcePoses::new(stored, is_color)),
            make_layer,
            description: description.clone(),
            limits,
            rotation,
            clock,
            pre_trigger,
            status,
            stop,
            path: path.to_path_buf(),
            begun: Instant::now(),
            first_file_id: writer.file_id(),
            writer: Some(writer),
            table: None,
            depth_work: None,
            sealing_since: None,
            depth_arrival: None,
            unsealed: Vec::with_capacity(4096),
            sealing_count: 0,
            report: DiskReport {
                files: vec![path.to_path_buf()],
                gaps: Vec::with_capacity(1024),
                ..DiskReport::default()
            },
            pulse: Pulse::new(service),
        })
    }

    /// Writes until the message `End`, then closes the file for the reason that `reason` gives.
    pub fn run(
        mut self,
        parker: &Parker,
        reason: impl Fn() -> EndReason,
    ) -> Result<DiskReport, SequenceError> {
        let mut payload = Vec::with_capacity(2 << 20);
        loop {
            let fused = self.take_fused();
            self.judge(fused)?;
            if self.pre_trigger.is_some() {
                let held = self.hold(&mut payload);
                self.judge(held)?;
                if self.pre_trigger.is_some() {
                    parker.park_timeout(LONGEST_PARK);
                    continue;
                }
            }
            match self.receiver.receive(&mut payload) {
                Some(head) if head.kind() == MessageKind::End => break,
                Some(head) => {
                    let stream = head.stream.get();
                    let begun = Work::begin();
                    let result = self.take(head.kind(), stream, &payload);
                    self.judge(result)?;
                    if head.kind() == MessageKind::Frame {
                        self.count_work(stream, head.work().and(begun.end()));
                        self.count_latency(stream, &payload);
                    }
                }
                None => parker.park_timeout(LONGEST_PARK),
            }
            let said = self.take_source_events();
            self.judge(said)?;
            let due = self.seal_if_due();
            self.judge(due)?;
        }
        self.pulse.stopping();
        let said = self.take_source_events();
        self.judge(said)?;
        let last = self.await_fused(Until::Over);
        self.judge(last)?;
        // From here on the fuse thread counts its poses as too late.
        self.fuse = None;
        let counts = self.write_histograms();
        self.judge(counts)?;
        let reason = self.report.failure.unwrap_or_else(reason);
        self.finish(reason)?;
        Ok(self.report)
    }

    /// Before the trigger: lets the oldest frames go. Comes to an end with the trigger, or with the recording.
    fn hold(&mut self, payload: &mut Vec<u8>) -> Result<(), SequenceError> {
        let Some(held) = self.pre_trigger.clone() else {
            return Ok(());
        };
        if held.trigger.load(Ordering::Relaxed) {
            self.pre_trigger = None;
            let host_nanos = (self.clock.monotonic)();
            let details = serde_json::json!({"event": "trigger"});
            return match &mut self.writer {
                Some(writer) => writer.write_event(&Event {
                    stream: 0,
                    host_nanos,
                    details,
                }),
                None => Ok(()),
            };
        }
        // The recording ends and nobody asked for it.
        let is_over = !self.receiver.is_connected();
        while let Some(head) = self.receiver.next_head() {
            let age = self
                .receiver
                .newest_nanos()
                .saturating_sub(head.device_nanos.get());
            match head.kind() {
                MessageKind::End => {
                    self.pre_trigger = None;
                    return Ok(());
                }
                MessageKind::Frame
                    if !is_over
                        && age <= held.span.as_nanos() as i64
                        && self.receiver.waiting_bytes() <= held.bytes =>
                {
                    return Ok(());
                }
                _ => {}
            }
            self.receiver.receive(payload);
            self.report.not_asked_for += u64::from(head.kind() == MessageKind::Frame);
            if head.kind() == MessageKind::Table {
                self.take(MessageKind::Table, head.stream.get(), payload)?;
            }
        }
        Ok(())
    }

    fn take(
        &mut self,
        kind: MessageKind,
        stream: u16,
        payload: &[u8],
    ) -> Result<(), SequenceError> {
        match kind {
            MessageKind::Frame => self.take_frame(stream, payload),
            MessageKind::Gap => {
                if let Some((header, words)) = gap_parts(payload) {
                    let words = String::from_utf8_lossy(words).into_owned();
                    self.take_gap(Gap::of(stream, header, words))?;
                }
                Ok(())
            }
            MessageKind::Table => {
                let table = CodeTable::from_bytes(payload)?;
                if let Some(writer) = &mut self.writer {
                    writer.write_table(stream, &table)?;
                }
                self.table = Some((stream, table));
                Ok(())
            }
            MessageKind::Histogram => {
                let histogram: Histogram = serde_json::from_slice(payload)?;
                match &mut self.writer {
                    // A full disk has no room for counts.
                    Some(writer) if self.report.failure.is_none() => {
                        writer.write_histogram(stream, &histogram)
                    }
                    _ => Ok(()),
                }
            }
            MessageKind::Poses => {
                self.take_poses(payload);
                Ok(())
            }
            MessageKind::Event => self.take_event(stream, payload),
            MessageKind::End => Ok(()),
        }
    }

    fn take_frame(&mut self, stream: u16, payload: &[u8]) -> Result<(), SequenceError> {
        let Some((header, image)) = frame_parts(payload) else {
            return Ok(());
        };
        let times = FrameTimes::of(header);
        if let Some(cause) = self.report.failure.and_then(EndReason::gap_cause) {
            return self.take_gap(one_frame(stream, times.number, cause));
        }
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        match writer.write_frame(stream, &times, image) {
            Ok(()) => {
                self.report.frames += 1;
                self.report.depth_frames += u64::from(stream == sequence::DEPTH_STREAM);
                self.unsealed.push((stream, times.number));
                self.note_frame(stream, times.number);
                self.report.repeats += u64::from(times.is_repeat);
                let nanos = times.device_nanos;
                let [first, last] = self.report.device_nanos.unwrap_or([nanos; 2]);
                self.report.device_nanos = Some([first.min(nanos), last.max(nanos)]);
                self.status.add_recorded(payload.len() as u64);
                self.pulse.beat(stream, (self.clock.monotonic)());
                Ok(())
            }
            Err(error) if error.is_disk_full() => {
                self.fail(EndReason::DiskFull);
                self.take_gap(one_frame(stream, times.number, GapCause::DiskFull))
            }
            Err(error) => Err(error),
        }
    }

    /// Writes a gap, joined with the one before where they touch: a full disk must not be filled with gaps.
    fn take_gap(&mut self, gap: Gap) -> Result<(), SequenceError> {
        let touches = |last: &&mut Gap| {
            last.stream == gap.stream
                && last.cause == gap.cause
                && last.first_number + last.count == gap.first_number
        };
        let is_joined = match self.report.gaps.iter_mut().rev().take(4).find(touches) {
            Some(last) if self.report.failure.is_some() => {
                last.count += gap.count;
                true
            }
            _ => false,
        };
        if is_joined {
            return Ok(());
        }
        if self.report.failure.is_none()
            && let Some(writer) = &mut self.writer
        {
            writer.write_gap(&gap)?;
        }
        self.report.gaps.push(gap);
        Ok(())
    }

    /// A disk that is full or broken ends the recording; other errors are passed on.
    fn judge(&mut self, result: Result<(), SequenceError>) -> Result<(), SequenceError> {
        match result {
            Err(error) if error.is_disk_full() => {
                self.fail(EndReason::DiskFull);
                Ok(())
            }
            Err(error) if error.is_disk_error() => {
                tracing::error!("{error}");
                self.fail(EndReason::DiskError);
                Ok(())
            }
            result => result,
        }
    }

    fn fail(&mut self, reason: EndReason) {
        if self.report.failure.is_none() {
            self.report.failure = Some(reason);
            self.stop.stop(reason);
        }
    }

    /// Closes this file and goes on in the next.
    fn rotate(&mut self) -> Result<(), SequenceError> {
        self.await_fused(Until::InStep)?;
        self.finish(EndReason::Part)?;
        self.begin_pose_sets();
        let number = self.report.files.len() as u32 + 1;
        let path = part_path(&self.path, number);
        self.description.part = Some(Part {
            number,
            first_file_id: self.first_file_id,
        });
        let layer = (self.make_layer)(&path)?;
        let mut writer = RecordingWriter::on(
            layer,
            FileId::random()?,
            &path,
            &self.description,
            self.limits,
        )?;
        if let Some((stream, table)) = &self.table {
            writer.write_table(*stream, table)?;
        }
        self.writer = Some(writer);
        self.begun = Instant::now();
        self.report.files.push(path);
        Ok(())
    }

    fn finish(&mut self, reason: EndReason) -> Result<(), SequenceError> {
        let poses = self.flush_poses();
        self.judge(poses)?;
        let sealed = self.await_seal();
        self.judge(sealed)?;
        let Some(mut writer) = self.writer.take() else {
            return Ok(());
        };
        let cause = self.report.failure.and_then(EndReason::gap_cause);
        if cause.is_some() {
            // These were held back to be joined.
            for gap in self.report.gaps.iter().filter(|gap| gap.cause == cause) {
                writer.write_gap(gap)?;
            }
        }
        let bytes = writer.bytes();
        let lost_before = writer.lost().to_vec();
        match writer.finish(&reason.to_string()) {
            Ok(finished) => {
                self.report.bytes += finished.bytes;
                self.report.frames -= finished.lost.iter().map(|gap| gap.count).sum::<u64>();
                self.report.gaps.extend(finished.lost);
                self.unsealed.clear();
                Ok(())
            }
            Err(error) if error.is_disk_error() => {
                tracing::error!("{error}");
                self.report.bytes += bytes;
                self.report.frames -= lost_before.iter().map(|gap| gap.count).sum::<u64>();
                self.report.gaps.extend(lost_before);
                self.give_up();
                Ok(())
            }
            Err(error) => Err(error),
        }
    }

    /// The file could not be closed: what was not durable is lost, and only the report says so.
    fn give_up(&mut self) {
        self.fail(EndReason::DiskError);
        self.report.failure = Some(EndReason::DiskError);
        let mut lost = std::mem::take(&mut self.unsealed);
        // Those of a chunk that was refused may be counted already.
        let is_counted = |stream: u16, number: u64| {
            self.report.gaps.iter().any(|gap| {
                gap.stream == stream
                    && (gap.first_number..gap.first_number + gap.count).contains(&number)
            })
        };
        lost.retain(|(stream, number)| !is_counted(*stream, *number));
        lost.sort_unstable();
        self.report.frames -= lost.len() as u64;
        for (stream, number) in lost {
            match self.report.gaps.last_mut() {
                Some(gap)
                    if gap.stream == stream
                        && gap.cause == Some(GapCause::DiskError)
                        && gap.first_number + gap.count == number =>
                {
                    gap.count += 1;
                }
                _ => self
                    .report
                    .gaps
                    .push(one_frame(stream, number, GapCause::DiskError)),
            }
        }
    }
}

fn one_frame(stream: u16, number: u64, cause: GapCause) -> Gap {
    crate::drops::Drop {
        stream,
        first_number: number,
        count: 1,
        cause,
    }
    .gap()
}

/// `room.glint` goes on in `room-002.glint`.
pub fn part_path(first: &Path, number: u32) -> PathBuf {
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    first.with_file_name(format!("{stem}-{number:03}.glint"))
}
