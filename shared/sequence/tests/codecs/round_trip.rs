//! What goes in comes out, and is no longer than it was.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{
    CodecError, ColorEncoder, ColorFormat, DepthCodec, DepthDecoder, DepthEncoder,
};

use crate::frames::*;

#[test]
fn depth_of_every_small_size_is_exact() {
    let mut random = Pcg64Mcg::seed_from_u64(2);
    for width in 1..12 {
        for height in 1..8 {
            assert_eq!(
                shifts(width, height, &mut random).mismatch_count(),
                0,
                "{width}x{height}"
            );
            assert_eq!(
                noise(width, height, &mut random).mismatch_count(),
                0,
                "{width}x{height}"
            );
        }
    }
}

#[test]
fn differences_of_every_size_are_exact() {
    // Each power of two and its neighbours, both signs: unary, Exp-Golomb and every length of a number.
    let mut samples = Vec::new();
    for power in 0..16 {
        for near in [-1_i32, 0, 1] {
            let step = ((1 << power) + near) as u16;
            samples.extend([
                30_000,
                30_000_u16.wrapping_add(step),
                30_000,
                30_000_u16.wrapping_sub(step),
            ]);
        }
    }
    let frame = Frame {
        width: samples.len() as u32,
        height: 1,
        samples,
    };
    assert_eq!(frame.mismatch_count(), 0);
}

#[test]
fn noise_is_stored_raw_and_never_longer_than_raw() {
    let frame = noise(64, 48, &mut Pcg64Mcg::seed_from_u64(3));
    for codec in BOTH {
        let mut encoder = DepthEncoder::of_codes(64, 48).unwrap();
        let (encoded, payload) = payload_of(&mut encoder, &frame, codec);
        assert!(encoded.is_raw);
        assert_eq!(payload.len(), 3 + 2 * 64 * 48);
        assert_eq!(payload[..3], [0, 0, 0]);
    }
}

#[test]
fn every_level_of_zstd_is_exact() {
    let frame = shifts(64, 48, &mut Pcg64Mcg::seed_from_u64(9));
    for level in [-7, -1, 3, 9, 19] {
        let mut encoder = DepthEncoder::of_codes(64, 48).unwrap();
        encoder.set_zstd_level(level).unwrap();
        let (encoded, decoded) = through(&mut encoder, &frame, DepthCodec::Fast);
        assert!(!encoded.is_raw && decoded == frame.samples, "level {level}");
    }
}

#[test]
fn a_frame_does_not_depend_on_those_before_it() {
    let mut random = Pcg64Mcg::seed_from_u64(4);
    let (first, second) = (shifts(40, 30, &mut random), shifts(40, 30, &mut random));
    for codec in BOTH {
        let mut encoder = DepthEncoder::of_codes(40, 30).unwrap();
        let _ = payload_of(&mut encoder, &first, codec);
        let (_, after_another) = payload_of(&mut encoder, &second, codec);
        let (_, alone) = payload_of(&mut DepthEncoder::of_codes(40, 30).unwrap(), &second, codec);
        assert_eq!(after_another, alone);
        // A decoder in the middle of another frame's damage is as good as a new one.
        let mut decoder = DepthDecoder::new(40, 30).unwrap();
        let mut samples = vec![0; 40 * 30];
        assert!(
            decoder
                .decode(&alone[..alone.len() / 2], None, &mut samples)
                .is_err()
        );
        decoder.decode(&alone, None, &mut samples).unwrap();
        assert_eq!(samples, second.samples);
    }
}

#[test]
fn dense_is_smaller_than_fast_and_fast_than_raw() {
    let frame = shifts(160, 120, &mut Pcg64Mcg::seed_from_u64(5));
    let mut encoder = DepthEncoder::of_codes(160, 120).unwrap();
    let (fast, _) = payload_of(&mut encoder, &frame, DepthCodec::Fast);
    let (dense, _) = payload_of(&mut encoder, &frame, DepthCodec::Dense);
    assert!(dense.byte_count < fast.byte_count, "{dense:?} {fast:?}");
    assert!(4 * fast.byte_count < 2 * 160 * 120, "{fast:?}");
}

#[test]
fn color_of_every_small_size_is_exact() {
    let mut random = Pcg64Mcg::seed_from_u64(6);
    for format in FORMATS {
        for (width, height) in (1..10).flat_map(|width| (1..6).map(move |height| (width, height))) {
            if format.frame_bytes(width, height).is_err() {
                assert_eq!(width % 2, 1);
                assert!(ColorEncoder::new(format, width, height).is_err());
                continue;
            }
            let amplitude = [0, 3, 40, u8::MAX][random.random_range(0..4)];
            let bytes = color_bytes(format, width, height, amplitude, &mut random);
            let payload = color_payload(format, width, height, &bytes);
            assert!(payload.len() <= 1 + bytes.len());
            assert_eq!(
                color_decoded(format, width, height, &payload).unwrap(),
                bytes,
                "{format:?} {width}x{height}"
            );
        }
    }
}

#[test]
fn colour_is_smaller_by_prediction_and_noise_is_raw() {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    for format in FORMATS {
        let smooth = color_bytes(format, 64, 48, 3, &mut random);
        assert!(
            2 * color_payload(format, 64, 48, &smooth).len() < smooth.len(),
            "{format:?}"
        );
        let noise = color_bytes(format, 64, 48, u8::MAX, &mut random);
        let payload = color_payload(format, 64, 48, &noise);
        assert_eq!(payload[0], 0);
        assert_eq!(payload[1..], noise);
    }
}

#[test]
fn slices_of_another_size_are_refused() {
    let mut encoder = DepthEncoder::of_codes(4, 3).unwrap();
    let mut out = vec![0; encoder.max_payload_bytes()];
    let wrong = CodecError::SampleCount {
        expected: 12,
        got: 11,
    };
    assert_eq!(
        encoder.encode(&[0; 11], DepthCodec::Fast, &mut out),
        Err(wrong)
    );
    let room = CodecError::Room {
        expected: 27,
        got: 26,
    };
    assert_eq!(
        encoder.encode(&[0; 12], DepthCodec::Dense, &mut out[..26]),
        Err(room)
    );
    let mut decoder = DepthDecoder::new(4, 3).unwrap();
    assert_eq!(decoder.decode(&[0; 27], None, &mut [0; 11]), Err(wrong));
    let mut encoder = ColorEncoder::new(ColorFormat::Rgb8, 2, 2).unwrap();
    assert!(encoder.encode(&[0; 11], &mut [0; 100]).is_err());
    assert!(encoder.encode(&[0; 12], &mut [0; 12]).is_err());
}

#[test]
fn sizes_that_no_stream_has_are_refused() {
    for (width, height) in [
        (0, 1),
        (1, 0),
        (16_385, 1),
        (1, u32::MAX),
        (u32::MAX, u32::MAX),
    ] {
        assert!(DepthEncoder::of_codes(width, height).is_err());
        assert!(DepthDecoder::new(width, height).is_err());
        for format in FORMATS {
            assert!(ColorEncoder::new(format, width, height).is_err());
        }
    }
}
