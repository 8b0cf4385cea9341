//! The fuse thread: tracks and fuses what was recorded, as fast as it can, and never in the recorder's way.
//!
//! ```text
//! record ─ring (8)─► decode + prepare ► track ► fuse ─► frames go back to the source
//!                                         └─ poses, events, histograms ─ring of bytes─► disk
//! ```
//! [`frames`] the way of the frames · [`prepare`] metres and radiance · [`budget`] what gives way · [`workers`] the
//! pool · [`report`] what is counted.

pub mod budget;
pub mod frames;
pub mod prepare;
pub mod report;
pub mod workers;

use std::path::PathBuf;

use anyhow::Context as _;
use fusion::VolumeConfig;
use fusion::live::{Effort, LiveConfig, LiveFusion, LiveRig, Tracked};
use fusion::tracking::TrackState;
use geometry::Pose;
use sequence::layout::PoseBytes;
use sequence::{ColorEncoding, DEPTH_STREAM, FramePose, PoseState, Streams};
use serde_json::json;
use zerocopy::IntoBytes as _;

use self::budget::Budget;
use self::frames::{FuseSource, FuseUnit, Next};
use self::prepare::{DepthPreparer, PhotographPreparer};
use self::report::FuseReport;
use self::workers::{StageClock, Workers};
use crate::clock::HostClock;
use crate::latency::Work;
use crate::message::{MessageKind, MessageSender};
use crate::status::Status;

/// How to track and fuse.
pub struct FuseOptions {
    /// Voxel edge, truncation, memory and the rest.
    pub live: LiveConfig,
    /// Workers.
    pub threads: usize,
    /// Every so many-th frame is fused, all are tracked; at least 1.
    pub stride: u64,
    /// Where the mesh goes.
    pub mesh: Option<PathBuf>,
    /// Called before each frame: for tests of slow fusion.
    pub before_frame: Option<Box<dyn FnMut() + Send>>,
}

/// Voxel edge where nothing is said, metres.
pub const VOXEL_SIZE: f32 = 0.005;
/// What the first view of a room takes at 5 mm, 80 MB with colour.
const RESERVED_BLOCKS: usize = 10_240;
/// Workers where nothing is said.
pub const THREADS: usize = 2;

impl Default for FuseOptions {
    fn default() -> Self {
        let live = LiveConfig::default();
        let volume = VolumeConfig {
            voxel_size: VOXEL_SIZE,
            ..live.volume
        };
        Self {
            live: LiveConfig {
                volume,
                reserved_blocks: RESERVED_BLOCKS,
                ..live
            },
            threads: THREADS,
            stride: 1,
            mesh: None,
            before_frame: None,
        }
    }
}

/// Share of the memory limit that is warned of.
const MEMORY_WARNING: f64 = 0.8;
/// Poses that wait for room on their way to the disk: several seconds.
const MOST_POSES: usize = 1024;

/// Tracks and fuses one recording.
pub struct Fuser<'status> {
    source: FuseSource,
    to: MessageSender,
    clock: HostClock,
    status: &'status Status,
    workers: Workers,
    state: State,
}

/// All that the workers touch.
struct State {
    depth: DepthPreparer,
    /// `None` where there is infrared in place of colour: its dots move with the camera and are no texture.
    photographs: Option<PhotographPreparer>,
    live: Box<LiveFusion>,
    options: FuseOptions,
    /// `None` where no frame is ever skipped: nothing gives way either.
    budget: Option<Budget>,
    outbox: Vec<PoseBytes>,
    tracked_count: u64,
    /// 1 when memory runs out, 2 when it has.
    memory_level: usize,
    report: FuseReport,
}

impl<'status> Fuser<'status> {
    /// Begins at `start`, world from depth camera. `period_nanos` is the time from frame to frame where fusion must
    /// keep up with it. Poses, events and histograms go to `to`.
    ///
    /// # Errors
    /// Streams that cannot be prepared, settings that a volume refuses, and a system without threads.
    pub fn new(
        source: FuseSource,
        to: MessageSender,
        streams: &Streams,
        options: FuseOptions,
        start: Pose,
        period_nanos: Option<i64>,
        clock: HostClock,
        status: &'status Status,
    ) -> anyhow::Result<Self> {
        let depth = DepthPreparer::new(streams)?;
        let has_colors = streams.color.encoding != ColorEncoding::Infrared10;
        let photographs = if has_colors {
            Some(PhotographPreparer::new(streams)?)
        } else {
            None
        };
        let rig = LiveRig {
            depth_camera: *depth.pinhole(),
            color_camera: has_colors.then_some(streams.color.intrinsics),
            color_from_depth: streams.color_from_depth,
        };
        let workers = Workers::new(options.threads).context("no threads for fusion")?;
        let live = workers.run(|_| LiveFusion::new(options.live.clone(), rig, start))?;
        Ok(Self {
            source,
            to,
            clock,
            status,
            workers,
            state: State {
                depth,
                photographs,
                live: Box::new(live),
                options,
                budget: period_nanos.map(Budget::new),
                outbox: Vec::with_capacity(MOST_POSES),
                tracked_count: 0,
                memory_level: 0,
                report: FuseReport::default(),
            },
        })
    }

    /// Works until the record thread is gone.
    pub fn run(self) -> FuseReport {
        let Self {
            mut source,
            mut to,
            clock,
            status,
            workers,
            mut state,
        } = self;
        workers.run(|stages| {
            loop {
                match source.take() {
                    Next::Frame(unit) if state.report.failure.is_none() => {
                        state.take(&unit, stages, clock, &mut to);
                        source.give_back(unit);
                        let level = state.budget.as_ref().map_or(0, Budget::level);
                        let FuseReport { ok, weak, lost, .. } = state.report;
                        let skipped = source.progress().skipped();
                        status.set_fusion(ok + weak, lost, skipped, level as u64);
                    }
                    Next::Frame(unit) => source.skip(unit),
                    Next::Nothing => state.send_poses(&mut to),
                    Next::End => break,
                }
            }
            state.finish(&mut to);
        });
        state.report.live = Some(state.live);
        state.report
    }
}

impl State {
    /// Tracks and fuses a frame.
    fn take(
        &mut self,
        unit: &FuseUnit,
        stages: &StageClock,
        clock: HostClock,
        to: &mut MessageSender,
    ) {
        if let Some(before_frame) = &mut self.options.before_frame {
            before_frame();
        }
        let begun_nanos = (clock.monotonic)();
        let begun = stages.begin();
        let arrival_nanos = arrival_nanos(unit);
        let age_nanos = arrival_nanos.map_or(0, |arrival| begun_nanos.saturating_sub(arrival));
        let budget = self.budget.as_ref();
        let (old_level, level) = budget.map_or((0, 0), |budget| {
            (budget.level(), budget.level_for(age_nanos))
        });
        match self.fuse(unit, stages, Budget::effort(level)) {
            Ok(tracked) => {
                self.report.count(&tracked);
                self.report.level_frames[level] += 1;
                self.outbox
                    .push(pose_of(unit.depth.times.number, &tracked).bytes());
            }
            Err(error) => self.fail(&format!("{error:#}"), to),
        }
        self.report.frame.add(stages.end(&begun));
        let now_nanos = (clock.monotonic)();
        if let Some(arrival) = arrival_nanos {
            let nanos = u64::try_from(now_nanos.saturating_sub(arrival));
            self.report.to_fused.add_nanos(nanos.unwrap_or_default());
        }
        let spent_nanos = now_nanos.saturating_sub(begun_nanos);
        let change = self
            .budget
            .as_mut()
            .and_then(|budget| budget.count(age_nanos, spent_nanos));
        if let Some(new_level) = change {
            self.say_effort(old_level, new_level, to);
        }
        self.watch_memory(to);
        self.send_poses(to);
    }

    /// The stages of a frame. A photograph that cannot be used leaves depth alone.
    fn fuse(
        &mut self,
        unit: &FuseUnit,
        stages: &StageClock,
        effort: Effort,
    ) -> anyhow::Result<Tracked> {
        let photograph = unit.color.as_deref().map(|frame| frame.bytes.as_slice());

        // A JPEG keeps one worker busy; the other prepares depth meanwhile.
        let begun = stages.begin();
        let Self {
            depth,
            photographs,
            live,
            ..
        } = self;
        let ((decoded, decoding), prepared) = rayon::join(
            || {
                let begun = Work::begin();
                let both = photograph.zip(photographs.as_mut());
                let decoded = both.map(|(bytes, photographs)| (bytes, photographs.decode(bytes)));
                (decoded, begun.end())
            },
            || {
                live.load_depth(depth.prepare(&unit.depth.samples)?);
                Ok::<_, anyhow::Error>(())
            },
        );
        prepared?;
        let photograph = match decoded {
            Some((bytes, Ok(()))) => Some(bytes),
            Some((_, Err(error))) => {
                tracing::debug!("photograph of frame {}: {error:#}", unit.depth.times.number);
                self.report.without_photograph += 1;
                None
            }
            None => None,
        };
        let has_color = match (photograph, &mut self.photographs, self.live.grey_mut()) {
            (Some(bytes), Some(photographs), Some(grey)) => {
                photographs.develop(bytes, grey)?;
                true
            }
            _ => false,
        };
        self.live.load_photograph(has_color);
        let both = stages.end(&begun);
        self.report.decode.add(decoding);
        self.report.prepare.add(Work {
            core_nanos: both.core_nanos.saturating_sub(decoding.core_nanos),
            ..both
        });

        let begun = stages.begin();
        let tracked = self.live.track(unit.depth.times.device_nanos, effort);
        self.report.track.add(stages.end(&begun));

        let begun = stages.begin();
        let is_due = self
            .tracked_count
            .is_multiple_of(self.options.stride.max(1));
        if tracked.state != TrackState::Lost {
            self.tracked_count += 1;
            if is_due {
                let colored = self.photographs.as_ref();
                let colored = colored.filter(|_| has_color && !effort.skip_color);
                let color = colored.map(PhotographPreparer::pixels);
                let stats = self.live.fuse(self.depth.image(), color)?;
                self.report.fused += u64::from(stats.is_some());
                self.report.limit_reached |= stats.is_some_and(|stats| stats.limit_reached);
            }
        }
        self.report.integrate.add(stages.end(&begun));
        Ok(tracked)
    }

    fn say_effort(&self, old: usize, new: usize, to: &mut MessageSender) {
        if new > old {
            tracing::warn!("fusion is late: {} gives way", Budget::name_of(new));
        } else {
            tracing::info!("fusion is in time: {} is back", Budget::name_of(old));
        }
        send_event(
            to,
            &json!({
                "event": "fusion-effort",
                "level": new,
                "from_level": old,
                "given_way": (1..=new).map(Budget::name_of).collect::<Vec<_>>(),
            }),
        );
    }

    /// Says once when memory runs out, and once when it has.
    fn watch_memory(&mut self, to: &mut MessageSender) {
        let limit = self.options.live.volume.memory_limit_bytes;
        let bytes = self.live.memory_bytes();
        self.report.memory_bytes = self.report.memory_bytes.max(bytes);
        let level = if self.report.limit_reached {
            2
        } else {
            usize::from(bytes as f64 > MEMORY_WARNING * limit as f64)
        };
        if level <= self.memory_level {
            return;
        }
        self.memory_level = level;
        let megabytes = limit as f64 / f64::from(1 << 20);
        let message = if level == 1 {
            format!(
                "the volume holds {:.0} % of its {megabytes:.0} MB",
                100.0 * MEMORY_WARNING
            )
        } else {
            format!("the volume is full at {megabytes:.0} MB: new surface is left out")
        };
        tracing::warn!("{message}; --fuse-memory-mb sets the limit");
        send_event(to, &json!({"event": "warning", "message": message}));
    }

    fn fail(&mut self, error: &str, to: &mut MessageSender) {
        tracing::error!("fusion ends, the recording goes on: {error}");
        let message = format!("fusion ended: {error}");
        send_event(to, &json!({"event": "warning", "message": message}));
        self.report.failure = Some(error.to_owned());
    }

    /// Sends what poses wait. They wait on while the disk has no room.
    fn send_poses(&mut self, to: &mut MessageSender) {
        if self.outbox.is_empty() {
            return;
        }
        let parts = [self.outbox.as_bytes(), &[]];
        if to.is_connected() && to.send(MessageKind::Poses, DEPTH_STREAM, Work::default(), parts) {
            self.outbox.clear();
        } else if !to.is_connected() || self.outbox.len() >= MOST_POSES {
            self.report.late_poses += self.outbox.len() as u64;
            self.outbox.clear();
        }
    }

    /// The last poses and the histograms.
    fn finish(&mut self, to: &mut MessageSender) {
        self.send_poses(to);
        self.report.late_poses += self.outbox.len() as u64;
        let stages = self.report.stages();
        let histograms = stages
            .iter()
            .map(|(name, stage)| stage.core.histogram(name))
            .chain([self.report.to_fused.histogram("last-packet-to-fused")]);
        for histogram in histograms {
            if let Ok(bytes) = serde_json::to_vec(&histogram) {
                to.send(
                    MessageKind::Histogram,
                    DEPTH_STREAM,
                    Work::default(),
                    [&bytes, &[]],
                );
            }
        }
    }
}

fn send_event(to: &mut MessageSender, details: &serde_json::Value) {
    let text = details.to_string();
    to.send(
        MessageKind::Event,
        0,
        Work::default(),
        [text.as_bytes(), &[]],
    );
}

/// When the last byte of the frame came, host time.
fn arrival_nanos(unit: &FuseUnit) -> Option<i64> {
    let [_, depth] = unit.depth.times.host_nanos?;
    let color = unit.color.as_ref().and_then(|frame| frame.times.host_nanos);
    Some(color.map_or(depth, |[_, color]| depth.max(color)))
}

fn pose_of(number: u64, tracked: &Tracked) -> FramePose {
    FramePose {
        number,
        map: tracked.map,
        state: match tracked.state {
            TrackState::Ok => PoseState::Ok,
            TrackState::Weak(axes) => PoseState::Weak(axes),
            TrackState::Lost => PoseState::Lost,
        },
        world_from_camera: tracked.world_from_camera,
        covariance: tracked.covariance,
    }
}
