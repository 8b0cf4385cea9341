//! The rows of hard-cases.md that are about codecs.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{CodecError, ColorFormat, DepthCodec, DepthEncoder};

use crate::frames::*;

const NEIGHBOURS: usize = 1000;

/// Differences in 16 bits that saturate, as a cast of a wider difference does.
fn naive_through_differences(samples: &[u16]) -> Vec<u16> {
    let clamped = |value: i32| value.clamp(i32::from(i16::MIN), i32::from(i16::MAX));
    let (mut previous, mut restored) = (0, 0);
    samples
        .iter()
        .map(|&sample| {
            let difference = clamped(i32::from(sample) - previous);
            previous = i32::from(sample);
            restored += difference;
            restored as u16
        })
        .collect()
}

#[test]
fn hc_k12_differences_of_depth_wrap_and_come_back() {
    const TOLERANCE: usize = 0;
    let mut random = Pcg64Mcg::seed_from_u64(12);
    let listed = [
        noise(31, 17, &mut random),
        Frame::from_fn(640, 3, |x, y| (x * 103 + y * 32_000) as u16),
        checkerboard(33, 20, 0, u16::MAX),
        checkerboard(32, 20, 1, u16::MAX),
    ];
    for frame in &listed {
        let naive = naive_through_differences(&frame.samples);
        assert_ne!(naive, frame.samples, "the naive form must break");
    }
    let mut worst = listed.iter().map(Frame::mismatch_count).max().unwrap_or(0);
    for _ in 0..NEIGHBOURS {
        worst = worst.max(any_frame(&mut random).mismatch_count());
    }
    println!("K12, worst {worst} samples of a frame differ, tolerance {TOLERANCE}");
    assert_eq!(worst, TOLERANCE);
}

/// One sentinel at the border of the recorder instead of behind the decoder.
fn naive_recorded(samples: &[u16]) -> Vec<u16> {
    samples
        .iter()
        .map(|&sample| if sample == u16::MAX { 0 } else { sample })
        .collect()
}

#[test]
fn hc_b03_both_missing_codes_are_recorded_as_they_came() {
    const TOLERANCE: usize = 0;
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let mut worst = 0;
    let mut check = |frame: &Frame| worst = worst.max(frame.mismatch_count());
    for code in [0, 1, 2047, 2048, 65_534, u16::MAX] {
        check(&Frame::from_fn(24, 18, |_, _| code));
    }
    let listed = Frame::from_fn(24, 18, |x, y| {
        if x == y {
            u16::MAX
        } else {
            (x % 3 * 800) as u16
        }
    });
    let naive = naive_recorded(&listed.samples);
    let lost = naive
        .iter()
        .zip(&listed.samples)
        .filter(|(a, b)| a != b)
        .count();
    assert!(lost > TOLERANCE, "the naive form must lose the second code");
    check(&listed);
    for _ in 0..NEIGHBOURS {
        let codes = [0, 0, u16::MAX, 2047, 900, 907, 914];
        let (width, height) = (random.random_range(1..30), random.random_range(1..20));
        check(&Frame::from_fn(width, height, |_, _| {
            codes[random.random_range(0..codes.len())]
        }));
    }
    // Neither is ever a value of a table.
    let mut encoder = DepthEncoder::of_values(24, 18, None).unwrap();
    let _ = payload_of(&mut encoder, &listed, DepthCodec::Fast);
    assert_eq!(encoder.table().unwrap().values(), [800, 1600]);
    println!("B03, worst {worst} samples of a frame differ, tolerance {TOLERANCE}");
    assert_eq!(worst, TOLERANCE);
}

/// A frame of zeros of any length in few bytes, streamed so that the test itself needs no memory.
fn bomb(mebibytes: usize) -> Vec<u8> {
    let mut encoder = zstd::stream::Encoder::new(Vec::new(), 1).unwrap();
    let zeros = vec![0; 1 << 20];
    for _ in 0..mebibytes {
        std::io::Write::write_all(&mut encoder, &zeros).unwrap();
    }
    encoder.finish().unwrap()
}

/// A zstd frame that declares a content of `declared` bytes and holds one.
fn liar(declared: u64) -> Vec<u8> {
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0b1110_0000];
    frame.extend(declared.to_le_bytes());
    frame.extend([0b0000_1001, 0, 0, 42]);
    frame
}

/// Bytes that a decoder writes that asks the payload for its size, or lets it run until it ends.
fn naive_decoded_bytes(zstd_frame: &[u8]) -> u64 {
    if let Ok(Some(declared)) = zstd::zstd_safe::get_frame_content_size(zstd_frame) {
        return declared;
    }
    let mut decoder = zstd::stream::Decoder::new(zstd_frame).unwrap();
    std::io::copy(&mut decoder, &mut std::io::sink()).unwrap()
}

#[test]
fn hc_k05_bombs_end_where_the_frame_does() {
    /// Memory that a decoder may write to for a VGA frame, bytes.
    const TOLERANCE: u64 = 32 << 20;
    let mut random = Pcg64Mcg::seed_from_u64(14);
    let listed = [bomb(64), liar(1 << 30), liar(u64::MAX - 2)];
    for zstd_frame in &listed {
        assert!(
            naive_decoded_bytes(zstd_frame) > TOLERANCE,
            "the naive form must blow up"
        );
    }
    let fast = [&[1, 0, 0], listed[0].as_slice()].concat();
    assert!(fast.len() < 1 << 16, "a bomb is small: {}", fast.len());
    for zstd_frame in &listed {
        let depth = [&[1, 0, 0], zstd_frame.as_slice()].concat();
        assert!(decoded(&depth, None, 640, 480).is_err());
        let color = [&[1], zstd_frame.as_slice()].concat();
        assert!(color_decoded(ColorFormat::Rgb8, 640, 480, &color).is_err());
    }
    // One byte more than the frame is as much refused as a gibibyte.
    let mut worst = 0;
    for _ in 0..NEIGHBOURS {
        let (width, height) = (
            2 * random.random_range(1..20_u32),
            random.random_range(1..30_u32),
        );
        let format = FORMATS[random.random_range(0..FORMATS.len())];
        let frame_bytes = format.frame_bytes(width, height).unwrap();
        let content = vec![random.random::<u8>(); frame_bytes + random.random_range(1..5000)];
        let packed = zstd::bulk::compress(&content, 1).unwrap();
        let color = [&[1], packed.as_slice()].concat();
        worst += usize::from(color_decoded(format, width, height, &color).is_ok());
        let content = vec![
            random.random::<u8>();
            4 * (width * height) as usize + random.random_range(100..5000)
        ];
        let packed = zstd::bulk::compress(&content, 1).unwrap();
        let depth = [&[1, 0, 0], packed.as_slice()].concat();
        worst += usize::from(decoded(&depth, None, width, height).is_ok());
    }
    println!("K05, {worst} bombs accepted, tolerance 0");
    assert_eq!(worst, 0);
}

/// The numbers of RVL, lowest three bits first, in as many nibbles as they take.
fn tokens(numbers: &[u64]) -> Vec<u8> {
    let mut nibbles = Vec::new();
    for &number in numbers {
        let mut rest = number;
        while rest >= 8 {
            nibbles.push(8 | (rest & 7) as u8);
            rest >>= 3;
        }
        nibbles.push(rest as u8);
    }
    nibbles
        .chunks(2)
        .map(|pair| pair[0] | pair.get(1).map_or(0, |high| high << 4))
        .collect()
}

fn fast_payload(numbers: &[u64]) -> Vec<u8> {
    let packed = zstd::bulk::compress(&tokens(numbers), 1).unwrap();
    [&[1, 0, 0], packed.as_slice()].concat()
}

/// The check "does the run end within the frame" in 32 bits.
fn naive_accepts(position: u32, run: u64, pixel_count: u32) -> bool {
    position.wrapping_add(run as u32) <= pixel_count
}

#[test]
fn hc_k14_hostile_lengths_are_measured_against_the_frame() {
    let mut random = Pcg64Mcg::seed_from_u64(15);
    let (width, height) = (16_u32, 12_u32);
    let pixel_count = width * height;
    // After 10 zeros and one other, a run that comes round to the start of the frame.
    let listed = [
        u64::from(u32::MAX) - 9,
        u64::from(u32::MAX),
        1 << 32,
        1 << 63,
        u64::MAX,
    ];
    for run in listed {
        assert!(
            naive_accepts(11, run, pixel_count),
            "the naive form must accept {run}"
        );
        for payload in [
            fast_payload(&[10, 1, 2, run, 1]),
            fast_payload(&[10, run, 2]),
        ] {
            assert!(decoded(&payload, None, width, height).is_err(), "{run}");
        }
    }
    let mut accepted = 0;
    for _ in 0..NEIGHBOURS {
        let before = random.random_range(1..u64::from(pixel_count));
        let run =
            u64::from(pixel_count) + 1 + (random.random::<u64>() >> random.random_range(0..64_u32));
        let payload = fast_payload(&[before, run - before.min(run), 2, 2, 2]);
        accepted += usize::from(decoded(&payload, None, width, height).is_ok());
        let payload = fast_payload(&[run, 1, 2]);
        accepted += usize::from(decoded(&payload, None, width, height).is_ok());
    }
    // Runs of nothing would take time and no pixels.
    let empty = CodecError::Damaged("an empty run");
    assert_eq!(
        decoded(&fast_payload(&[0; 64]), None, width, height),
        Err(empty)
    );
    println!("K14, {accepted} runs beyond the frame accepted, tolerance 0");
    assert_eq!(accepted, 0);
}
