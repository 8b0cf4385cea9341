//! Fusion that is late, stands still, or is told to stop.

use std::path::Path;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::mpsc;

use crossbeam::sync::Parker;
use geometry::Pose;
use glintd::capture::capture;
use glintd::clock::HostClock;
use glintd::frame::{ColorFrame, DepthFrame, FreeFrames, Returns, pool};
use glintd::fuse::budget::Budget;
use glintd::fuse::frames::{self, FuseLink, FuseSource, FuseUnit, Next, RING_FRAMES};
use glintd::fuse::report::FuseReport;
use glintd::fuse::{FuseOptions, Fuser};
use glintd::message::{self, MessageKind};
use glintd::status::{EndReason, Status, StopFlag};
use sequence::follow::Follower;
use sequence::verify::verify;
use sequence::{FrameTimes, Recording};

use super::live::{options, walk};
use super::scene::{self, Shot};

/// A ring with the pools of both its sides.
struct Line {
    depth_frames: FreeFrames<DepthFrame>,
    color_frames: FreeFrames<ColorFrame>,
    link: FuseLink,
    source: FuseSource,
    parker: Parker,
    /// Back from the record thread.
    _returns: (Returns<DepthFrame>, Returns<ColorFrame>),
}

fn line(frame_count: usize, waits: bool, stop: &StopFlag) -> Line {
    let (depth_frames, [depth, fused_depth]) =
        pool((0..frame_count).map(|_| DepthFrame::default()));
    let (color_frames, [color, fused_color]) =
        pool((0..frame_count).map(|_| ColorFrame::default()));
    let parker = Parker::new();
    let bell = || parker.unparker().clone();
    let (link, source) = frames::ring(fused_depth, fused_color, bell(), bell(), waits, stop);
    Line {
        depth_frames,
        color_frames,
        link,
        source,
        parker,
        _returns: (depth, color),
    }
}

impl Line {
    fn unit(&mut self, number: u64, shot: Shot) -> FuseUnit {
        let (samples, bytes) = scene::images(shot);
        let times = FrameTimes {
            host_nanos: Some([0, 0]),
            ..scene::times(number)
        };
        let mut depth = self.depth_frames.take().unwrap();
        *depth = DepthFrame { times, samples };
        let mut color = self.color_frames.take().unwrap();
        *color = ColorFrame { times, bytes };
        FuseUnit {
            depth,
            color: Some(color),
        }
    }
}

#[test]
fn a_full_ring_gives_frames_back_and_only_the_newest_that_waits_is_fused() {
    let mut line = line(20, false, &StopFlag::default());
    let mut refused = Vec::new();
    for number in 0..12 {
        let unit = line.unit(number, Shot::Blank(number));
        line.link.announce();
        if let Err(unit) = line.link.hand(unit, &line.parker) {
            refused.push(unit.depth.times.number);
        }
    }
    // Newer ones than the ring has places: who records keeps them and goes on.
    let places = RING_FRAMES as u64;
    assert!(refused.into_iter().eq(places..12));
    let Next::Frame(unit) = line.source.take() else {
        panic!("a frame waits");
    };
    assert_eq!(unit.depth.times.number, places - 1);
    line.source.give_back(unit);
    let progress = line.source.progress();
    assert_eq!(progress.skipped(), 11);
    assert_eq!((progress.announced(), progress.done()), (12, 12));
    // What was skipped can be taken again.
    let free = std::iter::from_fn(|| line.depth_frames.take()).count();
    assert_eq!(free, 20 - 12 + RING_FRAMES);
}

#[test]
fn a_ring_whose_source_can_wait_skips_nothing() {
    let mut line = line(20, true, &StopFlag::default());
    for number in 0..RING_FRAMES as u64 {
        let unit = line.unit(number, Shot::Blank(number));
        assert!(line.link.hand(unit, &line.parker).is_ok());
    }
    for number in 0..RING_FRAMES as u64 {
        let Next::Frame(unit) = line.source.take() else {
            panic!("a frame waits");
        };
        assert_eq!(unit.depth.times.number, number);
        line.source.give_back(unit);
    }
    assert_eq!(line.source.progress().skipped(), 0);
}

#[test]
fn a_recording_that_is_told_to_end_skips_what_waits() {
    let stop = StopFlag::default();
    let mut line = line(20, true, &stop);
    for number in 0..5 {
        let unit = line.unit(number, Shot::Blank(number));
        assert!(line.link.hand(unit, &line.parker).is_ok());
    }
    stop.stop(EndReason::Stopped);
    drop(line.link);
    assert!(matches!(line.source.take(), Next::End));
    assert_eq!(line.source.progress().skipped(), 5);
}

/// Nanoseconds between two looks at the clock.
static STEP_NANOS: AtomicI64 = AtomicI64::new(0);

/// A clock of which each look takes [`STEP_NANOS`].
fn slow_clock() -> HostClock {
    static NANOS: AtomicI64 = AtomicI64::new(0);
    HostClock {
        monotonic: || NANOS.fetch_add(STEP_NANOS.load(Ordering::Relaxed), Ordering::Relaxed),
        wall: || 0,
    }
}

/// Tracks and fuses `shots`, which take `step_nanos` each, and says which events came. They came when the clock began,
/// so that all but the first are late, or (`came` is false) nobody knows when.
fn fuse_slowly(
    shots: &[Shot],
    came: bool,
    step_nanos: impl Fn(u64) -> i64 + Send + 'static,
) -> (FuseReport, Vec<String>) {
    let mut line = line(shots.len(), true, &StopFlag::default());
    let units: Vec<FuseUnit> = (0..)
        .zip(shots)
        .map(|(number, shot)| {
            let mut unit = line.unit(number, *shot);
            if !came {
                unit.depth.times.host_nanos = None;
            }
            unit
        })
        .collect();
    let (to, mut receiver) = message::ring(1 << 20);
    let mut number = 0;
    let mut fuse = FuseOptions {
        threads: 1,
        before_frame: Some(Box::new(move || {
            STEP_NANOS.store(step_nanos(number), Ordering::Relaxed);
            number += 1;
        })),
        ..FuseOptions::default()
    };
    fuse.live.volume.voxel_size = 0.01;
    let status = Status::default();
    let streams = scene::description().streams;
    let fuser = Fuser::new(
        line.source,
        to,
        &streams,
        fuse,
        Pose::IDENTITY,
        Some(33_333_333),
        slow_clock(),
        &status,
    )
    .unwrap();
    let report = std::thread::scope(|scope| {
        let fusing = scope.spawn(move || fuser.run());
        for unit in units {
            assert!(line.link.hand(unit, &line.parker).is_ok());
        }
        drop(line.link);
        fusing.join().unwrap()
    });
    let mut events = Vec::new();
    let mut payload = Vec::new();
    while let Some(head) = receiver.receive(&mut payload) {
        if head.kind() == MessageKind::Event {
            events.push(String::from_utf8(payload.clone()).unwrap());
        }
    }
    (report, events)
}

#[test]
fn slow_frames_reduce_the_effort_step_by_step_and_each_step_is_said() {
    // A hundred frames that take three periods each, then as many that take a tenth.
    let shots = walk(300);
    let step = |number| if number < 100 { 100_000_000 } else { 3_000_000 };
    let (report, events) = fuse_slowly(&shots, false, step);
    let frames = report.level_frames;
    assert!(frames.iter().all(|count| *count > 0), "{frames:?}");
    assert_eq!(frames.iter().sum::<u64>(), 300);
    assert_eq!(report.ok + report.weak + report.lost, 300);
    assert_eq!(report.ok, 300, "reduced effort still tracks");
    let levels: Vec<u64> = events
        .iter()
        .map(|text| serde_json::from_str::<serde_json::Value>(text).unwrap())
        .filter(|event| event["event"] == "fusion-effort")
        .map(|event| event["level"].as_u64().unwrap())
        .collect();
    assert_eq!(levels, [1, 2, 3, 2, 1, 0]);
    assert_eq!(Budget::LAST_LEVEL, 3);

    // Quick frames that begin late catch up.
    let (report, _) = fuse_slowly(&walk(20), true, |_| 1_000_000);
    assert_eq!(report.level_frames, [0, 0, 0, 20]);
    assert_eq!(report.ok, 20);
}

/// Whether the file has its end.
fn is_closed(path: &Path) -> bool {
    let Ok(mut follower) = Follower::open(path) else {
        return false;
    };
    while !follower.is_closed() {
        if !matches!(follower.poll(), Ok(added) if added > 0) {
            return false;
        }
    }
    true
}

#[test]
fn a_file_is_closed_while_a_frame_is_still_being_fused() {
    let folder = tempfile::tempdir().unwrap();
    let input = scene::write(folder.path(), &walk(40));
    let output = folder.path().join("out.glint");
    let mut options = options(&input, &output);
    let (entered, has_entered) = mpsc::channel();
    let (release, is_released) = mpsc::channel::<()>();
    let mut count = 0;
    if let Some(fuse) = &mut options.fuse {
        // The third frame takes until the test lets it go.
        fuse.before_frame = Some(Box::new(move || {
            count += 1;
            if count == 3 {
                entered.send(()).unwrap();
                is_released.recv().unwrap();
            }
        }));
    }
    let stop = StopFlag::default();
    let outcome = std::thread::scope(|scope| {
        let recording = scope.spawn(|| capture(options, &stop).unwrap());
        has_entered.recv().unwrap();
        stop.stop(EndReason::Stopped);
        while !is_closed(&output) {
            assert!(!recording.is_finished(), "fusion stands still");
            std::thread::yield_now();
        }
        release.send(()).unwrap();
        recording.join().unwrap()
    });
    assert_eq!((outcome.reason.as_str(), outcome.gaps), ("stopped", 0));
    let found = verify(&output, true).unwrap();
    assert!(found.is_whole(), "{found:?}");
    let recording = Recording::open(&output).unwrap();
    let set = recording
        .contents()
        .pose_sets
        .iter()
        .find(|set| set.head.name == "live");
    assert_eq!(set.map(|set| set.poses.len()), Some(2));
    // The frame that was late was tracked, and its pose came too late for the file.
    assert_eq!((outcome.fusion.tracked, outcome.fusion.late_poses), (3, 1));
}
