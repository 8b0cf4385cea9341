//! The threads of a recording: what lies between them, how they begin and end.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::bounded;
use crossbeam::sync::{Parker, Unparker};
use ringbuf::traits::Split as _;
use ringbuf::{HeapCons, HeapProd, HeapRb};
use sequence::chunk_writer::DiskLimits;
use sequence::file_layer;
use sequence::{Description, Histogram};

use super::CaptureOptions;
use super::sizes::{POOL_FRAMES, Sizes};
use crate::disk::{Disk, DiskEnds, DiskReport, FuseMessages, PreTrigger};
use crate::drops::{self, DropLog};
use crate::frame::{ColorFrame, DepthFrame, FreeFrames, Returns, pool};
use crate::fuse::Fuser;
use crate::fuse::frames::{self, FuseLink, Progress};
use crate::fuse::report::FuseReport;
use crate::latency::Work;
use crate::message::{self, MessageKind, MessageSender};
use crate::pair::{PairReport, Sent, Unit, pair_frames};
use crate::priority::{self, Priority};
use crate::record::{RecordEnds, Recorder};
use crate::source::{self, FrameSource, SourceEnds, SourceReport};
use crate::status::{EndReason, Status, StatusNow, StopFlag};

/// Room for poses and words between the fuse thread and the disk: half a minute of poses.
const FUSE_MESSAGE_BYTES: usize = 256 << 10;

/// Everything that the threads need, before they begin.
pub(super) struct Threads<'capture> {
    source: SourceEnds,
    pair: PairEnds,
    recorder: Recorder<'capture>,
    fuser: Option<Fuser<'capture>>,
    disk: Disk<'capture>,
    disk_parker: Parker,
    progress: Option<Arc<Progress>>,
}

/// What the pair thread needs.
struct PairEnds {
    from: HeapCons<Sent>,
    to: HeapProd<Unit>,
    parker: Parker,
    record: Unparker,
}

/// The fuse thread and what others need of it.
struct Fusion<'capture> {
    fuser: Fuser<'capture>,
    link: FuseLink,
    messages: FuseMessages,
}

/// What the threads did.
pub(super) struct Done {
    pub(super) source: SourceReport,
    pub(super) pairing: PairReport,
    pub(super) disk: DiskReport,
    pub(super) fusion: FuseReport,
    /// From the beginning until the file was closed.
    pub(super) sealed_after: Duration,
}

impl<'capture> Threads<'capture> {
    /// Makes the rings, the pools and the file. What `options` hold of closures is taken.
    pub(super) fn new(
        source: &dyn FrameSource,
        description: &Description,
        sizes: &Sizes,
        options: &mut CaptureOptions,
        status: &'capture Status,
        stop: &'capture StopFlag,
    ) -> anyhow::Result<Self> {
        let (depth_frames, [depth_returns, fused_depth]) = depth_pool(sizes);
        let (color_frames, [color_returns, fused_color]) = color_pool(sizes);
        let parkers: [Parker; 4] = std::array::from_fn(|_| Parker::new());
        let [source_parker, pair_parker, record_parker, disk_parker] = parkers;
        let source_bell = source_parker.unparker().clone();
        let record_bell = record_parker.unparker().clone();
        let (to_pair, from_source) = HeapRb::new(2 * POOL_FRAMES).split();
        let (to_record, from_pair) = HeapRb::new(2 * POOL_FRAMES).split();
        let (drop_sender, drop_receiver) = drops::channel();
        let fusion = Fusion::new(
            (fused_depth, fused_color),
            [source_bell.clone(), record_bell.clone()],
            (source, description),
            options,
            status,
            stop,
        )?;
        let (fuser, link, messages) = match fusion {
            Some(fusion) => (Some(fusion.fuser), Some(fusion.link), Some(fusion.messages)),
            None => (None, None, None),
        };
        let ring_bytes = (sizes.buffer_bytes + sizes.held_bytes).max(1 << 20);
        let (to_disk, records) = message::ring(ring_bytes);
        let progress = link.as_ref().map(|link| Arc::clone(link.progress()));
        let recorder = Recorder::new(
            RecordEnds {
                from: from_pair,
                to: to_disk,
                drops: drop_receiver,
                depth_returns,
                color_returns,
                disk: disk_parker.unparker().clone(),
                source: source_bell,
                fuse: link,
                parker: record_parker,
            },
            &description.streams,
            options.depth_codec,
            sizes.most_color_bytes,
            source.waits(),
            status,
        )?;
        let (event_sender, event_receiver) = bounded(source::CHANNEL_EVENTS);
        if source.is_device() {
            // Before the file is mapped, whose pages are to go to the disk.
            priority::stay_in_memory();
        }
        let disk_ends = DiskEnds {
            records,
            fuse: messages,
            source_events: event_receiver,
            source_poses: source.source_poses(),
        };
        Ok(Self {
            source: SourceEnds {
                depth_frames,
                color_frames,
                to: to_pair,
                drops: DropLog::new(drop_sender),
                events: event_sender,
                pair: pair_parker.unparker().clone(),
                parker: source_parker,
            },
            pair: PairEnds {
                from: from_source,
                to: to_record,
                parker: pair_parker,
                record: record_bell,
            },
            recorder,
            fuser,
            disk: disk(disk_ends, description, sizes, options, status, stop)?,
            disk_parker,
            progress,
        })
    }

    /// What becomes of frames behind the recorder.
    pub(super) fn progress(&self) -> Option<Arc<Progress>> {
        self.progress.clone()
    }

    /// Runs until the source ends or `stop` is set; the file is closed before the fuse thread is waited for.
    pub(super) fn run(
        self,
        frame_source: &mut dyn FrameSource,
        options: &CaptureOptions,
        begun: Instant,
        status: &'capture Status,
        stop: &'capture StopFlag,
        show: &mut dyn FnMut(&StatusNow),
    ) -> anyhow::Result<Done> {
        let Self {
            source,
            pair,
            recorder,
            fuser,
            disk,
            disk_parker,
            ..
        } = self;
        let (clock, duration) = (options.clock, options.duration);
        let widest_nanos = frame_source.widest_pair_nanos();
        let is_device = frame_source.is_device();
        let ask = move |priority: Priority| {
            if is_device {
                priority.ask();
            }
        };
        let disk_bell = disk_parker.unparker().clone();
        std::thread::scope(|scope| {
            let spawn = |name: &str| std::thread::Builder::new().name(name.to_owned());
            let fuse = match fuser {
                Some(fuser) => Some(spawn("fuse").spawn_scoped(scope, move || fuser.run())?),
                None => None,
            };
            let source = spawn("source").spawn_scoped(scope, move || {
                ask(Priority::Source);
                frame_source.run(source, clock, status, stop)
            })?;
            let pair = spawn("pair").spawn_scoped(scope, move || {
                ask(Priority::Pair);
                pair_frames(pair.from, pair.to, widest_nanos, &pair.parker, &pair.record)
            })?;
            let record = spawn("record").spawn_scoped(scope, move || recorder.run(is_device))?;
            let disk = spawn("disk").spawn_scoped(scope, move || {
                ask(Priority::Disk);
                disk.run(&disk_parker, || {
                    stop.reason().unwrap_or(EndReason::Complete)
                })
            })?;

            watch(&duration, begun, status, stop, show, || {
                record.is_finished()
            });
            let source = joined(source.join())?;
            let pairing = joined(pair.join())?;
            let sender = joined(record.join())??;
            let (source, failed) = match source {
                Ok(report) => (report, None),
                Err(error) => (SourceReport::default(), Some(error)),
            };
            say_last_words(sender, &pairing, &source.histograms)?;
            disk_bell.unpark();
            // In lock-step the last frames are fused now, before the file is closed.
            watch(&duration, begun, status, stop, show, || disk.is_finished());
            let disk = joined(disk.join())??;
            if let Some(error) = failed {
                return Err(error);
            }
            let sealed_after = begun.elapsed();
            let fusion = match fuse {
                Some(fuse) => joined(fuse.join())?,
                None => FuseReport::default(),
            };
            Ok(Done {
                source,
                pairing,
                disk,
                fusion,
                sealed_after,
            })
        })
    }
}

impl<'capture> Fusion<'capture> {
    /// `None` where `options` only record.
    fn new(
        returns: (Returns<DepthFrame>, Returns<ColorFrame>),
        [source, record]: [Unparker; 2],
        (source_of_frames, description): (&dyn FrameSource, &Description),
        options: &mut CaptureOptions,
        status: &'capture Status,
        stop: &StopFlag,
    ) -> anyhow::Result<Option<Self>> {
        let Some(fuse) = options.fuse.take() else {
            return Ok(None);
        };
        let waits = source_of_frames.waits();
        let (link, frames) = frames::ring(returns.0, returns.1, source, record, waits, stop);
        let (to_disk, receiver) = message::ring(FUSE_MESSAGE_BYTES);
        let fuser = Fuser::new(
            frames,
            to_disk,
            &description.streams,
            fuse,
            source_of_frames.first_pose(),
            source_of_frames.period_nanos(),
            options.clock,
            status,
        )?;
        let messages = FuseMessages {
            receiver,
            progress: Arc::clone(link.progress()),
            waits,
        };
        Ok(Some(Self {
            fuser,
            link,
            messages,
        }))
    }
}

/// Free depth frames, with the ways back of record and fuse.
fn depth_pool(sizes: &Sizes) -> (FreeFrames<DepthFrame>, [Returns<DepthFrame>; 2]) {
    pool((0..POOL_FRAMES).map(|_| DepthFrame {
        samples: touched(sizes.pixel_count),
        ..DepthFrame::default()
    }))
}

/// Free colour frames, with the ways back of record and fuse.
fn color_pool(sizes: &Sizes) -> (FreeFrames<ColorFrame>, [Returns<ColorFrame>; 2]) {
    pool((0..POOL_FRAMES).map(|_| {
        let mut bytes = touched(sizes.most_color_bytes);
        bytes.clear();
        ColorFrame {
            bytes,
            ..ColorFrame::default()
        }
    }))
}

/// `count` zeros whose pages are in memory: zeros from the allocator come with the first touch, which would be made by the
/// thread that can wait least.
fn touched<T: Default + Copy>(count: usize) -> Vec<T> {
    std::iter::repeat_with(|| std::hint::black_box(T::default()))
        .take(count)
        .collect()
}

/// Makes the file.
fn disk<'capture>(
    ends: DiskEnds,
    description: &Description,
    sizes: &Sizes,
    options: &mut CaptureOptions,
    status: &'capture Status,
    stop: &'capture StopFlag,
) -> anyhow::Result<Disk<'capture>> {
    let write_path = options.write_path;
    let make_layer = options
        .make_layer
        .take()
        .unwrap_or_else(|| Box::new(move |path: &Path| file_layer::create(path, write_path)));
    let limits = DiskLimits {
        floor_bytes: sizes.floor_bytes,
        ..DiskLimits::default()
    };
    let pre_trigger = options.pre_trigger.map(|span| PreTrigger {
        span,
        bytes: sizes.held_bytes,
        trigger: Arc::clone(&options.trigger),
    });
    Ok(Disk::new(
        ends,
        make_layer,
        &options.output,
        description,
        limits,
        options.rotation,
        pre_trigger,
        options.clock,
        options.service,
        status,
        stop,
    )?)
}

/// Waits for a thread, showing what happens.
fn watch(
    duration: &Option<Duration>,
    begun: Instant,
    status: &Status,
    stop: &StopFlag,
    show: &mut dyn FnMut(&StatusNow),
    is_finished: impl Fn() -> bool,
) {
    let mut shown = begun;
    while !is_finished() {
        std::thread::sleep(Duration::from_millis(10));
        if duration.is_some_and(|duration| begun.elapsed() >= duration) {
            stop.stop(EndReason::Duration);
        }
        if shown.elapsed() >= Duration::from_millis(500) {
            shown = Instant::now();
            show(&status.now());
        }
    }
}

/// What is only known at the end, and that it is the end.
fn say_last_words(
    mut sender: MessageSender,
    pairing: &PairReport,
    of_source: &[Histogram],
) -> anyhow::Result<()> {
    let mut messages = Vec::new();
    let skews = pairing.skews.histogram("pair-skew");
    for histogram in std::iter::once(&skews).chain(of_source) {
        messages.push((MessageKind::Histogram, serde_json::to_vec(histogram)?));
    }
    messages.push((MessageKind::End, Vec::new()));
    for (kind, payload) in messages {
        while !sender.send(kind, 0, Work::default(), [&payload, &[]]) {
            anyhow::ensure!(sender.is_connected(), "the disk thread is gone");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    Ok(())
}

/// The result of a thread; a panic in it is a bug and goes on.
fn joined<T>(result: std::thread::Result<T>) -> anyhow::Result<T> {
    result.map_err(|panic| std::panic::resume_unwind(panic))
}
