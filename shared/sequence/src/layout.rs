//! The bytes of version 1, as structures: `docs/sequence-format.md` sections 3 to 6.
//!
//! All numbers are little-endian and unaligned, so that any slice can be looked at through them.

use zerocopy::byteorder::little_endian::{F32, F64, I64, U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

/// The first bytes of a file of this version.
pub const MAGIC: [u8; 32] = *b"glint recording, version 1\n\0\0\0\0\0";
/// How recordings of every version begin.
pub const ANY_VERSION: &[u8] = b"glint recording, version ";
/// The first bytes of a chunk.
pub const CHUNK_MAGIC: [u8; 8] = *b"\x89glchunk";
/// The first bytes of a commit mark.
pub const COMMIT_MAGIC: [u8; 8] = *b"glcommit";
/// The first bytes of a record.
pub const RECORD_MAGIC: [u8; 4] = *b"gRec";

/// Chunks begin on multiples of this.
pub const PAGE: u64 = 4096;
/// From the start of a chunk to its first record.
pub const RECORDS_OFFSET: u64 = 128;
/// Bytes of [`RecordHeader`].
pub const RECORD_HEADER_BYTES: u64 = 24;
/// Most bytes in the payload of a record.
pub const MOST_PAYLOAD_BYTES: u64 = 1 << 30;
/// Most bytes of all records of a chunk.
pub const MOST_CHUNK_BYTES: u64 = 1 << 31;
/// Largest offset in a file.
pub const MOST_OFFSET: u64 = 1 << 62;
/// Highest stream id.
pub const MOST_STREAMS: u16 = 64;

/// A frame repeats its predecessor.
pub const FLAG_REPEAT: u32 = 1;
/// The raw device counter of a frame is known.
pub const FLAG_TICKS: u32 = 2;
/// The host times of a frame are known.
pub const FLAG_HOST: u32 = 4;

/// The beginning of the file (section 3).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct FileHeader {
    /// [`MAGIC`].
    pub magic: [u8; 32],
    /// Minor version.
    pub minor: U32,
    /// Zero.
    pub reserved: [u8; 4],
    /// Random, in every chunk.
    pub file_id: [u8; 16],
    /// Zero.
    pub reserved_too: [u8; 4],
    /// CRC of the bytes before.
    pub crc: U32,
}

/// The beginning of a chunk (section 4).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct ChunkHeader {
    /// [`CHUNK_MAGIC`].
    pub magic: [u8; 8],
    /// Id of the file.
    pub file_id: [u8; 16],
    /// 0, 1, 2 …
    pub number: U64,
    /// Bytes of all records.
    pub records_bytes: U64,
    /// Number of records.
    pub record_count: U32,
    /// Offset of the index record from the start of the chunk.
    pub index_offset: U32,
    /// Sequence number of the first record.
    pub first_sequence: U64,
    /// CRC of all records.
    pub records_crc: U32,
    /// CRC of the bytes before.
    pub crc: U32,
}

/// What follows the header of a chunk that is durable (section 4).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct CommitMark {
    /// [`COMMIT_MAGIC`].
    pub magic: [u8; 8],
    /// Number of the chunk.
    pub number: U64,
    /// As in the header.
    pub records_crc: U32,
    /// As in the header.
    pub header_crc: U32,
    /// Zero.
    pub reserved: [u8; 36],
    /// CRC of the bytes before.
    pub crc: U32,
}

/// The beginning of a record (section 5).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct RecordHeader {
    /// [`RECORD_MAGIC`].
    pub magic: [u8; 4],
    /// Kind.
    pub kind: U16,
    /// Stream, 0 for none.
    pub stream: U16,
    /// Bytes of payload.
    pub payload_bytes: U32,
    /// CRC of the file id, this header without the CRC, and the payload.
    pub crc: U32,
    /// One more in each record of the file.
    pub sequence: U64,
}

/// The beginning of a frame's payload (section 6.3).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct FrameHeader {
    /// Counts what the source sent or should have sent.
    pub number: U64,
    /// Raw device counter.
    pub device_ticks: U64,
    /// Device time, unwrapped.
    pub device_nanos: I64,
    /// Host time at the first byte.
    pub host_first_nanos: I64,
    /// Host time at the last byte.
    pub host_last_nanos: I64,
    /// [`FLAG_REPEAT`], [`FLAG_TICKS`], [`FLAG_HOST`].
    pub flags: U32,
    /// Zero.
    pub reserved: [u8; 4],
}

/// The beginning of a gap's payload (section 6.4).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct GapHeader {
    /// First number that is missing.
    pub first_number: U64,
    /// How many are missing.
    pub count: U64,
    /// Device time of the frame before, or the least i64.
    pub from_nanos: I64,
    /// Device time of the frame after, or the greatest i64.
    pub to_nanos: I64,
    /// Cause.
    pub cause: U16,
    /// Zero.
    pub reserved: [u8; 6],
}

/// The beginning of a poses record (section 6.7).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct PosesHeader {
    /// Id of the set.
    pub set: U16,
    /// Zero.
    pub reserved: [u8; 6],
}

/// One pose (section 6.7).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct PoseBytes {
    /// Number of the frame.
    pub number: U64,
    /// World that the pose is in.
    pub map: U32,
    /// 1 OK, 2 WEAK, 3 LOST.
    pub state: u8,
    /// Axes that are not observed.
    pub weak_axes: u8,
    /// Bit 0: the covariance is known.
    pub flags: U16,
    /// Unit quaternion x, y, z, w.
    pub rotation: [F64; 4],
    /// Metres.
    pub translation: [F64; 3],
    /// Upper triangle by rows.
    pub covariance: [F32; 21],
    /// Zero.
    pub reserved: [u8; 4],
}

/// A gravity record's payload (section 6.8).
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct GravityBytes {
    /// Number of the frame.
    pub number: U64,
    /// Unit vector of down in camera axes.
    pub down: [F64; 3],
    /// Standard deviation, radians.
    pub sigma: F32,
    /// Zero.
    pub reserved: [u8; 4],
}

/// One record of a chunk, in its index (section 6.12).
#[derive(
    Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned,
)]
#[repr(C)]
pub struct IndexBytes {
    /// Offset of the record from the start of the chunk.
    pub offset: U32,
    /// Bytes of its payload.
    pub payload_bytes: U32,
    /// Kind.
    pub kind: U16,
    /// Stream.
    pub stream: U16,
    /// Flags of a frame.
    pub flags: U32,
    /// Number of a frame, first number of a gap.
    pub number: U64,
    /// Device time of a frame.
    pub device_nanos: I64,
    /// Sequence number.
    pub sequence: U64,
}

/// Bytes of a record with a payload of `payload_bytes`, with its padding.
pub const fn record_bytes(payload_bytes: u64) -> u64 {
    (RECORD_HEADER_BYTES + payload_bytes).next_multiple_of(8)
}

/// Where the chunk after one at `start` with `records_bytes` of records begins; `None` beyond
/// [`MOST_OFFSET`].
pub fn chunk_end(start: u64, records_bytes: u64) -> Option<u64> {
    start
        .checked_add(RECORDS_OFFSET)?
        .checked_add(records_bytes)?
        .checked_next_multiple_of(PAGE)
        .filter(|end| *end <= MOST_OFFSET)
}

// The layout is part of files: a change of these numbers is a change of the version.
const _: () = assert!(size_of::<FileHeader>() == 64);
const _: () = assert!(size_of::<ChunkHeader>() == 64 && size_of::<CommitMark>() == 64);
const _: () = assert!(size_of::<RecordHeader>() == RECORD_HEADER_BYTES as usize);
const _: () = assert!(size_of::<FrameHeader>() == 48 && size_of::<GapHeader>() == 40);
const _: () = assert!(size_of::<PosesHeader>() == 8 && size_of::<PoseBytes>() == 160);
const _: () = assert!(size_of::<GravityBytes>() == 40 && size_of::<IndexBytes>() == 40);
