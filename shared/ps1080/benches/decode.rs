//! Unpacking of VGA frames on one core; `cargo bench -p ps1080` prints MB/s of output, median (best), and the ratio to
//! the twin that takes one bit or one nibble at a time.
//!
//! Payload comes in packets of 3060 bytes. Colour: smooth waves with noise of the given sigma in codes; the share of
//! full values, which cost most, is printed.

use std::hint::black_box;

use ps1080::color::{ColorDecoder, ColorFormat, encode_color};
use ps1080::samples::{SampleDecoder, SampleFormat, encode_samples};
use ps1080::stream::Padding;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use rustix::time::{ClockId, clock_gettime};

const WIDTH: u16 = 640;
const HEIGHT: u16 = 480;
const PIXELS: usize = WIDTH as usize * HEIGHT as usize;
const PACKET_BYTES: usize = 3060;
const ROUNDS: usize = 15;
const FRAMES: usize = 20;

fn main() {
    for format in SampleFormat::ALL {
        samples(format);
    }
    for sigma in [0.7, 1.5, 3.0, 6.0] {
        color(ColorFormat::CompressedYuv422, sigma);
    }
    color(ColorFormat::CompressedBayer, 1.5);
}

fn samples(format: SampleFormat) {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    // Surfaces of several pixels' width with steps, a tenth without measurement.
    let mut code = 700;
    let codes: Vec<u16> = (0..PIXELS)
        .map(|at| {
            if at % 7 == 0 {
                code = (code + random.random_range(0..3)).clamp(400, 1000) - 1;
            }
            let is_hole = at / 64 % 10 == 0;
            let shown = if is_hole { 2047 } else { code };
            shown.min(format.max_code())
        })
        .collect();
    let width = usize::from(WIDTH);
    let mut payload = vec![0; format.max_bytes(PIXELS, width)];
    let byte_count =
        encode_samples(format, &codes, width, &mut payload).expect("a buffer of the largest size");
    payload.truncate(byte_count);
    let mut decoder = SampleDecoder::new(format, PIXELS);
    let mut decoded = vec![0; PIXELS];
    let mut bitwise = vec![0; PIXELS];
    compare(&format!("samples/{format:?}"), 2 * PIXELS, |slot| {
        if slot == 1 {
            decoder.begin(Padding::default());
            for packet in payload.chunks(PACKET_BYTES) {
                decoder.push(packet, &mut decoded).expect("whole payload");
            }
            decoder.finish(&mut decoded).expect("a whole frame");
        } else if let Some(bits) = bits_of(format) {
            unpack_bitwise(bits, black_box(&payload), &mut bitwise);
            black_box(&bitwise);
        } else {
            decoder.begin(Padding::default());
            for packet in payload.chunks(1) {
                decoder.push(packet, &mut decoded).expect("whole payload");
            }
        }
    });
    assert_eq!(decoded, codes);
}

fn bits_of(format: SampleFormat) -> Option<usize> {
    match format {
        SampleFormat::Packed10 => Some(10),
        SampleFormat::Packed11 => Some(11),
        SampleFormat::Packed12 => Some(12),
        SampleFormat::Raw16 | SampleFormat::Compressed => None,
    }
}

/// A bit at a time.
fn unpack_bitwise(bits: usize, payload: &[u8], codes: &mut [u16]) {
    let mut at = 0;
    for code in codes {
        *code = 0;
        for _ in 0..bits {
            let bit = payload
                .get(at / 8)
                .map_or(0, |byte| byte >> (7 - at % 8) & 1);
            *code = *code << 1 | u16::from(bit);
            at += 1;
        }
    }
}

fn color(format: ColorFormat, sigma: f64) {
    let mut random = Pcg64Mcg::seed_from_u64(2);
    let line_bytes = format.line_bytes(WIDTH).expect("an even width");
    let frame: Vec<u8> = (0..line_bytes * usize::from(HEIGHT))
        .map(|at| {
            let column = at % line_bytes;
            let is_chroma = format == ColorFormat::CompressedYuv422 && column.is_multiple_of(2);
            let slow = (column as f64 / 90.0).sin() + (at / line_bytes) as f64 / 480.0;
            let height = if is_chroma { 15.0 } else { 60.0 };
            // An edge every 50 pixels.
            let edge = if !is_chroma && (column / 50).is_multiple_of(2) {
                25.0
            } else {
                0.0
            };
            // Sum of twelve: normal enough.
            let normal: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let noise = if is_chroma { 0.5 } else { 1.0 } * sigma * normal;
            (110.0 + height * slow + edge + noise).clamp(0.0, 255.0) as u8
        })
        .collect();
    let mut payload = vec![0; format.max_bytes(frame.len(), line_bytes)];
    let byte_count = encode_color(format, &frame, line_bytes, &mut payload)
        .expect("a buffer of the largest size");
    payload.truncate(byte_count);
    // One nibble a difference, three a full value.
    let full = (2.0 * byte_count as f64 / frame.len() as f64 - 1.0) / 2.0;
    let mut decoder = ColorDecoder::new(format, WIDTH, HEIGHT).expect("an even width");
    let mut decoded = vec![0; frame.len()];
    let name = format!("color/{format:?}/sigma {sigma}, {:.1} % full", 100.0 * full);
    compare(&name, frame.len(), |slot| {
        decoder.begin();
        // Pieces of eight bytes are too short for the fast way.
        let piece_bytes = if slot == 1 { PACKET_BYTES } else { 8 };
        for packet in payload.chunks(piece_bytes) {
            decoder.push(packet, &mut decoded).expect("whole payload");
        }
        decoder.finish().expect("a whole frame");
    });
    assert_eq!(decoded, frame);
}

/// Runs `frame(0)`, the twin, and `frame(1)` by turns and prints their speed by CPU time.
fn compare(name: &str, output_bytes: usize, mut frame: impl FnMut(usize)) {
    let mut seconds = [Vec::new(), Vec::new()];
    for round in 0..=ROUNDS {
        for (slot, seconds) in seconds.iter_mut().enumerate() {
            let start = thread_seconds();
            for _ in 0..FRAMES {
                frame(slot);
            }
            // The first round warms the caches.
            if round > 0 {
                seconds.push((thread_seconds() - start) / FRAMES as f64);
            }
        }
    }
    let [twin, shipped] = seconds.map(|mut seconds| {
        seconds.sort_by(f64::total_cmp);
        let rate = |seconds: f64| output_bytes as f64 / seconds / 1e6;
        (rate(seconds[ROUNDS / 2]), rate(seconds[0]))
    });
    println!(
        "{name}: {:.0} ({:.0}) MB/s of output, twin {:.0} ({:.0}), ratio {:.1}; median (best)",
        shipped.0,
        shipped.1,
        twin.0,
        twin.1,
        shipped.0 / twin.0
    );
}

fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
