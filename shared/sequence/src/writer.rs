//! Writing a recording: records in, totals and losses kept.

use std::collections::BTreeMap;
use std::fs::{File, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use tempfile::TempPath;
use zerocopy::IntoBytes as _;

use crate::checksum::FileId;
use crate::chunk_writer::{ChunkWriter, DiskLimits, RecordLabel, Sealing};
use crate::codecs::CodeTable;
use crate::contents::require_pose_set_name;
use crate::description::Description;
use crate::error::SequenceError;
use crate::file_layer::{self, FileLayer, WritePath};
use crate::layout::{FLAG_REPEAT, PoseBytes};
use crate::losses::{SmallRecords, gaps_of};
use crate::record::{
    End, Event, FramePose, FrameTimes, Gap, Gravity, Histogram, Note, PoseSetHead, RecordKind,
    StreamTotals, poses_header,
};
use crate::split::Split;

/// Chunks are sealed when they are this old, nanoseconds.
pub const CHUNK_NANOS: i64 = 1_000_000_000;
/// Chunks are sealed when they are this big, bytes.
pub const CHUNK_BYTES: u64 = 32 << 20;

/// Writes one recording. Dropped before [`RecordingWriter::finish`], it leaves what was sealed; a recording
/// that was begun with [`RecordingWriter::create_beside`] leaves nothing.
#[derive(Debug)]
pub struct RecordingWriter {
    chunks: ChunkWriter,
    path: PathBuf,
    /// Removed when dropped, until it gets its name.
    beside: Option<TempPath>,
    /// Time of the first record in the open chunk.
    chunk_nanos: Option<i64>,
    pose_sets: Vec<PoseSetHead>,
    totals: BTreeMap<u16, StreamTotals>,
    /// Records of the open chunk that are no frames.
    unsealed: SmallRecords,
    /// Those of the chunk that is on its way to the disk.
    sealing: SmallRecords,
    lost: Vec<Gap>,
    /// Chunks in a row that the disk refused.
    refused_count: u32,
}

/// Chunks in a row that the disk may refuse before the recording ends.
const MOST_REFUSED: u32 = 3;

impl RecordingWriter {
    /// Begins a recording under its own name, which must be free: it can be followed, and what is sealed
    /// survives whatever happens.
    pub fn create(
        path: &Path,
        description: &Description,
        write_path: WritePath,
        limits: DiskLimits,
    ) -> Result<Self, SequenceError> {
        let created = file_layer::create(path, write_path).and_then(|layer| {
            let writer = Self::on(layer, FileId::random()?, path, description, limits)?;
            // Makes the name itself durable.
            File::open(folder_of(path))?.sync_all()?;
            Ok(writer)
        });
        created.map_err(|error| error.in_file(path))
    }

    /// Begins the recording that will be `path` when it is finished; an older file of that name is replaced
    /// then. The folder must exist.
    pub fn create_beside(
        path: &Path,
        file_id: FileId,
        description: &Description,
    ) -> Result<Self, SequenceError> {
        let begin = || {
            let part = tempfile::Builder::new()
                .prefix(".glint-")
                .suffix(".part")
                // As any program's files: the umask decides. Temporary files would be private.
                .permissions(Permissions::from_mode(0o666))
                .tempfile_in(folder_of(path))?;
            let (file, beside) = part.into_parts();
            let layer = file_layer::layer_of(file, WritePath::default())?;
            let mut writer = Self::on(layer, file_id, path, description, DiskLimits::default())?;
            writer.beside = Some(beside);
            Ok(writer)
        };
        begin().map_err(|error: SequenceError| error.in_file(path))
    }

    /// Begins a recording on any layer. `path` names it in errors only.
    pub fn on(
        layer: Box<dyn FileLayer>,
        file_id: FileId,
        path: &Path,
        description: &Description,
        limits: DiskLimits,
    ) -> Result<Self, SequenceError> {
        let mut chunks = ChunkWriter::begin(layer, file_id, limits)?;
        let label = RecordLabel::of(RecordKind::Description, 0);
        chunks.put_in_preamble(label, description.to_json()?);
        Ok(Self {
            chunks,
            path: path.to_path_buf(),
            beside: None,
            chunk_nanos: None,
            pose_sets: Vec::new(),
            totals: BTreeMap::new(),
            unsealed: SmallRecords::default(),
            sealing: SmallRecords::default(),
            lost: Vec::new(),
            refused_count: 0,
        })
    }

    /// Id of the file.
    pub fn file_id(&self) -> FileId {
        self.chunks.file_id()
    }

    /// Bytes of the file so far.
    pub fn bytes(&self) -> u64 {
        self.chunks.bytes()
    }

    /// Bytes that the disk can still take before the recording ends.
    pub fn room_bytes(&mut self) -> Result<u64, SequenceError> {
        self.chunks
            .room_bytes()
            .map_err(|error| error.in_file(&self.path))
    }

    /// What was written and lost of each stream so far.
    pub fn totals(&self) -> impl Iterator<Item = &StreamTotals> {
        self.totals.values()
    }

    /// Frames that had been taken and then could not be made durable.
    pub fn lost(&self) -> &[Gap] {
        &self.lost
    }

    /// Appends a frame: its payload as the encoder of the stream made it.
    pub fn write_frame(
        &mut self,
        stream: u16,
        times: &FrameTimes,
        payload: &[u8],
    ) -> Result<(), SequenceError> {
        let header = times.header();
        let label = RecordLabel {
            kind: RecordKind::Frame as u16,
            stream,
            flags: times.flags(),
            number: times.number,
            device_nanos: times.device_nanos,
        };
        self.append(label, &[header.as_bytes(), payload])?;
        let totals = self.totals_of(stream);
        totals.frames += 1;
        totals.repeats += u64::from(times.is_repeat);
        Ok(())
    }

    /// Stores a table of depth codes, before the first frame that names it.
    pub fn write_table(&mut self, stream: u16, table: &CodeTable) -> Result<(), SequenceError> {
        let bytes = table.to_bytes();
        let label = RecordLabel::of(RecordKind::DepthTable, stream);
        // Twice: a table that is extended within its chunk is in no later one, and a flipped bit in its only
        // copy would cost all frames that name it.
        self.append(label, &[&bytes])?;
        self.append(label, &[&bytes])?;
        // A table extends the one before: later chunks need the last one only.
        self.chunks.put_in_preamble(label, bytes);
        Ok(())
    }

    /// Says that frames are missing. This has room even when the disk is full.
    pub fn write_gap(&mut self, gap: &Gap) -> Result<(), SequenceError> {
        let label = RecordLabel {
            kind: RecordKind::Gap as u16,
            stream: gap.stream,
            number: gap.first_number,
            ..RecordLabel::default()
        };
        let header = gap.header();
        let parts = [header.as_bytes(), gap.note.as_bytes()];
        self.chunks
            .append_last(label, &parts)
            .map_err(|error| error.in_file(&self.path))?;
        self.unsealed.push(label, &parts);
        self.totals_of(gap.stream).missing += gap.count;
        Ok(())
    }

    /// Says what changed or went wrong.
    pub fn write_event(&mut self, event: &Event) -> Result<(), SequenceError> {
        let label = RecordLabel::of(RecordKind::Event, event.stream);
        self.append(label, &[&event.payload()])
    }

    /// Keeps words of the user.
    pub fn write_note(&mut self, note: &Note) -> Result<(), SequenceError> {
        self.append(RecordLabel::of(RecordKind::Note, 0), &[&note.payload()])
    }

    /// Keeps counts.
    pub fn write_histogram(
        &mut self,
        stream: u16,
        histogram: &Histogram,
    ) -> Result<(), SequenceError> {
        let payload = serde_json::to_vec(histogram)?;
        self.append(RecordLabel::of(RecordKind::Histogram, stream), &[&payload])
    }

    /// Keeps a direction of down in the axes of a stream's camera.
    pub fn write_gravity(&mut self, stream: u16, gravity: &Gravity) -> Result<(), SequenceError> {
        let label = RecordLabel::of(RecordKind::Gravity, stream);
        self.append(label, &[gravity.bytes().as_bytes()])
    }

    /// Keeps which frames training may see.
    pub fn write_split(&mut self, split: &Split) -> Result<(), SequenceError> {
        let payload = serde_json::to_vec(split)?;
        self.append(RecordLabel::of(RecordKind::Split, 0), &[&payload])
    }

    /// Begins a pose set of the camera of `stream`; returns its id.
    pub fn begin_poses(
        &mut self,
        name: &str,
        producer: &str,
        stream: u16,
    ) -> Result<u16, SequenceError> {
        require_pose_set_name(name, self.pose_sets.iter())?;
        let head = PoseSetHead {
            id: self.pose_sets.len() as u16 + 1,
            name: name.to_owned(),
            producer: producer.to_owned(),
            stream,
        };
        let payload = serde_json::to_vec(&head)?;
        let label = RecordLabel {
            // Several sets stand in the preamble.
            number: u64::from(head.id),
            ..RecordLabel::of(RecordKind::PoseSet, 0)
        };
        self.append(label, &[&payload])?;
        self.chunks.put_in_preamble(label, payload);
        let id = head.id;
        self.pose_sets.push(head);
        Ok(id)
    }

    /// Appends poses to a set.
    pub fn write_poses(&mut self, set: u16, poses: &[FramePose]) -> Result<(), SequenceError> {
        let entries: Vec<PoseBytes> = poses.iter().map(FramePose::bytes).collect();
        self.write_pose_bytes(set, &entries)
    }

    /// As [`RecordingWriter::write_poses`], of entries that are bytes already. Allocates nothing once warm.
    pub fn write_pose_bytes(
        &mut self,
        set: u16,
        entries: &[PoseBytes],
    ) -> Result<(), SequenceError> {
        let head = self.pose_sets.iter().find(|head| head.id == set);
        let stream = head.map_or(0, |head| head.stream);
        let label = RecordLabel::of(RecordKind::Poses, stream);
        let header = poses_header(set);
        self.append(label, &[header.as_bytes(), entries.as_bytes()])
    }

    /// Appends a record of any kind with the payload it has, even of a kind that this version does not know.
    pub fn write_copy(&mut self, label: RecordLabel, payload: &[u8]) -> Result<(), SequenceError> {
        self.append(label, &[payload])
    }

    /// Whether the open chunk is old or big enough to be sealed. `now_nanos` is of any clock that runs with the
    /// recording, always the same one. While the chunk before is on its way, age does not count: a disk that is slow gets
    /// longer chunks.
    pub fn is_due(&mut self, now_nanos: i64) -> bool {
        if self.chunks.unsealed_bytes() == 0 {
            self.chunk_nanos = None;
            return false;
        }
        let since = *self.chunk_nanos.get_or_insert(now_nanos);
        let is_old = now_nanos.saturating_sub(since) >= CHUNK_NANOS && !self.chunks.is_sealing();
        is_old || self.chunks.unsealed_bytes() >= CHUNK_BYTES
    }

    /// Seals the open chunk when it is due.
    pub fn seal_if_due(&mut self, now_nanos: i64) -> Result<(), SequenceError> {
        if self.is_due(now_nanos) {
            self.seal()?;
        }
        Ok(())
    }

    /// Seals the open chunk. Frames that the disk refuses become gaps of the next chunk.
    pub fn seal(&mut self) -> Result<(), SequenceError> {
        self.send_chunk(false)?;
        self.await_seal()
    }

    /// Begins to seal the open chunk and returns, where another thread can wait for the disk; what is written next is in
    /// another chunk. A chunk that was on its way before is waited for. [`RecordingWriter::is_sealed`] tells the end.
    pub fn begin_seal(&mut self) -> Result<(), SequenceError> {
        self.send_chunk(true)
    }

    /// Whether no chunk is on its way to the disk (any more). Frames that the disk refused are gaps of the open chunk
    /// then.
    pub fn is_sealed(&mut self) -> Result<bool, SequenceError> {
        if let Some(sealing) = self.chunks.sealed(false) {
            self.note_losses(sealing)?;
        }
        Ok(!self.chunks.is_sealing())
    }

    /// Waits until no chunk is on its way to the disk.
    pub fn await_seal(&mut self) -> Result<(), SequenceError> {
        match self.chunks.sealed(true) {
            Some(sealing) => self.note_losses(sealing),
            None => Ok(()),
        }
    }

    fn send_chunk(&mut self, is_beside: bool) -> Result<(), SequenceError> {
        self.await_seal()?;
        self.chunk_nanos = None;
        self.chunks
            .begin_seal(is_beside)
            .map_err(|error| error.in_file(&self.path))?;
        std::mem::swap(&mut self.unsealed, &mut self.sealing);
        Ok(())
    }

    /// Closes the file and makes it durable; one that was begun beside its name gets it. Frames that could
    /// not be made durable are in [`Finished::lost`].
    pub fn finish(mut self, reason: &str) -> Result<Finished, SequenceError> {
        let path = self.path.clone();
        self.close(reason).map_err(|error| match error {
            SequenceError::InFile { .. } => error,
            error => error.in_file(&path),
        })
    }

    fn close(&mut self, reason: &str) -> Result<Finished, SequenceError> {
        self.await_seal()?;
        let mut end = self.end(reason);
        let sealing = self.chunks.close(&serde_json::to_vec(&end)?)?;
        std::mem::swap(&mut self.unsealed, &mut self.sealing);
        if sealing != Sealing::Done {
            self.note_losses(sealing)?;
            end = self.end(reason);
            if self.chunks.close(&serde_json::to_vec(&end)?)? != Sealing::Done {
                return Err(SequenceError::NotDurable);
            }
        }
        let bytes = self.chunks.cut()?;
        if let Some(beside) = self.beside.take() {
            beside.persist(&self.path).map_err(|error| error.error)?;
            File::open(folder_of(&self.path))?.sync_all()?;
        }
        Ok(Finished {
            bytes,
            end,
            lost: std::mem::take(&mut self.lost),
        })
    }

    fn end(&self, reason: &str) -> End {
        End {
            reason: reason.to_owned(),
            streams: self.totals.values().copied().collect(),
        }
    }

    fn append(&mut self, label: RecordLabel, parts: &[&[u8]]) -> Result<(), SequenceError> {
        self.chunks
            .append(label, parts)
            .map_err(|error| error.in_file(&self.path))?;
        if label.kind != RecordKind::Frame as u16 {
            self.unsealed.push(label, parts);
        }
        Ok(())
    }

    fn totals_of(&mut self, stream: u16) -> &mut StreamTotals {
        self.totals.entry(stream).or_insert(StreamTotals {
            id: stream,
            ..StreamTotals::default()
        })
    }

    /// Writes what was lost with a chunk: its small records again, its frames as gaps.
    fn note_losses(&mut self, sealing: Sealing) -> Result<(), SequenceError> {
        let Sealing::Lost(labels) = sealing else {
            self.refused_count = 0;
            self.sealing.clear();
            return Ok(());
        };
        self.refused_count += 1;
        for label in &labels {
            if label.kind == RecordKind::Frame as u16 {
                let totals = self.totals_of(label.stream);
                totals.frames = totals.frames.saturating_sub(1);
                totals.repeats = totals
                    .repeats
                    .saturating_sub(u64::from(label.flags & FLAG_REPEAT));
            }
        }
        for (label, payload) in std::mem::take(&mut self.sealing).records() {
            self.append(label, &[payload])?;
        }
        for gap in gaps_of(&labels) {
            self.lost.push(gap.clone());
            self.write_gap(&gap)?;
        }
        self.write_event(&Event {
            stream: 0,
            host_nanos: 0,
            details: serde_json::json!({
                "event": "warning",
                "message": "the disk refused a chunk; its frames are in gaps",
            }),
        })?;
        if self.refused_count < MOST_REFUSED {
            Ok(())
        } else {
            Err(SequenceError::NotDurable.in_file(&self.path))
        }
    }
}

/// What [`RecordingWriter::finish`] made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finished {
    /// Length of the file.
    pub bytes: u64,
    /// Reason and totals, as they stand in the file.
    pub end: End,
    /// Frames that the disk refused.
    pub lost: Vec<Gap>,
}

pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}
