//! The disk, written to as a recording is.

use std::path::Path;

use anyhow::Context as _;
use geometry::{Intrinsics, Pose};
use sequence::chunk_writer::DiskLimits;
use sequence::file_layer::{self, FileLayer, WritePath};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FrameTimes, RecordingWriter, ResponseCurve, SequenceError, StreamTiming, Streams,
    VignettingCurve,
};

use super::{Finding, Severity};

/// Seconds of recording that are written.
const SECONDS: u64 = 3;
const RATE: u64 = 30;
/// Bytes of a pair that does not compress at all: the worst that a camera can send at VGA in Bayer.
const PAIR_BYTES: usize = 3 * 640 * 480;
/// What the ring in front of the disk bridges, nanoseconds.
const BRIDGED_NANOS: i64 = 3_000_000_000;
/// A disk should be so much faster than the camera.
const SPARE_FACTOR: f64 = 2.0;

/// Makes the file in place of the usual way.
pub type MakeLayer<'a> = &'a mut dyn FnMut(&Path) -> Result<Box<dyn FileLayer>, SequenceError>;

/// Writes frames that do not compress into a file in `folder`, seals a chunk a second, and removes it. `clock` counts
/// nanoseconds.
pub fn examine(folder: &Path, clock: fn() -> i64, make: Option<MakeLayer<'_>>) -> Finding {
    let bytes = SECONDS * RATE * PAIR_BYTES as u64;
    let name = format!(".glint-doctor-{}.glint", std::process::id());
    let path = folder.join(name);
    let measured = measure(&path, clock, make);
    // What cannot be made cannot be removed either.
    let _ = std::fs::remove_file(&path);
    let place = folder.display();
    let Measured {
        all_nanos,
        longest_nanos,
    } = match measured {
        Ok(measured) => measured,
        Err(error)
            if error
                .downcast_ref()
                .is_some_and(SequenceError::is_disk_full) =>
        {
            return Finding::new(
                "disk",
                Severity::Bad,
                format!("{place}: {} MB do not fit", bytes >> 20),
                format!("make room: df -h {place}; du -xh {place} | sort -h | tail"),
            );
        }
        Err(error) => {
            return Finding::new(
                "disk",
                Severity::Bad,
                format!("{place}: {error:#}"),
                format!("choose a folder that can be written to: touch {place}/x"),
            );
        }
    };
    let needed = (RATE as usize * PAIR_BYTES) as f64 / 1e6;
    let reached = bytes as f64 * 1e3 / all_nanos.max(1) as f64;
    let words = format!(
        "{place}: {reached:.0} MB/s with seals, the longest {:.0} ms; a camera that compresses badly needs {needed:.0} MB/s",
        longest_nanos as f64 / 1e6
    );
    let mend = "record to a local disk, an SSD if there is one (-o /PATH); who else writes: sudo iotop -oa";
    if reached < needed || longest_nanos >= BRIDGED_NANOS {
        Finding::new("disk", Severity::Bad, words, mend)
    } else if reached < SPARE_FACTOR * needed {
        Finding::new("disk", Severity::Warning, words, mend)
    } else {
        Finding::fine("disk", words)
    }
}

struct Measured {
    all_nanos: i64,
    /// Longest seal.
    longest_nanos: i64,
}

fn measure(
    path: &Path,
    clock: fn() -> i64,
    make: Option<MakeLayer<'_>>,
) -> anyhow::Result<Measured> {
    let layer = match make {
        Some(make) => make(path)?,
        None => file_layer::create(path, WritePath::default())?,
    };
    let id = FileId::random()?;
    let description = description()?;
    let mut writer = RecordingWriter::on(layer, id, path, &description, DiskLimits::default())?;
    let mut payload = vec![0_u8; PAIR_BYTES];
    let mut state = 1_u64;
    for bytes in payload.as_chunks_mut::<8>().0 {
        // A multiplicative congruence: no disk or file system compresses it.
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        *bytes = (state ^ state >> 29).to_le_bytes();
    }
    let (depth, color) = payload.split_at(PAIR_BYTES * 2 / 3);
    let begun = clock();
    let mut longest_nanos = 0;
    for number in 0..SECONDS * RATE {
        let times = FrameTimes {
            number,
            device_nanos: (number * 1_000_000_000 / RATE) as i64,
            ..FrameTimes::default()
        };
        writer.write_frame(DEPTH_STREAM, &times, depth)?;
        writer.write_frame(COLOR_STREAM, &times, color)?;
        if (number + 1).is_multiple_of(RATE) {
            let sealing = clock();
            writer.seal()?;
            longest_nanos = longest_nanos.max(clock().saturating_sub(sealing));
        }
    }
    writer.finish("complete")?;
    Ok(Measured {
        all_nanos: clock().saturating_sub(begun),
        longest_nanos,
    })
}

/// What the file says of the camera that is not there.
pub(super) fn description() -> anyhow::Result<Description> {
    let camera = || {
        let camera = Intrinsics::pinhole(640, 480, 570.0, 570.0, 319.5, 239.5);
        camera.context("the camera of the test")
    };
    let timing = StreamTiming::at_rate(RATE as f64);
    Ok(Description {
        writer: "glintd doctor".to_owned(),
        created: Created::default(),
        part: None,
        streams: Streams {
            depth: DepthCamera::new(camera()?, 0.001, 0.3..=10.0)?,
            color: ColorCamera::new(
                camera()?,
                ColorEncoding::BayerGrbg,
                1.0,
                ResponseCurve::Identity,
                VignettingCurve::None,
            )?,
            color_from_depth: Pose::IDENTITY,
            depth_timing: timing,
            color_timing: timing,
            device: None,
        },
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    })
}
