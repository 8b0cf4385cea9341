//! Files made here: whole, old, cut off, damaged, and of nothing.

use glint::import::ImportFormat;
use glint::import::oni::codec::{decode_8z, decode_16z, decode_16z_with_table};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::{COLOR_STREAM, DEPTH_STREAM, DepthSamples, Recording};

use super::Import;
use super::made::{Fields, OniFile, encode_8z, encode_16z, encode_16z_with_table};

const SIZE: [u32; 2] = [16, 12];
const AREA: usize = 16 * 12;
const FRAMES: u32 = 4;

/// Depth of frame `frame`, mm: steps, holes and a ramp.
fn depth(frame: u32) -> Vec<u16> {
    (0..AREA as u32)
        .map(|pixel| match (pixel + 7 * frame) % 23 {
            0..4 => 0,
            step @ 4..15 => (800 + step) as u16,
            step => (100 * step) as u16,
        })
        .collect()
}

/// Colour of frame `frame`.
fn color(frame: u32) -> Vec<u8> {
    (0..3 * AREA as u32)
        .map(|sample| (sample * 5 + frame * 31) as u8)
        .collect()
}

/// Microseconds between frames.
const PERIOD: u64 = 33_333;

/// The bundled film, colour 5 ms after depth; numbers from 1.
fn film(mut file: OniFile) -> OniFile {
    file.node(1, 2, b"16zT", SIZE);
    file.int(1, "xnDeviceMaxDepth", 10_000);
    file.node(2, 3, b"NONE", SIZE);
    file.int(2, "oniPixelFormat", 200);
    for frame in 0..FRAMES {
        let time = PERIOD * u64::from(frame);
        file.frame(1, time, frame + 1, &encode_16z_with_table(&depth(frame)));
        file.frame(2, time + 5000, frame + 1, &color(frame));
    }
    file
}

/// Asserts that the recording holds exactly these frames of the film.
fn assert_frames(import: &Import, depth_frames: &[u32], color_frames: &[u32]) {
    let recording = Recording::open(&import.output()).unwrap();
    let places = recording.contents().stream(DEPTH_STREAM);
    let numbers: Vec<u64> = places.iter().map(|place| place.label.number).collect();
    assert_eq!(
        numbers,
        depth_frames
            .iter()
            .map(|&frame| u64::from(frame))
            .collect::<Vec<_>>()
    );
    for (place, &frame) in places.iter().zip(depth_frames) {
        assert_eq!(recording.depth_frame(place).unwrap().pixels(), depth(frame));
        let nanos = 1000 * (PERIOD * u64::from(frame)) as i64;
        assert_eq!(place.label.device_nanos, nanos);
    }
    let places = recording.contents().stream(COLOR_STREAM);
    assert_eq!(places.len(), color_frames.len());
    for (place, &frame) in places.iter().zip(color_frames) {
        assert_eq!(recording.color_frame(place).unwrap(), color(frame));
    }
    assert!(recording.contents().gaps.len() <= 2 * FRAMES as usize);
}

#[test]
fn every_codec_comes_back() {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    for _ in 0..5_000 {
        let count = random.random_range(1..200);
        let (mut wide, mut narrow) = (random.random_range(0..32_768_u16), random.random::<u8>());
        let (mut words, mut bytes) = (Vec::new(), Vec::new());
        for _ in 0..count {
            match random.random_range(0..6) {
                0..3 => {}
                3 => {
                    wide = wide
                        .saturating_add_signed(random.random_range(-6..=6))
                        .min(32_767);
                    narrow = narrow.wrapping_add_signed(random.random_range(-6..=6));
                }
                4 => {
                    wide = wide
                        .saturating_add_signed(random.random_range(-63..=63))
                        .min(32_767);
                }
                _ => {
                    wide = random.random_range(0..32_768);
                    narrow = random.random();
                }
            }
            words.push(wide);
            bytes.push(narrow);
        }
        let mut decoded = vec![0; count];
        decode_16z(&encode_16z(&words), &mut decoded).unwrap();
        assert_eq!(decoded, words);
        decode_16z_with_table(&encode_16z_with_table(&words), &mut decoded).unwrap();
        assert_eq!(decoded, words);
        let mut decoded = vec![0; count];
        decode_8z(&encode_8z(&bytes), &mut decoded).unwrap();
        assert_eq!(decoded, bytes);
    }
}

#[test]
fn a_whole_file_is_imported_with_its_times() {
    for file in [OniFile::new(), OniFile::old()] {
        let mut bytes = film(file).end();
        bytes.extend(vec![0; 1000]);
        let import = Import::of(&bytes);
        let report = import.run().unwrap();
        assert_eq!(report.format, ImportFormat::Oni);
        assert_eq!(
            (report.frame_count, report.color_count, report.pair_count),
            (4, 4, 4)
        );
        assert!(report.missing.is_empty());
        assert_frames(&import, &[0, 1, 2, 3], &[0, 1, 2, 3]);
        let recording = Recording::open(&import.output()).unwrap();
        let streams = &recording.description().streams;
        assert_eq!(streams.depth_timing.rate_hz, Some(30.0));
        assert_eq!(streams.depth.samples, DepthSamples::Values);
        // 58.59 degrees across: half the width over the tangent of half the angle.
        assert!((streams.depth.intrinsics.focal().x - 8.0 / 0.5113_f64.tan()).abs() < 1e-9);
    }
}

#[test]
fn a_range_keeps_colour_of_its_time() {
    let import = Import::of(&film(OniFile::new()).end());
    let mut options = import.options();
    options.range = Some(1..3);
    let report = glint::import::import(&options, &mut |_, _| {}).unwrap();
    assert_eq!(
        (report.frame_count, report.color_count, report.pair_count),
        (2, 2, 2)
    );
    options.range = Some(1..5);
    let error = glint::import::import(&options, &mut |_, _| {}).unwrap_err();
    assert!(error.to_string().contains("0..4"), "{error}");
}

#[test]
fn records_of_no_known_kind_are_passed_over() {
    let mut file = OniFile::new();
    file.record(0x77, 9, Fields::default().u32(7), &[1, 2, 3]);
    let import = Import::of(&film(file).end());
    import.run().unwrap();
    assert_frames(&import, &[0, 1, 2, 3], &[0, 1, 2, 3]);
}

#[test]
fn a_file_that_breaks_off_gives_what_it_has_and_says_so() {
    let whole = film(OniFile::new()).bytes;
    let first_frame_ends = {
        let mut file = OniFile::new();
        file.node(1, 2, b"16zT", SIZE);
        file.int(1, "xnDeviceMaxDepth", 10_000);
        file.node(2, 3, b"NONE", SIZE);
        file.int(2, "oniPixelFormat", 200);
        file.frame(1, 0, 1, &encode_16z_with_table(&depth(0)));
        file.bytes.len()
    };
    for len in (0..=whole.len())
        .step_by(13)
        .chain([first_frame_ends, whole.len()])
    {
        let import = Import::of(&whole[..len]);
        match import.run() {
            Ok(report) => {
                assert!(len >= first_frame_ends);
                let [line] = report.missing.as_slice() else {
                    panic!("{:?}", report.missing);
                };
                assert!(line.contains("breaks off at byte"), "{line}");
                let frames = |count: usize| (0..count as u32).collect::<Vec<_>>();
                assert_frames(
                    &import,
                    &frames(report.frame_count),
                    &frames(report.color_count),
                );
            }
            Err(error) => {
                assert!(len < first_frame_ends, "{len}: {error}");
                assert!(!import.output().exists());
            }
        }
    }
}

#[test]
fn a_damaged_frame_is_a_gap_with_its_cause() {
    let mut file = film(OniFile::new());
    let mut payload = encode_16z_with_table(&depth(4));
    payload.truncate(payload.len() - 3);
    file.frame(1, 4 * PERIOD, 5, &payload);
    file.frame(1, 5 * PERIOD, 6, &encode_16z_with_table(&depth(5)));
    file.frame(2, 4 * PERIOD + 5000, 5, &color(4)[1..]);
    // Two numbers are missing.
    file.frame(1, 8 * PERIOD, 9, &encode_16z_with_table(&depth(8)));
    let import = Import::of(&file.end());
    let report = import.run().unwrap();
    assert_eq!(report.missing.len(), 2, "{:?}", report.missing);
    assert!(report.missing[0].starts_with("depth frame 4: "));
    assert!(report.missing[1].starts_with("colour frame 4: 575 bytes"));
    assert_frames(&import, &[0, 1, 2, 3, 5, 8], &[0, 1, 2, 3]);
    let recording = Recording::open(&import.output()).unwrap();
    let gaps = &recording.contents().gaps;
    let ranges: Vec<_> = gaps
        .iter()
        .map(|gap| (gap.stream, gap.first_number, gap.count))
        .collect();
    assert!(ranges.contains(&(DEPTH_STREAM, 4, 1)) && ranges.contains(&(DEPTH_STREAM, 6, 2)));
    assert!(ranges.contains(&(COLOR_STREAM, 4, 1)));
}

#[test]
fn shifts_stay_shifts() {
    let mut file = OniFile::new();
    file.node(1, 2, b"NONE", SIZE);
    file.int(1, "oniPixelFormat", 102);
    for (name, value) in [
        ("ConstShift", 200),
        ("PixelSizeFactor", 1),
        ("ParamCoeff", 4),
        ("ZPD", 120),
    ] {
        file.int(1, name, value);
    }
    let shifts: Vec<u16> = (0..AREA as u16).map(|pixel| 300 + pixel).collect();
    let payload: Vec<u8> = shifts
        .iter()
        .flat_map(|shift| shift.to_le_bytes())
        .collect();
    let without = {
        let mut file = file.clone();
        file.frame(1, 0, 1, &payload);
        Import::of(&file.end()).run().unwrap_err().to_string()
    };
    assert!(without.contains("depth"), "{without}");
    for (name, value) in [("ZPPS", 0.1052_f64), ("LDDIS", 7.5)] {
        let fields = Fields::default().text(name).u32(8).u64(value.to_bits());
        file.record(4, 1, fields, &[]);
    }
    file.frame(1, 0, 1, &payload);
    let import = Import::of(&file.end());
    let report = import.run().unwrap();
    assert_eq!(
        (report.frame_count, report.color_count, report.pair_count),
        (1, 0, 0)
    );
    let recording = Recording::open(&import.output()).unwrap();
    let camera = recording.depth_camera();
    assert_eq!(camera.samples, DepthSamples::Codes);
    let constants = camera.shift.clone().unwrap();
    // Samples of ps1080-protocol section 8.2.
    for (shift, millimetres) in [(400, 498.0), (800, 1193.0), (1000, 3948.0)] {
        assert!((constants.depth_mm(shift).unwrap() - millimetres).abs() < 1.0);
    }
    let place = &recording.contents().stream(DEPTH_STREAM)[0];
    assert_eq!(recording.depth_frame(place).unwrap().pixels(), shifts);
}

#[test]
fn what_is_no_recording_is_refused_in_a_sentence() {
    let refused = |bytes: &[u8]| Import::of(bytes).run().unwrap_err().to_string();
    assert!(refused(b"").contains("NI10"));
    assert!(refused(&[0; 100]).contains("NI10"));
    let newer = OniFile::of_version([1, 0, 2, 0], false);
    assert!(refused(&film(newer).end()).contains("version 1.0.2.0"));
    assert!(refused(&OniFile::new().end()).contains("depth or colour frames"));
    let mut unknown = OniFile::new();
    unknown.node(1, 2, b"wave", SIZE);
    unknown.frame(1, 0, 1, &[0]);
    assert!(refused(&unknown.end()).contains("codec"));
    let mut huge = OniFile::new();
    huge.node(1, 2, b"16zP", [1 << 30, 1 << 30]);
    huge.frame(1, 0, 1, &[0, 0]);
    assert!(refused(&huge.end()).contains("picture"));
}
