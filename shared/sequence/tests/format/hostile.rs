//! Files that are huge, shrink, lie at odd places, or claim what cannot be under checksums that are right.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::FileExt as _;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::file_layer::{self, WritePath};
use sequence::layout::{ChunkHeader, FileHeader, IndexBytes, PAGE, RECORDS_OFFSET, chunk_end};
use sequence::scan::{Checking, Scanner};
use sequence::source::{ByteSource, PreadFile};
use sequence::{Contents, DEPTH_STREAM, Recording};
use zerocopy::byteorder::little_endian::U64;
use zerocopy::{FromBytes as _, IntoBytes as _};

use super::faults::frames_of;
use super::memory::MemoryFile;
use super::{seal, small};

fn recording(chunk_frames: u64) -> Vec<u8> {
    let file = MemoryFile::default();
    small::write(file.layer(), chunk_frames, small::Waiting::InPlace).unwrap();
    file.bytes()
}

/// The pages of each chunk.
fn chunk_bytes(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut scanner = Scanner::begin(bytes, Checking::Marks).unwrap();
    let mut chunks = Vec::new();
    while let Some(chunk) = scanner.next_chunk().unwrap() {
        chunks.push(bytes[chunk.start as usize..chunk.end as usize].to_vec());
    }
    chunks
}

/// A chunk under another number.
fn renumbered(chunk: &[u8], number: u64) -> Vec<u8> {
    let mut bytes = chunk.to_vec();
    let mut header = ChunkHeader::read_from_prefix(chunk).unwrap().0;
    header.number = number.into();
    bytes[..64].copy_from_slice(header.as_bytes());
    seal::chunk(&mut bytes, 0);
    bytes
}

/// Header and mark of a chunk that was given up.
fn void(number: u64, records_bytes: u64) -> Vec<u8> {
    let header = ChunkHeader::sealed(small::FILE_ID, number, records_bytes, 0, 128, 0, 0);
    [header.as_bytes(), header.commit_mark().as_bytes()].concat()
}

const GIB: u64 = 1 << 30;
/// Places of the second and the third chunk: at least so far.
const FAR: [u64; 2] = [5 * GIB, 1024 * GIB];

/// A sparse file with three chunks: at the beginning, behind 5 GiB, behind 1 TiB. Between them lie void chunks, or
/// nothing at all. `None` where the file system refuses.
fn sparse(path: &Path, has_voids: bool) -> Option<()> {
    let chunks = chunk_bytes(&recording(3));
    let file = File::create(path).unwrap();
    let mut position = PAGE;
    let mut number = 0;
    let write = |offset: u64, bytes: &[u8]| file.write_all_at(bytes, offset);
    write(0, &FileHeader::page(small::FILE_ID)).ok()?;
    for (place, chunk) in chunks.iter().enumerate() {
        let least = if place == 0 { 0 } else { FAR[place - 1] };
        while position < least {
            // As big as a chunk can be.
            let records_bytes = (1 << 31) - 8;
            if has_voids {
                write(position, &void(number, records_bytes)).ok()?;
                number += 1;
            }
            position = chunk_end(position, records_bytes).unwrap();
        }
        write(position, &renumbered(chunk, number)).ok()?;
        number += 1;
        position += chunk.len() as u64;
    }
    Some(())
}

fn assert_holds_all(contents: &Contents) {
    for stream in [1, 2] {
        let numbers = contents
            .stream(stream)
            .iter()
            .map(|place| place.label.number);
        assert!(numbers.eq(small::numbers()));
    }
    assert!(contents.stream(1)[9].offset > FAR[1]);
    assert!(contents.end.is_some());
}

#[test]
fn hc_k03_chunks_lie_beyond_four_gibibytes_and_one_tebibyte() {
    // Bite: offsets of 32 bits come round.
    assert!(
        FAR.iter()
            .all(|offset| u64::from(*offset as u32) != *offset)
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sparse.glint");
    for has_voids in [true, false] {
        if sparse(&path, has_voids).is_none() {
            println!("skipped hc_k03: the file system refuses a sparse file of 1 TiB");
            return;
        }
        let source = PreadFile::open(&path).unwrap();
        for checking in [Checking::Marks, Checking::Everything] {
            let contents = Contents::read(&source, checking).unwrap();
            assert_holds_all(&contents);
            assert_eq!(contents.damages.len(), if has_voids { 0 } else { 2 });
        }
    }
    sparse(&path, true).unwrap();
    match Recording::open(&path) {
        Ok(recording) => {
            assert_eq!(recording.frame_count(), small::FRAME_COUNT as usize);
            for (index, number) in small::numbers().enumerate() {
                assert_eq!(
                    recording.depth_raw(index).unwrap().pixels(),
                    small::depth(number)
                );
            }
        }
        Err(error) => println!("skipped the map of hc_k03: {error}"),
    }
    println!("k03: chunks at 4096, 5 GiB and 1 TiB, 0 frames missed, tolerance 0");
}

#[test]
fn hc_k13_a_recording_is_read_at_any_address() {
    let whole = recording(3);
    let (_, frames) = frames_of(&whole).unwrap();
    let mut naive_refused_count = 0;
    // Every place in a cache line, again and again in buffers of other sizes.
    for round in 0..1024 {
        let shift = round % 64;
        let mut buffer = vec![0xa5; whole.len() + 64 + round];
        buffer[shift..shift + whole.len()].copy_from_slice(&whole);
        let slice = &buffer[shift..shift + whole.len()];
        // Bite: numbers looked at in place.
        naive_refused_count += u32::from(<[u64]>::ref_from_bytes(&slice[..4096]).is_err());
        assert!(<[U64]>::ref_from_bytes(&slice[..4096]).is_ok());
        if round < 64 || round % 16 == 0 {
            assert_eq!(frames_of(slice).unwrap().1, frames, "at {shift}");
        }
    }
    println!("k13: 1024 addresses, 0 refused (naive {naive_refused_count}), tolerance 0");
    assert!(naive_refused_count > 0);
}

/// A source that remembers how much was asked for at once.
struct Measured<'a> {
    bytes: &'a [u8],
    most: Cell<usize>,
    total: Cell<u64>,
}

impl ByteSource for Measured<'_> {
    fn byte_count(&self) -> io::Result<u64> {
        self.bytes.byte_count()
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        self.most.set(self.most.get().max(buffer.len()));
        self.total.set(self.total.get() + buffer.len() as u64);
        self.bytes.read_at(offset, buffer)
    }
}

/// Numbers that have hurt readers.
const EVIL: [u64; 12] = [
    0,
    1,
    7,
    8,
    0x7fff_fff8,
    0x8000_0000,
    0xffff_fff8,
    0xffff_ffff,
    1 << 32,
    i64::MAX as u64,
    u64::MAX - 7,
    u64::MAX,
];

/// Puts an evil number over a field of a header and makes all sums right.
fn make_evil(bytes: &mut [u8], random: &mut Pcg64Mcg) {
    let mut fields = Vec::new();
    for start in (PAGE as usize..bytes.len()).step_by(8) {
        if bytes[start..].starts_with(b"\x89glchunk") {
            fields.extend([
                (start + 24, 8),
                (start + 32, 8),
                (start + 40, 4),
                (start + 44, 4),
                (start + 48, 8),
            ]);
        }
        if bytes[start..].starts_with(b"gRec") {
            // Kind, stream, length, sequence and the first numbers of the payload.
            fields.extend([
                (start + 4, 2),
                (start + 6, 2),
                (start + 8, 4),
                (start + 16, 8),
            ]);
            fields.extend((24..64).step_by(4).map(|place| (start + place, 4)));
        }
    }
    let (at, width) = fields[random.random_range(0..fields.len())];
    let value = EVIL[random.random_range(0..EVIL.len())];
    if at + width <= bytes.len() {
        bytes[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
    }
    seal::everything(bytes);
}

/// Room that a reader believing every length would make for a file: the largest claim.
fn naive_room(bytes: &[u8]) -> u64 {
    let claims = (PAGE as usize..bytes.len() - 24).step_by(8);
    let claims = claims.filter(|start| bytes[*start..].starts_with(b"gRec"));
    let claims =
        claims.map(|start| u32::from_le_bytes(bytes[start + 8..start + 12].try_into().unwrap()));
    claims.map(u64::from).max().unwrap_or_default()
}

#[test]
fn hc_k14_no_claim_makes_room_or_work_beyond_the_file() {
    let mut random = Pcg64Mcg::seed_from_u64(14);
    let files = [recording(3), recording(100)];
    let count = if cfg!(debug_assertions) { 3000 } else { 20_000 };
    let (mut naive_most, mut most, mut most_work, mut refused_count) = (0, 0, 0, 0);
    for round in 0..count {
        let mut bytes = files[round % 2].clone();
        for _ in 0..random.random_range(1..4) {
            make_evil(&mut bytes, &mut random);
        }
        naive_most = naive_most.max(naive_room(&bytes));
        for checking in [Checking::Marks, Checking::Everything] {
            let source = Measured {
                bytes: &bytes,
                most: Cell::new(0),
                total: Cell::new(0),
            };
            refused_count += u32::from(Contents::read(&source, checking).is_err());
            most = most.max(source.most.get() as u64);
            most_work = most_work.max(source.total.get() / bytes.len() as u64);
        }
    }
    let longest = files.iter().map(Vec::len).max().unwrap() as u64;
    println!(
        "k14: {count} files, {refused_count} readings refused, at most {most} bytes asked for at once (naive {naive_most}), tolerance {longest}; at most {most_work} times the file read, tolerance 64"
    );
    assert!(naive_most > 1 << 31);
    assert!(most <= longest);
    assert!(most_work <= 64);
}

/// Bytes that reading `bytes` asks for, over their number.
fn work_of(bytes: &[u8]) -> u64 {
    let source = Measured {
        bytes,
        most: Cell::new(0),
        total: Cell::new(0),
    };
    let _ = Contents::read(&source, Checking::Everything);
    source.total.get() / bytes.len() as u64
}

#[test]
fn work_grows_with_the_file_and_not_with_its_square() {
    // A chunk on every page that claims all the rest, has no mark and another sum.
    let mut bytes = vec![0x55; 4 << 20];
    bytes[..PAGE as usize].copy_from_slice(&FileHeader::page(small::FILE_ID));
    let page_count = bytes.len() as u64 / PAGE;
    for number in 1..page_count {
        let start = (number * PAGE) as usize;
        let rest = (bytes.len() - start) as u64 - RECORDS_OFFSET;
        let header = ChunkHeader::sealed(small::FILE_ID, number, rest, 9, 128, 0, 1);
        bytes[start..start + 64].copy_from_slice(header.as_bytes());
    }
    let by_headers = work_of(&bytes);
    // Records in records: each claims the next ones as its payload.
    bytes[PAGE as usize..].fill(0);
    for start in (PAGE as usize..bytes.len() - 24).step_by(32) {
        let rest = (bytes.len() - start - 24) as u32;
        bytes[start..start + 4].copy_from_slice(b"gRec");
        bytes[start + 8..start + 12].copy_from_slice(&rest.to_le_bytes());
    }
    let by_records = work_of(&bytes);
    // An index that names one long record again and again.
    let whole = recording(100);
    let index = whole.len() - whole.iter().rev().position(|byte| *byte != 0).unwrap();
    let many = naming_one_record(&whole, index);
    let by_index = work_of(&many);
    println!(
        "work in lengths of the file: headers {by_headers}, records {by_records}, index {by_index}"
    );
    // A window of 256 KiB on each page makes 64; without a bound the headers would make 512.
    assert!(by_headers <= 80 && by_records <= 80 && by_index <= 80);
}

/// A recording of one chunk whose index has 4000 entries for its longest record.
fn naming_one_record(whole: &[u8], end: usize) -> Vec<u8> {
    let mut bytes = whole[..end.next_multiple_of(8)].to_vec();
    let start = PAGE as usize;
    let places = Scanner::begin(whole, Checking::Marks)
        .unwrap()
        .next_chunk()
        .unwrap()
        .unwrap();
    let longest = places
        .records
        .iter()
        .max_by_key(|place| place.payload_bytes)
        .unwrap();
    let entry = IndexBytes {
        offset: ((longest.offset - PAGE) as u32).into(),
        payload_bytes: longest.payload_bytes.into(),
        // A note: such records are read at once.
        kind: 10.into(),
        stream: 0.into(),
        flags: 0.into(),
        number: 0.into(),
        device_nanos: 0.into(),
        sequence: 0.into(),
    };
    let entries = entry.as_bytes().repeat(4000);
    let offset = bytes.len() - start;
    bytes.extend_from_slice(b"gRec\x0c\0\0\0");
    bytes.extend_from_slice(&(entries.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&[0; 12]);
    bytes.extend_from_slice(&entries);
    let records_bytes = (bytes.len() - start) as u64 - RECORDS_OFFSET;
    bytes[start + 32..start + 40].copy_from_slice(&records_bytes.to_le_bytes());
    bytes[start + 44..start + 48].copy_from_slice(&(offset as u32).to_le_bytes());
    seal::everything(&mut bytes);
    bytes
}

#[test]
fn hc_k05_a_bomb_costs_its_frame_and_no_memory() {
    // A gigabyte of zeros as one zstd frame, made in pieces.
    let zeros = vec![0; 1 << 20];
    let mut encoder = zstd::Encoder::new(Vec::new(), 1).unwrap();
    for _ in 0..1 << 10 {
        encoder.write_all(&zeros).unwrap();
    }
    let bomb = [&[1, 0, 0], encoder.finish().unwrap().as_slice()].concat();
    // Bite: a decoder that believes what comes out of it.
    let naive: u64 = io::copy(
        &mut zstd::Decoder::new(&bomb[3..]).unwrap(),
        &mut io::sink(),
    )
    .unwrap();
    assert_eq!(naive, GIB);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.glint");
    let layer = file_layer::create(&path, WritePath::Pwrite).unwrap();
    let mut writer = small::begin(layer, small::limits()).unwrap();
    small::write_records(&mut writer, 3, small::Waiting::InPlace, &mut |_| {}).unwrap();
    let times = small::times(small::FRAME_COUNT + 1);
    writer.write_frame(DEPTH_STREAM, &times, &bomb).unwrap();
    writer.finish("complete").unwrap();
    let recording = Recording::open(&path).unwrap();
    let places = recording.contents().stream(DEPTH_STREAM);
    let (bomb_place, others) = places.split_last().unwrap();
    assert!(recording.depth_frame(bomb_place).is_err());
    for place in others {
        let samples = recording.depth_frame(place).unwrap();
        assert_eq!(samples.pixels(), small::depth(place.label.number));
    }
    println!(
        "k05: a bomb of {} bytes for {naive} is refused, 0 other frames lost, tolerance 0",
        bomb.len()
    );
}

/// A file that another program cuts between two reads.
struct Shrinking {
    source: PreadFile,
    file: File,
    reads_left: Cell<u64>,
    length: u64,
}

impl ByteSource for Shrinking {
    fn byte_count(&self) -> io::Result<u64> {
        self.source.byte_count()
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<usize> {
        match self.reads_left.get() {
            0 => {}
            1 => {
                self.reads_left.set(0);
                self.file.set_len(self.length)?;
            }
            more => self.reads_left.set(more - 1),
        }
        self.source.read_at(offset, buffer)
    }

    fn next_data(&self, offset: u64) -> Option<u64> {
        self.source.next_data(offset)
    }
}

/// Names the file for [`a_child_maps_a_file_that_shrinks`].
const CHILD: &str = "GLINT_TEST_SHRINKING_FILE";

#[test]
fn a_child_maps_a_file_that_shrinks() {
    // Does nothing but as the child of the next test.
    let Some(path) = std::env::var_os(CHILD) else {
        return;
    };
    let recording = Recording::open(path.as_ref()).unwrap();
    let file = File::options().write(true).open(&path).unwrap();
    file.set_len(PAGE).unwrap();
    let _ = recording.depth_raw(9);
}

#[test]
fn hc_k07_a_file_that_shrinks_under_its_reader_is_an_error() {
    let whole = recording(2);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shrinks.glint");
    // Bite: a map of such a file kills its process.
    std::fs::write(&path, &whole).unwrap();
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "hostile::a_child_maps_a_file_that_shrinks"])
        .env(CHILD, &path)
        .output()
        .unwrap();
    const SIGBUS: i32 = 7;
    assert_eq!(child.status.signal(), Some(SIGBUS));
    // Hold: any cut in front of any read.
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let mut file = File::options().write(true).open(&path).unwrap();
    let (mut error_count, mut damaged_count, mut whole_count) = (0, 0, 0);
    for round in 0..1500 {
        file.seek(SeekFrom::Start(0)).unwrap();
        file.write_all(&whole).unwrap();
        let source = Shrinking {
            source: PreadFile::open(&path).unwrap(),
            file: file.try_clone().unwrap(),
            reads_left: Cell::new(1 + random.random_range(0..120)),
            length: random.random_range(0..whole.len() as u64),
        };
        let checking = [Checking::Marks, Checking::Everything][round % 2];
        match Contents::read(&source, checking) {
            Err(_) => error_count += 1,
            Ok(contents) => {
                // What a frame's place says must not be believed, but read.
                let scanner = Scanner::of_file(&source, small::FILE_ID, checking).unwrap();
                let mut is_all_there = contents.end.is_some() && contents.damages.is_empty();
                for place in contents.stream(DEPTH_STREAM) {
                    match scanner.payload(place).unwrap() {
                        Some(payload) => {
                            let written = small::payload(DEPTH_STREAM, place.label.number);
                            assert_eq!(Some(payload), written);
                        }
                        None => is_all_there = false,
                    }
                }
                if is_all_there {
                    whole_count += 1;
                } else {
                    damaged_count += 1;
                }
            }
        }
    }
    println!(
        "k07: 1500 cuts while reading: {error_count} errors, {damaged_count} named damages, {whole_count} behind the last read, 0 crashes (a map: SIGBUS)"
    );
    assert!(damaged_count > 100);
}

#[test]
fn void_chunks_reach_over_what_they_held() {
    let chunks = chunk_bytes(&recording(3));
    // The second chunk is given up; its bytes are still there.
    let mut bytes = FileHeader::page(small::FILE_ID).to_vec();
    bytes.extend_from_slice(&chunks[0]);
    let start = bytes.len();
    bytes.extend_from_slice(&chunks[1]);
    let header = ChunkHeader::read_from_prefix(&chunks[1]).unwrap().0;
    let void = void(1, header.records_bytes.get());
    bytes[start..start + RECORDS_OFFSET as usize].copy_from_slice(&void);
    bytes.extend_from_slice(&chunks[2]);
    let (contents, frames) = frames_of(&bytes).unwrap();
    assert_eq!(contents.damages, []);
    let numbers: Vec<u64> = frames
        .iter()
        .filter(|key| key.0 == 1)
        .map(|key| key.1)
        .collect();
    assert_eq!(numbers, [0, 1, 2, 9, 10]);
}
