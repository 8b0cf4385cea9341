//! What a recording holds, in numbers and words: for `glintd info`.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use crate::contents::Contents;
use crate::description::{Description, hex};
use crate::record::{GapCause, Histogram};

/// A recording in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Id of the file, 32 digits.
    pub file_id: String,
    /// Program that wrote it.
    pub writer: String,
    /// Wall clock at its beginning, nanoseconds since 1970 as a string; "0" for imports.
    pub created_unix_nanos: String,
    /// Camera, where known.
    pub device: Option<String>,
    /// Why it ended; absent when it was not closed.
    pub end_reason: Option<String>,
    /// Bytes up to the end of the last sealed chunk.
    pub sealed_bytes: u64,
    /// Sealed chunks.
    pub chunk_count: u64,
    /// The streams.
    pub streams: Vec<StreamSummary>,
    /// Names of pose sets with the number of poses.
    pub pose_sets: BTreeMap<String, usize>,
    /// Missing frames by cause, all streams.
    pub missing_by_cause: BTreeMap<String, u64>,
    /// How many settings, warnings and other events.
    pub event_count: usize,
    /// These, in the order of the file.
    pub events: Vec<EventSummary>,
    /// Counts of durations and differences, in the order of the file.
    pub histograms: Vec<HistogramSummary>,
    /// Words of the user.
    pub notes: Vec<String>,
    /// Whether colour is kept without loss.
    pub color_is_lossless: bool,
    /// Places that are not as they were written.
    pub damage_count: usize,
}

/// An event with its time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventSummary {
    /// Id of the stream, 0 for none.
    pub stream: u16,
    /// Monotonic time of the host, nanoseconds as a string.
    pub host_nanos: String,
    /// What happened: JSON with the key `event`.
    pub details: serde_json::Value,
}

/// A histogram with its stream.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HistogramSummary {
    /// Id of the stream, 0 for none.
    pub stream: u16,
    /// Name, unit, edges, counts.
    #[serde(flatten)]
    pub histogram: Histogram,
}

/// A stream in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StreamSummary {
    /// Id in the file.
    pub id: u16,
    /// `depth`, `color`, or `other`.
    pub kind: &'static str,
    /// Format, or empty for streams that are not described.
    pub format: String,
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames in the file.
    pub frames: usize,
    /// Frames that repeat their predecessor.
    pub repeats: usize,
    /// Frames that gaps name.
    pub missing: u64,
    /// Number of the first frame.
    pub first_number: Option<u64>,
    /// Number of the last frame.
    pub last_number: Option<u64>,
    /// Device time from the first to the last frame, seconds.
    pub duration_s: f64,
    /// Frames a second, measured between the first and the last; 0 for fewer than two.
    pub measured_rate_hz: f64,
    /// Payloads, bytes.
    pub bytes: u64,
}

impl Summary {
    /// The summary of `contents` with their description.
    pub fn of(contents: &Contents, description: &Description) -> Self {
        let mut ids: Vec<u16> = contents.frames.keys().copied().collect();
        ids.extend([description.depth_id, description.color_id]);
        ids.extend(contents.gaps.iter().map(|gap| gap.stream));
        ids.sort_unstable();
        ids.dedup();
        let mut missing_by_cause = BTreeMap::new();
        for gap in &contents.gaps {
            let cause = gap
                .cause
                .map_or("unknown".to_owned(), |cause: GapCause| cause.to_string());
            let count: &mut u64 = missing_by_cause.entry(cause).or_default();
            *count = count.saturating_add(gap.count);
        }
        let pose_sets = contents
            .pose_sets
            .iter()
            .map(|set| (set.head.name.clone(), set.poses.len()))
            .collect();
        Self {
            file_id: hex(contents.file_id),
            writer: description.writer.clone(),
            created_unix_nanos: description.created.unix_nanos.to_string(),
            device: description
                .streams
                .device
                .as_ref()
                .map(|device| device.name.clone()),
            end_reason: contents.end.as_ref().map(|end| end.reason.clone()),
            sealed_bytes: contents.sealed_bytes,
            chunk_count: contents.chunk_count,
            streams: ids
                .into_iter()
                .map(|id| StreamSummary::of(id, contents, description))
                .collect(),
            pose_sets,
            missing_by_cause,
            event_count: contents.events.len(),
            events: contents
                .events
                .iter()
                .map(|event| EventSummary {
                    stream: event.stream,
                    host_nanos: event.host_nanos.to_string(),
                    details: event.details.clone(),
                })
                .collect(),
            histograms: contents
                .histograms
                .iter()
                .map(|(stream, histogram)| HistogramSummary {
                    stream: *stream,
                    histogram: histogram.clone(),
                })
                .collect(),
            notes: contents
                .notes
                .iter()
                .map(|note| note.text.clone())
                .collect(),
            color_is_lossless: description.streams.color.encoding.lossless().is_some(),
            damage_count: contents.damages.len(),
        }
    }
}

impl Summary {
    /// How many events there are of each word; `unknown` has those without.
    fn events_by_word(&self) -> BTreeMap<&str, usize> {
        let mut counts = BTreeMap::new();
        for event in &self.events {
            let word = event.details["event"].as_str().unwrap_or("unknown");
            *counts.entry(word).or_default() += 1;
        }
        counts
    }
}

impl fmt::Display for HistogramSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let histogram = &self.histogram;
        write!(f, "{}, {} values", histogram.name, histogram.count())?;
        for (name, fraction) in [("p50", 0.5), ("p99", 0.99)] {
            let bin = histogram.quantile_bin(fraction);
            if let Some([lower, upper]) = bin.and_then(|bin| histogram.edges.get(bin..bin + 2)) {
                write!(f, ", {name} from {lower} to {upper} {}", histogram.unit)?;
            }
        }
        Ok(())
    }
}

impl StreamSummary {
    fn of(id: u16, contents: &Contents, description: &Description) -> Self {
        let places = contents.stream(id);
        let streams = &description.streams;
        let (kind, format, camera) = if id == description.depth_id {
            let format = match streams.depth.samples {
                crate::DepthSamples::Values => "values",
                crate::DepthSamples::Codes => "codes",
            };
            ("depth", format, Some(&streams.depth.intrinsics))
        } else if id == description.color_id {
            (
                "color",
                streams.color.encoding.name(),
                Some(&streams.color.intrinsics),
            )
        } else {
            ("other", "", None)
        };
        let nanos = || {
            places
                .iter()
                .map(|place| i128::from(place.label.device_nanos))
        };
        let span_nanos = match (nanos().min(), nanos().max()) {
            (Some(first), Some(last)) => last - first,
            _ => 0,
        };
        let duration_s = span_nanos as f64 / 1e9;
        let gaps = contents.gaps.iter().filter(|gap| gap.stream == id);
        Self {
            id,
            kind,
            format: format.to_owned(),
            width: camera.map_or(0, geometry::Intrinsics::width),
            height: camera.map_or(0, geometry::Intrinsics::height),
            frames: places.len(),
            repeats: places.iter().filter(|place| place.is_repeat()).count(),
            missing: gaps.fold(0, |sum, gap| u64::saturating_add(sum, gap.count)),
            first_number: places.first().map(|place| place.label.number),
            last_number: places.last().map(|place| place.label.number),
            duration_s,
            measured_rate_hz: if duration_s > 0.0 {
                (places.len() - 1) as f64 / duration_s
            } else {
                0.0
            },
            bytes: places
                .iter()
                .map(|place| u64::from(place.payload_bytes))
                .sum(),
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:.1} MB in {} chunks, written by {}",
            self.sealed_bytes as f64 / 1e6,
            self.chunk_count,
            self.writer
        )?;
        match &self.end_reason {
            Some(reason) => writeln!(f, ", closed ({reason})")?,
            None => writeln!(f, ", not closed")?,
        }
        if let Some(device) = &self.device {
            writeln!(f, "camera: {device}")?;
        }
        for stream in &self.streams {
            writeln!(
                f,
                "{} {}x{} {}: {} frames over {:.3} s ({:.3} a second), {} repeats, {} missing, {:.1} MB",
                stream.kind,
                stream.width,
                stream.height,
                stream.format,
                stream.frames,
                stream.duration_s,
                stream.measured_rate_hz,
                stream.repeats,
                stream.missing,
                stream.bytes as f64 / 1e6,
            )?;
        }
        for (cause, count) in &self.missing_by_cause {
            writeln!(f, "missing: {count} frames, {cause}")?;
        }
        for (name, count) in &self.pose_sets {
            writeln!(f, "poses: {name}, {count}")?;
        }
        for entry in &self.histograms {
            writeln!(f, "histogram: {entry}")?;
        }
        for (word, count) in self.events_by_word() {
            writeln!(f, "events: {count} {word}")?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        if self.damage_count > 0 {
            writeln!(
                f,
                "damage: {} places, see `glintd verify`",
                self.damage_count
            )?;
        }
        Ok(())
    }
}
