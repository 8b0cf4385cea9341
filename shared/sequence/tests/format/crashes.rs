//! The power goes: every state in which the disk can be, as far as it can be counted, and many more.
//!
//! What was synced is on the disk. Of the pages written since, each can be there or not, as any of the versions
//! it had, or torn at sectors of 512 bytes.

use std::collections::{BTreeMap, BTreeSet};

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::Contents;
use sequence::layout::{ChunkHeader, CommitMark, IndexBytes, RECORD_MAGIC, RecordHeader};
use sequence::record::RecordKind;
use sequence::scan::{Checking, Scanner};
use zerocopy::FromBytes as _;

use super::memory::{MemoryFile, Operation};
use super::small::{self, Waiting};

const PAGE: usize = 4096;
const SECTOR: usize = 512;
const SECTORS: usize = PAGE / SECTOR;

/// The order of writing that a log shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// Data, sync, commit mark, sync.
    Shipped,
    /// The same while the next chunk is written.
    Beside,
    /// Data and commit mark, one sync for both.
    Naive,
}

/// What was written to the disk and what is still under way.
struct Disk {
    durable: Vec<u8>,
    /// Versions of each page since it was durable, the newest last.
    versions: BTreeMap<usize, Vec<Vec<u8>>>,
    sync_count: usize,
    /// The file is at least this long, for certain.
    synced_end: usize,
}

impl Disk {
    fn new(length: usize) -> Self {
        Self {
            durable: vec![0; length.next_multiple_of(PAGE)],
            versions: BTreeMap::new(),
            sync_count: 0,
            synced_end: 0,
        }
    }

    fn apply(&mut self, operation: &Operation) {
        match operation {
            Operation::Write { offset, bytes } => self.write(*offset, bytes),
            Operation::Sync { start, end } => {
                self.sync(start / PAGE..end.div_ceil(PAGE));
                self.sync_count += 1;
                self.synced_end = self.synced_end.max(end.next_multiple_of(PAGE));
            }
            Operation::Length(length) => {
                self.durable.truncate(*length);
                self.sync(0..length.div_ceil(PAGE));
            }
        }
    }

    fn write(&mut self, mut offset: usize, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let (page, within) = (offset / PAGE, offset % PAGE);
            let count = bytes.len().min(PAGE - within);
            let durable = &self.durable[page * PAGE..(page + 1) * PAGE];
            let versions = self.versions.entry(page).or_default();
            let mut version = versions
                .last()
                .map_or_else(|| durable.to_vec(), Clone::clone);
            version[within..within + count].copy_from_slice(&bytes[..count]);
            versions.push(version);
            offset += count;
            bytes = &bytes[count..];
        }
    }

    fn sync(&mut self, pages: std::ops::Range<usize>) {
        let written: Vec<usize> = self.versions.range(pages).map(|(page, _)| *page).collect();
        for page in written {
            if let Some(newest) = self.versions.remove(&page).and_then(|mut all| all.pop()) {
                self.durable[page * PAGE..(page + 1) * PAGE].copy_from_slice(&newest);
            }
        }
    }

    /// The disk with `choose` deciding what became of each page under way.
    fn state(&self, mut choose: impl FnMut(usize, &[u8], &[Vec<u8>]) -> Vec<u8>) -> Vec<u8> {
        let mut bytes = self.durable.clone();
        for (place, (page, versions)) in self.versions.iter().enumerate() {
            let range = page * PAGE..(page + 1) * PAGE;
            let chosen = choose(place, &self.durable[range.clone()], versions);
            bytes[range].copy_from_slice(&chosen);
        }
        bytes
    }
}

/// `new` in the sectors where `is_new` says so, else `old`.
fn torn(old: &[u8], new: &[u8], is_new: impl Fn(usize) -> bool) -> Vec<u8> {
    let sectors = old.chunks(SECTOR).zip(new.chunks(SECTOR)).enumerate();
    sectors
        .flat_map(|(sector, (old, new))| if is_new(sector) { new } else { old })
        .copied()
        .collect()
}

/// What became of a page, for sampling.
fn sampled(random: &mut Pcg64Mcg, old: &[u8], versions: &[Vec<u8>]) -> Vec<u8> {
    let any = |random: &mut Pcg64Mcg| match random.random_range(0..=versions.len()) {
        0 => old.to_vec(),
        version => versions[version - 1].clone(),
    };
    let newest = &versions[versions.len() - 1];
    let sector = random.random_range(1..SECTORS);
    match random.random_range(0..6) {
        0 => old.to_vec(),
        1 => newest.clone(),
        2 => any(random),
        3 => torn(old, newest, |at| at < sector),
        4 => torn(old, newest, |at| at >= sector),
        _ => {
            let (one, other) = (any(random), any(random));
            let mask: u8 = random.random();
            torn(&one, &other, |at| mask >> at & 1 == 1)
        }
    }
}

/// What readers made of all states.
#[derive(Debug, Default)]
struct Tally {
    state_count: u64,
    /// Committed frames that were not found.
    lost_count: u64,
    /// Frames that were taken and are not what was written.
    wrong_count: u64,
    /// The same of a reader that believes a commit mark and no checksum.
    wrong_by_mark_count: u64,
    /// The same of a reader that walks and believes magic and length.
    wrong_by_length_count: u64,
}

impl Tally {
    fn judge(&mut self, bytes: &[u8], committed: &BTreeSet<(u16, u64)>) {
        self.state_count += 1;
        self.wrong_by_mark_count += by_mark(bytes);
        self.wrong_by_length_count += by_length(bytes);
        let mut found = BTreeSet::new();
        // A file without its first page is refused: nothing is committed then.
        if let Ok(contents) = Contents::read(bytes, Checking::Everything) {
            let scanner = Scanner::begin(bytes, Checking::Everything).unwrap();
            let places = contents.frames.values().flatten().chain(&contents.tail);
            for place in places.filter(|place| place.label.kind == RecordKind::Frame as u16) {
                let key = (place.label.stream, place.label.number);
                let payload = scanner.payload(place).unwrap();
                if payload.is_some() && payload == small::payload(key.0, key.1) {
                    found.insert(key);
                } else if payload.is_some() {
                    self.wrong_count += 1;
                }
            }
        }
        self.lost_count += committed.difference(&found).count() as u64;
    }
}

/// Frames of chunks with a commit mark that are not what was written.
fn by_mark(bytes: &[u8]) -> u64 {
    let mut wrong_count = 0;
    let mut start = PAGE;
    while let Some(chunk) = bytes.get(start..)
        && let Ok((header, rest)) = ChunkHeader::ref_from_prefix(chunk)
        && let Ok((mark, _)) = CommitMark::ref_from_prefix(rest)
        && &mark.magic == b"glcommit"
    {
        let index_at = header.index_offset.get() as usize;
        let index = RecordHeader::ref_from_prefix(chunk.get(index_at..).unwrap_or_default());
        let Ok((index, entries)) = index else { break };
        let entries = entries.get(..index.payload_bytes.get() as usize);
        let entries =
            <[IndexBytes]>::ref_from_bytes(entries.unwrap_or_default()).unwrap_or_default();
        let frames = entries
            .iter()
            .filter(|entry| entry.kind.get() == RecordKind::Frame as u16);
        for entry in frames {
            let at = entry.offset.get() as usize + 24;
            let payload = chunk.get(at..at + entry.payload_bytes.get() as usize);
            let written = small::payload(entry.stream.get(), entry.number.get());
            wrong_count += u64::from(payload != written.as_deref());
        }
        // Every chunk has a description: no frame at all is an index that is not there.
        wrong_count += u64::from(entries.is_empty());
        start += (128 + header.records_bytes.get() as usize).next_multiple_of(PAGE);
    }
    wrong_count
}

/// Frames that stand behind a magic with a length that fits, and are not what was written.
fn by_length(bytes: &[u8]) -> u64 {
    let mut wrong_count = 0;
    let mut at = PAGE;
    while let Some(rest) = bytes.get(at..)
        && let Ok((header, rest)) = RecordHeader::ref_from_prefix(rest)
    {
        let length = header.payload_bytes.get() as usize;
        if header.magic != RECORD_MAGIC || length > rest.len() {
            at += 8;
            continue;
        }
        if header.kind.get() == RecordKind::Frame as u16 && length > 48 {
            let number = u64::from_le_bytes(rest[..8].try_into().unwrap());
            let written = small::payload(header.stream.get(), number);
            wrong_count += u64::from(written.as_deref() != Some(&rest[..length]));
        }
        at += (24 + length).next_multiple_of(8);
    }
    wrong_count
}

/// What a writer did for the small recording, in an order.
fn log_of(chunk_frames: u64, order: Order) -> (Vec<Operation>, usize) {
    let (file, waiting) = match order {
        Order::Beside => (MemoryFile::late(), Waiting::Beside),
        _ => (MemoryFile::default(), Waiting::InPlace),
    };
    small::write(file.layer(), chunk_frames, waiting).unwrap();
    let mut log = file.log();
    let length = log.iter().map(|operation| match operation {
        Operation::Write { offset, bytes } => offset + bytes.len(),
        _ => 0,
    });
    let length = length.max().unwrap_or_default();
    if order == Order::Naive {
        // The first sync is that of the file header, then come two for each chunk: one for its data, which
        // takes the place of the one for the mark.
        let mut data = None;
        let mut number = 0;
        log.retain_mut(|operation| {
            let Operation::Sync { .. } = operation else {
                return true;
            };
            number += 1;
            if number > 1 && number % 2 == 0 {
                data = Some(operation.clone());
                return false;
            }
            if let Some(data) = data.take() {
                *operation = data;
            }
            true
        });
    }
    (log, length)
}

/// Numbers of the frames in each chunk.
fn chunks_of(chunk_frames: u64) -> Vec<Vec<u64>> {
    let mut chunks = vec![Vec::new()];
    for number in small::numbers() {
        chunks.last_mut().unwrap().push(number);
        if (number + 1).is_multiple_of(chunk_frames) {
            chunks.push(Vec::new());
        }
    }
    chunks
}

/// Goes through a recording operation by operation; after each, the power goes `samples` times, and around each
/// sync and mark in every way of a page being there, not there or torn.
fn explore(chunk_frames: u64, order: Order, samples: u64, random: &mut Pcg64Mcg) -> Tally {
    let (log, length) = log_of(chunk_frames, order);
    let chunks = chunks_of(chunk_frames);
    let syncs_of_chunk = if order == Order::Naive { 1 } else { 2 };
    let mut disk = Disk::new(length);
    let mut tally = Tally::default();
    for (place, operation) in log.iter().enumerate() {
        disk.apply(operation);
        let committed_count = disk.sync_count.saturating_sub(1) / syncs_of_chunk;
        let committed: BTreeSet<(u16, u64)> = chunks[..committed_count.min(chunks.len())]
            .iter()
            .flatten()
            .flat_map(|number| [(1, *number), (2, *number)])
            .collect();
        let is_edge = |operation: Option<&Operation>| match operation {
            Some(Operation::Write { bytes, .. }) => bytes.starts_with(b"gl") || bytes[0] == 0x89,
            Some(_) => true,
            None => false,
        };
        let is_few = disk.versions.len() <= MOST_ENUMERATED;
        assert!(is_few || order == Order::Beside, "{}", disk.versions.len());
        if is_few && (is_edge(Some(operation)) || is_edge(log.get(place + 1))) {
            enumerate(&disk, &committed, &mut tally);
        }
        for _ in 0..samples {
            let mut bytes = disk.state(|_, old, versions| sampled(random, old, versions));
            if random.random_range(0..4) == 0 && disk.synced_end < bytes.len() {
                // The new length of the file had not come to the disk.
                bytes.truncate(random.random_range(disk.synced_end..bytes.len()));
            }
            tally.judge(&bytes, &committed);
        }
    }
    tally
}

/// Pages under way whose subsets can be enumerated.
const MOST_ENUMERATED: usize = 8;

/// Every subset of the pages under way; and each page torn in every way, with all others there or none.
fn enumerate(disk: &Disk, committed: &BTreeSet<(u16, u64)>, tally: &mut Tally) {
    let count = disk.versions.len();
    for subset in 0..1_u32 << count {
        let bytes = disk.state(|place, old, versions| {
            let is_there = subset >> place & 1 == 1;
            if is_there {
                &versions[versions.len() - 1]
            } else {
                old
            }
            .to_vec()
        });
        tally.judge(&bytes, committed);
    }
    for page in 0..count {
        for way in 0..2 * (SECTORS - 1) {
            for are_others_there in [false, true] {
                let sector = way / 2 + 1;
                let bytes = disk.state(|place, old, versions| {
                    let newest = &versions[versions.len() - 1];
                    if place == page {
                        torn(old, newest, |at| (at < sector) == (way % 2 == 0))
                    } else {
                        if are_others_there { newest } else { old }.to_vec()
                    }
                });
                tally.judge(&bytes, committed);
            }
        }
    }
}

/// States sampled after each operation: enough for the catalogue in release, fewer where sums are slow.
const SAMPLES: u64 = if cfg!(debug_assertions) { 20 } else { 100 };

#[test]
fn hc_k08_a_commit_mark_stands_for_data_that_is_durable() {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    let naive = explore(3, Order::Naive, SAMPLES, &mut random);
    let shipped = explore(3, Order::Shipped, SAMPLES, &mut random);
    println!("k08 naive order: {naive:?}");
    println!("k08: {shipped:?}, tolerance 0");
    assert!(naive.wrong_by_mark_count > 0);
    assert!(shipped.state_count >= 1000);
    assert_eq!(shipped.wrong_by_mark_count, 0);
    assert_eq!(shipped.lost_count + shipped.wrong_count, 0);
}

#[test]
fn hc_k09_no_crash_loses_a_committed_frame_or_makes_one_up() {
    let mut random = Pcg64Mcg::seed_from_u64(9);
    let mut state_count = 0;
    let mut wrong_by_length_count = 0;
    for order in [Order::Shipped, Order::Beside] {
        for chunk_frames in [2, 3, 4, 6] {
            let tally = explore(chunk_frames, order, SAMPLES, &mut random);
            assert_eq!(tally.lost_count, 0, "{chunk_frames} {order:?}");
            assert_eq!(tally.wrong_count, 0, "{chunk_frames} {order:?}");
            assert_eq!(tally.wrong_by_mark_count, 0, "{chunk_frames} {order:?}");
            state_count += tally.state_count;
            wrong_by_length_count += tally.wrong_by_length_count;
        }
    }
    println!(
        "k09: {state_count} crash states, 0 committed frames lost, 0 torn ones taken (naive {wrong_by_length_count}), tolerance 0"
    );
    assert!(wrong_by_length_count > 0);
    let least = if cfg!(debug_assertions) { 5000 } else { 20_000 };
    assert!(state_count >= least);
}
