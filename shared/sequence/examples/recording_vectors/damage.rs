//! Edits of the vector `three-chunks` and what is left behind them.

use sequence::checksum::is_some_chunk;
use sequence::layout::{ChunkHeader, FileHeader, MAGIC};
use sequence::record::RecordKind;
use sequence::scan::{Checking, RecordPlace, Scanner};
use serde_json::{Map, Value, json};
use zerocopy::{FromBytes as _, IntoBytes as _};

use crate::tiny::Scene;
use crate::{Outcome, Vectors, truth, written};

pub(crate) const FILE: &str = "three-chunks.glint";

/// The file that is damaged, and where its parts lie.
pub(crate) struct Base {
    scene: Scene,
    pub(crate) bytes: Vec<u8>,
    /// Where the chunks begin.
    pub(crate) chunks: Vec<u64>,
    records: Vec<RecordPlace>,
}

impl Base {
    pub(crate) fn new() -> Outcome<Self> {
        Self::of(Scene::default())
    }

    fn of(scene: Scene) -> Outcome<Self> {
        let bytes = written(&scene)?;
        let mut chunks = Vec::new();
        let mut records = Vec::new();
        let mut scanner = Scanner::begin(bytes.as_slice(), Checking::Everything)?;
        while let Some(chunk) = scanner.next_chunk()? {
            chunks.push(chunk.start);
            records.extend(chunk.records);
        }
        Ok(Self {
            scene,
            bytes,
            chunks,
            records,
        })
    }

    /// The frame `number` of `stream`.
    pub(crate) fn frame(&self, stream: u16, number: u64) -> Outcome<RecordPlace> {
        let is_it = |place: &&RecordPlace| {
            place.label.kind == RecordKind::Frame as u16
                && (place.label.stream, place.label.number) == (stream, number)
        };
        let found = self.records.iter().find(is_it);
        Ok(*found.ok_or("no such frame")?)
    }

    /// All records of a kind.
    fn of_kind(&self, kind: RecordKind) -> impl Iterator<Item = &RecordPlace> {
        self.records
            .iter()
            .filter(move |place| place.label.kind == kind as u16)
    }

    pub(crate) fn header(&self, chunk: usize) -> Outcome<ChunkHeader> {
        let bytes = &self.bytes[self.chunks[chunk] as usize..];
        let header = ChunkHeader::read_from_prefix(bytes)
            .map_err(|_| "no header")?
            .0;
        assert!(is_some_chunk(&header));
        Ok(header)
    }

    fn index_offset(&self, chunk: usize) -> Outcome<u64> {
        Ok(self.chunks[chunk] + u64::from(self.header(chunk)?.index_offset.get()))
    }

    /// What is held with these frames gone and these damages.
    pub(crate) fn holds(&self, gone: &[(u16, u64)], damages: &[&str]) -> Map<String, Value> {
        let mut holds = truth::without(&self.scene, gone);
        holds.insert("damages".to_owned(), json!(damages));
        holds
    }

    /// The same, of damage that does not hide which frames are lost and nothing else.
    pub(crate) fn loses(&self, lost: &[(u16, u64)], damages: &[&str]) -> Map<String, Value> {
        let mut holds = truth::everything(&self.scene);
        holds.extend(self.holds(lost, damages));
        let words = lost
            .iter()
            .map(|(stream, number)| format!("{stream} {number}"));
        holds.insert("lost".to_owned(), json!(words.collect::<Vec<_>>()));
        holds
    }
}

pub(crate) fn flip(at: u64) -> Value {
    json!({"at": at, "xor": "10"})
}

pub(crate) fn put(at: u64, bytes: &[u8]) -> Value {
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    json!({"at": at, "put": digits})
}

/// The first page.
pub(crate) fn of_headers(vectors: &mut Vectors) -> Outcome {
    let base = Base::new()?;
    for (name, at, describes) in [
        ("file-header-line", 3, "a bit of the first line"),
        ("file-header-id", 41, "a bit of the file id"),
        ("file-header-crc", 62, "a bit of the CRC of the file header"),
    ] {
        vectors.add(name, FILE, &[flip(at)], None, describes)?;
    }
    let with = |magic: [u8; 32], minor: u32| {
        let mut header = FileHeader::read_from_bytes(&base.bytes[..64]).map_err(|_| "no header")?;
        header.magic = magic;
        header.minor = minor.into();
        header.reserved = [0xee; 4];
        header.crc = crc32c::crc32c(&header.as_bytes()[..60]).into();
        Outcome::Ok(put(0, header.as_bytes()))
    };
    vectors.add(
        "minor-version",
        FILE,
        &[with(MAGIC, 7)?],
        Some(base.loses(&[], &[])),
        "minor version 7, with something in bytes that are zero in version 1.0: read as it is",
    )?;
    let mut magic = MAGIC;
    magic[25] = b'2';
    let describes = "major version 2: refused";
    vectors.add("major-version", FILE, &[with(magic, 0)?], None, describes)?;
    let cut = |length: u64| json!({"cut": length});
    vectors.add("cut-in-file-header", FILE, &[cut(40)], None, "40 bytes")?;
    vectors.add(
        "cut-behind-file-header",
        FILE,
        &[cut(64)],
        None,
        "a file header and nothing else",
    )?;
    let zeros = json!({"at": 4096, "zeros": base.bytes.len() - 4096});
    vectors.add(
        "no-chunk",
        FILE,
        &[zeros],
        None,
        "a file header and reserved space",
    )
}

/// Chunk headers, commit marks, indices.
pub(crate) fn of_chunks(vectors: &mut Vectors) -> Outcome {
    let base = Base::new()?;
    let (second, third) = (base.chunks[1], base.chunks[2]);
    vectors.add(
        "chunk-header",
        FILE,
        &[flip(second + 33)],
        Some(base.loses(&[], &["header"])),
        "a bit of the size in a chunk header: the records are found by walking",
    )?;
    vectors.add(
        "commit-mark",
        FILE,
        &[flip(second + 85)],
        Some(base.loses(&[], &["commit-mark"])),
        "a bit of a commit mark: the CRC of the records says that the chunk is sealed",
    )?;
    let image = flip(base.frame(2, 4)?.offset + 90);
    vectors.add(
        "commit-mark-and-frame",
        FILE,
        &[flip(second + 85), image.clone()],
        Some(base.holds(&[(2, 4)], &["header"])),
        "a commit mark and a frame: the chunk is not sealed, but stands between others; its other records are \
            found by walking, and nothing says which was lost",
    )?;
    vectors.add(
        "index",
        FILE,
        &[flip(base.index_offset(1)? + 70)],
        Some(base.loses(&[], &["index"])),
        "a bit of an index: the records are found by walking",
    )?;
    vectors.add(
        "index-and-frame",
        FILE,
        &[flip(base.index_offset(1)? + 70), image],
        Some(base.holds(&[(2, 4)], &["index"])),
        "an index and a frame: nothing says which was lost",
    )?;
    vectors.add(
        "last-chunk-header",
        FILE,
        &[flip(third + 3)],
        Some(base.loses(&[], &["header"])),
        "the header of the last chunk: its commit mark says that it was sealed",
    )?;
    vectors.add(
        "last-chunk-header-and-mark",
        FILE,
        &[flip(third + 3), flip(third + 65)],
        Some(base.holds(&[(1, 5), (2, 5)], &["tail"])),
        "header and commit mark of the last chunk: nothing says that it was sealed, so it is the tail",
    )?;
    let bytes = third - second;
    vectors.add(
        "chunk-of-zeros",
        FILE,
        &[json!({"at": second, "zeros": bytes})],
        Some(base.holds(&[(1, 2), (1, 4), (2, 2), (2, 4)], &["header"])),
        "a chunk whose pages were lost: the next one is found behind them",
    )?;
    let at = base.frame(1, 4)?.offset / 512 * 512;
    let mut holds = base.holds(&[], &[]);
    let gone: Vec<(u16, u64)> = base
        .records
        .iter()
        .filter(|place| {
            let end = place.offset + 24 + u64::from(place.payload_bytes);
            place.label.kind == RecordKind::Frame as u16 && place.offset < at + 512 && at < end
        })
        .map(|place| (place.label.stream, place.label.number))
        .collect();
    holds.extend(truth::without(&base.scene, &gone));
    holds.remove("damages");
    vectors.add(
        "sector-of-zeros",
        FILE,
        &[json!({"at": at, "zeros": 512})],
        Some(holds),
        "a sector of 512 bytes was lost: the records in it are, others are not",
    )
}

/// Single records.
pub(crate) fn of_records(vectors: &mut Vectors) -> Outcome {
    let base = Base::new()?;
    let depth = base.frame(1, 2)?.offset;
    for (name, offset, describes) in [
        ("frame-image", 60, "a bit of the image of a frame"),
        ("frame-magic", 1, "a bit of the magic of a frame record"),
        (
            "frame-length",
            9,
            "a bit of the length of a frame record: it claims 4096 bytes more or less",
        ),
        (
            "frame-sequence",
            17,
            "a bit of the sequence number of a frame record",
        ),
        (
            "frame-number",
            25,
            "a bit of the number of a frame: the index says which frame is lost",
        ),
    ] {
        let holds = base.loses(&[(1, 2)], &["record"]);
        vectors.add(name, FILE, &[flip(depth + offset)], Some(holds), describes)?;
    }
    let lost = |kind: RecordKind, count: usize| json!(vec![format!("kind {}", kind as u16); count]);
    let description = base
        .of_kind(RecordKind::Description)
        .next()
        .ok_or("no description")?;
    let mut holds = base.loses(&[], &["record"]);
    holds.insert("lost".to_owned(), lost(RecordKind::Description, 1));
    vectors.add(
        "first-description",
        FILE,
        &[flip(description.offset + 100)],
        Some(holds),
        "the first description: that of another chunk serves",
    )?;
    let tables: Vec<Value> = base
        .of_kind(RecordKind::DepthTable)
        .map(|place| flip(place.offset + 30))
        .collect();
    let mut holds = base.loses(&[], &["record"]);
    holds.insert("lost".to_owned(), lost(RecordKind::DepthTable, 1));
    vectors.add(
        "first-table",
        FILE,
        &tables[..1],
        Some(holds),
        "the first copy of a table: that of the next chunk serves",
    )?;
    let depth_frames: Vec<(u16, u64)> = base.scene.numbers().map(|number| (1, number)).collect();
    let mut holds = base.loses(&depth_frames, &vec!["record"; tables.len()]);
    holds.insert("tables".to_owned(), json!([]));
    let mut words: Vec<String> = depth_frames
        .iter()
        .map(|(stream, number)| format!("{stream} {number}"))
        .collect();
    words.extend(vec!["kind 2".to_owned(); tables.len()]);
    holds.insert("lost".to_owned(), json!(words));
    vectors.add(
        "all-tables",
        FILE,
        &tables,
        Some(holds),
        "all copies of the tables: no depth can be decoded, the colour can",
    )?;
    tables_of_one_chunk(vectors)?;
    padding(vectors, &base)
}

/// A table that is extended within its chunk, and so is in no later one.
fn tables_of_one_chunk(vectors: &mut Vectors) -> Outcome {
    let base = Base::of(crate::dense_yuyv())?;
    let mut seen = Vec::new();
    let mut flips = Vec::new();
    for place in base.of_kind(RecordKind::DepthTable) {
        let at = place.offset as usize + 24;
        let payload = &base.bytes[at..at + place.payload_bytes as usize];
        if !seen.contains(&payload) {
            seen.push(payload);
            flips.push(flip(place.offset + 30));
        }
    }
    let mut holds = base.loses(&[], &["record", "record"]);
    holds.insert("lost".to_owned(), json!(["kind 2", "kind 2"]));
    vectors.add(
        "tables-of-one-chunk",
        "dense-yuyv.glint",
        &flips,
        Some(holds),
        "the first copies of two tables, of which the first is in no other chunk: the second copies serve",
    )
}

/// Bytes that hold nothing.
fn padding(vectors: &mut Vectors, base: &Base) -> Outcome {
    let padded = base
        .records
        .iter()
        .find(|place| place.payload_bytes % 8 != 0)
        .ok_or("no record has padding")?;
    let at = padded.offset + 24 + u64::from(padded.payload_bytes);
    vectors.add(
        "padding",
        FILE,
        &[flip(at)],
        Some(base.loses(&[], &["padding"])),
        "a bit between two records: the sum over the chunk shows it, nothing is lost",
    )?;
    let end = base.of_kind(RecordKind::End).next().ok_or("no end")?;
    let mut holds = base.loses(&[], &["record"]);
    holds.insert("end".to_owned(), Value::Null);
    holds.insert("lost".to_owned(), json!(["kind 13"]));
    vectors.add(
        "end-record",
        FILE,
        &[flip(end.offset + 40)],
        Some(holds),
        "the record `end`, which no index names: the file looks as if it had not been closed",
    )?;
    let header = base.header(0)?;
    let behind = base.chunks[0] + 128 + header.records_bytes.get();
    vectors.add(
        "behind-a-chunk",
        FILE,
        &[flip(behind)],
        Some(base.loses(&[], &[])),
        "a bit between a chunk and the next page: nobody looks there",
    )
}

/// Cut and lengthened files.
pub(crate) fn of_length(vectors: &mut Vectors) -> Outcome {
    let base = Base::new()?;
    let third = base.chunks[2];
    let end = base.of_kind(RecordKind::End).next().ok_or("no end")?;
    let without_end = |damages: &[&str], tail: usize| {
        let mut holds = base.holds(&[(1, 5), (2, 5)], damages);
        holds.insert("end".to_owned(), Value::Null);
        holds.insert("tail".to_owned(), json!(tail));
        holds
    };
    let mut cut_record = base.loses(&[], &["header"]);
    cut_record.insert("end".to_owned(), Value::Null);
    for (name, length, holds, describes) in [
        (
            "cut-between-chunks",
            third,
            without_end(&[], 0),
            "whole up to its end, but not closed",
        ),
        (
            "cut-in-chunk-header",
            third + 20,
            without_end(&["tail"], 0),
            "cut in the header of the last chunk",
        ),
        (
            "cut-in-last-record",
            end.offset + 30,
            cut_record,
            "cut in its last record: the commit mark says that the last chunk was sealed, its whole records count",
        ),
        (
            "cut-behind-last-record",
            end.offset + 24 + u64::from(end.payload_bytes).next_multiple_of(8),
            base.loses(&[], &[]),
            "cut in the zeros behind the last record: nothing is lost",
        ),
    ] {
        vectors.add(
            name,
            FILE,
            &[json!({"cut": length})],
            Some(holds),
            describes,
        )?;
    }
    let behind = base.bytes.len() as u64;
    vectors.add(
        "bytes-behind-the-end",
        FILE,
        &[put(behind, b"not ours")],
        Some(base.loses(&[], &["tail"])),
        "bytes behind the last chunk",
    )
}
