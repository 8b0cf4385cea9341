//! Mutants of recordings, for the fuzz runs: bytes, numbers, pages, records, words of the description; half of
//! them under checksums that are right, so that what lies behind the checksums is reached.

use std::collections::BTreeSet;

use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;
use sequence::copy::recover_source;
use sequence::scan::{Checking, Scanner};
use sequence::verify::verify_source;
use sequence::{Contents, Recording, SequenceError};

use super::{holding, seal};

const PAGE: usize = 4096;

/// Numbers that have hurt readers.
const EVIL: [u64; 12] = [
    0,
    1,
    7,
    0x7f,
    0xffff,
    0x7fff_fff8,
    0x8000_0000,
    0xffff_fff8,
    0xffff_ffff,
    i64::MAX as u64,
    i64::MIN as u64,
    u64::MAX,
];

/// Pieces that JSON has and pieces that it should not have here.
const WORDS: [&str; 16] = [
    "0",
    "1",
    "-1",
    "16384",
    "16385",
    "1e308",
    "1e-320",
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    "\"jpeg\"",
    "\"codes\"",
    "18446744073709551616",
    "\u{0}",
];

/// Files to begin with, and the frames that any of them holds.
pub(crate) struct Corpus {
    files: Vec<Vec<u8>>,
    frames: BTreeSet<(u16, u64, u32)>,
    /// For mutants that are mapped.
    folder: tempfile::TempDir,
}

/// What became of mutants.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) execution_count: u64,
    pub(crate) refused_count: u64,
    pub(crate) frame_count: u64,
    pub(crate) damage_count: u64,
}

impl Corpus {
    pub(crate) fn new(files: Vec<Vec<u8>>) -> Self {
        let mut frames = BTreeSet::new();
        for file in &files {
            if let Ok(held) = holding::read(file) {
                frames.extend(fingerprints(&held));
            }
        }
        Self {
            files,
            frames,
            folder: tempfile::tempdir().unwrap(),
        }
    }

    /// Makes one mutant and reads it in every way.
    ///
    /// # Panics
    /// When a reader does, or takes a frame that nobody wrote.
    pub(crate) fn execute(&self, random: &mut Pcg64Mcg, counts: &mut Counts) {
        let mut bytes = self.files[random.random_range(0..self.files.len())].clone();
        let mut is_spliced = false;
        for _ in 0..random.random_range(1..5) {
            is_spliced |= self.mutate(&mut bytes, random);
        }
        let is_sealed = random.random();
        if is_sealed {
            seal::everything(&mut bytes);
        }
        counts.execution_count += 1;
        if counts.execution_count.is_multiple_of(RECOVER_EVERY) {
            self.recover(&bytes);
        }
        match read(&bytes) {
            Err(_) => counts.refused_count += 1,
            Ok(held) => {
                counts.frame_count += held.frames.len() as u64;
                counts.damage_count += held.contents.damages.len() as u64;
                // Tables of files with one id may be mixed by a splice.
                let is_known = fingerprints(&held).all(|frame| self.frames.contains(&frame));
                assert!(is_sealed || is_spliced || is_known, "a frame was made up");
                if counts.execution_count.is_multiple_of(MAP_EVERY) {
                    self.map(&bytes);
                }
            }
        }
    }

    /// Checks and repairs a mutant; what comes out is whole but for what it says is missing.
    fn recover(&self, bytes: &[u8]) {
        // An error is an answer; nothing worse may be.
        let _ = verify_source(bytes, true);
        let path = self.folder.path().join("mended.glint");
        if let Ok(copied) = recover_source(bytes, &path) {
            let mended = std::fs::read(&path).unwrap();
            let found = verify_source(mended.as_slice(), false).unwrap();
            assert!(found.findings.is_empty(), "{:?}", found.findings);
            let counted =
                |frames: &[(u16, u64)]| frames.iter().map(|(_, count)| count).sum::<u64>();
            let held: usize = found
                .summary
                .streams
                .iter()
                .map(|stream| stream.frames)
                .sum();
            assert_eq!(held as u64, counted(&copied.frames));
            std::fs::remove_file(&path).unwrap();
        }
    }

    /// Reads a mutant through a map, in every way that a trainer does.
    fn map(&self, bytes: &[u8]) {
        let path = self.folder.path().join("mutant.glint");
        std::fs::write(&path, bytes).unwrap();
        let Ok(recording) = Recording::open(&path) else {
            return;
        };
        for index in 0..recording.frame_count() {
            let nanos = recording.time_nanos(index);
            let found = recording
                .frame_at(nanos)
                .map(|found| recording.time_nanos(found));
            assert_eq!(found, Some(nanos));
            // Any of these may be an error; none may be anything worse.
            let _ = recording.depth_raw(index);
            let _ = recording.depth_times(index);
            let _ = recording.color(index);
            let _ = recording.color_is_subsampled(index);
        }
        assert!(
            recording
                .split()
                .check(recording.frame_count() as u32)
                .is_ok()
        );
        for set in recording.pose_sets() {
            assert_eq!(set.world_from_depth.len(), recording.frame_count());
        }
    }

    /// Changes `bytes` once; whether a part of another file came in.
    fn mutate(&self, bytes: &mut Vec<u8>, random: &mut Pcg64Mcg) -> bool {
        let at = random.random_range(0..=bytes.len());
        match random.random_range(0..10) {
            0 => flip(bytes, at, random),
            1 => bytes.truncate(at),
            2 => number(bytes, at / 4 * 4, random),
            3..6 => record_field(bytes, random),
            6 => word(bytes, random),
            7 => return self.page(bytes, random),
            8 => shift(bytes, at / 8 * 8, random),
            _ => {
                let end = bytes
                    .len()
                    .min(at + [8, 512, PAGE][random.random_range(0..3)]);
                bytes[at..end].fill(0);
            }
        }
        false
    }

    /// Puts a page of some file over a page of this one, or behind it.
    fn page(&self, bytes: &mut Vec<u8>, random: &mut Pcg64Mcg) -> bool {
        let is_own = random.random();
        let other = if is_own {
            bytes.clone()
        } else {
            self.files[random.random_range(0..self.files.len())].clone()
        };
        let from = random.random_range(0..=other.len() / PAGE) * PAGE;
        let page = &other[from..other.len().min(from + PAGE)];
        let to = random.random_range(0..=bytes.len() / PAGE) * PAGE;
        let end = to + page.len();
        if bytes.len() < end {
            bytes.resize(end, 0);
        }
        bytes[to..end].copy_from_slice(page);
        !is_own
    }
}

fn fingerprints(held: &holding::Holding) -> impl Iterator<Item = (u16, u64, u32)> {
    let frames = held.frames.iter();
    frames.map(|((stream, number), frame)| (*stream, *number, crc32c::crc32c(&frame.samples)))
}

fn flip(bytes: &mut [u8], at: usize, random: &mut Pcg64Mcg) {
    if let Some(byte) = bytes.get_mut(at) {
        *byte ^= 1 << random.random_range(0..8);
    }
}

fn number(bytes: &mut [u8], at: usize, random: &mut Pcg64Mcg) {
    let value = EVIL[random.random_range(0..EVIL.len())].to_le_bytes();
    let width = [1, 2, 4, 8][random.random_range(0..4)];
    if let Some(place) = bytes.get_mut(at..at + width) {
        place.copy_from_slice(&value[..width]);
    }
}

/// Changes a number in or right behind a header of a record or a chunk.
fn record_field(bytes: &mut [u8], random: &mut Pcg64Mcg) {
    let starts = (0..bytes.len()).step_by(8);
    let is_header =
        |at: &usize| bytes[*at..].starts_with(b"gRec") || bytes[*at..].starts_with(b"\x89glc");
    let headers: Vec<usize> = starts.filter(is_header).collect();
    if let Some(count) = std::num::NonZeroUsize::new(headers.len()) {
        let header = headers[random.random_range(0..count.get())];
        number(bytes, header + 2 * random.random_range(0..60), random);
    }
}

/// Puts another word where one stands in some JSON.
fn word(bytes: &mut [u8], random: &mut Pcg64Mcg) {
    let colons: Vec<usize> = (0..bytes.len().saturating_sub(1))
        .filter(|at| bytes[*at] == b':')
        .collect();
    if let Some(count) = std::num::NonZeroUsize::new(colons.len()) {
        let at = colons[random.random_range(0..count.get())] + 1;
        let is_end = |byte: &u8| matches!(byte, b',' | b'}' | b']');
        let length = bytes[at..].iter().position(is_end).unwrap_or_default();
        let new = WORDS[random.random_range(0..WORDS.len())].as_bytes();
        // The record keeps its length: what is too long is cut, what is too short filled with blanks.
        for (place, byte) in bytes[at..at + length].iter_mut().enumerate() {
            *byte = new.get(place).copied().unwrap_or(b' ');
        }
    }
}

/// Takes bytes out or puts some in, so that all behind them moves.
fn shift(bytes: &mut Vec<u8>, at: usize, random: &mut Pcg64Mcg) {
    let at = at.min(bytes.len());
    let count = [8, 64, PAGE][random.random_range(0..3)];
    if random.random() {
        let end = bytes.len().min(at + count);
        bytes.drain(at..end);
    } else {
        bytes.splice(at..at, std::iter::repeat_n(0x67, count));
    }
}

/// One in so many mutants is written to a file and mapped.
const MAP_EVERY: u64 = 16;
/// One in so many mutants is checked and repaired.
const RECOVER_EVERY: u64 = 256;
/// Most pixels of frames that are decoded: a description may claim 2^28.
const MOST_PIXELS: u32 = 1 << 18;

/// Reads a file in every way there is.
fn read(bytes: &[u8]) -> Result<holding::Holding, SequenceError> {
    let marks = Contents::read(bytes, Checking::Marks);
    let mut follower = Scanner::begin(bytes, Checking::Marks)?;
    while follower.next_committed()?.is_some() {}
    let mut contents = Contents::read(bytes, Checking::Everything)?;
    let scanner = Scanner::begin(bytes, Checking::Everything)?;
    contents.take_tail(&scanner)?;
    let streams = marks?
        .description
        .ok_or(SequenceError::NoDescription)?
        .streams;
    let pixels = |camera: &geometry::Intrinsics| camera.width().saturating_mul(camera.height());
    if pixels(&streams.depth.intrinsics) > MOST_PIXELS
        || pixels(&streams.color.intrinsics) > MOST_PIXELS
    {
        return Err(SequenceError::NoDescription);
    }
    holding::read(bytes)
}
