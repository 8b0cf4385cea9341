//! Disks that are full, broken or late.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glintd::capture::capture;
use glintd::disk::LayerFactory;
use glintd::status::{EndReason, StopFlag};
use sequence::file_layer::{self, FileLayer, Syncer, WritePath};
use sequence::verify::verify;
use sequence::{GapCause, Recording, SequenceError};

use super::replay::options;
use super::source;

/// A file whose calls are watched, and refused when a judge says so.
struct Watched<J> {
    file: Box<dyn FileLayer>,
    judge: J,
    make_judge: Arc<dyn Fn() -> J + Send + Sync>,
}

/// What syncs it in another thread.
struct WatchedSyncer<J> {
    syncer: Box<dyn Syncer>,
    judge: J,
}

impl<J: FnMut(Call) -> io::Result<()> + Send> Syncer for WatchedSyncer<J> {
    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        (self.judge)(Call::Sync)?;
        self.syncer.sync(offset, bytes)
    }
}

/// A call.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Call {
    Allocate { end: u64 },
    Write,
    Sync,
}

impl<J: FnMut(Call) -> io::Result<()> + Send + 'static> FileLayer for Watched<J> {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        (self.judge)(Call::Allocate {
            end: offset + bytes,
        })?;
        self.file.allocate(offset, bytes)
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        (self.judge)(Call::Write)?;
        self.file.write_at(offset, bytes)
    }

    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        (self.judge)(Call::Sync)?;
        self.file.sync(offset, bytes)
    }

    fn syncer(&self) -> io::Result<Option<Box<dyn Syncer>>> {
        Ok(self.file.syncer()?.map(|syncer| {
            let judge = (self.make_judge)();
            Box::new(WatchedSyncer { syncer, judge }) as Box<dyn Syncer>
        }))
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        self.file.free_bytes()
    }

    fn release_before(&mut self, offset: u64) {
        self.file.release_before(offset);
    }
}

pub(crate) fn watched<J>(make_judge: impl Fn() -> J + Send + Sync + 'static) -> LayerFactory
where
    J: FnMut(Call) -> io::Result<()> + Send + 'static,
{
    let make_judge = Arc::new(make_judge);
    Box::new(
        move |path: &Path| -> Result<Box<dyn FileLayer>, SequenceError> {
            Ok(Box::new(Watched {
                file: file_layer::create(path, WritePath::default())?,
                judge: make_judge(),
                make_judge: make_judge.clone(),
            }))
        },
    )
}

/// A good disk that sets `stop` after so many frames or a few more: a record is four writes.
pub(crate) fn stopping_after(frame_count: u64, stop: &StopFlag) -> LayerFactory {
    let writes = Arc::new(AtomicU64::new(0));
    let stop = stop.clone();
    watched(move || {
        let (writes, stop) = (Arc::clone(&writes), stop.clone());
        move |call| {
            if matches!(call, Call::Write)
                && writes.fetch_add(1, Ordering::Relaxed) >= 4 * frame_count
            {
                stop.stop(EndReason::Stopped);
            }
            Ok(())
        }
    })
}

/// The sync of the second chunk's records: the file header comes first, then records and mark of the first.
const SECOND_CHUNK: u64 = 3;

/// A disk that reports an error (EIO) for the syncs with these numbers, from 0.
fn refusing_syncs(numbers: std::ops::Range<u64>) -> LayerFactory {
    let syncs = Arc::new(AtomicU64::new(0));
    watched(move || {
        let (syncs, numbers) = (Arc::clone(&syncs), numbers.clone());
        move |call| match call {
            Call::Sync if numbers.contains(&syncs.fetch_add(1, Ordering::Relaxed)) => {
                Err(io::Error::from_raw_os_error(5))
            }
            _ => Ok(()),
        }
    })
}

#[test]
fn hc_k06_a_full_disk_ends_the_recording_with_an_exact_list() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 400, &[]);
    // Bite: a file longer than the disk can be made without space for it, and that is what a map would be of.
    let sparse = std::fs::File::create(folder.path().join("sparse")).unwrap();
    sparse.set_len(1 << 40).unwrap();
    assert_eq!(sparse.metadata().unwrap().len(), 1 << 40);
    // Hold: at every size of disk the file is whole up to its end, and what is missing is said frame by frame.
    for room in [110_000_u64, 130_000, 160_000, 200_000] {
        let output = folder.path().join(format!("out-{room}.glint"));
        let mut options = options(&input, "", &output);
        options.make_layer = Some(watched(move || {
            move |call| match call {
                Call::Allocate { end } if end > room => Err(io::ErrorKind::StorageFull.into()),
                _ => Ok(()),
            }
        }));
        let outcome = capture(options, &StopFlag::default()).unwrap();
        assert_eq!(outcome.reason, "disk-full");
        assert!(outcome.bytes <= room && outcome.gaps > 0, "{outcome:?}");
        assert_eq!(
            outcome.frames_recorded + outcome.gaps,
            outcome.frames_in,
            "{outcome:?}"
        );
        let recording = Recording::open(&output).unwrap();
        let contents = recording.contents();
        for stream in [1, 2] {
            let places = contents.stream(stream);
            for gap in contents.gaps.iter().filter(|gap| gap.stream == stream) {
                assert_eq!(
                    (gap.cause, gap.first_number),
                    (Some(GapCause::DiskFull), places.len() as u64)
                );
            }
            // Nothing but the end is missing.
            assert!(
                places
                    .iter()
                    .map(|place| place.label.number)
                    .eq(0..places.len() as u64)
            );
        }
        let found = verify(&output, true).unwrap();
        assert!(found.findings.is_empty(), "{found:?}");
        println!(
            "k06: {room} bytes: {} frames kept, 0 unexplained, tolerance 0",
            outcome.frames_recorded
        );
    }
}

#[test]
fn hc_k10_a_chunk_that_the_disk_refuses_becomes_a_gap() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 200, &[]);
    let output = folder.path().join("out.glint");
    let mut options = options(&input, "", &output);
    options.clock = super::hard::counting_clock();
    // The operating system says so once, then all is well again.
    options.make_layer = Some(refusing_syncs(SECOND_CHUNK..SECOND_CHUNK + 1));
    let outcome = capture(options, &StopFlag::default()).unwrap();
    let recording = Recording::open(&output).unwrap();
    let gaps = &recording.contents().gaps;
    assert!(
        gaps.len() == 2
            && gaps
                .iter()
                .all(|gap| gap.cause == Some(GapCause::DiskError))
    );
    assert_eq!(outcome.frames_recorded + outcome.gaps, 400, "{outcome:?}");
    assert_eq!(outcome.gaps, gaps.iter().map(|gap| gap.count).sum::<u64>());
    let found = verify(&output, true).unwrap();
    assert!(
        found.findings.is_empty() && found.books.iter().all(|book| book.balances),
        "{found:?}"
    );
    println!(
        "k10: {} frames refused, {} in gaps, tolerance 0",
        outcome.gaps, outcome.gaps
    );
}

/// Looks at a counter before it is said to stand still.
const MOST_LOOKS: u64 = 50_000_000;

#[test]
fn a_disk_that_is_late_gets_longer_chunks_and_nobody_waits() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 200, &[]);
    let output = folder.path().join("out.glint");
    let mut options = options(&input, "", &output);
    options.clock = super::hard::counting_clock();
    // The second chunk, of the 25th pair and those behind it, is durable when 150 frames are stored: a record is four
    // writes.
    let enough = 4 * 150;
    let [writes, syncs] = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
    options.make_layer = Some(watched(move || {
        let [writes, syncs] = [&writes, &syncs].map(Arc::clone);
        move |call| {
            if matches!(call, Call::Write) {
                writes.fetch_add(1, Ordering::Relaxed);
            }
            let is_late =
                matches!(call, Call::Sync) && syncs.fetch_add(1, Ordering::Relaxed) == SECOND_CHUNK;
            if !is_late {
                return Ok(());
            }
            for _ in 0..MOST_LOOKS {
                if writes.load(Ordering::Relaxed) >= enough {
                    return Ok(());
                }
                std::thread::yield_now();
            }
            // The recorder waited for the disk.
            Err(io::ErrorKind::TimedOut.into())
        }
    }));
    let outcome = capture(options, &StopFlag::default()).unwrap();
    assert_eq!(
        (outcome.frames_recorded, outcome.gaps),
        (400, 0),
        "{outcome:?}"
    );
    let found = verify(&output, true).unwrap();
    assert!(found.findings.is_empty(), "{found:?}");
}

#[test]
fn a_disk_that_stays_broken_ends_the_recording_and_what_was_sealed_is_whole() {
    // From the second seal on, while recording or only when the file is closed.
    for count in [200, 120] {
        breaks_after(count);
    }
}

fn breaks_after(frame_count: u64) {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), frame_count, &[]);
    let output = folder.path().join("out.glint");
    let mut options = options(&input, "", &output);
    options.clock = super::hard::counting_clock();
    options.make_layer = Some(refusing_syncs(SECOND_CHUNK..u64::MAX));
    let outcome = capture(options, &StopFlag::default()).unwrap();
    assert_eq!(outcome.reason, "disk-error");
    assert_eq!(
        outcome.frames_recorded + outcome.gaps,
        outcome.frames_in,
        "{outcome:?}"
    );
    let recording = Recording::open(&output).unwrap();
    let contents = recording.contents();
    let held = contents.stream(1).len() + contents.stream(2).len();
    assert!(recording.frame_count() > 0);
    assert_eq!(held as u64, outcome.frames_recorded);
    for index in 0..recording.frame_count() {
        let expected = source::depth(index as u64);
        assert_eq!(recording.depth_raw(index).unwrap().pixels(), expected);
    }
}
