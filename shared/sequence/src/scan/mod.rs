//! From chunk to chunk through a file, around what is damaged: `docs/sequence-format.md` section 7.

mod found;
mod record_at;
mod window;

use zerocopy::FromBytes as _;

pub use found::{Checking, Chunk, ChunkState, Damage, RecordPlace};
use record_at::claimed_bytes;
pub(crate) use record_at::{place_of, read_record};
use window::{Window, crc_of};

use crate::checksum::{Beginning, FileId, is_commit, is_mark, is_some_chunk};
use crate::chunk_writer::RecordLabel;
use crate::error::SequenceError;
use crate::layout::{
    CHUNK_MAGIC, ChunkHeader, CommitMark, FileHeader, IndexBytes, PAGE, RECORD_MAGIC,
    RECORDS_OFFSET, chunk_end, record_bytes,
};
use crate::record::RecordKind;
use crate::source::ByteSource;

/// Walks through a file chunk by chunk.
pub struct Scanner<'source, S: ByteSource + ?Sized> {
    source: &'source S,
    file_id: FileId,
    checking: Checking,
    position: u64,
    byte_count: u64,
    least_number: u64,
    is_at_end: bool,
    /// Bytes that may still be summed to find out whether chunks without a mark are whole.
    sum_budget: u64,
}

impl<'source, S: ByteSource + ?Sized> Scanner<'source, S> {
    /// A scan of `source` from its first chunk.
    ///
    /// # Errors
    /// When the beginning is not that of a recording of this version.
    pub fn begin(source: &'source S, checking: Checking) -> Result<Self, SequenceError> {
        match beginning(source)? {
            Beginning::Recording(file_id) => Self::of_file(source, file_id, checking),
            Beginning::Damaged => Err(SequenceError::HeaderDamaged),
            Beginning::OtherVersion => Err(SequenceError::OtherVersion),
            Beginning::Foreign => Err(SequenceError::NotARecording),
        }
    }

    /// A scan of a file whose id is known.
    pub fn of_file(
        source: &'source S,
        file_id: FileId,
        checking: Checking,
    ) -> Result<Self, SequenceError> {
        let byte_count = source.byte_count()?;
        Ok(Self {
            source,
            file_id,
            checking,
            position: PAGE,
            byte_count,
            least_number: 0,
            is_at_end: false,
            sum_budget: byte_count
                .saturating_mul(SUM_EFFORT)
                .saturating_add(1 << 20),
        })
    }

    /// Id of the file.
    pub fn file_id(&self) -> FileId {
        self.file_id
    }

    /// Where the next chunk should begin, and its least number: to go on from here later.
    pub fn position(&self) -> (u64, u64) {
        (self.position, self.least_number)
    }

    /// Goes on from a [`Scanner::position`] of an earlier scan of the same file.
    pub fn go_on_from(&mut self, (position, least_number): (u64, u64)) {
        self.position = position;
        self.least_number = least_number;
    }

    /// The next chunk if it is committed; the scan stays where it is when it is not (yet). For files that
    /// grow.
    pub fn next_committed(&mut self) -> Result<Option<Chunk>, SequenceError> {
        self.byte_count = self.source.byte_count()?;
        let Some((header, mark)) = self.headers(self.position)? else {
            return Ok(None);
        };
        let end = chunk_end(self.position, header.records_bytes.get());
        match end {
            Some(end) if is_commit(&mark, &header) && end <= self.byte_count => {
                self.chunk(&header, &mark, end).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// The next chunk, or what lies in its place; `None` at the end.
    pub fn next_chunk(&mut self) -> Result<Option<Chunk>, SequenceError> {
        if self.is_at_end || self.position >= self.byte_count {
            return Ok(None);
        }
        let start = self.position;
        if let Some((header, mark)) = self.headers(start)?
            && let Some(end) = chunk_end(start, header.records_bytes.get())
            && start + RECORDS_OFFSET + header.records_bytes.get() <= self.byte_count
            && (is_commit(&mark, &header) || self.is_whole(start, &header)?)
        {
            return self.chunk(&header, &mark, end).map(Some);
        }
        match self.find_header(start + PAGE)? {
            Some(next) => self.headless(start, next).map(Some),
            // A mark without its header: the chunk was sealed, and is the last.
            None if self.is_marked(start)? => self.headless(start, self.byte_count).map(Some),
            None => self.tail(start),
        }
    }

    /// Whether the records of a chunk without a mark are those that its header sums.
    fn is_whole(&mut self, start: u64, header: &ChunkHeader) -> Result<bool, SequenceError> {
        let bytes = header.records_bytes.get();
        // Headers on every page that claim all the rest would take time that grows with its square.
        let Some(left) = self.sum_budget.checked_sub(bytes) else {
            return Ok(false);
        };
        self.sum_budget = left;
        let crc = crc_of(self.source, start + RECORDS_OFFSET, bytes)?;
        Ok(crc == Some(header.records_crc.get()))
    }

    /// A chunk that was sealed, or lies between others, and whose header does not say how long it is.
    fn headless(&mut self, start: u64, end: u64) -> Result<Chunk, SequenceError> {
        self.position = end;
        let (records, _) = self.walk(start, end)?;
        Ok(Chunk {
            start,
            end,
            number: None,
            state: ChunkState::Headless,
            records,
            damages: vec![Damage::Header {
                offset: start,
                bytes: end - start,
            }],
        })
    }

    /// Whether the commit mark of a chunk at `start` is whole.
    fn is_marked(&self, start: u64) -> Result<bool, SequenceError> {
        let mut bytes = [0; size_of::<CommitMark>()];
        let at = start + size_of::<ChunkHeader>() as u64;
        if self.source.read_exact_at(at, &mut bytes)?.is_none() {
            return Ok(false);
        }
        Ok(CommitMark::read_from_bytes(&bytes)
            .is_ok_and(|mark| is_mark(&mark) && mark.number.get() >= self.least_number))
    }

    /// What lies behind the last sealed chunk.
    fn tail(&mut self, start: u64) -> Result<Option<Chunk>, SequenceError> {
        self.is_at_end = true;
        if !self.has_content(start)? {
            return Ok(None);
        }
        let records = match self.checking {
            Checking::Marks => Vec::new(),
            Checking::Everything => self.walk(start, self.byte_count)?.0,
        };
        Ok(Some(Chunk {
            start,
            end: self.byte_count,
            number: None,
            state: ChunkState::Tail,
            records,
            damages: vec![Damage::Tail {
                offset: start,
                bytes: self.byte_count - start,
            }],
        }))
    }

    /// A sealed chunk at the position; moves behind it.
    fn chunk(
        &mut self,
        header: &ChunkHeader,
        mark: &CommitMark,
        end: u64,
    ) -> Result<Chunk, SequenceError> {
        let start = self.position;
        let number = header.number.get();
        let records_end = start + RECORDS_OFFSET + header.records_bytes.get();
        let mut chunk = Chunk {
            start,
            end,
            number: Some(number),
            state: ChunkState::Sealed,
            records: Vec::new(),
            damages: Vec::new(),
        };
        self.position = end;
        self.least_number = number.saturating_add(1);
        if header.record_count.get() == 0 {
            // Given up by its writer: nothing in it counts.
            return Ok(chunk);
        }
        if !is_commit(mark, header) {
            chunk.damages.push(Damage::CommitMark { chunk: number });
        }
        let index = self.indexed(start, u64::from(header.index_offset.get()), records_end)?;
        let is_indexed = index.is_some();
        chunk.records = match index {
            Some(records) => records,
            None => {
                chunk.damages.push(Damage::Index { chunk: number });
                self.walk(start + RECORDS_OFFSET, records_end)?.0
            }
        };
        if self.checking == Checking::Everything {
            let crc = crc_of(
                self.source,
                start + RECORDS_OFFSET,
                header.records_bytes.get(),
            )?;
            if crc != Some(header.records_crc.get()) {
                self.check_records(&mut chunk, is_indexed, header.record_count.get())?;
            }
        }
        Ok(chunk)
    }

    /// Takes the records out that are damaged, and names them.
    fn check_records(
        &self,
        chunk: &mut Chunk,
        is_indexed: bool,
        record_count: u32,
    ) -> Result<(), SequenceError> {
        // All records but the index; the last one, `end`, is in no index.
        let is_end_missing =
            is_indexed && chunk.records.len() as u64 + 2 == u64::from(record_count);
        let mut whole = Vec::with_capacity(chunk.records.len());
        for place in &chunk.records {
            if self.payload(place)?.is_some() {
                whole.push(*place);
            } else {
                chunk.damages.push(Damage::Record {
                    offset: place.offset,
                    label: place.label,
                });
            }
        }
        if is_end_missing {
            chunk.damages.push(Damage::Record {
                offset: chunk.start,
                label: RecordLabel::of(RecordKind::End, 0),
            });
        } else if is_indexed && whole.len() == chunk.records.len() {
            let chunk_number = chunk.number.unwrap_or_default();
            chunk.damages.push(Damage::Padding {
                chunk: chunk_number,
            });
        }
        chunk.records = whole;
        Ok(())
    }

    /// The payload of a record, or `None` when it is damaged.
    pub fn payload(&self, place: &RecordPlace) -> Result<Option<Vec<u8>>, SequenceError> {
        read_record(
            self.source,
            self.file_id,
            place.offset,
            self.byte_count,
            None,
        )
        .map(|record| record.map(|(_, payload)| payload))
    }

    /// The place of the record at `offset` by what it says itself, or `None` when it is damaged.
    pub fn place(&self, offset: u64) -> Result<Option<RecordPlace>, SequenceError> {
        let record = read_record(self.source, self.file_id, offset, self.byte_count, None)?;
        Ok(record.map(|(header, payload)| place_of(offset, &header, &payload)))
    }

    /// Header and commit mark at `offset`, when a chunk of this file begins there.
    fn headers(&self, offset: u64) -> Result<Option<(ChunkHeader, CommitMark)>, SequenceError> {
        let mut bytes = [0; RECORDS_OFFSET as usize];
        if self.source.read_exact_at(offset, &mut bytes)?.is_none() {
            return Ok(None);
        }
        let (header, rest) = bytes.split_at(size_of::<ChunkHeader>());
        let (Ok(header), Ok(mark)) = (
            ChunkHeader::read_from_bytes(header),
            CommitMark::read_from_bytes(rest),
        ) else {
            return Ok(None);
        };
        let is_ours = self.file_id.is_chunk(&header) && header.number.get() >= self.least_number;
        Ok(is_ours.then_some((header, mark)))
    }

    /// The records that the index at `offset` of the chunk names, when it is whole.
    fn indexed(
        &self,
        start: u64,
        offset: u64,
        records_end: u64,
    ) -> Result<Option<Vec<RecordPlace>>, SequenceError> {
        let at = start + offset;
        let index = read_record(
            self.source,
            self.file_id,
            at,
            records_end,
            Some(RecordKind::Index),
        )?;
        let Some((_, payload)) = index else {
            return Ok(None);
        };
        let Ok(entries) = <[IndexBytes]>::ref_from_bytes(&payload) else {
            return Ok(None);
        };
        let mut records = Vec::with_capacity(entries.len() + 1);
        let mut free_from = RECORDS_OFFSET;
        for entry in entries {
            let entry_offset = u64::from(entry.offset.get());
            let entry_end = entry_offset + record_bytes(u64::from(entry.payload_bytes.get()));
            // In the order of the file: no record is read more than once, whatever an index says.
            if entry_offset < free_from || entry_end > offset || entry_offset % 8 != 0 {
                return Ok(None);
            }
            free_from = entry_end;
            records.push(RecordPlace {
                offset: start + entry_offset,
                payload_bytes: entry.payload_bytes.get(),
                sequence: entry.sequence.get(),
                label: RecordLabel {
                    kind: entry.kind.get(),
                    stream: entry.stream.get(),
                    flags: entry.flags.get(),
                    number: entry.number.get(),
                    device_nanos: entry.device_nanos.get(),
                },
            });
        }
        // `end` stands behind the index, being the last.
        let behind = at + record_bytes(payload.len() as u64);
        let last = read_record(
            self.source,
            self.file_id,
            behind,
            records_end,
            Some(RecordKind::End),
        )?;
        if let Some((header, payload)) = last {
            records.push(place_of(behind, &header, &payload));
        }
        Ok(Some(records))
    }

    /// The valid records in `start..end`, tried at every multiple of 8, and whether all bytes between were
    /// looked at.
    fn walk(&self, start: u64, end: u64) -> Result<(Vec<RecordPlace>, bool), SequenceError> {
        let mut records = Vec::new();
        let mut offset = start.next_multiple_of(8);
        // Bytes that look like many long records would take time that grows with their square.
        let mut budget = (end - start)
            .saturating_mul(WALK_EFFORT)
            .saturating_add(1 << 20);
        let mut window = Window::new(self.source);
        while let Some(at) = window.find(&RECORD_MAGIC, offset, end, 8)? {
            let record = read_record(self.source, self.file_id, at, end, None)?;
            offset = match record {
                Some((header, payload)) => {
                    let place = place_of(at, &header, &payload);
                    if place.label.kind != RecordKind::Index as u16 {
                        records.push(place);
                    }
                    at + record_bytes(payload.len() as u64)
                }
                None => {
                    let Some(left) = budget.checked_sub(claimed_bytes(self.source, at, end)?)
                    else {
                        return Ok((records, false));
                    };
                    budget = left;
                    at + 8
                }
            };
        }
        Ok((records, true))
    }

    /// The first page from `offset` on where a chunk of this file begins.
    fn find_header(&self, offset: u64) -> Result<Option<u64>, SequenceError> {
        let mut window = Window::new(self.source);
        let mut offset = offset.next_multiple_of(PAGE);
        while let Some(at) = window.find(&CHUNK_MAGIC, offset, self.byte_count, PAGE)? {
            if self.headers(at)?.is_some() {
                return Ok(Some(at));
            }
            offset = at + PAGE;
        }
        Ok(None)
    }

    /// Whether anything but zeros stands from `offset` on.
    fn has_content(&self, offset: u64) -> Result<bool, SequenceError> {
        let mut window = Window::new(self.source);
        window.has_content(offset, self.byte_count)
    }
}

/// Times that all bytes may be summed for chunks without a mark; once is enough for files of ours.
const SUM_EFFORT: u64 = 4;
/// Times that bytes may be summed again while records are looked for among damaged ones.
const WALK_EFFORT: u64 = 16;

/// What the first bytes of `source` are.
pub fn beginning<S: ByteSource + ?Sized>(source: &S) -> Result<Beginning, SequenceError> {
    let mut bytes = [0; size_of::<FileHeader>()];
    if source.read_exact_at(0, &mut bytes)?.is_none() {
        return Ok(Beginning::Foreign);
    }
    Ok(FileHeader::read_from_bytes(&bytes).map_or(Beginning::Foreign, |header| header.judge()))
}

/// The id that most of the first chunks carry: for files whose header is damaged.
pub fn id_from_chunks<S: ByteSource + ?Sized>(source: &S) -> Result<Option<FileId>, SequenceError> {
    let byte_count = source.byte_count()?;
    let mut window = Window::new(source);
    let mut offset = PAGE;
    while let Some(at) = window.find(&CHUNK_MAGIC, offset, byte_count, PAGE)? {
        let mut bytes = [0; size_of::<ChunkHeader>()];
        if source.read_exact_at(at, &mut bytes)?.is_some()
            && let Ok(header) = ChunkHeader::read_from_bytes(&bytes)
            && is_some_chunk(&header)
        {
            return Ok(Some(FileId(header.file_id)));
        }
        offset = at + PAGE;
    }
    Ok(None)
}
