//! One recording: the threads, what they share, how they end.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use crossbeam::sync::Parker;
use ringbuf::HeapRb;
use ringbuf::traits::Split as _;
use sequence::chunk_writer::DiskLimits;
use sequence::codecs::DepthCodec;
use sequence::file_layer::{self, WritePath};
use sequence::{COLOR_STREAM, Created, DEPTH_STREAM, Description};

use crate::clock::HostClock;
use crate::disk::{Disk, DiskReport, LayerFactory, PreTrigger, Rotation};
use crate::drops::{self, DropLog};
use crate::frame::{ColorFrame, DepthFrame, pool};
use crate::latency::Work;
use crate::message::{self, MessageKind, MessageSender};
use crate::outcome::Outcome;
use crate::pair::{PairReport, Sent, Unit, pair_frames};
use crate::record::{RecordEnds, Recorder};
use crate::replay::{Replay, SourceEnds};
use crate::source_spec::SourceSpec;
use crate::status::{EndReason, Status, StatusNow, StopFlag};

/// Longest time that a thread sleeps without looking whether there is work; it is woken when there is.
pub const LONGEST_PARK: Duration = Duration::from_millis(20);

/// Frames of each stream that can be on their way at a time: most of a second.
const POOL_FRAMES: usize = 24;
/// Encoded frames that the disk may be late by, seconds.
const BUFFER_SECONDS: f64 = 3.0;
/// Frames a second where the source promises no rate.
const ASSUMED_RATE_HZ: f64 = 30.0;
/// Free space that is always left alone.
const LEAST_FLOOR_BYTES: u64 = 2 << 30;
/// Seconds of recording that are left alone.
const FLOOR_SECONDS: f64 = 60.0;

/// What to record, and how.
pub struct CaptureOptions {
    /// Where frames come from.
    pub source: SourceSpec,
    /// The file to make.
    pub output: PathBuf,
    /// How much work goes into depth.
    pub depth_codec: DepthCodec,
    /// How bytes reach the disk.
    pub write_path: WritePath,
    /// Free space that is left alone, bytes; the larger of 2 GiB and a minute of recording when absent.
    pub reserve_bytes: Option<u64>,
    /// When to go on in another file.
    pub rotation: Rotation,
    /// Keeps this much in memory and begins with it when SIGUSR1 comes.
    pub pre_trigger: Option<Duration>,
    /// What SIGUSR1 sets.
    pub trigger: Arc<AtomicBool>,
    /// Ends by itself after this time.
    pub duration: Option<Duration>,
    /// The clocks.
    pub clock: HostClock,
    /// Makes files in place of the usual way: for tests of late and broken disks.
    pub make_layer: Option<LayerFactory>,
}

impl CaptureOptions {
    /// The usual way from `source` to `output`.
    pub fn new(source: SourceSpec, output: PathBuf) -> Self {
        Self {
            source,
            output,
            depth_codec: DepthCodec::Fast,
            write_path: WritePath::Auto,
            reserve_bytes: None,
            rotation: Rotation::default(),
            pre_trigger: None,
            trigger: Arc::default(),
            duration: None,
            clock: HostClock::default(),
            make_layer: None,
        }
    }
}

/// Records until the source ends or `stop` is set.
///
/// # Errors
/// When the source cannot be opened, the file cannot be made, or too little space is free. What goes wrong later
/// ends the recording and stands in the outcome.
pub fn capture(options: CaptureOptions, stop: &StopFlag) -> anyhow::Result<Outcome> {
    capture_with(options, stop, &mut |_| {})
}

/// As [`capture`]; `show` is called about twice a second.
pub fn capture_with(
    options: CaptureOptions,
    stop: &StopFlag,
    show: &mut dyn FnMut(&StatusNow),
) -> anyhow::Result<Outcome> {
    let SourceSpec::Replay(spec) = &options.source;
    let replay = Replay::open(spec)?;
    let description = description_of(&replay, options.clock);
    let most_color_bytes = replay.most_color_bytes()?;
    let camera = &description.streams.depth.intrinsics;
    let pixel_count = camera.width() as usize * camera.height() as usize;
    let raw_pair_bytes = 2 * pixel_count + most_color_bytes;
    let rate_hz = description
        .streams
        .depth_timing
        .rate_hz
        .unwrap_or(ASSUMED_RATE_HZ);
    let raw_bytes_of = |span: f64| (span * rate_hz).ceil() as usize * (raw_pair_bytes + 1024);
    let buffer_bytes = raw_bytes_of(BUFFER_SECONDS);
    let pre_trigger = options.pre_trigger.map(|span| PreTrigger {
        span,
        bytes: raw_bytes_of(span.as_secs_f64()) / 2,
        trigger: Arc::clone(&options.trigger),
    });
    let held_bytes = pre_trigger.as_ref().map_or(0, |held| held.bytes);
    let floor_bytes = options.reserve_bytes.unwrap_or_else(|| {
        let minute = FLOOR_SECONDS * rate_hz * raw_pair_bytes as f64;
        LEAST_FLOOR_BYTES.max(minute as u64)
    });
    require_space(&options.output, floor_bytes)?;
    tracing::info!(
        "buffers: {:.0} MB for frames, {:.0} MB in front of the disk ({BUFFER_SECONDS} s uncompressed), {:.0} MB for the time before the trigger",
        (POOL_FRAMES * raw_pair_bytes) as f64 / 1e6,
        buffer_bytes as f64 / 1e6,
        held_bytes as f64 / 1e6
    );

    let status = Status::default();
    let (sender, receiver) = message::ring((buffer_bytes + held_bytes).max(1 << 20));
    let write_path = options.write_path;
    let make_layer = options
        .make_layer
        .unwrap_or_else(|| Box::new(move |path: &Path| file_layer::create(path, write_path)));
    let limits = DiskLimits {
        floor_bytes,
        ..DiskLimits::default()
    };
    let disk = Disk::new(
        receiver,
        make_layer,
        &options.output,
        &description,
        limits,
        options.rotation,
        pre_trigger,
        options.clock,
        &status,
        stop,
    )?;

    let begun = Instant::now();
    let (pairing, disk) =
        std::thread::scope(|scope| -> anyhow::Result<(PairReport, DiskReport)> {
            let (depth_frames, depth_returns) = pool((0..POOL_FRAMES).map(|_| DepthFrame {
                samples: vec![0; pixel_count],
                ..DepthFrame::default()
            }));
            let (color_frames, color_returns) = pool((0..POOL_FRAMES).map(|_| ColorFrame {
                bytes: Vec::with_capacity(most_color_bytes),
                ..ColorFrame::default()
            }));
            let (to_pair, from_source) = HeapRb::<Sent>::new(2 * POOL_FRAMES).split();
            let (to_record, from_pair) = HeapRb::<Unit>::new(2 * POOL_FRAMES).split();
            let (drop_sender, drop_receiver) = drops::channel();
            let parkers: [Parker; 4] = std::array::from_fn(|_| Parker::new());
            let [source_parker, pair_parker, record_parker, disk_parker] = parkers;
            let record_bell = record_parker.unparker().clone();
            let disk_bell = disk_parker.unparker().clone();
            let source_ends = SourceEnds {
                depth_frames,
                color_frames,
                to: to_pair,
                drops: DropLog::new(drop_sender),
                pair: pair_parker.unparker().clone(),
                parker: source_parker,
            };
            let recorder = Recorder::new(
                RecordEnds {
                    from: from_pair,
                    to: sender,
                    drops: drop_receiver,
                    depth_returns,
                    color_returns,
                    disk: disk_bell.clone(),
                    source: source_ends.parker.unparker().clone(),
                    parker: record_parker,
                },
                &description.streams,
                options.depth_codec,
                most_color_bytes,
                replay.waits(),
                &status,
            )?;
            let widest_nanos = replay.widest_pair_nanos();
            let spawn = |name: &str| std::thread::Builder::new().name(name.to_owned());
            let source = spawn("source").spawn_scoped(scope, || {
                replay.run(source_ends, options.clock, &status, stop)
            })?;
            let pair = spawn("pair").spawn_scoped(scope, move || {
                pair_frames(
                    from_source,
                    to_record,
                    widest_nanos,
                    &pair_parker,
                    &record_bell,
                )
            })?;
            let record = spawn("record").spawn_scoped(scope, move || recorder.run())?;
            let disk = spawn("disk").spawn_scoped(scope, move || {
                disk.run(&disk_parker, || {
                    stop.reason().unwrap_or(EndReason::Complete)
                })
            })?;

            watch(&options.duration, begun, &status, stop, show, || {
                record.is_finished()
            });
            joined(source.join())??;
            let pairing = joined(pair.join())?;
            let sender = joined(record.join())??;
            say_last_words(sender, &pairing)?;
            disk_bell.unpark();
            Ok((pairing, joined(disk.join())??))
        })?;
    let reason = disk
        .failure
        .or(stop.reason())
        .unwrap_or(EndReason::Complete);
    Ok(Outcome::new(
        &status.now(),
        pairing,
        disk,
        reason,
        raw_pair_bytes,
        begun.elapsed(),
    ))
}

/// Waits for the record thread, showing what happens.
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
fn say_last_words(mut sender: MessageSender, pairing: &PairReport) -> anyhow::Result<()> {
    let skews = serde_json::to_vec(&pairing.skews.histogram("pair-skew"))?;
    let messages: [(MessageKind, &[u8]); 2] =
        [(MessageKind::Histogram, &skews), (MessageKind::End, &[])];
    for (kind, payload) in messages {
        while !sender.send(kind, 0, Work::default(), [payload, &[]]) {
            anyhow::ensure!(sender.is_connected(), "the disk thread is gone");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    Ok(())
}

fn description_of(replay: &Replay, clock: HostClock) -> Description {
    Description {
        writer: concat!("glintd ", env!("CARGO_PKG_VERSION")).to_owned(),
        created: Created {
            unix_nanos: (clock.wall)(),
            host_nanos: (clock.monotonic)(),
        },
        part: None,
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
        ..replay.recording().description().clone()
    }
}

/// Refuses to begin where the reserve is not free.
fn require_space(output: &Path, floor_bytes: u64) -> anyhow::Result<()> {
    let folder = match output.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let stat = rustix::fs::statvfs(folder)
        .with_context(|| format!("{}: the folder cannot be used", folder.display()))?;
    let free = stat.f_bavail.saturating_mul(stat.f_frsize);
    anyhow::ensure!(
        free > floor_bytes,
        "{}: {:.2} GB are free and {:.2} GB are kept in reserve; make room, or give --reserve-mb",
        folder.display(),
        free as f64 / 1e9,
        floor_bytes as f64 / 1e9
    );
    Ok(())
}

/// The result of a thread; a panic in it is a bug and goes on.
fn joined<T>(result: std::thread::Result<T>) -> anyhow::Result<T> {
    result.map_err(|panic| std::panic::resume_unwind(panic))
}
