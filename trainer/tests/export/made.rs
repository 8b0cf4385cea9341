//! Small recordings with all that a recording can hold, and exports of them.

use std::path::{Path, PathBuf};

use geometry::{DVec3, Distortion, Intrinsics, Pose};
use glint::export::{ExportOptions, ExportReport, ExportTarget, export};
use glint::import::{ImportOptions, import};
use imaging::{Image, encode_jpeg};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorCamera, ColorEncoding, Created, DEPTH_STREAM, DepthCamera, DepthSamples,
    Description, Event, FileId, FramePose, FrameTimes, Gap, GapCause, Gravity, Note, PoseState,
    Recording, RecordingWriter, ResponseCurve, ShiftConstants, Split, StreamTiming, Streams,
    VignettingCurve, YuvMeaning,
};

pub(crate) const WIDTH: u32 = 128;
pub(crate) const HEIGHT: u32 = 96;
/// Numbers of the depth frames; 3 is in a gap, 6 has no colour frame near.
pub(crate) const DEPTH_NUMBERS: [u64; 8] = [0, 1, 2, 4, 5, 6, 7, 8];
/// Numbers of the colour frames; 9 has no depth frame near.
pub(crate) const COLOR_NUMBERS: [u64; 8] = [0, 1, 2, 4, 5, 7, 8, 9];
/// Depth frame 5 repeats 4, colour frame 2 repeats 1.
pub(crate) const REPEATS: [u64; 2] = [5, 2];
/// The frame of the set `source` whose pose is lost, and the one that was never tracked.
pub(crate) const LOST: [u64; 2] = [2, 7];
/// Later frames, the split and the poses are in a second chunk.
pub(crate) const LAST_OF_FIRST_CHUNK: u64 = 5;
/// Beyond what JSON readers with f64 keep.
pub(crate) const FIRST_TICK: u64 = (1 << 60) + 1;

/// A folder with a recording; removed when dropped.
pub(crate) struct Made {
    desk: tempfile::TempDir,
}

impl Made {
    /// A recording `x.glint` whose colour is of `encoding`.
    pub(crate) fn new(encoding: ColorEncoding) -> Self {
        Self::with(streams(encoding))
    }

    pub(crate) fn with(streams: Streams) -> Self {
        let desk = tempfile::tempdir().unwrap();
        write(&desk.path().join("x.glint"), &streams);
        Self { desk }
    }

    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.desk.path().join(name)
    }

    pub(crate) fn open(&self) -> Recording {
        Recording::open(&self.at("x.glint")).unwrap()
    }

    /// Options that export the recording to `output`.
    pub(crate) fn options(&self, target: ExportTarget, output: &str) -> ExportOptions {
        ExportOptions {
            input: self.at("x.glint"),
            target,
            output: self.at(output),
            poses: None,
            frame: None,
        }
    }

    pub(crate) fn export(&self, target: ExportTarget, output: &str) -> ExportReport {
        export(&self.options(target, output), &mut |_, _| {}).unwrap()
    }

    /// The sentence with which an export is refused.
    pub(crate) fn refusal(&self, options: &ExportOptions) -> String {
        let error = export(options, &mut |_, _| {}).expect_err("this cannot be exported");
        let sentence = format!("{error:#}");
        assert!(!sentence.contains('\n'), "{sentence}");
        let parts = std::fs::read_dir(self.desk.path()).unwrap();
        let parts = parts.filter(|entry| {
            let name = entry.as_ref().unwrap().file_name();
            name.to_str().unwrap().ends_with(".part")
        });
        assert_eq!(parts.count(), 0, "nothing is left");
        sentence
    }

    /// Imports an exported folder again.
    pub(crate) fn import(&self, folder: &str) -> Recording {
        import_folder(&self.at(folder), &self.at(&format!("{folder}.glint")))
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.at(name)).unwrap()
    }

    pub(crate) fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).unwrap()
    }
}

pub(crate) fn import_folder(folder: &Path, output: &Path) -> Recording {
    let options = ImportOptions {
        input: folder.to_path_buf(),
        output: output.to_path_buf(),
        format: None,
        rig: None,
        split: None,
        range: None,
    };
    import(&options, &mut |_, _| {}).unwrap();
    Recording::open(output).unwrap()
}

/// Columns and rows of the colour: odd where the encoding allows it and nothing else is compared.
pub(crate) fn color_size(encoding: ColorEncoding) -> [u32; 2] {
    match encoding {
        ColorEncoding::BayerGrbg => [WIDTH - 1, HEIGHT - 1],
        _ => [WIDTH, HEIGHT],
    }
}

pub(crate) fn streams(encoding: ColorEncoding) -> Streams {
    let lens = |[width, height]: [u32; 2], fx: f64, k1: f64| {
        let distortion = Distortion {
            k1,
            ..Distortion::NONE
        };
        Intrinsics::new(width, height, fx, 111.3, 63.1, 47.7, distortion).unwrap()
    };
    let response = ResponseCurve::Gamma { gamma: 2.2 };
    let vignetting = VignettingCurve::EvenPolynomial {
        center: [63.5, 47.5],
        radius: 80.0,
        a: [-0.3, 0.1, -0.02],
    };
    let color_lens = lens(color_size(encoding), 109.9, 0.01);
    let mut color = ColorCamera::new(color_lens, encoding, 0.7, response, vignetting).unwrap();
    if matches!(encoding, ColorEncoding::Uyvy | ColorEncoding::Yuyv) {
        color.yuv = Some(YuvMeaning {
            matrix: "bt601".to_owned(),
            range: "full".to_owned(),
            siting: "left".to_owned(),
        });
    }
    let turned = Pose::from_axis_angle(DVec3::new(0.1, 1.0, 0.2), 0.01);
    Streams {
        depth: DepthCamera::new(lens([WIDTH, HEIGHT], 110.7, 0.0), 0.00137, 0.5..=5.3).unwrap(),
        color,
        color_from_depth: Pose::from_translation(DVec3::new(-0.025, 0.001, 0.002)) * turned,
        depth_timing: StreamTiming::at_rate(30.0),
        color_timing: StreamTiming::at_rate(30.0),
        device: None,
    }
}

/// Streams whose depth is shifts, with a table of millimetres.
pub(crate) fn streams_of_shifts() -> Streams {
    let mut streams = streams(ColorEncoding::Jpeg);
    streams.depth.samples = DepthSamples::Codes;
    streams.depth.shift = Some(ShiftConstants {
        zero_plane_mm: 120.0,
        zero_plane_pixel_mm: 0.1042,
        emitter_distance_cm: 7.5,
        param_coefficient: 4.0,
        constant_shift: 200.0,
        pixel_size_factor: 1.0,
        offset_pixels: ShiftConstants::USUAL_OFFSET,
        table_mm: (0..2048).map(millimetres_of_shift).collect(),
    });
    streams
}

pub(crate) fn millimetres_of_shift(shift: u16) -> u16 {
    if shift < 100 { 0 } else { 400 + 2 * shift }
}

/// 33 ms apart and never round.
pub(crate) fn depth_nanos(number: u64) -> i64 {
    1_305_031_102_175_304_123 + 33_333_333 * number as i64
}

pub(crate) fn color_nanos(number: u64) -> i64 {
    depth_nanos(number) + 4_000_001
}

/// Noise between 1 and 3 m, with samples that are no measurement.
pub(crate) fn depth(number: u64, is_shift: bool) -> Image<u16> {
    let number = if number == REPEATS[0] {
        number - 1
    } else {
        number
    };
    let mut random = Pcg64Mcg::seed_from_u64(number);
    Image::from_fn(WIDTH, HEIGHT, |_, y| match (y, is_shift) {
        (0, _) => 0,
        (1, false) => u16::MAX,
        (_, false) => random.random_range(800..2200),
        (_, true) => random.random_range(300..1200),
    })
}

/// The raw frame in its encoding, or a JPEG.
pub(crate) fn color(number: u64, encoding: ColorEncoding) -> Vec<u8> {
    let number = if number == REPEATS[1] {
        number - 1
    } else {
        number
    };
    let [width, height] = color_size(encoding);
    let pixel = |x: u32, y: u32| [(2 * x) as u8, (2 * y) as u8, (20 * number) as u8];
    match encoding {
        ColorEncoding::Jpeg => encode_jpeg(&Image::from_fn(WIDTH, HEIGHT, pixel), 90).unwrap(),
        ColorEncoding::Rgb8 => {
            let image = Image::from_fn(WIDTH, HEIGHT, pixel);
            image.pixels().as_flattened().to_vec()
        }
        ColorEncoding::BayerGrbg => noise(number, width * height),
        ColorEncoding::Uyvy | ColorEncoding::Yuyv => noise(number, 2 * width * height),
        ColorEncoding::Infrared10 => noise(number, 2 * width * height)
            .chunks_exact(2)
            .flat_map(|bytes| [bytes[0], bytes[1] & 3])
            .collect(),
    }
}

fn noise(seed: u64, count: u32) -> Vec<u8> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..count).map(|_| random.random()).collect()
}

pub(crate) fn world_from_depth(number: u64) -> Pose {
    let t = number as f64;
    Pose::from_translation(DVec3::new(0.011 * t, 1.0 / 3.0, -0.007 * t))
        * Pose::from_axis_angle(DVec3::new(0.2, 1.0, 0.1), 0.03 * t)
}

fn write(path: &Path, streams: &Streams) {
    let description = Description {
        writer: "a test".to_owned(),
        created: Created::default(),
        part: None,
        streams: streams.clone(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    let mut writer = RecordingWriter::create_beside(path, FileId([7; 16]), &description).unwrap();
    let mut depth_encoder = DepthStreamEncoder::new(streams, DepthCodec::Fast).unwrap();
    let mut color_encoder = ColorStreamEncoder::new(streams).unwrap();
    let is_shift = streams.depth.samples == DepthSamples::Codes;
    write_events(&mut writer);
    for number in 0..10 {
        let times = |device_nanos: i64, is_repeat| FrameTimes {
            number,
            device_ticks: Some(FIRST_TICK + 1_000 * number),
            device_nanos,
            host_nanos: Some([device_nanos + 5_000_000, device_nanos + 9_000_000]),
            is_repeat,
        };
        if DEPTH_NUMBERS.contains(&number) {
            let samples = depth(number, is_shift);
            let (payload, table) = depth_encoder.encode(samples.pixels()).unwrap();
            if let Some(table) = table {
                writer.write_table(DEPTH_STREAM, table).unwrap();
            }
            let times = times(depth_nanos(number), number == REPEATS[0]);
            writer.write_frame(DEPTH_STREAM, &times, payload).unwrap();
        }
        if COLOR_NUMBERS.contains(&number) {
            let frame = color(number, streams.color.encoding);
            let payload = color_encoder.encode(&frame).unwrap();
            let times = times(color_nanos(number), number == REPEATS[1]);
            writer.write_frame(COLOR_STREAM, &times, payload).unwrap();
        }
        if number == LAST_OF_FIRST_CHUNK {
            writer.seal().unwrap();
        }
    }
    let split = Split {
        train: vec![0, 1, 2, 4],
        unused: vec![5, 6],
        test: vec![7, 8],
    };
    writer.write_split(&split).unwrap();
    write_poses(&mut writer);
    writer.finish("complete").unwrap();
}

fn write_events(writer: &mut RecordingWriter) {
    let gap = |stream, first_number| Gap {
        stream,
        first_number,
        count: 1,
        from_nanos: Some(depth_nanos(first_number - 1)),
        to_nanos: None,
        cause: Some(GapCause::PacketLoss),
        note: "a test".to_owned(),
    };
    for gap in [
        gap(DEPTH_STREAM, 3),
        gap(COLOR_STREAM, 3),
        gap(COLOR_STREAM, 6),
    ] {
        writer.write_gap(&gap).unwrap();
    }
    let details = serde_json::json!({"event": "settings", "exposure_us": 8000, "gain": 1.5});
    let event = Event {
        stream: COLOR_STREAM,
        host_nanos: i64::MAX - 1,
        details,
    };
    writer.write_event(&event).unwrap();
    let text = "the lamp was switched on".to_owned();
    let note = Note {
        host_nanos: 5,
        text,
    };
    writer.write_note(&note).unwrap();
    let gravity = Gravity {
        number: 1,
        down: DVec3::Y,
        sigma: 0.01,
    };
    writer.write_gravity(DEPTH_STREAM, &gravity).unwrap();
}

/// `source` of the depth camera, `live` of the colour camera, in two worlds.
fn write_poses(writer: &mut RecordingWriter) {
    let source = writer
        .begin_poses("source", "a test", DEPTH_STREAM)
        .unwrap();
    let poses: Vec<FramePose> = DEPTH_NUMBERS
        .into_iter()
        .filter(|number| *number != LOST[1])
        .map(|number| FramePose {
            state: if number == LOST[0] {
                PoseState::Lost
            } else {
                PoseState::Ok
            },
            ..FramePose::ok(number, world_from_depth(number))
        })
        .collect();
    writer.write_poses(source, &poses).unwrap();
    let live = writer.begin_poses("live", "a test", COLOR_STREAM).unwrap();
    let poses: Vec<FramePose> = COLOR_NUMBERS
        .into_iter()
        .map(|number| FramePose {
            map: u32::from(number >= 7),
            ..FramePose::ok(number, world_from_depth(number))
        })
        .collect();
    writer.write_poses(live, &poses).unwrap();
}
