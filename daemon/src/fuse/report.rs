//! What tracking and fusion came to.

use std::fmt;

use fusion::live::{LiveFusion, Tracked};
use fusion::tracking::TrackState;
use serde::Serialize;

use super::budget::Budget;
use super::frames::Progress;
use crate::latency::{Latencies, Work};

/// Time of a stage, frame by frame.
#[derive(Clone, Debug, Default)]
pub struct Stage {
    /// Time that passed.
    pub wall: Latencies,
    /// Time of all processors.
    pub core: Latencies,
    /// Time of all processors, nanoseconds.
    pub core_nanos: u64,
}

impl Stage {
    pub(super) fn add(&mut self, work: Work) {
        self.wall.add_nanos(work.wall_nanos);
        self.core.add_nanos(work.core_nanos);
        self.core_nanos = self.core_nanos.saturating_add(work.core_nanos);
    }
}

/// What the fuse thread did.
#[derive(Default)]
pub struct FuseReport {
    /// Frames whose pose is known on all axes.
    pub ok: u64,
    /// Frames whose pose is known on some axes.
    pub weak: u64,
    /// Frames whose pose is not known.
    pub lost: u64,
    /// Frames whose pose is known, of each map.
    pub map_frames: Vec<u64>,
    /// Frames that were fused.
    pub fused: u64,
    /// Frames whose photograph could not be used.
    pub without_photograph: u64,
    /// Times that the way back was found.
    pub relocalised: u64,
    /// Frames at each level of effort.
    pub level_frames: [u64; Budget::LAST_LEVEL + 1],
    /// Poses that came after the file was closed.
    pub late_poses: u64,
    /// Decoding of the photographs.
    pub decode: Stage,
    /// Metres, radiance, pyramids.
    pub prepare: Stage,
    /// Prediction and alignment.
    pub track: Stage,
    /// Into the volume.
    pub integrate: Stage,
    /// A frame from begin to end.
    pub frame: Stage,
    /// From the last byte of a frame until it was fused.
    pub to_fused: Latencies,
    /// Most bytes of the volume.
    pub memory_bytes: usize,
    /// The volume refused blocks for want of memory.
    pub limit_reached: bool,
    /// Why fusion ended before the recording.
    pub failure: Option<String>,
    /// The surface.
    pub live: Option<Box<LiveFusion>>,
}

impl FuseReport {
    pub(super) fn count(&mut self, tracked: &Tracked) {
        match tracked.state {
            TrackState::Ok => self.ok += 1,
            TrackState::Weak(_) => self.weak += 1,
            TrackState::Lost => self.lost += 1,
        }
        self.relocalised += u64::from(tracked.is_relocalised);
        if tracked.state != TrackState::Lost {
            let map = tracked.map as usize;
            if self.map_frames.len() <= map {
                self.map_frames.resize(map + 1, 0);
            }
            self.map_frames[map] += 1;
        }
    }

    /// The map with the most frames whose pose is known, of equals the first: as readers of the poses choose.
    pub fn largest_map(&self) -> u32 {
        let counts = self.map_frames.iter().enumerate().rev();
        counts
            .max_by_key(|(_, count)| **count)
            .map_or(0, |(map, _)| map as u32)
    }

    /// Stages with the names of their histograms.
    pub(super) fn stages(&self) -> [(&'static str, &Stage); 4] {
        [
            ("fuse-decode", &self.decode),
            ("fuse-prepare", &self.prepare),
            ("fuse-track", &self.track),
            ("fuse-integrate", &self.integrate),
        ]
    }
}

/// Keys of tracking and fusion in the summary of `glintd record`; all zero when it only records.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FuseSummary {
    /// Frames whose pose is known, on some axes at least.
    pub tracked: u64,
    /// Frames among them whose pose is known on some axes only.
    pub weak: u64,
    /// Frames whose pose is not known.
    pub lost: u64,
    /// Depth frames that are in the volume.
    pub fused: u64,
    /// Depth frames that were recorded and not tracked, for want of time.
    pub skipped: u64,
    /// Depth frames that repeat their predecessor, and so are not fused.
    pub depth_repeats: u64,
    /// Frames whose photograph could not be used.
    pub without_photograph: u64,
    /// Times that the way back was found.
    pub relocalised: u64,
    /// Frames with full effort, with a coarse prediction, without the finest pass too, without colour too.
    pub effort_frames: [u64; Budget::LAST_LEVEL + 1],
    /// Poses that came after the file was closed.
    pub late_poses: u64,
    /// Time that passed for a frame: median.
    pub fuse_ms_p50: f64,
    /// The same: 99 of 100 stay within.
    pub fuse_ms_p99: f64,
    /// Time of all processors for a frame, decoding of the photograph included: median.
    pub fuse_core_ms_p50: f64,
    /// Decoding of the photograph, time of all processors: median.
    pub jpeg_core_ms_p50: f64,
    /// Metres, radiance and pyramids, time of all processors: median.
    pub prepare_core_ms_p50: f64,
    /// Prediction and alignment, time of all processors: median.
    pub track_core_ms_p50: f64,
    /// Into the volume, time of all processors: median.
    pub integrate_core_ms_p50: f64,
    /// From the last byte of a frame until it was fused: median.
    pub to_fused_ms_p50: f64,
    /// The same: 99 of 100 stay within.
    pub to_fused_ms_p99: f64,
    /// Most memory of the volume, MB (2^20 bytes).
    pub fuse_memory_mb: f64,
    /// The volume refused blocks for want of memory.
    pub fuse_memory_limit_reached: bool,
    /// Decoding of all photographs, nanoseconds of all processors.
    #[serde(skip)]
    pub(crate) jpeg_core_nanos: u64,
    /// Why fusion ended before the recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fuse_failure: Option<String>,
}

impl FuseSummary {
    pub(crate) fn new(report: &FuseReport, progress: &Progress) -> Self {
        Self {
            tracked: report.ok + report.weak,
            weak: report.weak,
            lost: report.lost,
            fused: report.fused,
            skipped: progress.skipped(),
            depth_repeats: progress.repeats(),
            without_photograph: report.without_photograph,
            relocalised: report.relocalised,
            effort_frames: report.level_frames,
            late_poses: report.late_poses,
            fuse_ms_p50: report.frame.wall.quantile_ms(0.5),
            fuse_ms_p99: report.frame.wall.quantile_ms(0.99),
            fuse_core_ms_p50: report.frame.core.quantile_ms(0.5),
            jpeg_core_ms_p50: report.decode.core.quantile_ms(0.5),
            prepare_core_ms_p50: report.prepare.core.quantile_ms(0.5),
            track_core_ms_p50: report.track.core.quantile_ms(0.5),
            integrate_core_ms_p50: report.integrate.core.quantile_ms(0.5),
            to_fused_ms_p50: report.to_fused.quantile_ms(0.5),
            to_fused_ms_p99: report.to_fused.quantile_ms(0.99),
            fuse_memory_mb: report.memory_bytes as f64 / f64::from(1 << 20),
            fuse_memory_limit_reached: report.limit_reached,
            jpeg_core_nanos: report.decode.core_nanos,
            fuse_failure: report.failure.clone(),
        }
    }
}

impl fmt::Display for FuseSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seen = self.tracked + self.lost;
        writeln!(
            f,
            "tracked: {} of {} frames ({:.1} %; {} weak, {} lost), fused {}, skipped {}, repeats left out {}",
            self.tracked,
            seen,
            100.0 * self.tracked as f64 / seen.max(1) as f64,
            self.weak,
            self.lost,
            self.fused,
            self.skipped,
            self.depth_repeats
        )?;
        writeln!(
            f,
            "a frame is fused in {:.1} ms, p99 {:.1} ms; of a core {:.1} ms: JPEG {:.1}, prepare {:.1}, track {:.1}, integrate {:.1}; from its last byte {:.1} ms, p99 {:.1} ms",
            self.fuse_ms_p50,
            self.fuse_ms_p99,
            self.fuse_core_ms_p50,
            self.jpeg_core_ms_p50,
            self.prepare_core_ms_p50,
            self.track_core_ms_p50,
            self.integrate_core_ms_p50,
            self.to_fused_ms_p50,
            self.to_fused_ms_p99
        )?;
        if self.effort_frames[1..].iter().any(|count| *count > 0) {
            let [full, coarse, short, grey] = self.effort_frames;
            writeln!(
                f,
                "effort: {full} frames in full, {coarse} with a coarse prediction, {short} without the finest pass too, {grey} without colour too"
            )?;
        }
        if self.fuse_memory_limit_reached {
            writeln!(
                f,
                "the volume reached its memory limit at {:.0} MB: new surface was left out; give --fuse-memory-mb",
                self.fuse_memory_mb
            )?;
        }
        if self.without_photograph > 0 {
            writeln!(
                f,
                "photographs that could not be used: {}",
                self.without_photograph
            )?;
        }
        if self.late_poses > 0 {
            writeln!(
                f,
                "poses that came too late for the file: {}",
                self.late_poses
            )?;
        }
        if let Some(failure) = &self.fuse_failure {
            writeln!(f, "fusion ended early: {failure}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_map_is_the_first_of_equals() {
        let with = |map_frames: &[u64]| FuseReport {
            map_frames: map_frames.to_vec(),
            ..FuseReport::default()
        };
        assert_eq!(with(&[]).largest_map(), 0);
        assert_eq!(with(&[3, 7, 7, 2]).largest_map(), 1);
    }
}
