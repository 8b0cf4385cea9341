//! A small recording to be played: 32x24, depth values and Bayer.

use std::path::{Path, PathBuf};

use geometry::{Intrinsics, Pose};
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, Description,
    FileId, FrameTimes, RecordingWriter, ResponseCurve, StreamTiming, Streams, TickClock,
    VignettingCurve,
};

pub(crate) const WIDTH: u32 = 32;
pub(crate) const HEIGHT: u32 = 24;
pub(crate) const PIXEL_COUNT: usize = 768;
/// Frames a second: fast, so that a chunk of a second has many frames.
pub(crate) const RATE_HZ: f64 = 50.0;

pub(crate) fn description() -> Description {
    let intrinsics = Intrinsics::pinhole(WIDTH, HEIGHT, 30.0, 30.0, 15.5, 11.5).unwrap();
    let timing = StreamTiming {
        rate_hz: Some(RATE_HZ),
        clock: Some(TickClock {
            tick_hz: 1_000_000,
            bits: 32,
        }),
    };
    Description {
        writer: "test".to_owned(),
        created: Created::default(),
        part: None,
        streams: Streams {
            depth: DepthCamera::new(intrinsics, 0.001, 0.4..=4.0).unwrap(),
            color: ColorCamera::new(
                intrinsics,
                ColorEncoding::BayerGrbg,
                1.0,
                ResponseCurve::Identity,
                VignettingCurve::None,
            )
            .unwrap(),
            color_from_depth: Pose::IDENTITY,
            depth_timing: timing,
            color_timing: timing,
            device: None,
        },
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    }
}

/// Samples of a depth frame; number 4 shows what 3 shows.
pub(crate) fn depth(number: u64) -> Vec<u16> {
    let shown = if number == 4 { 3 } else { number } as usize;
    (0..PIXEL_COUNT)
        .map(|index| 500 + 4 * ((index / 7 + shown) % 100) as u16)
        .collect()
}

/// Samples of a colour frame.
pub(crate) fn color(number: u64) -> Vec<u8> {
    (0..PIXEL_COUNT)
        .map(|index| (index * 3 + number as usize * 5) as u8)
        .collect()
}

pub(crate) fn times(number: u64) -> FrameTimes {
    FrameTimes {
        number,
        device_ticks: Some((4_294_900_000 + 20_000 * number) % (1 << 32)),
        device_nanos: 20_000_000 * number as i64,
        host_nanos: None,
        is_repeat: false,
    }
}

/// Writes frames `0..count` but those in `holes` (both streams).
pub(crate) fn write(folder: &Path, count: u64, holes: &[u64]) -> PathBuf {
    let path = folder.join("source.glint");
    let description = description();
    let id = FileId::of_content(&[b"source"]);
    let mut writer = RecordingWriter::create_beside(&path, id, &description).unwrap();
    let mut depth_encoder =
        DepthStreamEncoder::new(&description.streams, DepthCodec::Fast).unwrap();
    let mut color_encoder = ColorStreamEncoder::new(&description.streams).unwrap();
    for number in (0..count).filter(|number| !holes.contains(number)) {
        let (payload, table) = depth_encoder.encode(&depth(number)).unwrap();
        if let Some(table) = table {
            writer.write_table(DEPTH_STREAM, table).unwrap();
        }
        writer
            .write_frame(DEPTH_STREAM, &times(number), payload)
            .unwrap();
        let payload = color_encoder.encode(&color(number)).unwrap().to_vec();
        writer
            .write_frame(COLOR_STREAM, &times(number), &payload)
            .unwrap();
        writer.seal_if_due(times(number).device_nanos).unwrap();
    }
    writer.finish("complete").unwrap();
    path
}
