//! What a scan finds.

use crate::chunk_writer::RecordLabel;
use crate::layout::FLAG_REPEAT;

/// How much a scan looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checking {
    /// Headers, commit marks and indices: enough to open a file.
    Marks,
    /// Every byte, and the records of a tail that was never sealed.
    Everything,
}

/// Where a record lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordPlace {
    /// Offset of its header in the file.
    pub offset: u64,
    /// Bytes of its payload.
    pub payload_bytes: u32,
    /// Sequence number.
    pub sequence: u64,
    /// What the index says of it.
    pub label: RecordLabel,
}

/// What a chunk is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChunkState {
    /// Sealed.
    Sealed,
    /// Between two chunks or behind its own commit mark, without a header of its own; its records were found
    /// by walking.
    Headless,
    /// Behind the last sealed chunk: never sealed, or cut off.
    Tail,
}

/// A chunk that was found.
#[derive(Clone, Debug)]
pub struct Chunk {
    /// Offset in the file.
    pub start: u64,
    /// Where the next one should be.
    pub end: u64,
    /// Its number, where it has a header.
    pub number: Option<u64>,
    /// What it is worth.
    pub state: ChunkState,
    /// Its records, without the index. Only with [`Checking::Everything`] are all of them known to be whole.
    pub records: Vec<RecordPlace>,
    /// What is wrong with it.
    pub damages: Vec<Damage>,
}

/// Something that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The beginning of the file.
    FileHeader,
    /// No chunk begins where one should; `bytes` up to the next one.
    Header {
        /// Where.
        offset: u64,
        /// How much was walked instead.
        bytes: u64,
    },
    /// A commit mark, of a chunk whose records are whole.
    CommitMark {
        /// Number of the chunk.
        chunk: u64,
    },
    /// An index; the records were found by walking.
    Index {
        /// Number of the chunk.
        chunk: u64,
    },
    /// A record is lost.
    Record {
        /// Where.
        offset: u64,
        /// What it was.
        label: RecordLabel,
    },
    /// Bytes between records, which hold nothing.
    Padding {
        /// Number of the chunk.
        chunk: u64,
    },
    /// Bytes behind the last sealed chunk that are not all zero.
    Tail {
        /// Where they begin.
        offset: u64,
        /// How many there are up to the end of the file.
        bytes: u64,
    },
}

impl RecordPlace {
    /// The samples of a frame repeat those before it.
    pub fn is_repeat(&self) -> bool {
        self.label.flags & FLAG_REPEAT != 0
    }
}
