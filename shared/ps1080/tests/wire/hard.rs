//! Rows of the catalogue of hard cases that this crate has code for.

use ps1080::Damage;
use ps1080::color::{ColorDecoder, encode_color, openni2_rgb};
use ps1080::samples::{NO_SHIFT, SampleDecoder, SampleFormat, encode_samples, measured_shift};
use ps1080::stream::{DeviceTicks, Padding, TickRate};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::made;

const NEIGHBOURS: u64 = 1000;

/// A table that is asked with every code that is sent, as long as the table.
fn naive_depth_mm(table: &[u16], code: u16) -> u16 {
    table[usize::from(code) % table.len()]
}

#[test]
fn hc_b03_codes_without_a_measurement_are_none() {
    // Depth of every shift: a mistake shows as a depth.
    let table: Vec<u16> = (0..2048).map(|shift| 300 + shift).collect();
    let invalid = [0, NO_SHIFT, 2048, 4095, 32_767, u16::MAX];
    let naive = invalid.map(|code| naive_depth_mm(&table, code));
    let naive_count = naive.iter().filter(|&&depth| depth != 0).count();
    assert_eq!(naive_count, invalid.len());

    let mut wrong_count = 0;
    for code in invalid {
        wrong_count += usize::from(measured_shift(code).is_some());
    }
    for code in 0..=u16::MAX {
        let expected = (code > 0 && code < 2047).then_some(code);
        wrong_count += usize::from(measured_shift(code) != expected);
    }
    println!("B03: worst error {wrong_count} codes of 65536, tolerance 0");
    assert_eq!(wrong_count, 0);
}

/// The rule of OpenNI2 without its check: a stamp that is not above the latest is a wrap.
fn naive_unwrap(stamps: &[u32]) -> i64 {
    let (mut wraps, mut latest) = (0, None);
    let mut last = 0;
    for &stamp in stamps {
        if latest.is_some_and(|latest| stamp <= latest) {
            wraps += 1_i64 << 32;
        }
        latest = Some(stamp);
        last = wraps + i64::from(stamp);
    }
    last - i64::from(stamps[0])
}

fn summed(stamps: &[u32]) -> i64 {
    stamps
        .windows(2)
        .map(|pair| i64::from(DeviceTicks(pair[1]).since(DeviceTicks(pair[0]))))
        .sum()
}

/// Frames at 30 a second from `first` on, with a repeated and a swapped stamp.
fn stamps(first: u32, frame_count: u32, repeated: usize, swapped: usize) -> (Vec<u32>, i64) {
    let step = 2_000_000;
    let mut stamps: Vec<u32> = (0..frame_count)
        .map(|frame| first.wrapping_add(frame.wrapping_mul(step)))
        .collect();
    stamps.insert(repeated, stamps[repeated]);
    stamps.swap(swapped, swapped + 1);
    (stamps, i64::from(frame_count - 1) * i64::from(step))
}

#[test]
fn hc_b08_a_repeated_or_swapped_stamp_is_no_wrap() {
    let seconds = |ticks: i64| ticks as f64 / TickRate::PS1080.hz() as f64;
    let (listed, expected) = stamps(u32::MAX - 10_000_000, 100, 20, 40);
    let naive = seconds((naive_unwrap(&listed) - expected).abs());
    // The wrap that is there, counted right, and two that are not.
    assert!(naive > 71.0, "{naive}");

    let mut worst: f64 = seconds((summed(&listed) - expected).abs());
    let mut random = Pcg64Mcg::seed_from_u64(8);
    for _ in 0..NEIGHBOURS {
        let frame_count = random.random_range(10..4000);
        let (stamps, expected) = stamps(
            random.random(),
            frame_count,
            random.random_range(1..8),
            random.random_range(1..8),
        );
        worst = worst.max(seconds((summed(&stamps) - expected).abs()));
        let (first, later) = (DeviceTicks(stamps[0]), random.random_range(0..1 << 31));
        let difference = first.after(later).since(first);
        worst = worst.max(seconds(i64::from(difference) - later as i64).abs());
    }
    println!("B08: worst error {worst} s, tolerance 0 s");
    assert_eq!(worst, 0.0);
}

/// Unpacks as far as the payload goes and says nothing.
fn naive_unpack(payload: &[u8], codes: &mut [u16]) {
    for (code, bytes) in codes.iter_mut().zip(payload.chunks_exact(2)) {
        *code = u16::from_le_bytes([bytes[0], bytes[1]]);
    }
}

/// Whether a frame cut at `length` passes as whole.
fn passes(format: SampleFormat, payload: &[u8], codes: &mut [u16]) -> bool {
    let mut decoder = SampleDecoder::new(format, codes.len());
    decoder.begin(Padding::default());
    let pushed = decoder.push(payload, codes);
    pushed.is_ok() && decoder.finish(codes).is_ok()
}

#[test]
fn hc_b13_a_short_frame_is_never_whole() {
    let mut random = Pcg64Mcg::seed_from_u64(13);
    let (width, count) = (320, 320 * 240);
    let mut passed = 0;
    let mut tried = 0_u64;
    for format in SampleFormat::ALL {
        let codes = made::samples(format, count, &mut random);
        let mut payload = vec![0; format.max_bytes(count, width)];
        let byte_count = encode_samples(format, &codes, width, &mut payload).unwrap();
        payload.truncate(byte_count);
        if format == SampleFormat::Raw16 {
            // The frame before shows through.
            let mut shown = vec![0x5A5A; count];
            naive_unpack(&payload[..payload.len() - 512], &mut shown);
            let stale_count = shown.iter().filter(|&&code| code == 0x5A5A).count();
            assert_eq!(stale_count, 256);
        }
        let mut decoded = vec![0; count];
        let cuts = (0..byte_count).step_by(512);
        let near = (0..NEIGHBOURS / 5).map(|_| random.random_range(0..byte_count));
        for length in cuts.chain(near) {
            passed += u64::from(passes(format, &payload[..length], &mut decoded));
            tried += 1;
        }
        assert!(passes(format, &payload, &mut decoded) && decoded == codes);
        // A frame of nothing is no mistake of the wire: it is whole.
        if format != SampleFormat::Compressed {
            payload.fill(0);
            assert!(passes(format, &payload, &mut decoded));
            assert!(decoded.iter().all(|&code| measured_shift(code).is_none()));
        }
    }
    for format in made::SIZED_COLOR {
        let line_bytes = format.line_bytes(320).unwrap();
        let frame = made::color(line_bytes * 240, &mut random);
        let mut payload = vec![0; format.max_bytes(frame.len(), line_bytes)];
        let byte_count = encode_color(format, &frame, line_bytes, &mut payload).unwrap();
        let mut decoder = ColorDecoder::new(format, 320, 240).unwrap();
        let mut decoded = vec![0; frame.len()];
        for length in (0..byte_count).step_by(512) {
            decoder.begin();
            decoder.push(&payload[..length], &mut decoded).unwrap();
            let end = decoder.finish();
            passed += u64::from(!matches!(end, Err(Damage::Short { .. })));
            tried += 1;
        }
    }
    assert!(tried >= NEIGHBOURS);
    println!("B13: worst error {passed} of {tried} cut frames pass, tolerance 0");
    assert_eq!(passed, 0);
}

/// The same sums in the width of the result.
fn naive_rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    let luma = y.wrapping_sub(16);
    let (u, v) = (u.wrapping_sub(128), v.wrapping_sub(128));
    [
        luma.wrapping_add(v).wrapping_add(v >> 1),
        luma.wrapping_sub(v >> 1).wrapping_sub(u >> 2),
        luma.wrapping_add(u).wrapping_add(u),
    ]
}

/// BT.601 of limited range, in f64.
fn exact_rgb(y: u8, u: u8, v: u8) -> [f64; 3] {
    let luma = 255.0 / 219.0 * (f64::from(y) - 16.0);
    let gain = 255.0 / 224.0;
    let (u, v) = (gain * (f64::from(u) - 128.0), gain * (f64::from(v) - 128.0));
    [
        luma + 1.402 * v,
        luma - 0.344_136 * u - 0.714_136 * v,
        luma + 1.772 * u,
    ]
    .map(|channel| channel.clamp(0.0, 255.0))
}

#[test]
fn hc_b15_yuv_to_rgb_never_wraps() {
    const TOLERANCE: f64 = 1.0;
    let error = |rgb: [u8; 3], exact: [f64; 3]| {
        let differences = rgb
            .iter()
            .zip(exact)
            .map(|(&code, exact)| f64::from(code) - exact);
        differences.map(f64::abs).fold(0.0, f64::max)
    };
    assert!(error(naive_rgb(235, 128, 240), exact_rgb(235, 128, 240)) > 100.0);
    let mut worst: f64 = 0.0;
    for y in 0..=255 {
        for u in 0..=255 {
            for v in 0..=255 {
                worst = worst.max(error(openni2_rgb(y, u, v), exact_rgb(y, u, v)));
            }
        }
    }
    println!("B15: worst error {worst:.3} codes, tolerance {TOLERANCE}");
    assert!(worst <= TOLERANCE, "{worst}");
}
