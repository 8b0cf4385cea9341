//! What the disk thread counts of time.

use sequence::{FrameTimes, SequenceError};

use super::Disk;
use crate::latency::Work;
use crate::message::frame_parts;

impl Disk<'_> {
    /// From the last byte of a pair until it stood in the file, for others to read.
    pub(super) fn count_latency(&mut self, stream: u16, payload: &[u8]) {
        let arrival = frame_parts(payload)
            .and_then(|(header, _)| FrameTimes::of(header).host_nanos)
            .map(|[_, last]| last);
        if stream == sequence::DEPTH_STREAM {
            self.depth_arrival = arrival;
        } else if let (Some(depth), Some(color)) = (self.depth_arrival.take(), arrival) {
            let nanos = (self.clock.monotonic)().saturating_sub(depth.max(color));
            let nanos = u64::try_from(nanos).unwrap_or_default();
            self.report.to_recorded.add_nanos(nanos);
        }
    }

    /// Keeps the latencies of this thread with the recording.
    pub(super) fn write_histograms(&mut self) -> Result<(), SequenceError> {
        let Some(writer) = self
            .writer
            .as_mut()
            .filter(|_| self.report.failure.is_none())
        else {
            return Ok(());
        };
        let to_recorded = self.report.to_recorded.histogram("last-packet-to-recorded");
        writer.write_histogram(0, &to_recorded)?;
        writer.write_histogram(0, &self.report.seals.histogram("chunk-to-durable"))
    }

    /// Time to encode and store a pair.
    pub(super) fn count_work(&mut self, stream: u16, work: Work) {
        if stream == sequence::DEPTH_STREAM {
            self.depth_work = Some(work);
        } else if let Some(depth) = self.depth_work.take() {
            let pair = depth.and(work);
            self.report.pair_wall.add_nanos(pair.wall_nanos);
            self.report.pair_core.add_nanos(pair.core_nanos);
        }
    }
}
