//! What is lost when the disk refuses a chunk.

use crate::chunk_writer::RecordLabel;
use crate::record::{Gap, GapCause, RecordKind};

/// Small records, kept until they are durable: when the disk refuses their chunk, they are written again.
/// Frames are too big to be kept; they become gaps.
#[derive(Debug, Default)]
pub(crate) struct SmallRecords {
    /// Label and length of each payload.
    labels: Vec<(RecordLabel, usize)>,
    /// The payloads, one after the other.
    payloads: Vec<u8>,
}

impl SmallRecords {
    pub(crate) fn push(&mut self, label: RecordLabel, parts: &[&[u8]]) {
        let start = self.payloads.len();
        for part in parts {
            self.payloads.extend_from_slice(part);
        }
        self.labels.push((label, self.payloads.len() - start));
    }

    /// Label and payload of each, in the order in which they came.
    pub(crate) fn records(&self) -> impl Iterator<Item = (RecordLabel, &[u8])> {
        let mut rest = self.payloads.as_slice();
        self.labels.iter().map(move |&(label, length)| {
            let (payload, behind) = rest.split_at(length);
            rest = behind;
            (label, payload)
        })
    }

    pub(crate) fn clear(&mut self) {
        self.labels.clear();
        self.payloads.clear();
    }
}

/// The frames among `labels` as gaps, one for each run of numbers of a stream.
pub(crate) fn gaps_of(labels: &[RecordLabel]) -> Vec<Gap> {
    let mut frames: Vec<&RecordLabel> = labels
        .iter()
        .filter(|label| label.kind == RecordKind::Frame as u16)
        .collect();
    frames.sort_by_key(|label| (label.stream, label.number));
    let mut gaps: Vec<Gap> = Vec::new();
    for label in frames {
        match gaps.last_mut() {
            Some(gap)
                if gap.stream == label.stream && gap.first_number + gap.count == label.number =>
            {
                gap.count += 1;
            }
            _ => gaps.push(Gap {
                stream: label.stream,
                first_number: label.number,
                count: 1,
                from_nanos: None,
                to_nanos: None,
                cause: Some(GapCause::DiskError),
                note: String::new(),
            }),
        }
    }
    gaps
}
