//! Single records at an offset.

use zerocopy::FromBytes as _;

use super::RecordPlace;
use crate::checksum::FileId;
use crate::chunk_writer::RecordLabel;
use crate::error::SequenceError;
use crate::layout::{
    FrameHeader, GapHeader, MOST_PAYLOAD_BYTES, RECORD_HEADER_BYTES, RECORD_MAGIC, RecordHeader,
};
use crate::record::RecordKind;
use crate::source::ByteSource;

/// Header and payload of the record at `offset`, when it is whole, ends before `end` and is of `kind`.
pub(crate) fn read_record<S: ByteSource + ?Sized>(
    source: &S,
    file_id: FileId,
    offset: u64,
    end: u64,
    kind: Option<RecordKind>,
) -> Result<Option<(RecordHeader, Vec<u8>)>, SequenceError> {
    let Some(room) = end
        .checked_sub(offset)
        .and_then(|room| room.checked_sub(RECORD_HEADER_BYTES))
    else {
        return Ok(None);
    };
    let mut bytes = [0; RECORD_HEADER_BYTES as usize];
    if source.read_exact_at(offset, &mut bytes)?.is_none() {
        return Ok(None);
    }
    let Ok(header) = RecordHeader::read_from_bytes(&bytes) else {
        return Ok(None);
    };
    let payload_bytes = u64::from(header.payload_bytes.get());
    if header.magic != RECORD_MAGIC
        || payload_bytes > room.min(MOST_PAYLOAD_BYTES)
        || kind.is_some_and(|kind| header.kind.get() != kind as u16)
    {
        return Ok(None);
    }
    // Not more than the file has: `room` ends at its end or before.
    let mut payload = vec![0; payload_bytes as usize];
    if source
        .read_exact_at(offset + RECORD_HEADER_BYTES, &mut payload)?
        .is_none()
    {
        return Ok(None);
    }
    Ok(file_id
        .is_record(&header, &payload)
        .then_some((header, payload)))
}

/// What a damaged record claims to be long, within `end`: the work that was spent on it.
pub(super) fn claimed_bytes<S: ByteSource + ?Sized>(
    source: &S,
    offset: u64,
    end: u64,
) -> Result<u64, SequenceError> {
    let mut bytes = [0; RECORD_HEADER_BYTES as usize];
    if source.read_exact_at(offset, &mut bytes)?.is_none() {
        return Ok(0);
    }
    let claimed = RecordHeader::read_from_bytes(&bytes)
        .map_or(0, |header| u64::from(header.payload_bytes.get()));
    Ok(if claimed <= end - offset { claimed } else { 0 })
}

/// The place of a record that was read, with what an index would say of it.
pub(crate) fn place_of(offset: u64, header: &RecordHeader, payload: &[u8]) -> RecordPlace {
    let mut label = RecordLabel {
        kind: header.kind.get(),
        stream: header.stream.get(),
        ..RecordLabel::default()
    };
    match RecordKind::from_number(label.kind) {
        Some(RecordKind::Frame) => {
            if let Ok((frame, _)) = FrameHeader::ref_from_prefix(payload) {
                label.flags = frame.flags.get();
                label.number = frame.number.get();
                label.device_nanos = frame.device_nanos.get();
            }
        }
        Some(RecordKind::Gap) => {
            if let Ok((gap, _)) = GapHeader::ref_from_prefix(payload) {
                label.number = gap.first_number.get();
            }
        }
        _ => {}
    }
    RecordPlace {
        offset,
        payload_bytes: header.payload_bytes.get(),
        sequence: header.sequence.get(),
        label,
    }
}
