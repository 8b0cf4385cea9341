//! Replays without trouble.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use glintd::capture::{CaptureOptions, capture};
use glintd::disk::Rotation;
use glintd::outcome::Outcome;
use glintd::status::StopFlag;
use sequence::verify::verify;
use sequence::{GapCause, Recording};

use super::source;

pub(crate) fn options(source: &Path, query: &str, output: &Path) -> CaptureOptions {
    let text = format!("replay:{}?speed=max{query}", source.display());
    let mut options = CaptureOptions::new(text.parse().unwrap(), output.to_path_buf());
    // The machine's disk is not what is tested.
    options.reserve_bytes = Some(0);
    options
}

fn record(folder: &Path, count: u64, holes: &[u64]) -> (Outcome, PathBuf) {
    let input = source::write(folder, count, holes);
    let output = folder.join("out.glint");
    let outcome = capture(options(&input, "", &output), &StopFlag::default()).unwrap();
    (outcome, output)
}

#[test]
fn a_lock_step_replay_keeps_every_frame_and_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let (outcome, output) = record(folder.path(), 130, &[]);
    assert_eq!(
        (outcome.frames_in, outcome.frames_recorded, outcome.gaps),
        (260, 260, 0)
    );
    assert_eq!((outcome.repeats, outcome.unpaired), (1, 0));
    let recording = Recording::open(&output).unwrap();
    assert_eq!(recording.frame_count(), 130);
    for index in 0..130 {
        let number = index as u64;
        assert_eq!(
            recording.depth_raw(index).unwrap().pixels(),
            source::depth(number)
        );
        assert_eq!(recording.color_raw(index).unwrap(), source::color(number));
        let times = recording.depth_times(index).unwrap();
        let sent = source::times(number);
        assert_eq!(
            (times.number, times.device_ticks, times.device_nanos),
            (number, sent.device_ticks, sent.device_nanos)
        );
        assert_eq!(times.is_repeat, number == 4);
        assert!(times.host_nanos.is_some());
    }
    let found = verify(&output, true).unwrap();
    assert!(found.is_whole(), "{found:?}");
    let (_, histogram) = &recording.contents().histograms[0];
    assert_eq!(
        (histogram.name.as_str(), histogram.counts[0]),
        ("pair-skew", 130)
    );
}

#[test]
fn a_hole_in_the_source_is_a_gap_with_its_cause() {
    let folder = tempfile::tempdir().unwrap();
    let (outcome, output) = record(folder.path(), 20, &[7, 8, 12]);
    assert_eq!((outcome.frames_recorded, outcome.gaps), (34, 6));
    let recording = Recording::open(&output).unwrap();
    let gaps: Vec<_> = recording
        .contents()
        .gaps
        .iter()
        .map(|gap| {
            (
                gap.stream,
                gap.first_number,
                gap.count,
                gap.cause,
                gap.to_nanos,
            )
        })
        .collect();
    let source = Some(GapCause::Source);
    assert_eq!(
        gaps,
        [
            (1, 7, 2, source, Some(180_000_000)),
            (1, 12, 1, source, Some(260_000_000)),
            (2, 7, 2, source, Some(180_000_000)),
            (2, 12, 1, source, Some(260_000_000)),
        ]
    );
    let found = verify(&output, true).unwrap();
    assert!(
        found.findings.is_empty() && found.books.iter().all(|book| book.balances),
        "{found:?}"
    );
    assert_eq!(found.missing.len(), 4);
}

#[test]
fn more_damaged_frames_than_the_pools_have_become_gaps() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 60, &[]);
    // A byte in the image of every depth frame from 10 on.
    let mut bytes = std::fs::read(&input).unwrap();
    {
        let recording = Recording::open(&input).unwrap();
        for place in &recording.contents().stream(1)[10..] {
            bytes[place.offset as usize + 80] ^= 1;
        }
    }
    let broken = folder.path().join("broken.glint");
    std::fs::write(&broken, &bytes).unwrap();
    let output = folder.path().join("out.glint");
    let outcome = capture(options(&broken, "", &output), &StopFlag::default()).unwrap();
    assert_eq!(
        (outcome.frames_in, outcome.frames_recorded, outcome.gaps),
        (120, 70, 50)
    );
    let recording = Recording::open(&output).unwrap();
    let gap = &recording.contents().gaps[0];
    assert_eq!(
        (gap.first_number, gap.count, gap.cause),
        (10, 50, Some(GapCause::Corrupt))
    );
}

#[test]
fn rounds_go_on_in_numbers_times_and_ticks() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 10, &[]);
    let output = folder.path().join("out.glint");
    let stop = StopFlag::default();
    let mut options = options(&input, "&loop", &output);
    // The source would go on for ever: the disk ends it after 60 frames.
    options.make_layer = Some(super::disks::stopping_after(60, &stop));
    capture(options, &stop).unwrap();
    let recording = Recording::open(&output).unwrap();
    assert!(recording.frame_count() >= 25, "{}", recording.frame_count());
    for index in 0..recording.frame_count() {
        let number = index as u64;
        let times = recording.depth_times(index).unwrap();
        let sent = source::times(number);
        assert_eq!(
            (times.number, times.device_nanos),
            (number, sent.device_nanos)
        );
        assert_eq!(times.device_ticks, sent.device_ticks);
        let expected = source::depth(number % 10);
        assert_eq!(recording.depth_raw(index).unwrap().pixels(), expected);
    }
    let found = verify(&output, true).unwrap();
    assert!(found.is_whole(), "{found:?}");
}

#[test]
fn a_recording_begins_before_its_trigger() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 400, &[]);
    // Never asked for: an empty recording that is whole.
    let silent = folder.path().join("silent.glint");
    let mut armed = options(&input, "", &silent);
    armed.pre_trigger = Some(Duration::from_secs(1));
    let outcome = capture(armed, &StopFlag::default()).unwrap();
    assert_eq!(
        (outcome.frames_recorded, outcome.not_asked_for, outcome.gaps),
        (0, 800, 0)
    );
    assert!(verify(&silent, true).unwrap().is_whole());
    // Asked for by the time frame 150 is on its way: what is in the file goes back a second at most.
    let output = folder.path().join("out.glint");
    let mut armed = options(&input, "", &output);
    armed.pre_trigger = Some(Duration::from_secs(1));
    let looks = Arc::new(AtomicU64::new(0));
    let trigger = Arc::clone(&armed.trigger);
    let outcome = std::thread::scope(|scope| {
        scope.spawn(|| {
            while looks.fetch_add(1, Ordering::Relaxed) < 200 {
                std::thread::yield_now();
            }
            trigger.store(true, Ordering::Relaxed);
        });
        capture(armed, &StopFlag::default()).unwrap()
    });
    assert_eq!(
        outcome.frames_recorded + outcome.not_asked_for,
        800,
        "{outcome:?}"
    );
    let recording = Recording::open(&output).unwrap();
    let places = recording.contents().stream(1);
    let first = places.first().map_or(400, |place| place.label.number);
    assert!(places.iter().map(|place| place.label.number).eq(first..400));
    for place in places {
        let depth = recording.depth_frame(place).unwrap();
        assert_eq!(depth.pixels(), source::depth(place.label.number));
    }
    assert!(verify(&output, true).unwrap().is_whole());
}

#[test]
fn a_recording_that_is_split_has_every_frame_in_one_of_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 200, &[]);
    let output = folder.path().join("out.glint");
    let mut options = options(&input, "", &output);
    // A host clock that runs as the device's: chunks of a second, so of fifty pairs.
    options.clock = super::hard::counting_clock();
    options.rotation = Rotation {
        bytes: Some(1),
        age: None,
    };
    let outcome = capture(options, &StopFlag::default()).unwrap();
    assert!(outcome.files.len() > 1, "{:?}", outcome.files);
    assert_eq!((outcome.frames_recorded, outcome.gaps), (400, 0));
    let mut next = 0;
    let mut first_id = None;
    for (position, file) in outcome.files.iter().enumerate() {
        let recording = Recording::open(file).unwrap();
        let part = recording.description().part;
        assert_eq!(
            part.map(|part| part.number),
            (position > 0).then_some(position as u32 + 1)
        );
        let id = *first_id.get_or_insert(recording.file_id());
        assert!(part.is_none_or(|part| part.first_file_id == id));
        let places = recording.contents().stream(1);
        for place in places {
            assert_eq!(place.label.number, next);
            let depth = recording.depth_frame(place).unwrap();
            assert_eq!(depth.pixels(), source::depth(next));
            next += 1;
        }
        let is_last = position + 1 == outcome.files.len();
        let end = recording.contents().end.as_ref().unwrap();
        assert_eq!(end.reason, if is_last { "complete" } else { "part" });
    }
    assert_eq!(next, 200);
}

#[test]
fn an_output_that_exists_and_a_source_that_does_not_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 3, &[]);
    let error = capture(options(&input, "", &input), &StopFlag::default()).unwrap_err();
    assert!(format!("{error:#}").contains("exists"), "{error:#}");
    let absent = folder.path().join("absent.glint");
    let output = folder.path().join("out.glint");
    let error = capture(options(&absent, "", &output), &StopFlag::default()).unwrap_err();
    assert!(format!("{error:#}").contains("absent.glint"), "{error:#}");
    assert!(!output.exists());
}
