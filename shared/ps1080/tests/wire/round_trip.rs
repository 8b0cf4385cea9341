//! Every codec gives back what it was given, in whatever pieces it comes.

use ps1080::Damage;
use ps1080::color::{ColorDecoder, ColorFormat, encode_color};
use ps1080::samples::{NO_DEPTH, SampleDecoder, SampleFormat, encode_samples, measured_shift};
use ps1080::stream::Padding;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::made;
use super::receive::{Host, Outcome, packets, ticks_of};

const ROUNDS: u64 = 300;

fn encoded(format: SampleFormat, codes: &[u16], width: usize) -> Vec<u8> {
    let mut payload = vec![0; format.max_bytes(codes.len(), width)];
    let byte_count = encode_samples(format, codes, width, &mut payload).unwrap();
    payload.truncate(byte_count);
    payload
}

#[test]
fn samples_in_any_pieces() {
    for seed in 0..ROUNDS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for format in SampleFormat::ALL {
            let width = random.random_range(1..80);
            let count = width * random.random_range(1..12);
            let codes = made::samples(format, count, &mut random);
            let payload = encoded(format, &codes, width);
            let mut decoder = SampleDecoder::new(format, count);
            let mut decoded = vec![0x5A5A; count];
            for _ in 0..2 {
                decoder.begin(Padding::default());
                for piece in made::pieces(&payload, &mut random) {
                    decoder.push(piece, &mut decoded).unwrap();
                }
                assert_eq!(decoder.finish(&mut decoded), Ok(()));
                assert_eq!(decoded, codes, "{format:?}, seed {seed}");
            }
        }
    }
}

#[test]
fn packed_samples_are_those_of_a_bit_string() {
    for seed in 0..ROUNDS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for (format, bits) in [
            (SampleFormat::Packed10, 10),
            (SampleFormat::Packed11, 11),
            (SampleFormat::Packed12, 12),
        ] {
            let count = random.random_range(0..100);
            let codes = made::samples(format, count, &mut random);
            let mut string: String = codes.iter().map(|code| format!("{code:0bits$b}")).collect();
            string.extend(std::iter::repeat_n('0', (8 - string.len() % 8) % 8));
            let expected: Vec<u8> = string
                .as_bytes()
                .chunks(8)
                .map(|byte| u8::from_str_radix(str::from_utf8(byte).unwrap(), 2).unwrap())
                .collect();
            assert_eq!(
                encoded(format, &codes, 10),
                expected,
                "{format:?}, seed {seed}"
            );
        }
    }
}

#[test]
fn codes_that_a_format_cannot_hold_are_not_encoded() {
    for format in SampleFormat::ALL {
        let mut payload = [0; 64];
        let most = format.max_code();
        assert!(encode_samples(format, &[most; 4], 4, &mut payload).is_ok());
        if let Some(more) = most.checked_add(1) {
            assert!(encode_samples(format, &[0, more, 0, 0], 4, &mut payload).is_err());
        }
        let codes = [0, most, 0, most, 0, most, 0, most];
        let byte_count = encoded(format, &codes, 8).len();
        let mut small = vec![0; byte_count - 1];
        assert!(encode_samples(format, &codes, 8, &mut small).is_err());
    }
}

#[test]
fn padding_is_filled_in_around_what_is_sent() {
    for seed in 0..ROUNDS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for format in SampleFormat::ALL {
            let padding = Padding {
                before: random.random_range(0..20),
                after: random.random_range(0..20),
            };
            let (before, after) = (usize::from(padding.before), usize::from(padding.after));
            let sent = made::samples(format, random.random_range(0..50), &mut random);
            let payload = encoded(format, &sent, 16);
            let count = before + sent.len() + after;
            let mut decoder = SampleDecoder::new(format, count);
            let mut decoded = vec![0x5A5A; count];
            decoder.begin(padding);
            for piece in made::pieces(&payload, &mut random) {
                decoder.push(piece, &mut decoded).unwrap();
            }
            assert_eq!(decoder.finish(&mut decoded), Ok(()));
            assert_eq!(decoded[before..before + sent.len()], sent);
            let around = decoded[..before].iter().chain(&decoded[count - after..]);
            assert!(around.copied().all(|code| code == NO_DEPTH));
            assert_eq!(measured_shift(NO_DEPTH), None);
        }
    }
    let mut decoder = SampleDecoder::new(SampleFormat::Raw16, 10);
    decoder.begin(Padding {
        before: 6,
        after: 5,
    });
    assert_eq!(decoder.push(&[], &mut [0; 10]), Err(Damage::Padding));
    assert_eq!(decoder.finish(&mut [0; 10]), Err(Damage::Padding));
}

#[test]
fn colour_in_any_pieces() {
    for seed in 0..ROUNDS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for format in made::SIZED_COLOR {
            let width = 2 * random.random_range(1..60);
            let height = random.random_range(1..8);
            let line_bytes = format.line_bytes(width).unwrap();
            let frame = made::color(line_bytes * usize::from(height), &mut random);
            let mut payload = vec![0; format.max_bytes(frame.len(), line_bytes)];
            let byte_count = encode_color(format, &frame, line_bytes, &mut payload).unwrap();
            payload.truncate(byte_count);
            let mut decoder = ColorDecoder::new(format, width, height).unwrap();
            let mut decoded = vec![0; frame.len()];
            decoder.begin();
            for piece in made::pieces(&payload, &mut random) {
                decoder.push(piece, &mut decoded).unwrap();
            }
            assert_eq!(decoder.finish(), Ok(frame.len()));
            assert_eq!(decoded, frame, "{format:?}, seed {seed}");
        }
    }
}

#[test]
fn an_odd_width_has_no_pairs() {
    for format in made::SIZED_COLOR {
        assert!(ColorDecoder::new(format, 641, 480).is_none());
    }
    assert!(ColorDecoder::new(ColorFormat::Jpeg, 641, 480).is_some());
}

/// A JPEG stream with everything that could be taken for its end: a segment that holds EOI, stuffed and restart
/// markers, fill bytes, a second scan.
fn jpeg(random: &mut Pcg64Mcg) -> Vec<u8> {
    let mut bytes = vec![0xFF, 0xD8];
    let mut segment = |bytes: &mut Vec<u8>, marker: u8, content: &[u8]| {
        bytes.extend(std::iter::repeat_n(0xFF, random.random_range(1..4)));
        bytes.push(marker);
        bytes.extend((content.len() as u16 + 2).to_be_bytes());
        bytes.extend(content);
    };
    segment(&mut bytes, 0xE0, &[1, 0xFF, 0xD8, 0xFF, 0xD9, 7]);
    segment(&mut bytes, 0xFE, &[]);
    for _ in 0..2 {
        segment(&mut bytes, 0xDA, &[3, 0xFF, 0xD9]);
        bytes.extend([9, 0xFF, 0x00, 0xFF, 0xD3, 0xD9, 0xFF, 0x00]);
    }
    bytes.extend([0xFF, 0xFF, 0xD9]);
    bytes
}

#[test]
fn a_jpeg_ends_at_its_end_whatever_follows() {
    for seed in 0..ROUNDS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let stream = jpeg(&mut random);
        let filler = random.random_range(0..40);
        let mut payload = stream.clone();
        payload.extend((0..filler).map(|_| random.random::<u8>()));
        let mut decoder = ColorDecoder::new(ColorFormat::Jpeg, 32, 32).unwrap();
        let mut decoded = vec![0; stream.len() + random.random_range(0..9)];
        decoder.begin();
        for piece in made::pieces(&payload, &mut random) {
            decoder.push(piece, &mut decoded).unwrap();
        }
        assert_eq!(decoder.finish(), Ok(stream.len()));
        assert_eq!(decoded[..stream.len()], stream);
        // Without its last byte it has no end, and a buffer of that size is too small.
        decoder.begin();
        decoder
            .push(&stream[..stream.len() - 1], &mut decoded)
            .unwrap();
        assert_eq!(decoder.finish(), Err(Damage::Cut));
        decoder.begin();
        let mut small = vec![0; stream.len() - 1];
        assert_eq!(decoder.push(&stream, &mut small), Err(Damage::Excess));
    }
    let mut decoder = ColorDecoder::new(ColorFormat::Jpeg, 32, 32).unwrap();
    decoder.begin();
    let not_one = [0xFF, 0xD9, 0, 0];
    assert_eq!(decoder.push(&not_one, &mut [0; 9]), Err(Damage::NotJpeg));
}

#[test]
fn streams_in_any_pieces() {
    for seed in 0..ROUNDS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let format = SampleFormat::ALL[random.random_range(0..5)];
        let count = 16 * random.random_range(1..40);
        let frames: Vec<Vec<u16>> = (0..random.random_range(1..5))
            .map(|_| made::samples(format, count, &mut random))
            .collect();
        let payloads: Vec<Vec<u8>> = frames
            .iter()
            .map(|codes| encoded(format, codes, 16))
            .collect();
        let packet_bytes = [13, 40, 512, 3072, 65_012, 65_512, 65_535][random.random_range(0..7)];
        let stream = packets(&payloads, packet_bytes).concat();
        let mut host = Host::new(format, count);
        for piece in made::pieces(&stream, &mut random) {
            host.transfer(piece);
        }
        let expected: Vec<Outcome> = frames
            .into_iter()
            .enumerate()
            .map(|(index, codes)| Outcome::Frame(ticks_of(index), codes))
            .collect();
        assert_eq!(host.outcomes, expected, "seed {seed}");
        let counts = host.receiver.counts();
        assert_eq!(counts.ended_count, expected.len() as u64);
        assert_eq!((counts.lost_count, counts.garbage_bytes), (0, 0));
    }
}
