//! What a source of frames is: a camera, or a recording in its place.
//!
//! A source runs in a thread of its own. It takes free frames, fills in samples and times, sends them, and says what
//! it could not deliver: every number from the first to the last is sent or dropped.

use crossbeam::channel::Sender;
use crossbeam::sync::{Parker, Unparker};
use geometry::Pose;
use ringbuf::HeapProd;
use ringbuf::traits::Producer as _;
use sequence::contents::StoredPoses;
use sequence::{Event, Histogram, Streams};

use crate::clock::HostClock;
use crate::drops::DropLog;
use crate::frame::{ColorFrame, DepthFrame, FreeFrames};
use crate::latency::Work;
use crate::pair::Sent;
use crate::status::{Status, StopFlag};

/// A source of depth and colour frames.
pub trait FrameSource: Send {
    /// Formats, calibration, rates and counters of both streams, and the device: what a recording says of them.
    fn streams(&self) -> &Streams;

    /// Whether it can be paused: it then waits for free frames, and nobody skips or drops.
    fn waits(&self) -> bool;

    /// Whether it is a device that loses what is not taken in time: its threads run before other programs, where the
    /// system lets them.
    fn is_device(&self) -> bool {
        false
    }

    /// Bytes of the largest colour frame as the source sends it.
    fn most_color_bytes(&self) -> usize;

    /// How far apart frames of a pair may be, nanoseconds.
    fn widest_pair_nanos(&self) -> i64;

    /// Time from frame to frame as frames come, nanoseconds; `None` where the source waits for the recorder.
    fn period_nanos(&self) -> Option<i64>;

    /// Poses that come with the frames, and whether they are of the colour camera.
    fn source_poses(&self) -> Option<(StoredPoses, bool)> {
        None
    }

    /// World from depth camera of the first frame that has a pose; identity where none has.
    fn first_pose(&self) -> Pose {
        Pose::IDENTITY
    }

    /// Sends frames until there are no more or `stop` is set; a source that ends for a reason of its own sets it.
    ///
    /// # Errors
    /// Only before the first frame: what goes wrong later is a gap or the end.
    fn run(
        &mut self,
        ends: SourceEnds,
        clock: HostClock,
        status: &Status,
        stop: &StopFlag,
    ) -> anyhow::Result<SourceReport>;
}

/// Where a source gives frames.
pub struct SourceEnds {
    /// Free depth frames.
    pub depth_frames: FreeFrames<DepthFrame>,
    /// Free colour frames.
    pub color_frames: FreeFrames<ColorFrame>,
    /// To the pair thread.
    pub to: HeapProd<Sent>,
    /// What is dropped.
    pub drops: DropLog,
    /// What happens, for the recording.
    pub events: Sender<Event>,
    /// Wakes the pair thread.
    pub pair: Unparker,
    /// Where this thread waits for free frames.
    pub parker: Parker,
}

/// What a source did.
#[derive(Clone, Debug, Default)]
pub struct SourceReport {
    /// What decoding took.
    pub decoding: Work,
    /// What it counted, for the recording.
    pub histograms: Vec<Histogram>,
}

/// Room in the channel for events.
pub(crate) const CHANNEL_EVENTS: usize = 256;

impl SourceEnds {
    /// Passes a frame on, after what was dropped before it.
    pub(crate) fn send(&mut self, frame: Sent, stream: u16) {
        self.drops.flush(stream);
        // The ring has a place for every frame of both pools.
        let _ = self.to.try_push(frame);
        self.pair.unpark();
    }

    /// Writes something down. What does not fit the channel is said in the log instead.
    pub(crate) fn say(&self, event: Event) {
        if let Err(error) = self.events.try_send(event) {
            tracing::warn!("not in the recording: {}", error.into_inner().details);
        }
    }
}

/// A free frame; waits for one only when the source can.
pub(crate) fn take<F>(
    free: &mut FreeFrames<F>,
    parker: &Parker,
    waits: bool,
    stop: &StopFlag,
) -> Option<Box<F>> {
    loop {
        let frame = free.take();
        if frame.is_some() || !waits || stop.is_set() {
            return frame;
        }
        parker.park_timeout(crate::capture::LONGEST_PARK);
    }
}
