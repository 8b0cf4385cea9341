//! What the fuse thread sends to the disk, and how long the disk waits for it: never past the end of a recording that
//! was told to end.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sequence::contents::StoredPoses;
use sequence::layout::PoseBytes;
use sequence::{COLOR_STREAM, DEPTH_STREAM, Event, FramePose, SequenceError};
use zerocopy::FromBytes as _;

use super::Disk;
use super::poses::PoseQueue;
use crate::fuse::frames::Progress;
use crate::message::{MessageKind, MessageReceiver};

/// Name of the set that fusion makes.
pub const LIVE_SET: &str = "live";
/// Name of the set that a replay brings.
pub const SOURCE_SET: &str = "source";

/// Longest wait for poses before a file is closed that must be closed now.
const LONGEST_WAIT: Duration = Duration::from_millis(50);
/// Time between two looks while waiting.
const LOOK_INTERVAL: Duration = Duration::from_micros(500);

/// The end of the fuse thread's messages that the disk has.
pub struct FuseMessages {
    /// Poses, events, histograms.
    pub receiver: MessageReceiver,
    /// What became of the frames.
    pub progress: Arc<Progress>,
    /// The source can be paused, so there is time to wait for poses.
    pub waits: bool,
}

/// Poses that come with the frames of a replay.
pub(super) struct SourcePoses {
    poses: Vec<FramePose>,
    queue: PoseQueue,
}

impl SourcePoses {
    /// `stored` is of the camera whose frames are stored as `stream`.
    pub(super) fn new(stored: StoredPoses, is_color: bool) -> Self {
        let stream = if is_color { COLOR_STREAM } else { DEPTH_STREAM };
        Self {
            queue: PoseQueue::new(SOURCE_SET, stored.head.producer, stream),
            poses: stored.poses,
        }
    }

    fn note_frame(&mut self, stream: u16, number: u64) {
        self.queue.note_frame(stream, number);
        if stream == self.queue.stream()
            && let Ok(index) = self.poses.binary_search_by_key(&number, |pose| pose.number)
        {
            self.queue.push(&[self.poses[index].bytes()]);
        }
    }
}

/// Until when [`Disk::await_fused`] waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Until {
    /// All frames that are in the file now are tracked or skipped.
    InStep,
    /// The fuse thread is done with everything.
    Over,
}

impl Disk<'_> {
    /// Takes what the fuse thread sent. Before the trigger, events are of no recording.
    pub(super) fn take_fused(&mut self) -> Result<(), SequenceError> {
        let Some(mut fuse) = self.fuse.take() else {
            return Ok(());
        };
        let mut payload = std::mem::take(&mut self.fuse_payload);
        let mut result = Ok(());
        while result.is_ok()
            && let Some(head) = fuse.receiver.receive(&mut payload)
        {
            if head.kind() == MessageKind::Poses || self.pre_trigger.is_none() {
                result = self.take(head.kind(), head.stream.get(), &payload);
            }
        }
        self.fuse = Some(fuse);
        self.fuse_payload = payload;
        result
    }

    /// Waits for poses: as long as it takes where nobody is in a hurry, else 50 ms.
    pub(super) fn await_fused(&mut self, until: Until) -> Result<(), SequenceError> {
        let begun = Instant::now();
        let target = self.fuse.as_ref().map(|fuse| fuse.progress.announced());
        loop {
            let Some(fuse) = &self.fuse else {
                return Ok(());
            };
            let is_over = !fuse.receiver.is_connected();
            let is_in_step = Some(fuse.progress.done()) >= target && until == Until::InStep;
            let is_patient = (fuse.waits || until == Until::Over) && !self.stop.is_set();
            // Looked for first, taken then: nothing that was sent before is missed.
            self.take_fused()?;
            if is_over || is_in_step || (!is_patient && begun.elapsed() >= LONGEST_WAIT) {
                return Ok(());
            }
            std::thread::sleep(LOOK_INTERVAL);
        }
    }

    pub(super) fn take_poses(&mut self, payload: &[u8]) {
        if let Ok(entries) = <[PoseBytes]>::ref_from_bytes(payload) {
            self.live.push(entries);
        }
    }

    pub(super) fn take_event(&mut self, stream: u16, payload: &[u8]) -> Result<(), SequenceError> {
        let event = Event {
            stream,
            host_nanos: (self.clock.monotonic)(),
            details: serde_json::from_slice(payload)?,
        };
        match &mut self.writer {
            // A full disk has no room for words.
            Some(writer) if self.report.failure.is_none() => writer.write_event(&event),
            _ => Ok(()),
        }
    }

    /// Writes what happened in the source. Before the trigger nothing waits here: the channel keeps it.
    pub(super) fn take_source_events(&mut self) -> Result<(), SequenceError> {
        while let Ok(event) = self.source_events.try_recv() {
            if let Some(writer) = self.writer.as_mut()
                && self.report.failure.is_none()
            {
                writer.write_event(&event)?;
            }
        }
        Ok(())
    }

    /// A frame is in the file: its poses may follow.
    pub(super) fn note_frame(&mut self, stream: u16, number: u64) {
        self.live.note_frame(stream, number);
        if let Some(source) = &mut self.source {
            source.note_frame(stream, number);
        }
    }

    /// Writes the poses of the frames that are in the file.
    pub(super) fn flush_poses(&mut self) -> Result<(), SequenceError> {
        if self.report.failure.is_some() {
            return Ok(());
        }
        if let Some(writer) = &mut self.writer {
            self.live.flush(writer)?;
            if let Some(source) = &mut self.source {
                source.queue.flush(writer)?;
            }
        }
        Ok(())
    }

    /// Sets begin anew in each file.
    pub(super) fn begin_pose_sets(&mut self) {
        self.live.begin_file();
        if let Some(source) = &mut self.source {
            source.queue.begin_file();
        }
    }
}
