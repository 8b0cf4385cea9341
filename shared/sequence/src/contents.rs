//! What a file holds, gathered chunk by chunk.

use std::collections::BTreeMap;

use crate::checksum::FileId;
use crate::codecs::CodeTable;
use crate::description::Description;
use crate::error::SequenceError;
use crate::record::{
    End, Event, FramePose, Gap, Gravity, Histogram, MUST_UNDERSTAND, Note, PoseSetHead, PoseState,
    RecordKind, read_poses,
};
use crate::scan::{Checking, Chunk, ChunkState, Damage, RecordPlace, Scanner};
use crate::source::ByteSource;
use crate::split::Split;

/// A named path of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredPoses {
    /// Id, name, producer, stream.
    pub head: PoseSetHead,
    /// One a frame at most, by rising numbers.
    pub poses: Vec<FramePose>,
}

impl StoredPoses {
    /// The map with the most poses that are not lost, of equals the one with the least id: poses of different maps
    /// are in different worlds. `None` where every pose is lost.
    pub fn largest_map(&self) -> Option<u32> {
        let mut counts = BTreeMap::new();
        for pose in self
            .poses
            .iter()
            .filter(|pose| pose.state != PoseState::Lost)
        {
            *counts.entry(pose.map).or_insert(0_usize) += 1;
        }
        // Of equals, `max_by_key` gives the last.
        let largest = counts.into_iter().rev().max_by_key(|(_, count)| *count);
        largest.map(|(map, _)| map)
    }
}

/// Everything in a file but the images.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Id of the file.
    pub file_id: FileId,
    /// Streams and calibration; `None` until a chunk was read.
    pub description: Option<Description>,
    /// Tables of depth codes by stream and id.
    pub tables: BTreeMap<(u16, u16), CodeTable>,
    /// Where the frames of each stream lie, by rising numbers.
    pub frames: BTreeMap<u16, Vec<RecordPlace>>,
    /// Frames that are missing.
    pub gaps: Vec<Gap>,
    /// Changes and warnings.
    pub events: Vec<Event>,
    /// Words of the user.
    pub notes: Vec<Note>,
    /// Counts, with their streams, 0 for none.
    pub histograms: Vec<(u16, Histogram)>,
    /// Directions of down, with their streams.
    pub gravity: Vec<(u16, Gravity)>,
    /// Pose sets in the order of their first records.
    pub pose_sets: Vec<StoredPoses>,
    /// Which frames training may see.
    pub split: Option<Split>,
    /// The last record of a closed file.
    pub end: Option<End>,
    /// What is not as it was written.
    pub damages: Vec<Damage>,
    /// Sealed chunks.
    pub chunk_count: u64,
    /// Bytes up to the end of the last sealed chunk.
    pub sealed_bytes: u64,
    /// Records in the tail that was never sealed; not part of anything above.
    pub tail: Vec<RecordPlace>,
    /// Poses of sets whose first head is damaged: the next chunk has another.
    poses_without_set: Vec<(u16, Vec<FramePose>)>,
}

impl Contents {
    /// Nothing yet, of the file `file_id`.
    pub fn new(file_id: FileId) -> Self {
        Self {
            file_id,
            description: None,
            tables: BTreeMap::new(),
            frames: BTreeMap::new(),
            gaps: Vec::new(),
            events: Vec::new(),
            notes: Vec::new(),
            histograms: Vec::new(),
            gravity: Vec::new(),
            pose_sets: Vec::new(),
            split: None,
            end: None,
            damages: Vec::new(),
            chunk_count: 0,
            sealed_bytes: crate::layout::PAGE,
            tail: Vec::new(),
            poses_without_set: Vec::new(),
        }
    }

    /// All of a source.
    pub fn read<S: ByteSource + ?Sized>(
        source: &S,
        checking: Checking,
    ) -> Result<Self, SequenceError> {
        Self::of_scan(Scanner::begin(source, checking)?)
    }

    /// All that a scan finds.
    pub fn of_scan<S: ByteSource + ?Sized>(
        mut scanner: Scanner<'_, S>,
    ) -> Result<Self, SequenceError> {
        let mut contents = Self::new(scanner.file_id());
        while let Some(chunk) = scanner.next_chunk()? {
            contents.add(&scanner, &chunk)?;
        }
        contents.sort();
        Ok(contents)
    }

    /// Adds a chunk; [`Contents::sort`] when all are in.
    pub fn add<S: ByteSource + ?Sized>(
        &mut self,
        scanner: &Scanner<'_, S>,
        chunk: &Chunk,
    ) -> Result<(), SequenceError> {
        self.damages.extend_from_slice(&chunk.damages);
        if chunk.state == ChunkState::Tail {
            self.tail.extend_from_slice(&chunk.records);
            return Ok(());
        }
        self.chunk_count += 1;
        self.sealed_bytes = chunk.end;
        for place in &chunk.records {
            self.add_record(scanner, place)?;
        }
        Ok(())
    }

    /// Adds the records of the tail too: for repair.
    pub fn take_tail<S: ByteSource + ?Sized>(
        &mut self,
        scanner: &Scanner<'_, S>,
    ) -> Result<(), SequenceError> {
        for place in std::mem::take(&mut self.tail) {
            self.add_record(scanner, &place)?;
        }
        self.sort();
        Ok(())
    }

    /// Takes what the index says of frames from the frames themselves: for copies of files whose indices may say
    /// something else.
    pub fn trust_frames<S: ByteSource + ?Sized>(
        &mut self,
        scanner: &Scanner<'_, S>,
    ) -> Result<(), SequenceError> {
        for places in self.frames.values_mut() {
            let mut whole = Vec::with_capacity(places.len());
            for place in places.iter() {
                whole.extend(scanner.place(place.offset)?);
            }
            *places = whole;
        }
        self.sort();
        Ok(())
    }

    fn add_record<S: ByteSource + ?Sized>(
        &mut self,
        scanner: &Scanner<'_, S>,
        place: &RecordPlace,
    ) -> Result<(), SequenceError> {
        let Some(kind) = RecordKind::from_number(place.label.kind) else {
            return if place.label.kind & MUST_UNDERSTAND == 0 {
                Ok(())
            } else {
                Err(SequenceError::UnknownKind {
                    kind: place.label.kind,
                })
            };
        };
        let stream = place.label.stream;
        if kind == RecordKind::Frame {
            self.frames.entry(stream).or_default().push(*place);
            return Ok(());
        }
        // The same in every chunk: one that is whole is enough.
        if kind == RecordKind::Description && self.description.is_some() {
            return Ok(());
        }
        let Some(payload) = scanner.payload(place)? else {
            self.damages.push(Damage::Record {
                offset: place.offset,
                label: place.label,
            });
            return Ok(());
        };
        self.take(kind, stream, &payload)
    }

    fn take(&mut self, kind: RecordKind, stream: u16, payload: &[u8]) -> Result<(), SequenceError> {
        let unfit = |what| SequenceError::Payload { what };
        match kind {
            RecordKind::Description => self.description = Some(Description::from_json(payload)?),
            RecordKind::DepthTable => {
                let table = CodeTable::from_bytes(payload).map_err(SequenceError::Codec)?;
                self.tables.entry((stream, table.id())).or_insert(table);
            }
            RecordKind::Gap => {
                self.gaps
                    .push(Gap::read(stream, payload).ok_or_else(|| unfit("a gap"))?);
            }
            RecordKind::Event => {
                self.events
                    .push(Event::read(stream, payload).ok_or_else(|| unfit("an event"))?);
            }
            RecordKind::PoseSet => self.take_pose_set(serde_json::from_slice(payload)?)?,
            RecordKind::Poses => self.take_poses(payload)?,
            RecordKind::Gravity => {
                let gravity = Gravity::read(payload).ok_or_else(|| unfit("a gravity record"))?;
                self.gravity.push((stream, gravity));
            }
            RecordKind::Histogram => {
                self.histograms
                    .push((stream, serde_json::from_slice(payload)?));
            }
            RecordKind::Note => {
                self.notes
                    .push(Note::read(payload).ok_or_else(|| unfit("a note"))?);
            }
            RecordKind::Split => {
                let StoredSplit {
                    train,
                    unused,
                    test,
                } = serde_json::from_slice(payload)?;
                self.split = Some(Split {
                    train,
                    unused,
                    test,
                });
            }
            RecordKind::End => self.end = Some(serde_json::from_slice(payload)?),
            RecordKind::Frame | RecordKind::Index => {}
        }
        Ok(())
    }

    fn take_pose_set(&mut self, head: PoseSetHead) -> Result<(), SequenceError> {
        if self.pose_sets.iter().any(|set| set.head == head) {
            return Ok(());
        }
        require_pose_set_name(&head.name, self.pose_sets.iter().map(|set| &set.head))?;
        let mut poses = Vec::new();
        self.poses_without_set.retain_mut(|(set, waiting)| {
            let is_of_set = *set == head.id;
            if is_of_set {
                poses.append(waiting);
            }
            !is_of_set
        });
        self.pose_sets.push(StoredPoses { head, poses });
        Ok(())
    }

    fn take_poses(&mut self, payload: &[u8]) -> Result<(), SequenceError> {
        let name = |id: u16| {
            let set = self.pose_sets.iter().find(|set| set.head.id == id);
            set.map_or_else(|| format!("number {id}"), |set| set.head.name.clone())
        };
        let (id, poses) = read_poses(payload, &name)?;
        match self.pose_sets.iter_mut().find(|set| set.head.id == id) {
            Some(set) => set.poses.extend(poses),
            None => self.poses_without_set.push((id, poses)),
        }
        Ok(())
    }

    /// Brings frames and poses into the order of their numbers, each number once: of frames the one that was
    /// written first, of poses the one that was written last.
    pub fn sort(&mut self) {
        for places in self.frames.values_mut() {
            places.sort_by_key(|place| (place.label.number, place.sequence));
            places.dedup_by_key(|place| place.label.number);
        }
        for set in &mut self.pose_sets {
            set.poses.reverse();
            set.poses.sort_by_key(|pose| pose.number);
            set.poses.dedup_by_key(|pose| pose.number);
        }
        self.gaps.sort_by_key(|gap| (gap.stream, gap.first_number));
    }

    /// Frames of a stream.
    pub fn stream(&self, id: u16) -> &[RecordPlace] {
        self.frames.get(&id).map_or(&[], Vec::as_slice)
    }
}

/// A split as it is stored: unlike in a file that a user wrote, keys of later versions are ignored.
#[derive(serde::Deserialize)]
struct StoredSplit {
    train: Vec<u32>,
    unused: Vec<u32>,
    test: Vec<u32>,
}

/// Pose sets that a recording may have: keeps a hostile list of names from costing time.
const MOST_POSE_SETS: usize = 256;

/// Refuses a name that would be awkward on a command line, one that `earlier` sets have, and too many.
pub(crate) fn require_pose_set_name<'a>(
    name: &str,
    earlier: impl ExactSizeIterator<Item = &'a PoseSetHead>,
) -> Result<(), SequenceError> {
    let usable = (1..=64).contains(&name.len())
        && name
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_');
    if usable && earlier.len() < MOST_POSE_SETS && !earlier.into_iter().any(|set| set.name == name)
    {
        Ok(())
    } else {
        Err(SequenceError::PoseSetName(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use geometry::Pose;

    use super::*;

    #[test]
    fn the_largest_map_counts_what_is_not_lost_and_of_equals_is_the_first() {
        let set = |poses: &[(u32, PoseState)]| StoredPoses {
            head: PoseSetHead {
                id: 1,
                name: "live".to_owned(),
                producer: String::new(),
                stream: 1,
            },
            poses: (0..)
                .zip(poses)
                .map(|(number, &(map, state))| FramePose {
                    map,
                    state,
                    ..FramePose::ok(number, Pose::IDENTITY)
                })
                .collect(),
        };
        let (ok, weak, lost) = (PoseState::Ok, PoseState::Weak(1), PoseState::Lost);
        assert_eq!(set(&[]).largest_map(), None);
        assert_eq!(set(&[(0, lost)]).largest_map(), None);
        assert_eq!(set(&[(7, ok), (3, weak), (3, ok)]).largest_map(), Some(3));
        assert_eq!(set(&[(7, ok), (3, lost), (3, lost)]).largest_map(), Some(7));
        assert_eq!(
            set(&[(9, ok), (4, ok), (9, weak), (4, ok)]).largest_map(),
            Some(4)
        );
    }
}
