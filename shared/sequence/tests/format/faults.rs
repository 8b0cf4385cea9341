//! A disk that fails: at any call, once or for good.

use std::collections::BTreeSet;
use std::io;

use sequence::chunk_writer::DiskLimits;
use sequence::file_layer::FileLayer;
use sequence::scan::{Checking, Scanner};
use sequence::writer::Finished;
use sequence::{COLOR_STREAM, Contents, DEPTH_STREAM, SequenceError};

use super::memory::{Fault, MemoryFile, Plan};
use super::small::{self, Step, Waiting};

/// A frame by stream and number.
type FrameKey = (u16, u64);

/// A recording as its writer believes it to be.
struct Run {
    /// Frames that must be in the file.
    promised: BTreeSet<FrameKey>,
    /// Frames and missing numbers that were accepted.
    accepted: BTreeSet<FrameKey>,
    finished: Result<Finished, SequenceError>,
}

/// Writes the small recording as a recorder does: a full disk ends it.
fn record(
    layer: Box<dyn FileLayer>,
    chunk_frames: u64,
    limits: DiskLimits,
    waiting: Waiting,
) -> Run {
    let mut run = Run {
        promised: BTreeSet::new(),
        accepted: BTreeSet::new(),
        finished: Err(SequenceError::NotDurable),
    };
    let mut writer = match small::begin(layer, limits) {
        Ok(writer) => writer,
        Err(error) => {
            run.finished = Err(error);
            return run;
        }
    };
    let [mut frames, mut sent, mut sealed] = [const { BTreeSet::new() }; 3];
    let written =
        small::write_records(&mut writer, chunk_frames, waiting, &mut |step| match step {
            Step::Frame { stream, number } => {
                frames.insert((stream, number));
            }
            Step::Gaps => {
                run.accepted.insert((DEPTH_STREAM, small::MISSING));
                run.accepted.insert((COLOR_STREAM, small::MISSING));
            }
            Step::Sent => sent.clone_from(&frames),
            Step::Seal => sealed.clone_from(&sent),
        });
    let mut lost = writer.lost().to_vec();
    run.finished = match written {
        Ok(()) => writer.finish("complete"),
        Err(error) if error.is_disk_full() => writer.finish("disk-full"),
        Err(error) => Err(error),
    };
    run.accepted.extend(&frames);
    run.promised = if let Ok(finished) = &run.finished {
        lost.clone_from(&finished.lost);
        frames
    } else {
        sealed
    };
    run.promised
        .retain(|(stream, number)| !is_covered(&lost, *stream, *number));
    run
}

fn is_covered(gaps: &[sequence::Gap], stream: u16, number: u64) -> bool {
    gaps.iter().any(|gap| {
        gap.stream == stream && (gap.first_number..gap.first_number + gap.count).contains(&number)
    })
}

/// What a file holds: contents, and frames whose records are what was written. Panics on any other frame.
pub(crate) fn frames_of(bytes: &[u8]) -> Result<(Contents, BTreeSet<FrameKey>), SequenceError> {
    let contents = Contents::read(bytes, Checking::Everything)?;
    let scanner = Scanner::begin(bytes, Checking::Everything)?;
    let mut frames = BTreeSet::new();
    for (&stream, places) in &contents.frames {
        for place in places {
            let number = place.label.number;
            if let Some(payload) = scanner.payload(place)? {
                let written = small::payload(stream, number);
                assert_eq!(
                    Some(payload),
                    written,
                    "frame {number} of {stream} is invented"
                );
                frames.insert((stream, number));
            }
        }
    }
    Ok((contents, frames))
}

/// What a reader misses of what `run` promised.
fn missing_of(run: &Run, bytes: &[u8]) -> BTreeSet<FrameKey> {
    let frames = match frames_of(bytes) {
        Ok((_, frames)) => frames,
        Err(_) => BTreeSet::new(),
    };
    run.promised.difference(&frames).copied().collect()
}

/// Everything that must hold of a file after a run.
fn check(run: &Run, bytes: &[u8], what: &dyn std::fmt::Debug) {
    assert_eq!(missing_of(run, bytes), BTreeSet::new(), "{what:?}");
    let Ok(finished) = &run.finished else { return };
    let (contents, frames) = frames_of(bytes).unwrap();
    assert_eq!(contents.end.as_ref(), Some(&finished.end), "{what:?}");
    // The books: what was accepted is there or in one gap.
    for (stream, number) in &run.accepted {
        let gaps = contents.gaps.iter().filter(|gap| {
            gap.stream == *stream
                && (gap.first_number..gap.first_number + gap.count).contains(number)
        });
        let count = gaps.count() + usize::from(frames.contains(&(*stream, *number)));
        assert_eq!(count, 1, "{number} of {stream} after {what:?}");
    }
    for total in &finished.end.streams {
        let count = frames
            .iter()
            .filter(|(stream, _)| *stream == total.id)
            .count();
        assert_eq!(total.frames, count as u64, "{what:?}");
        let gaps = contents.gaps.iter().filter(|gap| gap.stream == total.id);
        let missing: u64 = gaps.map(|gap| gap.count).sum();
        assert_eq!(total.missing, missing, "{what:?}");
    }
}

/// Extents that every chunk crosses, and a floor that is asked for.
fn limits_of(kind: usize) -> DiskLimits {
    DiskLimits {
        extent_bytes: [4096, 128 << 10][kind],
        floor_bytes: [0, 1][kind],
    }
}

/// A case with a writer that waits for the disk, and with one that goes on.
fn both<T: Copy>(case: T) -> [(T, Waiting); 2] {
    [Waiting::InPlace, Waiting::Beside].map(|waiting| (case, waiting))
}

/// Runs with `fault` at the first, second, third … call until none is left; how many there were.
fn at_every_call(
    fault: Fault,
    is_lasting: bool,
    judge: &mut dyn FnMut(&MemoryFile, &Run, Plan),
) -> u64 {
    let mut run_count = 0;
    let chunks = [(1, 0), (3, 0), (3, 1), (100, 1)];
    for ((chunk_frames, kind), waiting) in chunks.into_iter().flat_map(both) {
        for call in 1.. {
            let plan = Plan {
                fault,
                call,
                is_lasting,
            };
            let file = MemoryFile::failing(plan);
            let run = record(file.layer(), chunk_frames, limits_of(kind), waiting);
            judge(&file, &run, plan);
            run_count += 1;
            if file.fault_count() == 0 {
                break;
            }
        }
    }
    run_count
}

#[test]
fn a_disk_that_fails_at_any_call_costs_no_sealed_frame() {
    for (fault, is_lasting) in [
        (Fault::Full, false),
        (Fault::Full, true),
        (Fault::Broken, false),
        (Fault::Broken, true),
    ] {
        let mut error_count = 0;
        let run_count = at_every_call(fault, is_lasting, &mut |file, run, plan| {
            check(run, &file.bytes(), &plan);
            // What the disk has for certain is as good.
            assert_eq!(
                missing_of(run, &file.durable_bytes()),
                BTreeSet::new(),
                "{plan:?}"
            );
            error_count += u64::from(run.finished.is_err());
        });
        println!(
            "{fault:?}, lasting {is_lasting}: {run_count} runs, {error_count} ended with an error"
        );
        assert!(run_count > 300);
    }
}

#[test]
fn signals_short_writes_and_slowness_leave_no_trace() {
    for fault in [Fault::Interrupted, Fault::Short, Fault::Slow] {
        let mut whole = Vec::new();
        let run_count = at_every_call(fault, false, &mut |file, run, plan| {
            check(run, &file.bytes(), &plan);
            assert!(run.finished.is_ok(), "{plan:?}");
            if plan.call == 1 {
                whole = file.bytes();
            }
            assert!(file.bytes() == whole, "{plan:?}");
        });
        println!("{fault:?}: {run_count} runs");
    }
    for (fault, waiting) in [Fault::Short, Fault::Slow].into_iter().flat_map(both) {
        let file = MemoryFile::failing(Plan {
            fault,
            call: 1,
            is_lasting: true,
        });
        let run = record(file.layer(), 3, limits_of(0), waiting);
        check(&run, &file.bytes(), &fault);
        assert!(file.fault_count() > 100);
    }
}

/// Fills the disk to its last byte and wants to close the file then.
fn naive_fill(file: &MemoryFile) -> io::Result<()> {
    let mut layer = file.layer();
    let mut end = 0;
    let record = [7; 1000];
    while layer.allocate(end, record.len() as u64).is_ok() {
        layer.write_at(end, &record)?;
        end += record.len() as u64;
    }
    // The index and the end of the file.
    layer.allocate(end, 4096)
}

#[test]
fn hc_k06_a_full_disk_ends_with_a_closed_file() {
    // Bite: without room kept for it, nothing can be closed.
    let naive = naive_fill(&MemoryFile::on_disk_of(1 << 20));
    assert_eq!(naive.unwrap_err().kind(), io::ErrorKind::StorageFull);
    // Hold: every size of a disk, from one without room for a header to one with room for all.
    let (mut run_count, mut closed_count, mut short_count) = (0, 0, 0);
    for capacity in (0..200 << 10).step_by(1 << 10) {
        let chunks = [(1, 0), (2, 0), (3, 0), (5, 0), (3, 1), (100, 0)];
        for ((chunk_frames, kind), waiting) in chunks.into_iter().flat_map(both) {
            let file = MemoryFile::on_disk_of(capacity);
            let run = record(file.layer(), chunk_frames, limits_of(kind), waiting);
            check(&run, &file.bytes(), &(capacity, chunk_frames));
            run_count += 1;
            match &run.finished {
                Ok(finished) => {
                    closed_count += 1;
                    short_count += u64::from(finished.end.reason == "disk-full");
                }
                // Not even an empty recording has room.
                Err(error) => {
                    assert!(error.is_disk_full());
                    assert_eq!(run.accepted, BTreeSet::new(), "{capacity}");
                }
            }
        }
    }
    println!(
        "k06: {run_count} disks, {closed_count} files closed, {short_count} of them by a full disk, 0 frames lost, tolerance 0"
    );
    assert!(run_count >= 1000 && short_count >= 20);
}

/// Asks again when a sync fails, and believes the second answer.
struct NaiveRetry(MemoryFile);

impl FileLayer for NaiveRetry {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        self.0.allocate(offset, bytes)
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        self.0.write_at(offset, bytes)
    }

    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        self.0
            .sync(offset, bytes)
            .or_else(|_| self.0.sync(offset, bytes))
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        self.0.set_len(bytes)
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        self.0.free_bytes()
    }

    fn release_before(&mut self, offset: u64) {
        self.0.release_before(offset);
    }
}

#[test]
fn hc_k10_a_sync_that_failed_is_never_believed() {
    let (mut naive_lost, mut lost, mut gap_count, mut run_count) = (0, 0, 0, 0);
    for (chunk_frames, waiting) in [1, 2, 3, 5, 100].into_iter().flat_map(both) {
        for call in 1.. {
            let plan = Plan {
                fault: Fault::Broken,
                call,
                is_lasting: false,
            };
            let file = MemoryFile::failing(plan);
            let run = record(file.layer(), chunk_frames, limits_of(0), waiting);
            lost += missing_of(&run, &file.durable_bytes()).len();
            check(&run, &file.bytes(), &plan);
            gap_count += run.finished.map_or(0, |finished| finished.lost.len());
            run_count += 1;
            let naive_file = MemoryFile::failing(plan);
            let naive_run = record(
                Box::new(NaiveRetry(naive_file.clone())),
                chunk_frames,
                limits_of(0),
                waiting,
            );
            naive_lost += missing_of(&naive_run, &naive_file.durable_bytes()).len();
            if file.fault_count() == 0 {
                break;
            }
        }
    }
    println!(
        "k10: {run_count} faults, {lost} promised frames lost (naive {naive_lost}), {gap_count} gaps, tolerance 0"
    );
    assert!(naive_lost > 0);
    assert_eq!(lost, 0);
    assert!(run_count >= 1000 && gap_count > 0);
}
