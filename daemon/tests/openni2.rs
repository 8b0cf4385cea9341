//! `glintd record openni2`: recordings against the checksums of OpenNI2's player, a camera in software through the
//! unmodified driver.
#![cfg(feature = "openni2")]

use std::path::{Path, PathBuf};
use std::process::Command;

use imaging::decode_jpeg;
use sequence::{COLOR_STREAM, ColorEncoding, DEPTH_STREAM, DepthSamples, Recording};
use virtual_carmine::TestPattern;

const SEED: u64 = 5;
const CYCLE: u64 = 8;

fn record(source: &str, output: &Path, extra: &[&str], folder: Option<&Path>) -> i32 {
    let mut command = Command::new(env!("CARGO_BIN_EXE_glintd"));
    command
        .args(["record", source, "--no-fuse", "--reserve-mb", "0", "-o"])
        .arg(output)
        .args(extra);
    if let Some(folder) = folder {
        command
            .env("LD_LIBRARY_PATH", folder)
            .env("GLINT_VIRTUAL_CAMERAS", folder.join("cameras.toml"));
    }
    let run = command.output().unwrap();
    println!("{}", String::from_utf8_lossy(&run.stderr));
    let code = run.status.code();
    code.unwrap_or_else(|| panic!("ended by {}", run.status))
}

fn shared_oni() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/oni");
    folder.is_dir().then_some(folder)
}

/// The samples as a player delivers them.
fn played(recording: &Recording, is_depth: bool, index: usize) -> Vec<u8> {
    if is_depth {
        let place = &recording.contents().stream(DEPTH_STREAM)[index];
        let codes = recording.depth_frame(place).unwrap();
        return codes
            .pixels()
            .iter()
            .flat_map(|code| code.to_le_bytes())
            .collect();
    }
    let place = &recording.contents().stream(COLOR_STREAM)[index];
    let frame = recording.color_frame(place).unwrap();
    match recording.color_camera().encoding {
        ColorEncoding::Jpeg => decode_jpeg(&frame)
            .unwrap()
            .pixels()
            .as_flattened()
            .to_vec(),
        _ => frame,
    }
}

#[test]
fn recordings_of_openni_are_what_its_player_delivers() {
    let Some(folder) = shared_oni() else {
        println!("skipped: no recordings of OpenNI here");
        return;
    };
    let reference = std::fs::read_to_string(folder.join("reference-crc.csv")).unwrap();
    let made = tempfile::tempdir().unwrap();
    let mut frame_count = 0;
    let mut opened: Option<(String, Recording)> = None;
    for line in reference.lines().skip(1) {
        let words: Vec<&str> = line.trim().split(',').collect();
        let (file, is_depth) = (words[0], words[1] == "depth");
        if opened.as_ref().is_none_or(|(name, _)| name != file) {
            let output = made.path().join(format!("{file}.glint"));
            let source = format!("openni2:{}", folder.join(file).display());
            assert_eq!(record(&source, &output, &[], None), 0, "{file}");
            opened = Some((file.to_owned(), Recording::open(&output).unwrap()));
        }
        let (_, recording) = opened.as_ref().unwrap();
        let index: usize = words[2].parse().unwrap();
        let stream = if is_depth { DEPTH_STREAM } else { COLOR_STREAM };
        let place = &recording.contents().stream(stream)[index - 1];
        let micros: i64 = words[3].parse().unwrap();
        assert_eq!(place.label.device_nanos, 1000 * micros, "{line}");
        let mut samples = played(recording, is_depth, index - 1);
        if words[6] == "202" {
            // Grey is kept as three equal channels.
            samples = samples.iter().copied().step_by(3).collect();
        }
        let checksum = u32::from_str_radix(words[8], 16).unwrap();
        assert_eq!(crc32fast::hash(&samples), checksum, "{line}");
        frame_count += 1;
    }
    println!("{frame_count} frames equal");
    assert_eq!(frame_count, 50);
}

/// The JPEG pictures in a file, in its order: from a start of image in JFIF to the last end of image before the next.
fn pictures(bytes: &[u8]) -> Vec<&[u8]> {
    const START: [u8; 4] = [0xFF, 0xD8, 0xFF, 0xE0];
    const END: [u8; 2] = [0xFF, 0xD9];
    let starts = bytes.windows(4).enumerate();
    let starts: Vec<usize> = starts
        .filter_map(|(place, window)| (window == START).then_some(place))
        .collect();
    let ends = starts.iter().skip(1).copied().chain([bytes.len()]);
    let until = starts.iter().zip(ends).filter_map(|(&start, next)| {
        let within = &bytes[start..next];
        let end = within.windows(2).rposition(|window| window == END)?;
        Some(&within[..end + 2])
    });
    until.collect()
}

/// Levels of 255 by which our decoder may differ from libjpeg, which rounds its transform and its chroma otherwise: the
/// most of any sample, and the mean.
const JPEG_BOUND: (u8, f64) = (6, 0.4);

#[test]
fn our_decoder_sees_in_jpeg_what_libjpeg_sees() {
    let Some(folder) = shared_oni() else {
        println!("skipped: no recordings of OpenNI here");
        return;
    };
    let made = tempfile::tempdir().unwrap();
    let mut picture_count = 0;
    for file in ["SampleONI.oni", "virtual-qvga-16zT-jpeg.oni"] {
        let output = made.path().join(format!("{file}.glint"));
        let source = format!("openni2:{}", folder.join(file).display());
        assert_eq!(record(&source, &output, &[], None), 0, "{file}");
        let recording = Recording::open(&output).unwrap();
        let bytes = std::fs::read(folder.join(file)).unwrap();
        let pictures = pictures(&bytes);
        assert_eq!(
            pictures.len(),
            recording.contents().stream(COLOR_STREAM).len()
        );
        for (index, picture) in pictures.into_iter().enumerate() {
            let ours = decode_jpeg(picture).unwrap();
            let theirs = played(&recording, false, index);
            let pairs = ours.pixels().as_flattened().iter().zip(&theirs);
            let (most, sum) = pairs.fold((0, 0.0), |(most, sum), (one, other)| {
                let difference = one.abs_diff(*other);
                (difference.max(most), sum + f64::from(difference))
            });
            let mean = sum / theirs.len() as f64;
            println!("{file} {index}: at most {most}, mean {mean:.3}");
            assert!(most <= JPEG_BOUND.0 && mean <= JPEG_BOUND.1);
            picture_count += 1;
        }
    }
    assert_eq!(picture_count, 12);
}

#[test]
fn a_camera_behind_the_driver_of_openni2_keeps_its_shifts() {
    let made = tempfile::tempdir().unwrap();
    usb_lookalike::library::put_into(made.path()).unwrap();
    let config = format!("[[camera]]\npattern_seed = {SEED}\npattern_cycle = {CYCLE}\n");
    std::fs::write(made.path().join("cameras.toml"), config).unwrap();
    let output = made.path().join("x.glint");
    let code = record(
        "openni2?registration=off",
        &output,
        &["--duration", "3"],
        Some(made.path()),
    );
    assert!(code == 0 || code == 3, "{code}");
    let recording = Recording::open(&output).unwrap();
    let streams = &recording.description().streams;
    assert_eq!(streams.depth.samples, DepthSamples::Codes);
    assert_eq!(streams.color.encoding, ColorEncoding::Uyvy);
    let constants = streams.depth.shift.as_ref().unwrap();
    // The camera in software is a Carmine 1.09 with 0.0394 cm.
    assert!((constants.zero_plane_pixel_mm - 0.394).abs() < 1e-6);
    assert!(recording.frame_count() > 20);
    let pattern = TestPattern::with_cycle(SEED, CYCLE);
    for index in 0..recording.frame_count() {
        let image = recording.depth_raw(index).unwrap();
        let film_index = pattern.depth_index(image.pixels()).unwrap();
        for (place, got) in (0..).zip(image.pixels()) {
            let filmed = pattern.shift(film_index, place % 640, place / 640, false);
            assert_eq!(*got, filmed, "frame {index}, pixel {place}");
        }
    }
}

#[test]
fn what_is_not_there_is_code_2_and_a_sentence() {
    let made = tempfile::tempdir().unwrap();
    let output = made.path().join("x.glint");
    assert_eq!(record("openni2:no-such-file.oni", &output, &[], None), 2);
    assert!(!output.exists());
}
