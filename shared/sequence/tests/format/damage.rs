//! A file cut at every byte, and with every bit flipped.

use std::collections::BTreeSet;
use std::os::unix::fs::FileExt as _;

use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::chunk_writer::RecordLabel;
use sequence::codecs::{CodeTable, DepthDecoder};
use sequence::layout::{IndexBytes, PAGE, RECORD_HEADER_BYTES, RECORDS_OFFSET};
use sequence::record::RecordKind;
use sequence::scan::{Checking, Chunk, Damage, Scanner};
use sequence::{Contents, DEPTH_STREAM, Recording};
use zerocopy::{FromBytes as _, IntoBytes as _};

use super::faults::frames_of;
use super::memory::MemoryFile;
use super::{seal, small};

/// Pairs in a chunk: the file then has three chunks.
const CHUNK_FRAMES: u64 = 3;

fn recording() -> Vec<u8> {
    let file = MemoryFile::default();
    small::write(file.layer(), CHUNK_FRAMES, small::Waiting::InPlace).unwrap();
    let bytes = file.bytes();
    assert!(bytes.len() <= 30 << 10, "{} bytes", bytes.len());
    bytes
}

fn chunks_of(bytes: &[u8]) -> Vec<Chunk> {
    let mut scanner = Scanner::begin(bytes, Checking::Everything).unwrap();
    std::iter::from_fn(|| scanner.next_chunk().unwrap()).collect()
}

fn everything(bytes: &[u8]) -> Contents {
    Contents::read(bytes, Checking::Everything).unwrap()
}

/// What a byte of a file belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    FileHeader,
    /// Zeros that nobody looks at.
    Nothing,
    ChunkHeader,
    CommitMark,
    Record(RecordLabel),
    /// Zeros between records.
    Padding,
}

/// The part of each byte.
fn parts_of(bytes: &[u8]) -> Vec<Part> {
    let mut parts = vec![Part::Nothing; bytes.len()];
    parts[..64].fill(Part::FileHeader);
    for chunk in chunks_of(bytes) {
        let start = chunk.start as usize;
        parts[start..start + 64].fill(Part::ChunkHeader);
        parts[start + 64..start + 128].fill(Part::CommitMark);
        let mut records = chunk.records.clone();
        let index = index_of(bytes, start);
        records.push(sequence::scan::RecordPlace {
            offset: index as u64,
            payload_bytes: payload_bytes_at(bytes, index) as u32,
            sequence: 0,
            label: RecordLabel::of(RecordKind::Index, 0),
        });
        for place in records {
            let at = place.offset as usize;
            let end = at + (RECORD_HEADER_BYTES + u64::from(place.payload_bytes)) as usize;
            parts[at..end].fill(Part::Record(place.label));
            parts[end..end.next_multiple_of(8)].fill(Part::Padding);
        }
    }
    parts
}

/// Where the index record of the chunk at `start` lies.
fn index_of(bytes: &[u8], start: usize) -> usize {
    start + u32::from_le_bytes(bytes[start + 44..start + 48].try_into().unwrap()) as usize
}

fn payload_bytes_at(bytes: &[u8], record: usize) -> usize {
    u32::from_le_bytes(bytes[record + 8..record + 12].try_into().unwrap()) as usize
}

/// Which parts of two contents differ, but for frames.
fn differences(one: &Contents, other: &Contents) -> Vec<RecordKind> {
    let differs = [
        (
            RecordKind::Description,
            one.description != other.description,
        ),
        (RecordKind::DepthTable, one.tables != other.tables),
        (RecordKind::Gap, one.gaps != other.gaps),
        (RecordKind::Event, one.events != other.events),
        (RecordKind::Poses, one.pose_sets != other.pose_sets),
        (RecordKind::Gravity, one.gravity != other.gravity),
        (RecordKind::Histogram, one.histograms != other.histograms),
        (RecordKind::Note, one.notes != other.notes),
        (RecordKind::Split, one.split != other.split),
        (RecordKind::End, one.end != other.end),
    ];
    differs
        .into_iter()
        .filter_map(|(kind, differs)| differs.then_some(kind))
        .collect()
}

/// What a flip in a part may cost: kinds other than frames, a frame, and the damage that is reported.
fn cost_of(part: Part) -> (Vec<RecordKind>, Option<(u16, u64)>, Option<&'static str>) {
    let Part::Record(label) = part else {
        let word = match part {
            Part::ChunkHeader => Some("Header"),
            Part::CommitMark => Some("CommitMark"),
            Part::Padding => Some("Padding"),
            Part::FileHeader | Part::Nothing | Part::Record(_) => None,
        };
        return (Vec::new(), None, word);
    };
    match RecordKind::from_number(label.kind).unwrap() {
        RecordKind::Frame => (
            Vec::new(),
            Some((label.stream, label.number)),
            Some("Record"),
        ),
        RecordKind::Index => (Vec::new(), None, Some("Index")),
        // In every chunk.
        RecordKind::Description | RecordKind::DepthTable | RecordKind::PoseSet => {
            (Vec::new(), None, Some("Record"))
        }
        // Behind the index, so that its damage is known by the sum over the chunk only.
        RecordKind::End => (vec![RecordKind::End], None, Some("Record")),
        kind => (vec![kind], None, Some("Record")),
    }
}

fn word_of(damage: &Damage) -> &'static str {
    match damage {
        Damage::FileHeader => "FileHeader",
        Damage::Header { .. } => "Header",
        Damage::CommitMark { .. } => "CommitMark",
        Damage::Index { .. } => "Index",
        Damage::Record { .. } => "Record",
        Damage::Padding { .. } => "Padding",
        Damage::Tail { .. } => "Tail",
    }
}

/// Decodes the images of frames that lost a bit, without looking at their checksum; how many come out wrong.
fn naive_flips() -> (u64, u64) {
    let mut decoder = DepthDecoder::new(small::WIDTH, small::HEIGHT).unwrap();
    let contents = everything(&recording());
    let tables: Vec<&CodeTable> = contents.tables.values().collect();
    let mut samples = vec![0; (small::WIDTH * small::HEIGHT) as usize];
    let (mut flip_count, mut wrong_count) = (0, 0);
    for number in small::numbers() {
        let payload = small::payload(DEPTH_STREAM, number).unwrap();
        let written = small::depth(number);
        for bit in 48 * 8..payload.len() * 8 {
            let mut flipped = payload[48..].to_vec();
            flipped[bit / 8 - 48] ^= 1 << (bit % 8);
            let decoded = tables
                .iter()
                .any(|table| decoder.decode(&flipped, Some(table), &mut samples).is_ok());
            flip_count += 1;
            wrong_count += u64::from(decoded && samples != written);
        }
    }
    (flip_count, wrong_count)
}

/// Of a debug build one bit a byte, of others all eight.
const BITS: usize = if cfg!(debug_assertions) { 1 } else { 8 };

#[test]
fn hc_k02_a_flipped_bit_costs_one_record_and_is_named() {
    // Bite: what the codec alone notices.
    let (naive_count, naive_wrong_count) = naive_flips();
    assert!(naive_wrong_count > 0);
    // Hold: every bit of a file.
    let whole = recording();
    let parts = parts_of(&whole);
    let (contents, frames) = frames_of(&whole).unwrap();
    assert_eq!(contents.damages, []);
    assert_eq!(frames.len(), 2 * small::FRAME_COUNT as usize);
    let mut bytes = whole.clone();
    let (mut flip_count, mut lost_count, mut refused_count) = (0_u64, 0_u64, 0_u64);
    for (at, part) in parts.iter().enumerate() {
        for bit in 0..BITS {
            // In a debug build another bit in each byte.
            let mask = 1 << (bit + (8 / BITS - 1) * (at % 8) / 7);
            bytes[at] ^= mask;
            flip_count += 1;
            match frames_of(&bytes) {
                Err(_) => {
                    assert_eq!(*part, Part::FileHeader, "bit {bit} of byte {at}");
                    refused_count += 1;
                }
                Ok((found, found_frames)) => {
                    let (kinds, frame, word) = cost_of(*part);
                    let lost: Vec<(u16, u64)> = frames.difference(&found_frames).copied().collect();
                    let words: Vec<&str> = found.damages.iter().map(word_of).collect();
                    let told = (differences(&contents, &found), lost, words);
                    let expected = (
                        kinds,
                        frame.into_iter().collect::<Vec<_>>(),
                        word.into_iter().collect::<Vec<_>>(),
                    );
                    assert_eq!(told, expected, "bit {bit} of byte {at}, {part:?}");
                    lost_count += u64::from(frame.is_some());
                }
            }
            bytes[at] ^= mask;
        }
    }
    println!(
        "k02: {flip_count} flips in {} bytes: {lost_count} cost a frame, {refused_count} are refused, 0 silent, tolerance 0; without checksums {naive_wrong_count} of {naive_count} flips in depth decode to something else",
        whole.len()
    );
}

#[test]
fn a_flipped_bit_costs_one_frame_of_a_map_too() {
    let whole = recording();
    let parts = parts_of(&whole);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flipped.glint");
    std::fs::write(&path, &whole).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    // All bytes in steps, so that each part of each structure has its turn.
    let step = if cfg!(debug_assertions) { 61 } else { 23 };
    let mut open_count = 0;
    for at in (0..whole.len()).step_by(step) {
        file.write_at(&[whole[at] ^ 1 << (at % 8)], at as u64)
            .unwrap();
        let opened = Recording::open(&path);
        assert_eq!(opened.is_err(), parts[at] == Part::FileHeader, "byte {at}");
        if let Ok(recording) = opened {
            let (_, lost, _) = cost_of(parts[at]);
            for (index, number) in small::numbers().enumerate() {
                let depth = recording.depth_raw(index);
                let is_depth_lost = lost == Some((DEPTH_STREAM, number));
                assert_eq!(depth.is_err(), is_depth_lost, "byte {at}, depth {number}");
                assert!(depth.is_err() || depth.unwrap().pixels() == small::depth(number));
                let color = recording.color_raw(index);
                assert_eq!(
                    color.is_err(),
                    lost == Some((2, number)),
                    "byte {at}, color {number}"
                );
                assert!(color.is_err() || color.unwrap() == small::color(number));
            }
            open_count += 1;
        }
        file.write_at(&whole[at..=at], at as u64).unwrap();
    }
    println!("{open_count} files with a flipped bit were opened and read whole");
}

#[test]
fn hc_k01_a_cut_file_gives_every_frame_in_front_of_the_cut() {
    let whole = recording();
    let chunks = chunks_of(&whole);
    // When each frame is complete.
    let mut frame_ends = Vec::new();
    for place in chunks.iter().flat_map(|chunk| &chunk.records) {
        if place.label.kind == RecordKind::Frame as u16 {
            let end = place.offset + RECORD_HEADER_BYTES + u64::from(place.payload_bytes);
            frame_ends.push((end as usize, (place.label.stream, place.label.number)));
        }
    }
    // Bite: a reader that knows the frames by an index at the end of the file.
    let naive = |cut: usize| cut == whole.len();
    let mut naive_count = 0;
    for cut in 0..=whole.len() {
        let complete: BTreeSet<(u16, u64)> = frame_ends
            .iter()
            .filter(|(end, _)| *end <= cut)
            .map(|(_, key)| *key)
            .collect();
        naive_count += usize::from(!naive(cut) && !complete.is_empty());
        let bytes = &whole[..cut];
        let Ok((contents, mut found)) = frames_of(bytes) else {
            assert!(cut < 64, "cut at {cut}");
            continue;
        };
        assert!(cut >= 64);
        let tail = contents.tail.iter().map(|place| place.label);
        let tail = tail.filter(|label| label.kind == RecordKind::Frame as u16);
        found.extend(tail.map(|label| (label.stream, label.number)));
        assert_eq!(found, complete, "cut at {cut}");
        // Nothing is silent: a damage, or no end.
        let is_end_cut = contents.end.is_none();
        let is_whole = cut >= whole.len() || whole[cut..].iter().all(|byte| *byte == 0);
        assert!(is_whole || is_end_cut, "cut at {cut}");
        if cut % 97 == 0 {
            let opened = Contents::read(bytes, Checking::Marks);
            assert!(opened.is_ok(), "cut at {cut}");
        }
    }
    println!(
        "k01: {} cuts, 0 complete frames missed, tolerance 0; an index at the end alone misses frames in {naive_count}",
        whole.len() + 1
    );
    assert!(naive_count > 1000);
}

/// The index of the chunk at `start` with its entries shuffled, their times too, some of them twice.
fn shuffle_index(bytes: &mut [u8], start: usize, random: &mut Pcg64Mcg) {
    let index = index_of(bytes, start);
    let payload = index + RECORD_HEADER_BYTES as usize;
    let range = payload..payload + payload_bytes_at(bytes, index);
    let mut entries = <[IndexBytes]>::ref_from_bytes(&bytes[range.clone()])
        .unwrap()
        .to_vec();
    entries.shuffle(random);
    let times: Vec<_> = entries.iter().map(|entry| entry.device_nanos).collect();
    for entry in &mut entries {
        entry.device_nanos = times[random.random_range(0..times.len())];
    }
    bytes[range].copy_from_slice(entries.as_slice().as_bytes());
    seal::record(bytes, small::FILE_ID, index);
    seal::chunk(bytes, start);
}

/// Times in the order of an index.
fn index_times(bytes: &[u8], start: usize) -> Vec<i64> {
    let index = index_of(bytes, start);
    let payload = index + RECORD_HEADER_BYTES as usize;
    let entries = &bytes[payload..payload + payload_bytes_at(bytes, index)];
    let entries = <[IndexBytes]>::ref_from_bytes(entries).unwrap();
    entries
        .iter()
        .map(|entry| entry.device_nanos.get())
        .collect()
}

#[test]
fn hc_k15_an_index_in_any_order_gives_the_same_frames() {
    let whole = recording();
    let (_, frames) = frames_of(&whole).unwrap();
    let starts: Vec<usize> = chunks_of(&whole)
        .iter()
        .map(|chunk| chunk.start as usize)
        .collect();
    let mut random = Pcg64Mcg::seed_from_u64(15);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shuffled.glint");
    let (mut naive_missed_count, mut file_count) = (0, 0);
    for round in 0..1200 {
        let mut bytes = whole.clone();
        for start in &starts {
            shuffle_index(&mut bytes, *start, &mut random);
        }
        let (contents, found) = frames_of(&bytes).unwrap();
        assert_eq!(found, frames);
        // An index out of order is none: its records are walked.
        let words: Vec<&str> = contents.damages.iter().map(word_of).collect();
        assert_eq!(words, vec!["Index"; starts.len()]);
        // Bite: a search by halves in the order of the file.
        let times = index_times(&bytes, starts[0]);
        naive_missed_count += times
            .iter()
            .filter(|time| times.binary_search(time).is_err())
            .count();
        let stream = contents.stream(DEPTH_STREAM);
        assert!(stream.is_sorted_by_key(|place| place.label.number));
        if round % 40 == 0 {
            std::fs::write(&path, &bytes).unwrap();
            let recording = Recording::open(&path).unwrap();
            for nanos in [i64::MIN, -1, 0, 333_333_333, i64::MAX] {
                assert!(recording.frame_at(nanos).is_some() || recording.frame_count() == 0);
            }
            for place in recording.contents().stream(DEPTH_STREAM) {
                let samples = recording.depth_frame(place).unwrap();
                assert_eq!(samples.pixels(), small::depth(place.label.number));
            }
        }
        file_count += 1;
    }
    println!(
        "k15: {file_count} shuffled files, 0 frames missed (naive {naive_missed_count}), tolerance 0"
    );
    assert!(naive_missed_count > 0);
}

#[test]
fn walking_finds_what_the_index_says() {
    let whole = recording();
    let indexed = chunks_of(&whole);
    let mut bytes = whole.clone();
    for chunk in &indexed {
        let index = index_of(&whole, chunk.start as usize);
        bytes[index + 30] ^= 1;
    }
    for (walked, indexed) in chunks_of(&bytes).iter().zip(&indexed) {
        assert_eq!(walked.damages.len(), 1);
        assert_eq!(walked.records, indexed.records);
    }
    assert!(indexed.iter().all(|chunk| chunk.start % PAGE == 0));
    assert!(
        indexed
            .iter()
            .flat_map(|chunk| &chunk.records)
            .all(|place| place.offset % 8 == 0)
    );
    assert!(indexed[0].records[0].offset == PAGE + RECORDS_OFFSET);
}
