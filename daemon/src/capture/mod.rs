//! One recording: what to record and how; [`sizes`] its memory, [`threads`] who does what.

mod sizes;
mod threads;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use sequence::codecs::DepthCodec;
use sequence::file_layer::WritePath;
use sequence::{COLOR_STREAM, Created, DEPTH_STREAM, Description};

use self::sizes::{Sizes, require_space};
use self::threads::Threads;
use crate::clock::HostClock;
use crate::disk::{LayerFactory, Rotation};
use crate::fuse::FuseOptions;
use crate::fuse::report::FuseSummary;
use crate::mesh;
use crate::outcome::{Numbers, Outcome};
use crate::replay::Replay;
use crate::service::Service;
use crate::source::FrameSource;
use crate::source_spec::SourceSpec;
use crate::status::{Status, StatusNow, StopFlag};

/// Longest time that a thread sleeps without looking whether there is work; it is woken when there is.
pub const LONGEST_PARK: Duration = Duration::from_millis(20);

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
    /// How to track and fuse; `None` only records.
    pub fuse: Option<FuseOptions>,
    /// Who is told that it runs.
    pub service: Service,
    /// The clocks.
    pub clock: HostClock,
    /// Makes files in place of the usual way: for tests of late and broken disks.
    pub make_layer: Option<LayerFactory>,
}

impl CaptureOptions {
    /// The usual way from `source` to `output`, without fusion.
    pub fn new(source: SourceSpec, output: PathBuf) -> Self {
        Self {
            source,
            output,
            depth_codec: DepthCodec::Fast,
            write_path: WritePath::default(),
            reserve_bytes: None,
            rotation: Rotation::default(),
            pre_trigger: None,
            trigger: Arc::default(),
            duration: None,
            fuse: None,
            service: Service::default(),
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
    match &options.source {
        SourceSpec::Replay(spec) => {
            let mut replay = Replay::open(spec)?;
            capture_from(&mut replay, options, stop, show)
        }
        SourceSpec::Camera(spec) => {
            let mut camera = crate::ps1080::open_camera(spec)?;
            capture_from(&mut camera, options, stop, show)
        }
        #[cfg(feature = "openni2")]
        SourceSpec::OpenNi2(spec) => {
            let mut device = crate::openni2::OpenNi2::open(spec)?;
            capture_from(&mut device, options, stop, show)
        }
    }
}

/// As [`capture_with`], from a source that is open already; that in the options only names it.
///
/// # Errors
/// As [`capture`].
pub fn capture_from(
    source: &mut dyn FrameSource,
    mut options: CaptureOptions,
    stop: &StopFlag,
    show: &mut dyn FnMut(&StatusNow),
) -> anyhow::Result<Outcome> {
    let description = description_of(source, options.clock);
    let sizes = Sizes::of(source, &description, &options);
    require_space(&options.output, sizes.floor_bytes)?;
    let status = Status::default();
    let mesh_path = options.fuse.as_mut().and_then(|fuse| fuse.mesh.take());
    let threads = Threads::new(source, &description, &sizes, &mut options, &status, stop)?;
    let progress = threads.progress();
    let begun = Instant::now();
    let mut done = threads.run(source, &options, begun, &status, stop, show)?;
    let fusion = match &progress {
        Some(progress) => FuseSummary::new(&done.fusion, progress),
        None => FuseSummary::default(),
    };
    let mut outcome = Outcome::new(Numbers {
        status: status.now(),
        pairing: &done.pairing,
        disk: &mut done.disk,
        fusion,
        decoding: done.source.decoding,
        ended: stop.reason(),
        raw_pair_bytes: sizes.raw_pair_bytes,
        wall: done.sealed_after,
    });
    let largest_map = done.fusion.largest_map();
    if let (Some(path), Some(live)) = (mesh_path, done.fusion.live) {
        let signal = stop.watch_for_another();
        outcome.mesh = Some(mesh::write(*live, largest_map, &path, &signal));
    }
    Ok(outcome)
}

fn description_of(source: &dyn FrameSource, clock: HostClock) -> Description {
    Description {
        writer: concat!("glintd ", env!("CARGO_PKG_VERSION")).to_owned(),
        created: Created {
            unix_nanos: (clock.wall)(),
            host_nanos: (clock.monotonic)(),
        },
        part: None,
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
        streams: source.streams().clone(),
    }
}
