//! Checksums made right again after a change: what a program that writes nonsense would leave.

use sequence::FileId;
use sequence::layout::{
    CHUNK_MAGIC, ChunkHeader, FileHeader, PAGE, RECORD_MAGIC, RECORDS_OFFSET, RecordHeader,
};
use zerocopy::{FromBytes as _, IntoBytes as _};

/// Makes the CRC of the record at `offset` right, as far as the file has its payload.
pub(crate) fn record(bytes: &mut [u8], file_id: FileId, offset: usize) {
    let Ok((mut header, rest)) = RecordHeader::read_from_prefix(&bytes[offset..]) else {
        return;
    };
    let length = rest.len().min(header.payload_bytes.get() as usize);
    header.crc = file_id.record_crc(&header, &[&rest[..length]]).into();
    bytes[offset..offset + size_of::<RecordHeader>()].copy_from_slice(header.as_bytes());
}

/// Makes the sums over the chunk at `start` right, and its commit mark.
pub(crate) fn chunk(bytes: &mut [u8], start: usize) {
    let Ok((mut header, _)) = ChunkHeader::read_from_prefix(&bytes[start..]) else {
        return;
    };
    let records_start = start + RECORDS_OFFSET as usize;
    if records_start > bytes.len() {
        return;
    }
    let room = bytes.len() - records_start;
    let length =
        usize::try_from(header.records_bytes.get()).map_or(room, |length| length.min(room));
    header.records_crc = crc32c::crc32c(&bytes[records_start..records_start + length]).into();
    header.crc = crc32c::crc32c(&header.as_bytes()[..60]).into();
    let both = [header.as_bytes(), header.commit_mark().as_bytes()].concat();
    bytes[start..start + both.len()].copy_from_slice(&both);
}

/// Makes all sums of a file right, under the id in its header.
pub(crate) fn everything(bytes: &mut [u8]) {
    let Ok((mut header, _)) = FileHeader::read_from_prefix(bytes) else {
        return;
    };
    header.crc = crc32c::crc32c(&header.as_bytes()[..60]).into();
    bytes[..size_of::<FileHeader>()].copy_from_slice(header.as_bytes());
    let file_id = FileId(header.file_id);
    for offset in (PAGE as usize..bytes.len()).step_by(8) {
        if bytes[offset..].starts_with(&RECORD_MAGIC) {
            record(bytes, file_id, offset);
        }
    }
    for start in (PAGE as usize..bytes.len()).step_by(PAGE as usize) {
        if bytes[start..].starts_with(&CHUNK_MAGIC) {
            chunk(bytes, start);
        }
    }
}
