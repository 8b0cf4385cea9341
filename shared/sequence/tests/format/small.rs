//! A small recording with everything in it: 64x48 pixels, ten pairs, a gap, a repeat, poses, notes.

use std::path::Path;
use std::sync::OnceLock;

use geometry::{DQuat, DVec3, Intrinsics, Pose};
use sequence::chunk_writer::DiskLimits;
use sequence::codecs::{CodeTable, DepthCodec};
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::file_layer::FileLayer;
use sequence::writer::Finished;
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    Device, Event, FileId, FramePose, FrameTimes, Gap, GapCause, Gravity, Histogram, Note,
    PoseState, RecordingWriter, ResponseCurve, SequenceError, Split, StreamTiming, Streams,
    TickClock, VignettingCurve,
};

pub(crate) const WIDTH: u32 = 64;
pub(crate) const HEIGHT: u32 = 48;
/// Frames that are written; number 5 is missing, so the last has number 10.
pub(crate) const FRAME_COUNT: u64 = 10;
/// The number that is missing in both streams.
pub(crate) const MISSING: u64 = 5;
/// The number whose depth repeats the one before.
pub(crate) const REPEAT: u64 = 3;
pub(crate) const FILE_ID: FileId = FileId(*b"a small glint id");

pub(crate) fn description() -> Description {
    let intrinsics = Intrinsics::pinhole(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5).unwrap();
    let timing = StreamTiming {
        rate_hz: Some(10.0),
        clock: Some(TickClock {
            tick_hz: 60_000_000,
            bits: 32,
        }),
    };
    Description {
        writer: "test".to_owned(),
        created: Created {
            unix_nanos: 1_700_000_000_123_456_789,
            host_nanos: 5_000_000_000,
        },
        part: None,
        streams: Streams {
            depth: DepthCamera::new(intrinsics, 0.001, 0.4..=4.0).unwrap(),
            color: ColorCamera::new(
                intrinsics,
                ColorEncoding::BayerGrbg,
                1.0,
                ResponseCurve::Gamma { gamma: 2.2 },
                VignettingCurve::None,
            )
            .unwrap(),
            color_from_depth: Pose::new(DQuat::IDENTITY, DVec3::new(0.025, 0.0, 0.0)).unwrap(),
            depth_timing: timing,
            color_timing: timing,
            device: Some(Device {
                name: "a camera".to_owned(),
                ..Device::default()
            }),
        },
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    }
}

/// Numbers of the frames that are written.
pub(crate) fn numbers() -> impl Iterator<Item = u64> {
    (0..=FRAME_COUNT).filter(|number| *number != MISSING)
}

/// Depth of a frame: a plane of few values with a hole; a repeat is the frame before.
pub(crate) fn depth(number: u64) -> Vec<u16> {
    let shown = if number == REPEAT { REPEAT - 1 } else { number } as u32;
    let sample = |index: u32| {
        let (column, row) = (index % WIDTH, index / WIDTH);
        if (column + shown) % WIDTH < 6 && row > 20 {
            0
        } else {
            600 + 8 * ((column / 3 + row / 2 + shown) % 40) as u16
        }
    };
    (0..WIDTH * HEIGHT).map(sample).collect()
}

/// Mosaic of a frame.
pub(crate) fn color(number: u64) -> Vec<u8> {
    let sample = |index: u32| {
        let (column, row) = (index % WIDTH, index / WIDTH);
        (40 + 2 * (column / 8) + row + 9 * (column % 2) + number as u32) as u8
    };
    (0..WIDTH * HEIGHT).map(sample).collect()
}

pub(crate) fn times(number: u64) -> FrameTimes {
    let nanos = 100_000_000 * number as i64;
    FrameTimes {
        number,
        device_ticks: Some((4_294_000_000 + 6_000_000 * number) & 0xffff_ffff),
        device_nanos: nanos,
        host_nanos: Some([5_000_000_000 + nanos, 5_020_000_000 + nanos]),
        is_repeat: false,
    }
}

pub(crate) fn pose(number: u64) -> FramePose {
    let turn = DQuat::from_rotation_y(0.01 * number as f64);
    let shift = DVec3::new(0.02 * number as f64, 0.0, 0.1);
    FramePose {
        state: if number == 7 {
            PoseState::Weak(0b100_001)
        } else {
            PoseState::Ok
        },
        covariance: (number == 7).then(|| std::array::from_fn(|index| index as f32)),
        ..FramePose::ok(number, Pose::new(turn, shift).unwrap())
    }
}

pub(crate) fn gap(stream: u16) -> Gap {
    Gap {
        stream,
        first_number: MISSING,
        count: 1,
        from_nanos: Some(400_000_000),
        to_nanos: Some(600_000_000),
        cause: Some(GapCause::PacketLoss),
        note: "two packets".to_owned(),
    }
}

pub(crate) fn split() -> Split {
    Split {
        train: vec![0, 1, 2, 3, 4, 6],
        unused: vec![7],
        test: vec![8, 9, 10],
    }
}

/// A pair as the encoders make it.
struct EncodedPair {
    number: u64,
    depth: Vec<u8>,
    /// The table that depth is the first to need.
    table: Option<CodeTable>,
    color: Vec<u8>,
}

/// All pairs, encoded once for all tests.
fn pairs() -> &'static [EncodedPair] {
    static PAIRS: OnceLock<Vec<EncodedPair>> = OnceLock::new();
    PAIRS.get_or_init(|| {
        let streams = description().streams;
        let mut depth_encoder = DepthStreamEncoder::new(&streams, DepthCodec::Fast).unwrap();
        let mut color_encoder = ColorStreamEncoder::new(&streams).unwrap();
        let encode = |number| {
            let (depth, table) = depth_encoder.encode(&depth(number)).unwrap();
            EncodedPair {
                number,
                depth: depth.to_vec(),
                table: table.cloned(),
                color: color_encoder.encode(&color(number)).unwrap().to_vec(),
            }
        };
        numbers().map(encode).collect()
    })
}

/// Times of a frame of a stream.
pub(crate) fn times_of(stream: u16, number: u64) -> FrameTimes {
    FrameTimes {
        is_repeat: stream == DEPTH_STREAM && number == REPEAT,
        ..times(number)
    }
}

/// The payload of the record of a frame; `None` of one that was never written.
pub(crate) fn payload(stream: u16, number: u64) -> Option<Vec<u8>> {
    let pair = pairs().iter().find(|pair| pair.number == number)?;
    let image = match stream {
        DEPTH_STREAM => &pair.depth,
        COLOR_STREAM => &pair.color,
        _ => return None,
    };
    let times = times_of(stream, number);
    let [first, last] = times.host_nanos?;
    let mut payload = Vec::new();
    payload.extend_from_slice(&number.to_le_bytes());
    payload.extend_from_slice(&times.device_ticks?.to_le_bytes());
    for nanos in [times.device_nanos, first, last] {
        payload.extend_from_slice(&nanos.to_le_bytes());
    }
    let flags = 6 + u64::from(times.is_repeat);
    payload.extend_from_slice(&flags.to_le_bytes());
    payload.extend_from_slice(image);
    Some(payload)
}

/// How chunks are sealed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Waiting {
    /// The writer waits for the disk.
    InPlace,
    /// It goes on with the next chunk.
    Beside,
}

/// Writes the small recording; a chunk is sealed every `chunk_frames` pairs.
pub(crate) fn write(
    layer: Box<dyn FileLayer>,
    chunk_frames: u64,
    waiting: Waiting,
) -> Result<Finished, SequenceError> {
    let mut writer = begin(layer, limits())?;
    write_records(&mut writer, chunk_frames, waiting, &mut |_| {})?;
    writer.finish("complete")
}

/// Small extents, so that short recordings cross them.
pub(crate) fn limits() -> DiskLimits {
    DiskLimits {
        extent_bytes: 128 << 10,
        floor_bytes: 0,
    }
}

pub(crate) fn begin(
    layer: Box<dyn FileLayer>,
    limits: DiskLimits,
) -> Result<RecordingWriter, SequenceError> {
    let path = Path::new("small.glint");
    RecordingWriter::on(layer, FILE_ID, path, &description(), limits)
}

/// What a writer has accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// A frame.
    Frame { stream: u16, number: u64 },
    /// Both gaps.
    Gaps,
    /// All before is on its way to the disk.
    Sent,
    /// All before the last [`Step::Sent`] was sealed, or given up.
    Seal,
}

/// Writes everything but the end; `done` hears of each step that succeeded.
pub(crate) fn write_records(
    writer: &mut RecordingWriter,
    chunk_frames: u64,
    waiting: Waiting,
    done: &mut dyn FnMut(Step),
) -> Result<(), SequenceError> {
    let set = writer.begin_poses("live", "test", DEPTH_STREAM)?;
    writer.write_event(&Event {
        stream: COLOR_STREAM,
        host_nanos: 5_000_000_000,
        details: serde_json::json!({"event": "settings", "exposure_us": 8000, "exposure_locked": true}),
    })?;
    for pair in pairs() {
        let number = pair.number;
        if number == MISSING + 1 {
            writer.write_gap(&gap(DEPTH_STREAM))?;
            writer.write_gap(&gap(COLOR_STREAM))?;
            done(Step::Gaps);
        }
        if let Some(table) = &pair.table {
            writer.write_table(DEPTH_STREAM, table)?;
        }
        for (stream, payload) in [(DEPTH_STREAM, &pair.depth), (COLOR_STREAM, &pair.color)] {
            writer.write_frame(stream, &times_of(stream, number), payload)?;
            done(Step::Frame { stream, number });
        }
        writer.write_poses(set, &[pose(number)])?;
        let is_due = (number + 1).is_multiple_of(chunk_frames);
        match waiting {
            Waiting::InPlace if is_due => {
                writer.seal()?;
                done(Step::Sent);
                done(Step::Seal);
            }
            // As the disk thread of the recorder does.
            Waiting::Beside if is_due => {
                writer.await_seal()?;
                done(Step::Seal);
                writer.begin_seal()?;
                done(Step::Sent);
            }
            Waiting::Beside if writer.is_sealed()? => done(Step::Seal),
            _ => {}
        }
    }
    write_closing_records(writer)
}

fn write_closing_records(writer: &mut RecordingWriter) -> Result<(), SequenceError> {
    writer.write_gravity(
        DEPTH_STREAM,
        &Gravity {
            number: 0,
            down: DVec3::Y,
            sigma: 0.02,
        },
    )?;
    writer.write_histogram(
        0,
        &Histogram {
            name: "pair-skew".to_owned(),
            unit: "ms".to_owned(),
            edges: vec![0.0, 1.0, 2.0],
            counts: vec![9, 1],
        },
    )?;
    writer.write_note(&Note {
        host_nanos: 5_900_000_000,
        text: "a note".to_owned(),
    })?;
    writer.write_split(&split())
}
