//! Hard cases of the recorder.

use std::sync::atomic::{AtomicI64, Ordering};

use crossbeam::sync::Parker;
use glintd::capture::capture;
use glintd::clock::HostClock;
use glintd::drops;
use glintd::frame::{ColorFrame, DepthFrame, pool};
use glintd::latency::Work;
use glintd::message::{self, MessageKind, frame_parts, gap_parts};
use glintd::pair::Unit;
use glintd::record::{RecordEnds, Recorder};
use glintd::status::{Status, StopFlag};
use ringbuf::HeapRb;
use ringbuf::traits::{Producer as _, Split as _};
use sequence::chunk_writer::DiskLimits;
use sequence::codecs::DepthCodec;
use sequence::file_layer::{self, WritePath};
use sequence::follow::Follower;
use sequence::scan::Checking;
use sequence::source::PreadFile;
use sequence::{Contents, FileId, FrameTimes, GapCause, Recording, RecordingWriter};

use zerocopy::IntoBytes as _;

use super::replay::options;
use super::source;

/// A monotonic clock that goes on by 5 ms with every look, and a wall clock that is set back all the time.
pub(crate) fn counting_clock() -> HostClock {
    static MONOTONIC: AtomicI64 = AtomicI64::new(1_000_000_000);
    static WALL: AtomicI64 = AtomicI64::new(1_700_000_000_000_000_000);
    HostClock {
        monotonic: || MONOTONIC.fetch_add(5_000_000, Ordering::Relaxed),
        wall: || WALL.fetch_sub(5_000_000_000, Ordering::Relaxed),
    }
}

#[test]
fn hc_b10_a_wall_clock_that_is_set_back_changes_nothing() {
    let clock = counting_clock();
    // Bite: an interval of the wall clock is negative.
    let begun = (clock.wall)();
    assert!((clock.wall)() - begun < 0);
    // Hold: host times rise, and the label is the one reading of the wall clock.
    let folder = tempfile::tempdir().unwrap();
    let input = source::write(folder.path(), 120, &[]);
    let output = folder.path().join("out.glint");
    let mut options = options(&input, "", &output);
    options.clock = clock;
    capture(options, &StopFlag::default()).unwrap();
    let recording = Recording::open(&output).unwrap();
    assert_eq!(recording.frame_count(), 120);
    let mut previous = i64::MIN;
    for index in 0..recording.frame_count() {
        let [first, last] = recording.depth_times(index).unwrap().host_nanos.unwrap();
        assert!(previous < first && first <= last);
        previous = last;
    }
    assert!(recording.description().created.unix_nanos > 1_600_000_000_000_000_000);
    println!("b10: 0 of 120 host times out of order, tolerance 0");
}

/// A recorder whose disk takes nothing, with what it needs; `ring_bytes` of buffer.
struct Stalled {
    units: ringbuf::HeapProd<Unit>,
    recorder: Recorder<'static>,
    receiver: message::MessageReceiver,
    depth_frames: glintd::frame::FreeFrames<DepthFrame>,
    color_frames: glintd::frame::FreeFrames<ColorFrame>,
}

fn stalled(frame_count: usize, ring_bytes: usize) -> Stalled {
    let streams = source::description().streams;
    let (depth_frames, [depth_returns]) = pool((0..frame_count).map(|_| DepthFrame::default()));
    let (color_frames, [color_returns]) = pool((0..frame_count).map(|_| ColorFrame::default()));
    let (units, from) = HeapRb::new(frame_count).split();
    let (to, receiver) = message::ring(ring_bytes);
    let (_, drops) = drops::channel();
    let [parker, other] = std::array::from_fn(|_| Parker::new());
    let ends = RecordEnds {
        from,
        to,
        drops,
        depth_returns,
        color_returns,
        disk: other.unparker().clone(),
        source: other.unparker().clone(),
        fuse: None,
        parker,
    };
    let status: &'static Status = Box::leak(Box::default());
    let recorder = Recorder::new(
        ends,
        &streams,
        DepthCodec::Fast,
        source::PIXEL_COUNT,
        false,
        status,
    )
    .unwrap();
    Stalled {
        units,
        recorder,
        receiver,
        depth_frames,
        color_frames,
    }
}

impl Stalled {
    fn push(&mut self, number: u64, depth: Vec<u16>, color: Vec<u8>) {
        let times = FrameTimes {
            ..source::times(number)
        };
        let mut depth_frame = self.depth_frames.take().unwrap();
        *depth_frame = DepthFrame {
            times,
            samples: depth,
        };
        let mut color_frame = self.color_frames.take().unwrap();
        *color_frame = ColorFrame {
            times,
            bytes: color,
        };
        self.units
            .try_push(Unit::Pair(depth_frame, color_frame))
            .unwrap();
    }

    /// Frames and gaps that the disk would get: (stream, first number, count, cause).
    fn run(mut self) -> Vec<(u16, u64, u64, Option<GapCause>)> {
        drop(self.units);
        std::thread::scope(|scope| {
            let recorder = self.recorder;
            let running = scope.spawn(move || recorder.run(false));
            // The disk takes what it can get, now and then.
            let mut seen = Vec::new();
            let mut payload = Vec::new();
            while !running.is_finished() || !self.receiver.is_empty() {
                if let Some(head) = self.receiver.receive(&mut payload) {
                    let stream = head.stream.get();
                    match head.kind() {
                        MessageKind::Frame => {
                            let (header, _) = frame_parts(&payload).unwrap();
                            seen.push((stream, header.number.get(), 1, None));
                        }
                        MessageKind::Gap => {
                            let (header, _) = gap_parts(&payload).unwrap();
                            let cause = GapCause::from_number(header.cause.get());
                            seen.push((
                                stream,
                                header.first_number.get(),
                                header.count.get(),
                                cause,
                            ));
                        }
                        _ => {}
                    }
                }
            }
            drop(running.join().unwrap().unwrap());
            seen
        })
    }
}

#[test]
fn hc_b13_short_and_empty_frames_are_gaps_and_nothing_panics() {
    // Bite: the codec refuses a short frame, so an error passed on would end the recording.
    let streams = source::description().streams;
    let mut encoder =
        sequence::encode::DepthStreamEncoder::new(&streams, DepthCodec::Fast).unwrap();
    assert!(encoder.encode(&source::depth(0)[..100]).is_err());
    // Hold: cut at every 64 samples, empty, all zero, and repeated.
    let cuts: Vec<usize> = (0..source::PIXEL_COUNT).step_by(64).collect();
    let mut stalled = stalled(cuts.len() + 3, 4 << 20);
    for (number, cut) in cuts.iter().enumerate() {
        stalled.push(
            number as u64,
            source::depth(0)[..*cut].to_vec(),
            source::color(0)[..*cut].to_vec(),
        );
    }
    let whole = cuts.len() as u64;
    stalled.push(
        whole,
        vec![0; source::PIXEL_COUNT],
        vec![0; source::PIXEL_COUNT],
    );
    stalled.push(whole + 1, source::depth(1), source::color(1));
    stalled.push(whole + 2, source::depth(1), source::color(1));
    let seen = stalled.run();
    for stream in [1, 2] {
        let of_stream: Vec<_> = seen.iter().filter(|entry| entry.0 == stream).collect();
        let corrupt = Some(GapCause::Corrupt);
        assert_eq!(*of_stream[0], (stream, 0, whole, corrupt));
        let frames: Vec<u64> = of_stream[1..].iter().map(|entry| entry.1).collect();
        assert_eq!(frames, [whole, whole + 1, whole + 2]);
    }
    println!(
        "b13: {} bad frames, {} in gaps, tolerance 0",
        2 * whole,
        2 * whole
    );
}

#[test]
fn hc_k11_a_disk_that_stands_still_costs_whole_pairs_and_the_gap_is_exact() {
    let frame_count = 60;
    // Bite: a sender that does not ask whether there is room loses frames without a word.
    let (mut naive, mut receiver) = message::ring(24_000);
    for number in 0..frame_count as u64 {
        let header = source::times(number).header();
        naive.send(
            MessageKind::Frame,
            1,
            Work::default(),
            [header.as_bytes(), &[0; 1000]],
        );
    }
    let mut payload = Vec::new();
    let received = std::iter::from_fn(|| receiver.receive(&mut payload)).count();
    assert!(received < frame_count);
    // Hold, with room for two or three pairs at a time.
    let mut stalled = stalled(frame_count, 24_000);
    for number in 0..frame_count as u64 {
        stalled.push(number, source::depth(number), source::color(number));
    }
    let seen = stalled.run();
    let mut numbers = [Vec::new(), Vec::new()];
    for (stream, first, count, cause) in seen {
        assert!(cause.is_none_or(|cause| cause == GapCause::RingFull));
        let of_stream = &mut numbers[usize::from(stream) - 1];
        of_stream.extend((first..first + count).map(|number| (number, cause)));
    }
    // Whole pairs: what is missing of one is missing of the other; each number once.
    for of_stream in &mut numbers {
        of_stream.sort_unstable_by_key(|entry| entry.0);
        assert!(
            of_stream
                .iter()
                .map(|entry| entry.0)
                .eq(0..frame_count as u64)
        );
    }
    assert_eq!(numbers[0], numbers[1]);
    println!("k11: 60 pairs, 0 unexplained, tolerance 0");
}

#[test]
fn hc_k16_a_follower_reads_a_thousand_frames_of_a_growing_file_without_an_error() {
    let folder = tempfile::tempdir().unwrap();
    // Bite: behind the last commit mark stand bytes of a chunk that is being written; a reader that goes to the
    // end of the file takes them for damage.
    let growing = folder.path().join("growing.glint");
    let layer = file_layer::create(&growing, WritePath::Pwrite).unwrap();
    let (id, limits) = (FileId([7; 16]), DiskLimits::default());
    let description = source::description();
    let mut writer = RecordingWriter::on(layer, id, &growing, &description, limits).unwrap();
    for number in 0..4 {
        writer
            .write_frame(1, &source::times(number), b"an image")
            .unwrap();
        if number == 1 {
            writer.seal().unwrap();
        }
    }
    let file = PreadFile::open(&growing).unwrap();
    assert!(
        !Contents::read(&file, Checking::Marks)
            .unwrap()
            .damages
            .is_empty()
    );
    let mut follower = Follower::open(&growing).unwrap();
    follower.poll().unwrap();
    let followed = follower.contents().unwrap();
    assert_eq!((followed.stream(1).len(), followed.damages.len()), (2, 0));

    // Hold.
    let input = source::write(folder.path(), 1000, &[]);
    let output = folder.path().join("out.glint");
    let mut options = options(&input, "", &output);
    options.clock = counting_clock();
    let (most, poll_count) = std::thread::scope(|scope| {
        let recording = scope.spawn(|| capture(options, &StopFlag::default()).unwrap());
        while !output.exists() {
            assert!(!recording.is_finished());
            std::thread::yield_now();
        }
        let mut follower = Follower::open(&output).unwrap();
        let (mut seen, mut poll_count) = (0, 0);
        while !follower.is_closed() {
            let added = follower.poll().unwrap();
            poll_count += usize::from(added > 0);
            let Some(contents) = follower.contents() else {
                continue;
            };
            assert_eq!(contents.damages, []);
            let places = contents.stream(1);
            assert!(places.len() >= seen);
            seen = places.len();
            assert!(
                places
                    .iter()
                    .map(|place| place.label.number)
                    .eq(0..seen as u64)
            );
        }
        assert_eq!(recording.join().unwrap().gaps, 0);
        (seen, poll_count)
    });
    assert_eq!(most, 1000);
    println!("k16: {most} frames in {poll_count} polls, 0 errors, tolerance 0");
}
