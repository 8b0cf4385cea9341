//! Bytes that are not ours, and claims that cannot be.

use sequence::layout::{ChunkHeader, RecordHeader};
use sequence::scan::{Checking, RecordPlace, Scanner};
use sequence::{FileId, SequenceError};
use serde_json::json;
use zerocopy::{FromBytes as _, IntoBytes as _};

use crate::damage::{Base, FILE, flip, put};
use crate::tiny::{Scene, UNKNOWN_KIND};
use crate::{Outcome, Vectors, truth, written};

/// Bytes of another recording, or of another place of this one.
pub(crate) fn bytes(vectors: &mut Vectors) -> Outcome {
    let base = Base::new()?;
    let other = Scene {
        file_id: FileId(*b"another glint id"),
        ..Scene::default()
    };
    vectors.whole("other", &other, "the same frames under another file id")?;
    let (second, third) = (base.chunks[1], base.chunks[2]);
    let copy = |name: &str, from: u64| json!({"at": second, "file": name, "from": from, "bytes": third - second});
    let second_gone = [(1, 2), (1, 4), (2, 2), (2, 4)];
    vectors.add(
        "chunk-of-another-file",
        FILE,
        &[copy("other.glint", second)],
        Some(base.holds(&second_gone, &["header"])),
        "the second chunk is that of another recording (blocks used before): nothing of it is taken",
    )?;
    vectors.add(
        "chunk-again",
        FILE,
        &[copy(FILE, base.chunks[0])],
        Some(base.holds(&second_gone, &["header"])),
        "the first chunk stands in the place of the second too: its number does not fit, its frames count once",
    )?;
    embedded(vectors, &other)
}

/// A recording inside a record of this one, on pages, as if it belonged to it.
fn embedded(vectors: &mut Vectors, other: &Scene) -> Outcome {
    let mut scene = Scene {
        extra: Some((UNKNOWN_KIND, Vec::new())),
        ..Scene::default()
    };
    let place_of = |bytes: &[u8]| -> Result<Option<RecordPlace>, SequenceError> {
        let mut scanner = Scanner::begin(bytes, Checking::Everything)?;
        while let Some(chunk) = scanner.next_chunk()? {
            let is_extra = |place: &&RecordPlace| place.label.kind == UNKNOWN_KIND;
            if let Some(place) = chunk.records.iter().find(is_extra) {
                return Ok(Some(*place));
            }
        }
        Ok(None)
    };
    let place = place_of(&written(&scene)?)?.ok_or("no record")?;
    let start = place.offset + 24;
    let mut payload = vec![0; (start.next_multiple_of(4096) - start) as usize];
    payload.extend_from_slice(&written(other)?[4096..3 * 4096]);
    scene.extra = Some((UNKNOWN_KIND, payload));
    let describes = "a record holds chunks of another recording, on pages: they are its payload and nothing else";
    vectors.whole("embedded", &scene, describes)?;
    let bytes = written(&scene)?;
    let file = "embedded.glint";
    let mut scanner = Scanner::begin(bytes.as_slice(), Checking::Marks)?;
    let mut chunks = Vec::new();
    while let Some(chunk) = scanner.next_chunk()? {
        chunks.push(chunk);
    }
    let last = chunks.last().ok_or("no chunk")?;
    let mut holds = truth::without(&scene, &[(1, 5), (2, 5)]);
    holds.insert("damages".to_owned(), json!(["tail"]));
    let describes = "the chunk around it has lost its header and its mark, the record a bit: the pages inside are looked at \
        and are not ours";
    let flips = [
        flip(last.start + 2),
        flip(last.start + 66),
        flip(place.offset + 40),
    ];
    vectors.add("embedded-in-the-tail", file, &flips, Some(holds), describes)
}

/// Sizes that cannot be, under checksums that are right.
pub(crate) fn claims(vectors: &mut Vectors) -> Outcome {
    let base = Base::new()?;
    let second = base.chunks[1];
    let header = |change: &dyn Fn(&mut ChunkHeader)| {
        let mut header = base.header(1)?;
        change(&mut header);
        header.crc = crc32c::crc32c(&header.as_bytes()[..60]).into();
        let mark = header.commit_mark();
        Outcome::Ok(put(second, &[header.as_bytes(), mark.as_bytes()].concat()))
    };
    let found = || Some(base.loses(&[], &["header"]));
    for (name, edit, describes) in [
        (
            "hostile-chunk-beyond-file",
            header(&|header| header.records_bytes = (1 << 30).into())?,
            "a chunk that claims more than the file has",
        ),
        (
            "hostile-chunk-size",
            header(&|header| header.records_bytes = u64::MAX.into())?,
            "a chunk that claims 2^64 - 1 bytes",
        ),
        (
            "hostile-chunk-odd",
            header(&|header| header.records_bytes = (header.records_bytes.get() + 4).into())?,
            "a chunk whose size is no multiple of 8",
        ),
    ] {
        vectors.add(name, FILE, &[edit], found(), describes)?;
    }
    let index = |offset: u32| header(&move |header| header.index_offset = offset.into());
    for (name, edit, describes) in [
        (
            "hostile-index-beyond",
            index(u32::MAX - 7)?,
            "an index far behind its chunk",
        ),
        (
            "hostile-index-on-frame",
            index((base.frame(1, 4)?.offset - second) as u32)?,
            "an index that is a frame",
        ),
    ] {
        let holds = Some(base.loses(&[], &["index"]));
        vectors.add(name, FILE, &[edit], holds, describes)?;
    }
    let frame = base.frame(1, 2)?;
    let mut record = RecordHeader::read_from_prefix(&base.bytes[frame.offset as usize..])
        .map_err(|_| "no record")?
        .0;
    record.payload_bytes = u32::MAX.into();
    vectors.add(
        "hostile-record-length",
        FILE,
        &[put(frame.offset, record.as_bytes())],
        Some(base.loses(&[(1, 2)], &["record"])),
        "a record that claims 2^32 - 1 bytes",
    )
}
