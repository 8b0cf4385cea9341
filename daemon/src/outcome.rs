//! What a recording came to.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use sequence::{Gap, GapCause};
use serde::Serialize;

use crate::disk::DiskReport;
use crate::fuse::report::FuseSummary;
use crate::latency::Work;
use crate::mesh::MeshOutcome;
use crate::pair::PairReport;
use crate::status::{EndReason, StatusNow};

/// The summary of `glintd record`.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Why it ended.
    pub reason: String,
    /// The files.
    pub files: Vec<PathBuf>,
    /// Frames of both streams that the source had.
    pub frames_in: u64,
    /// Frames in the files.
    pub frames_recorded: u64,
    /// Frames that repeat their predecessor.
    pub repeats: u64,
    /// Frames that are missing.
    pub gaps: u64,
    /// Frames that went before the trigger came.
    pub not_asked_for: u64,
    /// Frames without a partner in the other stream.
    pub unpaired: u64,
    /// Frames that were on their way when the camera was unplugged; `gaps` counts them too.
    pub unplugged: u64,
    /// What is missing, in words.
    pub missing: Vec<String>,
    /// Seconds that passed.
    pub wall_s: f64,
    /// Time that the recorded frames span by the device, over the time that passed.
    pub realtime_factor: f64,
    /// Time to encode and store a pair, waits for other threads aside: median.
    pub record_ms_p50: f64,
    /// The same: 99 of 100 stay within.
    pub record_ms_p99: f64,
    /// The same in time of a processor: median.
    pub record_core_ms_p50: f64,
    /// The same in time of a processor: 99 of 100 stay within.
    pub record_core_ms_p99: f64,
    /// Time to make a chunk durable: median.
    pub seal_ms_p50: f64,
    /// Time to make a chunk durable: 99 of 100 stay within.
    pub seal_ms_p99: f64,
    /// Time between the frames of a pair: median.
    pub pair_skew_ms_p50: f64,
    /// The same: 99 of 100 stay within.
    pub pair_skew_ms_p99: f64,
    /// Bytes of the files.
    pub bytes: u64,
    /// Bytes of the recorded frames as the camera sent them, or for JPEG the largest frame for each.
    pub raw_bytes: u64,
    /// Most memory that the program had resident, MB.
    pub rss_peak_mb: f64,
    /// Processor time of all threads, seconds.
    pub cpu_s: f64,
    /// Processor time of all threads a depth frame, milliseconds.
    pub core_ms_a_frame: f64,
    /// Decoding of the replay and of JPEG, milliseconds of a processor a depth frame: a camera needs none of the first.
    pub decode_ms: f64,
    /// From the last byte of a pair until it stood in the file: median.
    pub to_recorded_ms_p50: f64,
    /// The same: 99 of 100 stay within.
    pub to_recorded_ms_p99: f64,
    /// The same: 999 of 1000 stay within.
    pub to_recorded_ms_p999: f64,
    /// Tracking and fusion.
    #[serde(flatten)]
    pub fusion: FuseSummary,
    /// The mesh, where one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshOutcome>,
}

/// What an outcome is made of.
pub(crate) struct Numbers<'a> {
    pub(crate) status: StatusNow,
    pub(crate) pairing: &'a PairReport,
    pub(crate) disk: &'a mut DiskReport,
    pub(crate) fusion: FuseSummary,
    /// Of the replay.
    pub(crate) decoding: Work,
    /// Why, unless the source ended.
    pub(crate) ended: Option<EndReason>,
    pub(crate) raw_pair_bytes: usize,
    /// Until the file was closed.
    pub(crate) wall: Duration,
}

impl Outcome {
    pub(crate) fn new(numbers: Numbers<'_>) -> Self {
        let Numbers {
            status,
            pairing,
            disk,
            fusion,
            decoding,
            ended,
            raw_pair_bytes,
            wall,
        } = numbers;
        let reason = disk.failure.or(ended).unwrap_or(EndReason::Complete);
        let realtime_factor = disk.span_s() / wall.as_secs_f64();
        let cpu_s = processor_seconds();
        let depth_frames = disk.depth_frames.max(1) as f64;
        let jpeg_nanos = fusion.jpeg_core_nanos;
        Self {
            reason: reason.to_string(),
            files: std::mem::take(&mut disk.files),
            frames_in: status.frames_in,
            frames_recorded: disk.frames,
            repeats: disk.repeats,
            gaps: disk.gaps.iter().map(|gap| gap.count).sum(),
            not_asked_for: disk.not_asked_for,
            unpaired: pairing.single_count,
            unplugged: disk
                .gaps
                .iter()
                .filter(|gap| gap.cause == Some(GapCause::Unplug))
                .map(|gap| gap.count)
                .sum(),
            missing: disk.gaps.iter().map(in_words).collect(),
            wall_s: wall.as_secs_f64(),
            realtime_factor,
            record_ms_p50: disk.pair_wall.quantile_ms(0.5),
            record_ms_p99: disk.pair_wall.quantile_ms(0.99),
            record_core_ms_p50: disk.pair_core.quantile_ms(0.5),
            record_core_ms_p99: disk.pair_core.quantile_ms(0.99),
            seal_ms_p50: disk.seals.quantile_ms(0.5),
            seal_ms_p99: disk.seals.quantile_ms(0.99),
            pair_skew_ms_p50: pairing.skews.quantile_ms(0.5),
            pair_skew_ms_p99: pairing.skews.quantile_ms(0.99),
            bytes: disk.bytes,
            raw_bytes: disk.frames * raw_pair_bytes as u64 / 2,
            rss_peak_mb: peak_resident_mb(),
            cpu_s,
            core_ms_a_frame: 1e3 * cpu_s / depth_frames,
            decode_ms: decoding.core_nanos.saturating_add(jpeg_nanos) as f64 / 1e6 / depth_frames,
            to_recorded_ms_p50: disk.to_recorded.quantile_ms(0.5),
            to_recorded_ms_p99: disk.to_recorded.quantile_ms(0.99),
            to_recorded_ms_p999: disk.to_recorded.quantile_ms(0.999),
            fusion,
            mesh: None,
        }
    }

    /// Whether every frame is in the files, but for those that were cut off by unplugging the camera: that is how a
    /// recording usually ends.
    pub fn is_whole(&self) -> bool {
        self.gaps == self.unplugged
    }
}

fn in_words(gap: &Gap) -> String {
    let cause = gap
        .cause
        .map_or_else(|| "unknown".to_owned(), |cause| cause.to_string());
    format!(
        "stream {}: {} frames from {} on ({cause})",
        gap.stream, gap.count, gap.first_number
    )
}

/// Peak of resident memory, MB (2^20 bytes); 0 where the system does not say.
pub fn peak_resident_mb() -> f64 {
    status_mb("VmHWM:")
}

/// Resident memory now, MB (2^20 bytes); 0 where the system does not say.
pub fn resident_mb() -> f64 {
    status_mb("VmRSS:")
}

fn status_mb(key: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(key));
    let kilobytes = line.and_then(|rest| rest.split_whitespace().next()?.parse::<f64>().ok());
    kilobytes.unwrap_or_default() / 1024.0
}

/// Processor time of all threads, seconds.
fn processor_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let files: Vec<String> = self
            .files
            .iter()
            .map(|file| file.display().to_string())
            .collect();
        writeln!(
            f,
            "{} frames of {} in {:.1} s, {:.1} MB ({:.1} % of raw), ended: {}",
            self.frames_recorded,
            self.frames_in,
            self.wall_s,
            self.bytes as f64 / 1e6,
            100.0 * self.bytes as f64 / self.raw_bytes.max(1) as f64,
            self.reason,
        )?;
        writeln!(f, "file: {}", files.join(", "))?;
        writeln!(
            f,
            "a pair takes {:.2} ms, p99 {:.2} ms (of a core {:.2} ms, p99 {:.2} ms); a chunk is durable after {:.1} ms, p99 {:.1} ms",
            self.record_ms_p50,
            self.record_ms_p99,
            self.record_core_ms_p50,
            self.record_core_ms_p99,
            self.seal_ms_p50,
            self.seal_ms_p99
        )?;
        writeln!(
            f,
            "pairs {:.2} ms apart, p99 {:.2} ms; last byte to file {:.2} ms, p99 {:.2} ms; {:.1} ms of a core a depth frame in all, {:.1} ms of them for decoding the replay and JPEG; {:.2} times real time",
            self.pair_skew_ms_p50,
            self.pair_skew_ms_p99,
            self.to_recorded_ms_p50,
            self.to_recorded_ms_p99,
            self.core_ms_a_frame,
            self.decode_ms,
            self.realtime_factor
        )?;
        if self.fusion.tracked + self.fusion.lost + self.fusion.skipped > 0 {
            write!(f, "{}", self.fusion)?;
        }
        if let Some(mesh) = &self.mesh {
            writeln!(f, "{mesh}")?;
        }
        if self.repeats > 0 {
            writeln!(f, "repeated frames: {}", self.repeats)?;
        }
        for missing in &self.missing {
            writeln!(f, "missing: {missing}")?;
        }
        Ok(())
    }
}
