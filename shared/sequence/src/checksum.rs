//! What ties bytes to one file: its id and the checksums that the id enters.

use zerocopy::IntoBytes as _;

use crate::layout::{
    ANY_VERSION, CHUNK_MAGIC, COMMIT_MAGIC, ChunkHeader, CommitMark, FileHeader, MAGIC,
    MOST_CHUNK_BYTES, MOST_PAYLOAD_BYTES, PAGE, RECORD_MAGIC, RECORDS_OFFSET, RecordHeader,
};

/// The random id of a file (`docs/sequence-format.md` section 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FileId(pub [u8; 16]);

impl FileId {
    /// An id that no other file has: 128 bits of the operating system's randomness.
    pub fn random() -> std::io::Result<Self> {
        let mut id = [0; 16];
        let mut filled = 0;
        while filled < id.len() {
            filled +=
                rustix::rand::getrandom(&mut id[filled..], rustix::rand::GetRandomFlags::empty())?;
        }
        Ok(Self(id))
    }

    /// The id of a file that is computed from others: the same for the same `parts`.
    pub fn of_content(parts: &[&[u8]]) -> Self {
        let mut hasher = blake3::Hasher::new();
        for part in parts {
            hasher.update(&(part.len() as u64).to_le_bytes());
            hasher.update(part);
        }
        let mut id = [0; 16];
        id.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
        Self(id)
    }

    /// CRC of a record: the id, its header without the CRC field, its payload in `parts`.
    pub fn record_crc(self, header: &RecordHeader, parts: &[&[u8]]) -> u32 {
        let header = header.as_bytes();
        let mut crc = crc32c::crc32c(&self.0);
        crc = crc32c::crc32c_append(crc, &header[..12]);
        crc = crc32c::crc32c_append(crc, &header[16..]);
        for part in parts {
            crc = crc32c::crc32c_append(crc, part);
        }
        crc
    }

    /// Whether `header` can begin a record and `payload` is its payload.
    pub fn is_record(self, header: &RecordHeader, payload: &[u8]) -> bool {
        header.magic == RECORD_MAGIC
            && payload.len() as u64 == u64::from(header.payload_bytes.get())
            && u64::from(header.payload_bytes.get()) <= MOST_PAYLOAD_BYTES
            && header.crc.get() == self.record_crc(header, &[payload])
    }

    /// Whether `header` is the header of a chunk of this file.
    pub fn is_chunk(self, header: &ChunkHeader) -> bool {
        header.file_id == self.0 && is_some_chunk(header)
    }
}

/// Whether `header` is the header of a chunk of some file: its id is then that of the file.
pub fn is_some_chunk(header: &ChunkHeader) -> bool {
    header.magic == CHUNK_MAGIC
        && header.crc.get() == crc32c::crc32c(&header.as_bytes()[..60])
        && header.records_bytes.get() <= MOST_CHUNK_BYTES
        && header.records_bytes.get().is_multiple_of(8)
        && u64::from(header.index_offset.get()) >= RECORDS_OFFSET
}

/// Whether `mark` commits some chunk.
pub fn is_mark(mark: &CommitMark) -> bool {
    mark.magic == COMMIT_MAGIC && mark.crc.get() == crc32c::crc32c(&mark.as_bytes()[..60])
}

/// Whether `mark` commits the chunk that begins with `header`.
pub fn is_commit(mark: &CommitMark, header: &ChunkHeader) -> bool {
    is_mark(mark)
        && mark.number == header.number
        && mark.records_crc == header.records_crc
        && mark.header_crc == header.crc
}

impl FileHeader {
    /// The first page of a file.
    pub fn page(file_id: FileId) -> [u8; PAGE as usize] {
        let mut header = Self {
            magic: MAGIC,
            minor: 0.into(),
            reserved: [0; 4],
            file_id: file_id.0,
            reserved_too: [0; 4],
            crc: 0.into(),
        };
        header.crc = crc32c::crc32c(&header.as_bytes()[..60]).into();
        let mut page = [0; PAGE as usize];
        page[..size_of::<Self>()].copy_from_slice(header.as_bytes());
        page
    }

    /// What the beginning of a file says.
    pub fn judge(&self) -> Beginning {
        if self.magic == MAGIC {
            if self.crc.get() == crc32c::crc32c(&self.as_bytes()[..60]) {
                Beginning::Recording(FileId(self.file_id))
            } else {
                Beginning::Damaged
            }
        } else if self.magic.starts_with(ANY_VERSION) {
            Beginning::OtherVersion
        } else {
            Beginning::Foreign
        }
    }
}

/// What a file is, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beginning {
    /// A recording of this version.
    Recording(FileId),
    /// A recording of this version whose header is damaged.
    Damaged,
    /// A recording of another version.
    OtherVersion,
    /// Something else, or a recording whose first line is damaged.
    Foreign,
}

impl ChunkHeader {
    /// A header whose checksum is right.
    pub fn sealed(
        file_id: FileId,
        number: u64,
        records_bytes: u64,
        record_count: u32,
        index_offset: u32,
        first_sequence: u64,
        records_crc: u32,
    ) -> Self {
        let mut header = Self {
            magic: CHUNK_MAGIC,
            file_id: file_id.0,
            number: number.into(),
            records_bytes: records_bytes.into(),
            record_count: record_count.into(),
            index_offset: index_offset.into(),
            first_sequence: first_sequence.into(),
            records_crc: records_crc.into(),
            crc: 0.into(),
        };
        header.crc = crc32c::crc32c(&header.as_bytes()[..60]).into();
        header
    }

    /// The mark that commits this chunk.
    pub fn commit_mark(&self) -> CommitMark {
        let mut mark = CommitMark {
            magic: COMMIT_MAGIC,
            number: self.number,
            records_crc: self.records_crc,
            header_crc: self.crc,
            reserved: [0; 36],
            crc: 0.into(),
        };
        mark.crc = crc32c::crc32c(&mark.as_bytes()[..60]).into();
        mark
    }
}
