//! Frames equal those that OpenNI2's player delivers.

use std::path::Path;

use glint::import::{ImportOptions, import};
use imaging::decode_jpeg;
use sequence::{COLOR_STREAM, ColorEncoding, DEPTH_STREAM, Recording};

use crate::folders::shared_data;

/// A line of `reference-crc.csv`.
struct Line<'a> {
    file: &'a str,
    stream: &'a str,
    /// From 1.
    index: usize,
    timestamp_us: i64,
    size: [u32; 2],
    pixels: &'a str,
    checksum: u32,
}

fn line(text: &str) -> Line<'_> {
    let words: Vec<&str> = text.split(',').collect();
    let number = |word: usize| words[word].parse::<i64>().unwrap();
    Line {
        file: words[0],
        stream: words[1],
        index: number(2) as usize,
        timestamp_us: number(3),
        size: [number(4) as u32, number(5) as u32],
        pixels: words[6],
        checksum: u32::from_str_radix(words[8].trim(), 16).unwrap(),
    }
}

/// Size, time and samples of a frame as a player delivers them.
fn played(recording: &Recording, line: &Line) -> ([u32; 2], i64, Vec<u8>) {
    let streams = &recording.description().streams;
    let (stream, camera) = match line.stream {
        "depth" => (DEPTH_STREAM, &streams.depth.intrinsics),
        _ => (COLOR_STREAM, &streams.color.intrinsics),
    };
    let place = &recording.contents().stream(stream)[line.index - 1];
    let samples: Vec<u8> = if line.stream == "depth" {
        let codes = recording.depth_frame(place).unwrap();
        codes
            .pixels()
            .iter()
            .flat_map(|code| code.to_le_bytes())
            .collect()
    } else {
        let frame = recording.color_frame(place).unwrap();
        if streams.color.encoding == ColorEncoding::Jpeg {
            decode_jpeg(&frame)
                .unwrap()
                .pixels()
                .as_flattened()
                .to_vec()
        } else if line.pixels == "202" {
            // A recording keeps grey as three equal channels.
            let (pixels, rest) = frame.as_chunks::<3>();
            assert!(rest.is_empty() && pixels.iter().all(|[r, g, b]| r == g && g == b));
            pixels.iter().map(|pixel| pixel[0]).collect()
        } else {
            frame
        }
    };
    (
        [camera.width(), camera.height()],
        place.label.device_nanos,
        samples,
    )
}

#[test]
fn frames_are_those_of_the_player_of_openni2() {
    let Some(folder) = shared_data("oni") else {
        eprintln!("skipped: no recordings of OpenNI here");
        return;
    };
    let reference = std::fs::read_to_string(folder.join("reference-crc.csv")).unwrap();
    let lines: Vec<Line> = reference.lines().skip(1).map(line).collect();
    let mut files: Vec<&str> = lines.iter().map(|line| line.file).collect();
    files.dedup();
    assert_eq!(files.len(), 8);
    let made = tempfile::tempdir().unwrap();
    let (mut exact_count, mut jpeg_count) = (0, 0);
    for file in files {
        let recording = imported(&folder.join(file), &made.path().join("x.glint"));
        let is_jpeg = recording.description().streams.color.encoding == ColorEncoding::Jpeg;
        let of_file = lines.iter().filter(|line| line.file == file);
        let mut counts = [0, 0];
        for line in of_file {
            let (size, nanos, samples) = played(&recording, line);
            assert_eq!((size, nanos), (line.size, 1000 * line.timestamp_us));
            counts[usize::from(line.stream != "depth")] += 1;
            let checksum = crc32fast::hash(&samples);
            if line.stream == "depth" || !is_jpeg {
                assert_eq!(
                    checksum, line.checksum,
                    "{file} {} {}",
                    line.stream, line.index
                );
                exact_count += 1;
            } else if checksum == line.checksum {
                jpeg_count += 1;
            }
        }
        let recorded = [DEPTH_STREAM, COLOR_STREAM].map(|id| recording.contents().stream(id).len());
        assert_eq!(recorded, counts, "{file}");
    }
    println!(
        "{exact_count} frames equal; of 12 JPEG frames {jpeg_count} decode to the same levels"
    );
    assert_eq!(exact_count, 38);
}

fn imported(input: &Path, output: &Path) -> Recording {
    let options = ImportOptions {
        input: input.to_path_buf(),
        output: output.to_path_buf(),
        format: None,
        rig: None,
        split: None,
        range: None,
    };
    let report = import(&options, &mut |_, _| {}).unwrap();
    assert!(report.missing.is_empty(), "{:?}", report.missing);
    Recording::open(output).unwrap()
}
