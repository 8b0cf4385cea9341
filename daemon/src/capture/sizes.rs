//! How much memory a recording takes, and how much disk it leaves alone.

use std::path::Path;

use anyhow::Context as _;
use sequence::Description;

use super::CaptureOptions;
use crate::replay::ASSUMED_RATE_HZ;
use crate::source::FrameSource;

/// Frames of each stream that can be on their way at a time: most of a second.
pub(super) const POOL_FRAMES: usize = 24;
/// Encoded frames that the disk may be late by, seconds.
const BUFFER_SECONDS: f64 = 3.0;
/// Free space that is always left alone.
const LEAST_FLOOR_BYTES: u64 = 2 << 30;
/// Seconds of recording that are left alone.
const FLOOR_SECONDS: f64 = 60.0;

/// Sizes of a recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    /// Pixels of a depth frame.
    pub(super) pixel_count: usize,
    /// Bytes of the largest colour frame.
    pub(super) most_color_bytes: usize,
    /// Bytes of a pair as the camera sends it.
    pub(super) raw_pair_bytes: usize,
    /// The ring in front of the disk.
    pub(super) buffer_bytes: usize,
    /// What is kept before the trigger.
    pub(super) held_bytes: usize,
    /// Free space that is left alone.
    pub(super) floor_bytes: u64,
}

impl Sizes {
    /// Of the recording of `source` that `options` ask for; says them in the log.
    pub(super) fn of(
        source: &dyn FrameSource,
        description: &Description,
        options: &CaptureOptions,
    ) -> Self {
        let most_color_bytes = source.most_color_bytes();
        let camera = &description.streams.depth.intrinsics;
        let pixel_count = camera.width() as usize * camera.height() as usize;
        let raw_pair_bytes = 2 * pixel_count + most_color_bytes;
        let rate_hz = description.streams.depth_timing.rate_hz;
        let rate_hz = rate_hz.unwrap_or(ASSUMED_RATE_HZ);
        let raw_bytes_of = |span: f64| (span * rate_hz).ceil() as usize * (raw_pair_bytes + 1024);
        let held_bytes = options
            .pre_trigger
            .map_or(0, |span| raw_bytes_of(span.as_secs_f64()) / 2);
        let floor_bytes = options.reserve_bytes.unwrap_or_else(|| {
            let minute = FLOOR_SECONDS * rate_hz * raw_pair_bytes as f64;
            LEAST_FLOOR_BYTES.max(minute as u64)
        });
        let sizes = Self {
            pixel_count,
            most_color_bytes,
            raw_pair_bytes,
            buffer_bytes: raw_bytes_of(BUFFER_SECONDS),
            held_bytes,
            floor_bytes,
        };
        tracing::info!(
            "buffers: {:.0} MB for frames, {:.0} MB in front of the disk ({BUFFER_SECONDS} s uncompressed), {:.0} MB for the time before the trigger, at most {:.0} MB for the volume",
            (POOL_FRAMES * raw_pair_bytes) as f64 / 1e6,
            sizes.buffer_bytes as f64 / 1e6,
            held_bytes as f64 / 1e6,
            options
                .fuse
                .as_ref()
                .map_or(0.0, |fuse| fuse.live.volume.memory_limit_bytes as f64 / 1e6)
        );
        sizes
    }
}

/// Refuses to begin where the reserve is not free.
pub(super) fn require_space(output: &Path, floor_bytes: u64) -> anyhow::Result<()> {
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
