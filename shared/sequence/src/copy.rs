//! New files from the records of old ones: repair and excerpts.

use std::ops::Range;
use std::path::Path;

use serde::Serialize;

use crate::checksum::{Beginning, FileId};
use crate::contents::{Contents, StoredPoses};
use crate::description::Description;
use crate::error::SequenceError;
use crate::layout::FrameHeader;
use crate::record::{FramePose, FrameTimes, Gap, GapCause};
use crate::scan::{Checking, RecordPlace, Scanner, beginning, id_from_chunks};
use crate::source::{ByteSource, PreadFile};
use crate::split::Split;
use crate::verify::{Missing, damaged_frames, unexplained};
use crate::writer::{Finished, RecordingWriter};

/// What a copy holds and what it lacks.
#[derive(Clone, Debug, Serialize)]
pub struct Copied {
    /// Length of the new file in bytes.
    pub bytes: u64,
    /// Frames of each stream, by id.
    pub frames: Vec<(u16, u64)>,
    /// Frames that came from behind the last sealed chunk.
    pub from_tail: u64,
    /// Frames that are not in the new file; its gaps say the same.
    pub missing: Vec<Missing>,
    /// What was wrong with the old file, a sentence each.
    pub findings: Vec<String>,
}

/// Poses in a record: about a megabyte.
const POSES_IN_A_RECORD: usize = 4096;

/// Writes all that is whole in `from` to the new file `to`: sealed chunks, and the records of the tail that was
/// never sealed. What is missing becomes gaps.
///
/// # Errors
/// When `to` exists, and when no description is left.
pub fn recover(from: &Path, to: &Path) -> Result<Copied, SequenceError> {
    let file = PreadFile::open(from).map_err(|error| error.in_file(from))?;
    require_free(to)?;
    recover_source(&file, to).map_err(|error| match error {
        SequenceError::InFile { .. } => error,
        error => error.in_file(from),
    })
}

/// As [`recover`], of any source.
pub fn recover_source<S: ByteSource + ?Sized>(
    file: &S,
    to: &Path,
) -> Result<Copied, SequenceError> {
    let ReadAll {
        contents,
        from_tail,
        mut findings,
    } = read_all(file)?;
    let plan = Plan::all(&contents)?;
    findings.extend(contents.damages.iter().map(ToString::to_string));
    let scanner = Scanner::of_file(file, contents.file_id, Checking::Everything)?;
    let reason = match &contents.end {
        Some(end) if findings.is_empty() => end.reason.as_str(),
        _ => "recovered",
    };
    let finished = plan.write(&scanner, &contents, to, reason)?;
    Ok(Copied::of(&finished, from_tail, plan.missing, findings))
}

/// Writes the depth frames with numbers in `range`, and everything that belongs to their time, to the new file
/// `to`. Numbers and times stay.
///
/// # Errors
/// When `to` exists, and when no depth frame has such a number.
pub fn cut(from: &Path, to: &Path, range: Range<u64>) -> Result<Copied, SequenceError> {
    let file = PreadFile::open(from).map_err(|error| error.in_file(from))?;
    require_free(to)?;
    let read = || {
        let scanner = Scanner::begin(&file, Checking::Everything)?;
        let file_id = scanner.file_id();
        let mut contents = Contents::of_scan(scanner)?;
        contents.trust_frames(&Scanner::of_file(&file, file_id, Checking::Everything)?)?;
        let plan = Plan::all(&contents)?.cut(&contents, &range)?;
        Ok((file_id, contents, plan))
    };
    let (file_id, contents, plan) = read().map_err(|error: SequenceError| error.in_file(from))?;
    let scanner = Scanner::of_file(&file, file_id, Checking::Everything)?;
    let finished = plan.write(&scanner, &contents, to, "complete")?;
    let findings = contents.damages.iter().map(ToString::to_string).collect();
    Ok(Copied::of(&finished, 0, plan.missing, findings))
}

impl Copied {
    fn of(
        finished: &Finished,
        from_tail: u64,
        missing: Vec<Missing>,
        findings: Vec<String>,
    ) -> Self {
        let streams = finished.end.streams.iter();
        Self {
            bytes: finished.bytes,
            frames: streams.map(|totals| (totals.id, totals.frames)).collect(),
            from_tail,
            missing,
            findings,
        }
    }
}

fn require_free(path: &Path) -> Result<(), SequenceError> {
    if path.exists() {
        return Err(SequenceError::Exists.in_file(path));
    }
    Ok(())
}

/// A damaged file, read as far as it goes.
struct ReadAll {
    /// With the records of the tail.
    contents: Contents,
    /// Frames that came from there.
    from_tail: u64,
    /// What was wrong with the first page.
    findings: Vec<String>,
}

fn read_all<S: ByteSource + ?Sized>(file: &S) -> Result<ReadAll, SequenceError> {
    let mut findings = Vec::new();
    let file_id: FileId = match beginning(file)? {
        Beginning::Recording(file_id) => file_id,
        beginning => {
            findings.push("the first page of the file is damaged".to_owned());
            id_from_chunks(file)?.ok_or(match beginning {
                Beginning::OtherVersion => SequenceError::OtherVersion,
                _ => SequenceError::NotARecording,
            })?
        }
    };
    let scanner = Scanner::of_file(file, file_id, Checking::Everything)?;
    let mut contents = Contents::of_scan(scanner)?;
    let frames = |contents: &Contents| contents.frames.values().map(Vec::len).sum::<usize>();
    let sealed_count = frames(&contents);
    let scanner = Scanner::of_file(file, file_id, Checking::Everything)?;
    contents.take_tail(&scanner)?;
    let from_tail = frames(&contents).saturating_sub(sealed_count) as u64;
    contents.trust_frames(&scanner)?;
    Ok(ReadAll {
        from_tail,
        contents,
        findings,
    })
}

/// Frames that are damaged, and numbers that are missing without a gap.
fn holes(contents: &Contents) -> Vec<Missing> {
    let damaged = damaged_frames(contents);
    let mut holes: Vec<Missing> = damaged
        .iter()
        .map(|(stream, number)| Missing::damaged(*stream, *number))
        .collect();
    for stream in contents.frames.keys() {
        let found = unexplained(contents, *stream, &damaged).into_iter();
        holes.extend(found.map(|hole| Missing {
            cause: GapCause::Damaged.to_string(),
            ..hole
        }));
    }
    holes
}

fn gap_of(hole: &Missing, places: &[RecordPlace]) -> Gap {
    let after = places.partition_point(|place| place.label.number < hole.first_number);
    let nanos = |index: usize| places.get(index).map(|place| place.label.device_nanos);
    Gap {
        stream: hole.stream,
        first_number: hole.first_number,
        count: hole.count,
        from_nanos: after.checked_sub(1).and_then(nanos),
        to_nanos: nanos(after),
        cause: Some(GapCause::Damaged),
        note: String::new(),
    }
}

/// What goes into a copy.
struct Plan {
    description: Description,
    /// Frames of all streams in the order they were written.
    frames: Vec<(u16, RecordPlace)>,
    gaps: Vec<Gap>,
    missing: Vec<Missing>,
    split: Option<Split>,
    poses: Vec<StoredPoses>,
}

impl Plan {
    /// Everything, with gaps for what is missing and was not said.
    fn all(contents: &Contents) -> Result<Self, SequenceError> {
        let description = contents
            .description
            .clone()
            .ok_or(SequenceError::NoDescription)?;
        let mut frames: Vec<(u16, RecordPlace)> = contents
            .frames
            .iter()
            .flat_map(|(stream, places)| places.iter().map(|place| (*stream, *place)))
            .collect();
        frames.sort_by_key(|(_, place)| (place.sequence, place.offset));
        let mut gaps = contents.gaps.clone();
        // What the old file itself said is missing stays missing.
        let mut missing: Vec<Missing> = contents.gaps.iter().map(Missing::of_gap).collect();
        for hole in holes(contents) {
            gaps.push(gap_of(&hole, contents.stream(hole.stream)));
            missing.push(hole);
        }
        missing.sort_by_key(|missing| (missing.stream, missing.first_number));
        Ok(Self {
            description,
            frames,
            gaps,
            missing,
            split: contents.split.clone(),
            poses: contents.pose_sets.clone(),
        })
    }

    /// Only what belongs to the depth frames in `range`.
    fn cut(mut self, contents: &Contents, range: &Range<u64>) -> Result<Self, SequenceError> {
        let depth_id = self.description.depth_id;
        let kept: Vec<&RecordPlace> = contents
            .stream(depth_id)
            .iter()
            .filter(|place| range.contains(&place.label.number))
            .collect();
        let nanos = || kept.iter().map(|place| place.label.device_nanos);
        let (Some(first), Some(last)) = (nanos().min(), nanos().max()) else {
            let places = contents.stream(depth_id);
            return Err(SequenceError::EmptyRange {
                start: range.start,
                end: range.end,
                first: places.first().map_or(0, |place| place.label.number),
                last: places.last().map_or(0, |place| place.label.number),
            });
        };
        let half = crate::recording::widest_pair_nanos(&self.description);
        let time = first.saturating_sub(half)..=last.saturating_add(half);
        self.frames.retain(|(stream, place)| {
            if *stream == depth_id {
                range.contains(&place.label.number)
            } else {
                time.contains(&place.label.device_nanos)
            }
        });
        // Gaps between frames that are kept.
        let mut spans = std::collections::BTreeMap::<u16, (u64, u64)>::new();
        for (stream, place) in &self.frames {
            let number = place.label.number;
            let span = spans.entry(*stream).or_insert((number, number));
            *span = (span.0.min(number), span.1.max(number));
        }
        let inside = |stream: u16, number: u64| {
            spans
                .get(&stream)
                .is_some_and(|(first, last)| (*first..=*last).contains(&number))
        };
        self.gaps.retain(|gap| inside(gap.stream, gap.first_number));
        self.missing
            .retain(|missing| inside(missing.stream, missing.first_number));
        for set in &mut self.poses {
            let stream = set.head.stream;
            set.poses.retain(|pose| inside(stream, pose.number));
        }
        if let Some(split) = &mut self.split {
            for list in [&mut split.train, &mut split.unused, &mut split.test] {
                list.retain(|number| range.contains(&u64::from(*number)));
            }
        }
        Ok(self)
    }

    fn write<S: ByteSource + ?Sized>(
        &self,
        scanner: &Scanner<'_, S>,
        contents: &Contents,
        to: &Path,
        reason: &str,
    ) -> Result<Finished, SequenceError> {
        let mut writer = RecordingWriter::create_beside(to, FileId::random()?, &self.description)?;
        for ((stream, _), table) in &contents.tables {
            writer.write_table(*stream, table)?;
        }
        for event in &contents.events {
            writer.write_event(event)?;
        }
        for note in &contents.notes {
            writer.write_note(note)?;
        }
        for (stream, histogram) in &contents.histograms {
            writer.write_histogram(*stream, histogram)?;
        }
        for (stream, gravity) in &contents.gravity {
            writer.write_gravity(*stream, gravity)?;
        }
        if let Some(split) = &self.split {
            writer.write_split(split)?;
        }
        self.write_poses(&mut writer)?;
        for gap in &self.gaps {
            writer.write_gap(gap)?;
        }
        for (stream, place) in &self.frames {
            // Checked a moment ago; a file that shrinks meanwhile is an error, not a hole.
            let payload = scanner.payload(place)?.ok_or(SequenceError::Damaged {
                offset: place.offset,
            })?;
            let (header, image) = payload
                .split_at_checked(size_of::<FrameHeader>())
                .ok_or(SequenceError::Payload { what: "a frame" })?;
            let header = zerocopy::FromBytes::ref_from_bytes(header)
                .map_err(|_| SequenceError::Payload { what: "a frame" })?;
            writer.write_frame(*stream, &FrameTimes::of(header), image)?;
            writer.seal_if_due(place.label.device_nanos)?;
        }
        writer.finish(reason)
    }

    fn write_poses(&self, writer: &mut RecordingWriter) -> Result<(), SequenceError> {
        for StoredPoses { head, poses } in &self.poses {
            let set = writer.begin_poses(&head.name, &head.producer, head.stream)?;
            for part in poses.chunks(POSES_IN_A_RECORD) {
                let part: &[FramePose] = part;
                writer.write_poses(set, part)?;
            }
        }
        Ok(())
    }
}
