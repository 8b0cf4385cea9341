//! The record thread: frames are encoded and handed to the disk. It never waits for the disk, unless the source
//! can be paused. Colour is encoded in a thread of its own.

mod color;

use std::time::Duration;

use crossbeam::channel::Receiver;
use crossbeam::sync::{Parker, Unparker};
use ringbuf::HeapCons;
use ringbuf::traits::{Consumer as _, Observer as _};
use sequence::codecs::{CodeTable, DepthCodec, MAX_CODES};
use sequence::encode::DepthStreamEncoder;
use sequence::layout::{FrameHeader, GapHeader};
use sequence::{COLOR_STREAM, DEPTH_STREAM, GapCause, SequenceError, Streams};
use zerocopy::IntoBytes as _;

use self::color::{ColorLink, ColorTask, color_task};
use crate::capture::LONGEST_PARK;
use crate::drops::Drop;
use crate::frame::{ColorFrame, DepthFrame, Returns};
use crate::fuse::frames::{FuseLink, FuseUnit};
use crate::latency::Work;
use crate::message::{HEAD_BYTES, MessageKind, MessageSender};
use crate::pair::Unit;
use crate::priority::Priority;
use crate::status::Status;

/// Room for gaps and a table beside the frames of a unit, bytes.
const EXTRA_BYTES: usize = 64 * (HEAD_BYTES + size_of::<GapHeader>()) + 8 + 2 * MAX_CODES;

/// Where the record thread gives and takes.
pub struct RecordEnds {
    /// From the pair thread.
    pub from: HeapCons<Unit>,
    /// To the disk.
    pub to: MessageSender,
    /// What other threads dropped.
    pub drops: Receiver<Drop>,
    /// Free depth frames go back.
    pub depth_returns: Returns<DepthFrame>,
    /// Free colour frames go back.
    pub color_returns: Returns<ColorFrame>,
    /// Where this thread waits.
    pub parker: Parker,
    /// Wakes the disk.
    pub disk: Unparker,
    /// Wakes the source.
    pub source: Unparker,
    /// To the fuse thread, where there is one.
    pub fuse: Option<FuseLink>,
}

/// Encodes the frames of one recording.
pub struct Recorder<'status> {
    ends: RecordEnds,
    status: &'status Status,
    depth_encoder: DepthStreamEncoder,
    color: ColorLink,
    /// Until it runs.
    color_task: Option<ColorTask>,
    /// The source waits when the ring is full.
    waits: bool,
    last: [StreamState; 2],
    previous_depth: Vec<u16>,
    pixel_count: usize,
    /// Bytes of a raw colour frame; `None` for JPEG, whose frames differ.
    color_bytes: Option<usize>,
    most_unit_bytes: usize,
    is_warned: bool,
}

/// What was recorded last of a stream.
#[derive(Default)]
struct StreamState {
    nanos: Option<i64>,
    /// Drops that are not written yet.
    drops: Vec<Drop>,
}

impl<'status> Recorder<'status> {
    /// A recorder for `streams`; a colour frame has at most `most_color_bytes`. `waits` is for sources that can
    /// be paused.
    pub fn new(
        ends: RecordEnds,
        streams: &Streams,
        depth_codec: DepthCodec,
        most_color_bytes: usize,
        waits: bool,
        status: &'status Status,
    ) -> Result<Self, SequenceError> {
        let depth_encoder = DepthStreamEncoder::new(streams, depth_codec)?;
        let (color_task, color, most_color_payload) = color_task(streams, most_color_bytes)?;
        let camera = &streams.depth.intrinsics;
        let pixel_count = camera.width() as usize * camera.height() as usize;
        let heads = 2 * (HEAD_BYTES + size_of::<FrameHeader>());
        let state = || StreamState {
            nanos: None,
            drops: Vec::with_capacity(256),
        };
        Ok(Self {
            most_unit_bytes: heads
                + depth_encoder.max_payload_bytes()
                + most_color_payload
                + EXTRA_BYTES,
            ends,
            status,
            pixel_count,
            color_bytes: streams.color.encoding.lossless().map(|_| most_color_bytes),
            depth_encoder,
            color,
            color_task: Some(color_task),
            waits,
            last: [state(), state()],
            previous_depth: Vec::with_capacity(pixel_count),
            is_warned: false,
        })
    }

    /// Records until the pair thread is gone; returns the way to the disk for what comes last. With `is_urgent` it asks to
    /// run before other programs.
    pub fn run(mut self, is_urgent: bool) -> Result<MessageSender, SequenceError> {
        let ask = move || {
            if is_urgent {
                Priority::Record.ask();
            }
        };
        let task = self.color_task.take();
        std::thread::scope(|scope| {
            if let Some(task) = task {
                let color = std::thread::Builder::new().name("color".to_owned());
                color.spawn_scoped(scope, move || {
                    ask();
                    task.run();
                })?;
            }
            ask();
            self.record_all()
        })
    }

    /// Ends the colour thread by its own end.
    fn record_all(mut self) -> Result<MessageSender, SequenceError> {
        loop {
            match self.ends.from.try_pop() {
                Some(unit) => self.record(unit)?,
                None if self.ends.from.write_is_held() => {
                    self.ends.parker.park_timeout(LONGEST_PARK);
                }
                // What was pushed between the two looks.
                None if !self.ends.from.is_empty() => {}
                None => break,
            }
        }
        self.take_drops();
        self.wait_for_room();
        for stream in [DEPTH_STREAM, COLOR_STREAM] {
            self.send_gaps(stream, u64::MAX, None);
        }
        self.ends.disk.unpark();
        Ok(self.ends.to)
    }

    fn record(&mut self, unit: Unit) -> Result<(), SequenceError> {
        self.take_drops();
        let has_room = if self.waits {
            self.wait_for_room();
            true
        } else {
            self.ends.to.vacant_bytes() >= self.most_unit_bytes
        };
        let (depth, color) = match unit {
            Unit::Pair(depth, color) => (Some(depth), Some(color)),
            Unit::Depth(depth) => (Some(depth), None),
            Unit::Color(color) => (None, Some(color)),
        };
        let color = color.and_then(|frame| self.accept_color(frame, has_room));
        let is_color = color.is_some();
        if let Some(frame) = color {
            self.color.begin(frame);
        }
        let mut kept_depth = depth.and_then(|frame| self.accept_depth(frame, has_room));
        if let Some(frame) = &mut kept_depth {
            self.record_depth(frame)?;
        }
        let kept_color = if is_color {
            Some(self.record_color()?)
        } else {
            None
        };
        self.ends.disk.unpark();
        self.pass_on(kept_depth, kept_color);
        self.ends.source.unpark();
        self.warn_of_fill();
        Ok(())
    }

    /// Frames that are in the file go to the fuse thread where it can have them, else back to the source. A frame that
    /// repeats its predecessor shows nothing new (hard-cases B13), and colour alone is not tracked.
    fn pass_on(&mut self, depth: Option<Box<DepthFrame>>, color: Option<Box<ColorFrame>>) {
        let Some(link) = &mut self.ends.fuse else {
            return self.give_back(depth, color);
        };
        let Some(depth) = depth else {
            return self.give_back(None, color);
        };
        if depth.times.is_repeat {
            link.count_repeat();
            return self.give_back(Some(depth), color);
        }
        let (stale, color) = match color {
            Some(color) if color.times.is_repeat => (Some(color), None),
            color => (None, color),
        };
        let refused = link.hand(FuseUnit { depth, color }, &self.ends.parker);
        self.give_back(None, stale);
        if let Err(unit) = refused {
            self.give_back(Some(unit.depth), unit.color);
        }
    }

    fn give_back(&mut self, depth: Option<Box<DepthFrame>>, color: Option<Box<ColorFrame>>) {
        if let Some(depth) = depth {
            self.ends.depth_returns.give(depth);
        }
        if let Some(color) = color {
            self.ends.color_returns.give(color);
        }
    }

    /// The frame, if it is to be recorded; else it is dropped.
    fn accept_depth(&mut self, frame: Box<DepthFrame>, has_room: bool) -> Option<Box<DepthFrame>> {
        let is_whole = frame.samples.len() == self.pixel_count;
        if self.accepts(DEPTH_STREAM, frame.times.number, is_whole, has_room) {
            return Some(frame);
        }
        self.ends.depth_returns.give(frame);
        None
    }

    /// The frame, if it is to be recorded; else it is dropped.
    fn accept_color(&mut self, frame: Box<ColorFrame>, has_room: bool) -> Option<Box<ColorFrame>> {
        let is_whole = match self.color_bytes {
            Some(bytes) => frame.bytes.len() == bytes,
            None => !frame.bytes.is_empty(),
        };
        if self.accepts(COLOR_STREAM, frame.times.number, is_whole, has_room) {
            return Some(frame);
        }
        self.ends.color_returns.give(frame);
        None
    }

    /// Whether a frame is to be recorded; one that is not is written down with its cause.
    fn accepts(&mut self, stream: u16, number: u64, is_whole: bool, has_room: bool) -> bool {
        let cause = match (is_whole, has_room) {
            (true, true) => return true,
            (true, false) => GapCause::RingFull,
            (false, _) => GapCause::Corrupt,
        };
        self.drop_frame(stream, number, cause);
        false
    }

    fn record_depth(&mut self, frame: &mut DepthFrame) -> Result<(), SequenceError> {
        let begun = Work::begin();
        frame.times.is_repeat =
            self.last[0].nanos.is_some() && self.previous_depth == frame.samples;
        let times = frame.times;
        self.send_gaps(DEPTH_STREAM, times.number, Some(times.device_nanos));
        if !times.is_repeat {
            self.previous_depth.clone_from(&frame.samples);
            if let Some(link) = &self.ends.fuse {
                link.announce();
            }
        }
        let (payload, table) = self.depth_encoder.encode(&frame.samples)?;
        if let Some(table) = table {
            let bytes = CodeTable::to_bytes(table);
            self.ends.to.send(
                MessageKind::Table,
                DEPTH_STREAM,
                Work::default(),
                [&bytes, &[]],
            );
        }
        let header = times.header();
        let work = begun.end();
        let parts = [header.as_bytes(), payload];
        self.ends
            .to
            .send(MessageKind::Frame, DEPTH_STREAM, work, parts);
        self.last[0].nanos = Some(times.device_nanos);
        Ok(())
    }

    /// Waits for the frame that was given to the colour thread.
    fn record_color(&mut self) -> Result<Box<ColorFrame>, SequenceError> {
        let encoded = self.color.finish()?;
        let times = encoded.frame.times;
        self.send_gaps(COLOR_STREAM, times.number, Some(times.device_nanos));
        let header = times.header();
        let parts = [header.as_bytes(), &encoded.payload];
        self.ends
            .to
            .send(MessageKind::Frame, COLOR_STREAM, encoded.work, parts);
        self.last[1].nanos = Some(times.device_nanos);
        self.color.recycle(encoded.payload);
        Ok(encoded.frame)
    }

    fn drop_frame(&mut self, stream: u16, number: u64, cause: GapCause) {
        self.keep_drop(Drop {
            stream,
            first_number: number,
            count: 1,
            cause,
        });
    }

    fn take_drops(&mut self) {
        while let Ok(drop) = self.ends.drops.try_recv() {
            self.keep_drop(drop);
        }
    }

    fn keep_drop(&mut self, drop: Drop) {
        self.status.add_missing(drop.count);
        let drops = &mut self.last[index_of(drop.stream)].drops;
        match drops.last_mut() {
            Some(last)
                if last.cause == drop.cause
                    && last.first_number + last.count == drop.first_number =>
            {
                last.count += drop.count;
            }
            _ => drops.push(drop),
        }
    }

    /// Sends the drops of a stream before frame `number`, which was taken at `nanos`.
    fn send_gaps(&mut self, stream: u16, number: u64, nanos: Option<i64>) {
        let state = &mut self.last[index_of(stream)];
        let to = &mut self.ends.to;
        state.drops.retain(|drop| {
            if drop.first_number >= number {
                return true;
            }
            let mut gap = drop.gap();
            gap.from_nanos = state.nanos;
            gap.to_nanos = nanos;
            // One that does not fit stays for the next time.
            !to.send(
                MessageKind::Gap,
                stream,
                Work::default(),
                [gap.header().as_bytes(), &[]],
            )
        });
    }

    fn wait_for_room(&self) {
        while self.ends.to.vacant_bytes() < self.most_unit_bytes && self.ends.to.is_connected() {
            self.ends.disk.unpark();
            std::thread::sleep(Duration::from_micros(500));
        }
    }

    /// Says once that the disk is late, when four fifths of the ring are full.
    fn warn_of_fill(&mut self) {
        let fill = self.ends.to.fill_fraction();
        self.status.set_ring_fill(fill);
        if fill > 0.8 && !self.is_warned && !self.waits {
            tracing::warn!(
                "the disk is late: {:.0} % of the buffer is full",
                100.0 * fill
            );
        }
        self.is_warned = fill > if self.is_warned { 0.5 } else { 0.8 };
    }
}

fn index_of(stream: u16) -> usize {
    usize::from(stream == COLOR_STREAM)
}
