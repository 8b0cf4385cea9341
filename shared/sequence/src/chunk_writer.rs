//! Records into chunks, chunks onto the disk: `docs/sequence-format.md` section 4, in the order it demands.

use std::io;

use zerocopy::IntoBytes as _;

use crate::checksum::FileId;
use crate::error::SequenceError;
use crate::file_layer::{FileLayer, uninterrupted, write_all};
use crate::layout::{
    ChunkHeader, FileHeader, IndexBytes, MOST_CHUNK_BYTES, MOST_PAYLOAD_BYTES, PAGE, RECORD_MAGIC,
    RECORDS_OFFSET, RecordHeader, chunk_end, record_bytes,
};
use crate::record::RecordKind;
use crate::sealing::{ClosedChunk, Sealer};

/// How a [`ChunkWriter`] uses the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskLimits {
    /// Space reserved at a time, bytes.
    pub extent_bytes: u64,
    /// Free space that is left alone, bytes: the recording ends before.
    pub floor_bytes: u64,
}

impl Default for DiskLimits {
    fn default() -> Self {
        Self {
            extent_bytes: 64 << 20,
            floor_bytes: 0,
        }
    }
}

/// What stands in the index of a record, beside its place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordLabel {
    /// Kind.
    pub kind: u16,
    /// Stream, 0 for none.
    pub stream: u16,
    /// Flags of a frame.
    pub flags: u32,
    /// Number of a frame, first number of a gap.
    pub number: u64,
    /// Device time of a frame.
    pub device_nanos: i64,
}

impl RecordLabel {
    /// The label of a record that is no frame and no gap.
    pub fn of(kind: RecordKind, stream: u16) -> Self {
        Self {
            kind: kind as u16,
            stream,
            ..Self::default()
        }
    }
}

/// What became of a chunk that should be sealed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Sealing {
    /// It is durable.
    Done,
    /// The disk refused; these records are not in the file.
    Lost(Vec<RecordLabel>),
}

/// A record that begins every chunk.
struct PreambleRecord {
    label: RecordLabel,
    payload: Vec<u8>,
}

/// Room for the records with which a recording closes, bytes; kept free in front of every other record.
const CLOSING_BYTES: u64 = 64 << 10;

/// The system is told to write whenever there is so much, bytes.
const BEGUN_BYTES: u64 = 1 << 20;

/// Writes one file. Dropped, it leaves all chunks that were sealed or on their way and, on a healthy system, the
/// records after them.
pub struct ChunkWriter {
    layer: Box<dyn FileLayer>,
    file_id: FileId,
    limits: DiskLimits,
    /// Allocated up to here.
    reserved_end: u64,
    chunk_start: u64,
    /// End of the last record; [`ChunkWriter::chunk_start`] + 128 while the chunk has none.
    cursor: u64,
    /// The system was told to write up to here.
    begun_end: u64,
    chunk_number: u64,
    records_crc: u32,
    first_sequence: u64,
    next_sequence: u64,
    index: Vec<IndexBytes>,
    /// Memory for the index of the next chunk but one.
    spare_index: Vec<IndexBytes>,
    preamble: Vec<PreambleRecord>,
    preamble_bytes: u64,
    sealer: Sealer,
}

impl ChunkWriter {
    /// Writes the file header and makes it durable. `layer` is a new file.
    pub fn begin(
        layer: Box<dyn FileLayer>,
        file_id: FileId,
        limits: DiskLimits,
    ) -> Result<Self, SequenceError> {
        let mut writer = Self {
            layer,
            file_id,
            limits,
            reserved_end: 0,
            chunk_start: PAGE,
            cursor: PAGE + RECORDS_OFFSET,
            begun_end: 0,
            chunk_number: 0,
            records_crc: 0,
            first_sequence: 0,
            next_sequence: 0,
            index: Vec::with_capacity(1024),
            spare_index: Vec::with_capacity(1024),
            preamble: Vec::new(),
            preamble_bytes: 0,
            sealer: Sealer::new(),
        };
        writer.reserve(2 * PAGE + CLOSING_BYTES)?;
        write_all(&mut *writer.layer, 0, &FileHeader::page(file_id))?;
        uninterrupted(|| writer.layer.sync(0, PAGE))?;
        Ok(writer)
    }

    /// Id of the file.
    pub fn file_id(&self) -> FileId {
        self.file_id
    }

    /// Bytes of the file up to the last record.
    pub fn bytes(&self) -> u64 {
        if self.index.is_empty() {
            self.chunk_start
        } else {
            self.cursor
        }
    }

    /// Bytes that can still be written: what is reserved, and what is free above the floor.
    pub fn room_bytes(&mut self) -> Result<u64, SequenceError> {
        let free = uninterrupted(|| self.layer.free_bytes())?;
        let usable = free.saturating_sub(self.limits.floor_bytes);
        Ok(usable.saturating_add(self.reserved_end - self.cursor.min(self.reserved_end)))
    }

    /// Bytes of records in the chunk that is not sealed yet.
    pub fn unsealed_bytes(&self) -> u64 {
        self.cursor - self.chunk_start - RECORDS_OFFSET
    }

    /// Makes a record the beginning of every later chunk, in place of one with the same label.
    pub fn put_in_preamble(&mut self, label: RecordLabel, payload: Vec<u8>) {
        self.preamble.retain(|record| record.label != label);
        self.preamble.push(PreambleRecord { label, payload });
        let bytes = |record: &PreambleRecord| record_bytes(record.payload.len() as u64);
        self.preamble_bytes = self.preamble.iter().map(bytes).sum();
    }

    /// Appends a record whose payload is `parts` one after the other.
    ///
    /// # Errors
    /// [`SequenceError::is_disk_full`] when there is no room: the record is not in the file, what was
    /// appended before is, and [`ChunkWriter::close`] still has room.
    pub fn append(&mut self, label: RecordLabel, parts: &[&[u8]]) -> Result<(), SequenceError> {
        self.open_chunk()?;
        self.append_leaving(label, parts, CLOSING_BYTES)
    }

    /// Appends a record in the room that is kept for closing: for the last words of a recording whose disk is
    /// full.
    pub fn append_last(
        &mut self,
        label: RecordLabel,
        parts: &[&[u8]],
    ) -> Result<(), SequenceError> {
        self.open_chunk()?;
        self.append_leaving(label, parts, 0)
    }

    /// Whether a chunk is on its way to the disk.
    pub fn is_sealing(&self) -> bool {
        self.sealer.is_busy()
    }

    /// Sends the open chunk on its way to the disk; the next record begins another. One that was on its way before must
    /// have [arrived](Self::sealed). With `is_beside` nobody waits here where the layer has a [`Syncer`] to give.
    ///
    /// [`Syncer`]: crate::file_layer::Syncer
    pub fn begin_seal(&mut self, is_beside: bool) -> Result<(), SequenceError> {
        if self.index.is_empty() {
            return Ok(());
        }
        self.append_index()?;
        self.commit(is_beside)
    }

    /// What became of the chunk that was on its way; `None` while it is, or when there was none. With `waits` it is
    /// waited for. A chunk that the disk refuses is given up and named record by record; it is an error only when the
    /// file cannot go on.
    pub fn sealed(&mut self, waits: bool) -> Option<Sealing> {
        let arrived = self.sealer.advance(&mut *self.layer, self.file_id, waits);
        let (mut chunk, is_durable) = arrived?;
        let sealing = if is_durable {
            Sealing::Done
        } else {
            Sealing::Lost(chunk.index.iter().map(label_of).collect())
        };
        chunk.index.clear();
        self.spare_index = chunk.index;
        self.layer.release_before(chunk.end);
        Some(sealing)
    }

    /// Appends the preamble once more, the index and the record `end` with the payload `end`, and seals the
    /// chunk; the room for this was kept. When it was lost, this can be called again. A chunk that was on its way must
    /// have [arrived](Self::sealed).
    pub fn close(&mut self, end: &[u8]) -> Result<Sealing, SequenceError> {
        if self.index.is_empty() {
            self.open_chunk()?;
        } else {
            // So that damage to the only chunk of a short file does not cost all of it.
            self.append_preamble()?;
        }
        self.append_index()?;
        self.write_record(RecordLabel::of(RecordKind::End, 0), &[end])?;
        self.commit(false)?;
        Ok(self.sealed(true).unwrap_or(Sealing::Done))
    }

    /// Cuts the space off that was reserved and not used; returns the length of the file in bytes.
    pub fn cut(&mut self) -> Result<u64, SequenceError> {
        uninterrupted(|| self.layer.set_len(self.chunk_start))?;
        self.reserved_end = self.chunk_start;
        Ok(self.chunk_start)
    }

    /// Writes the preamble when the chunk is empty.
    fn open_chunk(&mut self) -> Result<(), SequenceError> {
        if self.index.is_empty() {
            self.first_sequence = self.next_sequence;
            if let Err(error) = self.append_preamble() {
                self.empty_chunk();
                self.next_sequence = self.first_sequence;
                return Err(error);
            }
        }
        Ok(())
    }

    fn append_preamble(&mut self) -> Result<(), SequenceError> {
        let preamble = std::mem::take(&mut self.preamble);
        let written = preamble
            .iter()
            .try_for_each(|record| self.append_leaving(record.label, &[&record.payload], 0));
        self.preamble = preamble;
        written
    }

    fn append_leaving(
        &mut self,
        label: RecordLabel,
        parts: &[&[u8]],
        room_bytes: u64,
    ) -> Result<(), SequenceError> {
        let payload_bytes: u64 = parts.iter().map(|part| part.len() as u64).sum();
        let bytes = record_bytes(payload_bytes);
        if payload_bytes > MOST_PAYLOAD_BYTES
            || self.unsealed_bytes() + bytes > MOST_CHUNK_BYTES / 2
        {
            return Err(SequenceError::Section {
                part: "a record",
                offset: self.cursor,
                bytes: payload_bytes,
            });
        }
        let index_bytes =
            record_bytes((self.index.len() as u64 + 1) * size_of::<IndexBytes>() as u64);
        // Behind this chunk another one may be needed to close: its preamble and its index.
        let next_chunk_bytes = if room_bytes == 0 {
            0
        } else {
            2 * PAGE + 2 * self.preamble_bytes
        };
        self.reserve(self.cursor + bytes + index_bytes + next_chunk_bytes + room_bytes + PAGE)?;
        let offset = self.cursor - self.chunk_start;
        let sequence = self.next_sequence;
        self.write_record(label, parts)?;
        self.index.push(IndexBytes {
            // A chunk is shorter than 2^31 bytes (checked above), as is a payload.
            offset: (offset as u32).into(),
            payload_bytes: (payload_bytes as u32).into(),
            kind: label.kind.into(),
            stream: label.stream.into(),
            flags: label.flags.into(),
            // Of other kinds it only tells records of the preamble apart.
            number: if is_numbered(label.kind) {
                label.number
            } else {
                0
            }
            .into(),
            device_nanos: label.device_nanos.into(),
            sequence: sequence.into(),
        });
        Ok(())
    }

    /// Writes a record at the cursor; on an error nothing has moved.
    fn write_record(&mut self, label: RecordLabel, parts: &[&[u8]]) -> Result<(), SequenceError> {
        let payload_bytes: usize = parts.iter().map(|part| part.len()).sum();
        let mut header = RecordHeader {
            magic: RECORD_MAGIC,
            kind: label.kind.into(),
            stream: label.stream.into(),
            payload_bytes: (payload_bytes as u32).into(),
            crc: 0.into(),
            sequence: self.next_sequence.into(),
        };
        header.crc = self.file_id.record_crc(&header, parts).into();
        let bytes = record_bytes(payload_bytes as u64);
        let padding = &[0; 8][..(bytes as usize - size_of::<RecordHeader>() - payload_bytes)];
        let mut crc = self.records_crc;
        let mut offset = self.cursor;
        // The header last: until it stands, a follower finds no record here.
        let mut part_offset = offset + size_of::<RecordHeader>() as u64;
        for part in parts.iter().copied().chain([padding]) {
            write_all(&mut *self.layer, part_offset, part)?;
            part_offset += part.len() as u64;
        }
        write_all(&mut *self.layer, offset, header.as_bytes())?;
        crc = crc32c::crc32c_append(crc, header.as_bytes());
        for part in parts.iter().copied().chain([padding]) {
            crc = crc32c::crc32c_append(crc, part);
        }
        offset += bytes;
        self.records_crc = crc;
        self.cursor = offset;
        self.next_sequence += 1;
        self.begin_writing();
        Ok(())
    }

    /// Spreads the writing over the second of a chunk: whole pages, a tenth of a chunk at a time.
    fn begin_writing(&mut self) {
        let start = self.begun_end.max(self.chunk_start + PAGE);
        let end = self.cursor / PAGE * PAGE;
        if end.saturating_sub(start) >= BEGUN_BYTES {
            self.layer.begin_writing(start, end - start);
            self.begun_end = end;
        }
    }

    /// Where the index record stands is noted in `self.index`'s place: the last record but `end`.
    fn append_index(&mut self) -> Result<(), SequenceError> {
        let index = std::mem::take(&mut self.index);
        let written = self.write_record(
            RecordLabel::of(RecordKind::Index, 0),
            &[index.as_slice().as_bytes()],
        );
        self.index = index;
        written
    }

    /// Sends the open chunk, which has its index, to the disk.
    fn commit(&mut self, is_beside: bool) -> Result<(), SequenceError> {
        let start = self.chunk_start;
        let records_bytes = self.unsealed_bytes();
        let index_offset = self.index.last().map_or(RECORDS_OFFSET, |last| {
            u64::from(last.offset.get()) + record_bytes(u64::from(last.payload_bytes.get()))
        });
        let header = ChunkHeader::sealed(
            self.file_id,
            self.chunk_number,
            records_bytes,
            (self.next_sequence - self.first_sequence) as u32,
            index_offset as u32,
            self.first_sequence,
            self.records_crc,
        );
        let end = chunk_end(start, records_bytes).ok_or(SequenceError::Section {
            part: "a chunk",
            offset: start,
            bytes: records_bytes,
        })?;
        let spare = std::mem::take(&mut self.spare_index);
        let chunk = ClosedChunk {
            start,
            end,
            header,
            index: std::mem::replace(&mut self.index, spare),
        };
        self.chunk_start = end;
        self.chunk_number += 1;
        self.empty_chunk();
        self.sealer.begin(&mut *self.layer, chunk, is_beside);
        Ok(())
    }

    fn empty_chunk(&mut self) {
        self.cursor = self.chunk_start + RECORDS_OFFSET;
        self.records_crc = 0;
        self.index.clear();
    }

    /// Makes sure that the file reaches `end`.
    fn reserve(&mut self, end: u64) -> Result<(), SequenceError> {
        let Some(needed) = end
            .checked_sub(self.reserved_end)
            .filter(|bytes| *bytes > 0)
        else {
            return Ok(());
        };
        let needed = needed.next_multiple_of(PAGE);
        let mut step = needed.max(self.limits.extent_bytes).next_multiple_of(PAGE);
        if self.limits.floor_bytes > 0 {
            let free = uninterrupted(|| self.layer.free_bytes())?;
            let usable = free.saturating_sub(self.limits.floor_bytes) / PAGE * PAGE;
            step = step.min(usable);
            if step < needed {
                return Err(io::Error::from(io::ErrorKind::StorageFull).into());
            }
        }
        loop {
            match uninterrupted(|| self.layer.allocate(self.reserved_end, step)) {
                Ok(()) => {
                    self.reserved_end += step;
                    return Ok(());
                }
                Err(error) if is_full(&error) && step > needed => {
                    step = (step / 2).next_multiple_of(PAGE).max(needed);
                }
                Err(error) => return Err(error.into()),
            }
        }
    }
}

impl Drop for ChunkWriter {
    fn drop(&mut self) {
        // What was on its way keeps the promise that a sealed chunk is one.
        let _ = self.sealed(true);
    }
}

impl std::fmt::Debug for ChunkWriter {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("ChunkWriter")
            .field("chunk_number", &self.chunk_number)
            .field("bytes", &self.bytes())
            .finish_non_exhaustive()
    }
}

/// The label that an index names.
fn label_of(entry: &IndexBytes) -> RecordLabel {
    RecordLabel {
        kind: entry.kind.get(),
        stream: entry.stream.get(),
        flags: entry.flags.get(),
        number: entry.number.get(),
        device_nanos: entry.device_nanos.get(),
    }
}

/// Whether an index names the number of such a record.
fn is_numbered(kind: u16) -> bool {
    kind == RecordKind::Frame as u16 || kind == RecordKind::Gap as u16
}

/// Whether the disk or a quota is full.
pub(crate) fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge
    )
}
