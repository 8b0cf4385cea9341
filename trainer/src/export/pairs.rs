//! Pairs as files: what the layouts with one number a frame have in common.

use std::collections::BTreeSet;

use sequence::FrameTimes;
use sequence::scan::RecordPlace;

use super::OnProgress;
use super::files::{FrameFile, FrameFiles, StreamKind, in_order, lost_frame};
use super::target_folder::TargetFolder;

/// A pair whose images were written.
pub(crate) struct WrittenPair {
    /// Index in the recording.
    pub(crate) index: usize,
    pub(crate) depth: FrameTimes,
    pub(crate) color: FrameTimes,
}

/// The pairs that were written, numbered anew without holes, so that an import takes them.
pub(crate) struct WrittenPairs {
    pub(crate) pairs: Vec<WrittenPair>,
    /// Pairs that could not be read, a line for each image.
    pub(crate) missing: Vec<String>,
}

/// Writes the images of all pairs as `prefix` + NNNNNN + `.color.*` and `.depth.png`. A pair of which one
/// image is damaged is left out.
pub(crate) fn write_pairs(
    files: &FrameFiles,
    part: &TargetFolder,
    prefix: &str,
    progress: OnProgress,
) -> anyhow::Result<WrittenPairs> {
    let indices: Vec<usize> = (0..files.recording.frame_count()).collect();
    let mut written = WrittenPairs {
        pairs: Vec::new(),
        missing: Vec::new(),
    };
    in_order(
        &indices,
        |&index| pair(files, index),
        |&index, made| {
            match made {
                Ok([depth, color]) => {
                    let stem = format!("{prefix}{:06}", written.pairs.len());
                    part.write(&format!("{stem}.depth.png"), &depth.bytes)?;
                    let extension = files.extension(StreamKind::Color);
                    part.write(&format!("{stem}.color.{extension}"), &color.bytes)?;
                    written.pairs.push(WrittenPair {
                        index,
                        depth: depth.times,
                        color: color.times,
                    });
                }
                Err(lines) => written.missing.extend(lines),
            }
            Ok(())
        },
        progress,
    )?;
    Ok(written)
}

/// Depth and colour of a pair, or a line for each that is lost.
fn pair(files: &FrameFiles, index: usize) -> Result<[FrameFile; 2], Vec<String>> {
    let recording = files.recording;
    let file = |kind, place: Result<&RecordPlace, _>| {
        let place = place.map_err(|error: sequence::SequenceError| error.to_string())?;
        files
            .file(kind, place)
            .map_err(|error| lost_frame(kind, place, &error))
    };
    let depth = file(StreamKind::Depth, recording.depth_place(index));
    let color = file(StreamKind::Color, recording.color_place(index));
    match (depth, color) {
        (Ok(depth), Ok(color)) => Ok([depth, color]),
        (depth, color) => Err([depth.err(), color.err()].into_iter().flatten().collect()),
    }
}

impl WrittenPairs {
    /// The split of the recording, of what was written; `None` where the recording has none.
    pub(crate) fn split(&self, files: &FrameFiles) -> Option<String> {
        files.recording.contents().split.as_ref()?;
        let split = files.recording.split();
        let numbers = |list: &[u32]| -> Vec<usize> {
            let list: BTreeSet<usize> = list.iter().map(|&index| index as usize).collect();
            let pairs = self.pairs.iter().enumerate();
            pairs
                .filter(|(_, pair)| list.contains(&pair.index))
                .map(|(number, _)| number)
                .collect()
        };
        let json = serde_json::json!({
            "train": numbers(&split.train),
            "unused": numbers(&split.unused),
            "test": numbers(&split.test),
        });
        Some(format!("{json}\n"))
    }

    /// Mean rate of the depth of the pairs, frames a second; `None` where there is none.
    pub(crate) fn mean_rate_hz(&self) -> Option<f64> {
        let (first, last) = (self.pairs.first()?, self.pairs.last()?);
        let nanos = i128::from(last.depth.device_nanos) - i128::from(first.depth.device_nanos);
        let rate_hz = (self.pairs.len() - 1) as f64 * 1e9 / nanos as f64;
        // What an import accepts.
        (0.01..=1000.0).contains(&rate_hz).then_some(rate_hz)
    }
}

/// The frames of a stream that are in no pair.
pub(crate) fn unpaired<'a>(files: &FrameFiles<'a>, kind: StreamKind) -> Vec<&'a RecordPlace> {
    let recording = files.recording;
    let paired: BTreeSet<u64> = (0..recording.frame_count())
        .filter_map(|index| {
            let place = match kind {
                StreamKind::Depth => recording.depth_place(index),
                StreamKind::Color => recording.color_place(index),
            };
            Some(place.ok()?.offset)
        })
        .collect();
    let places = files.places(kind).iter();
    places
        .filter(|place| !paired.contains(&place.offset))
        .collect()
}
