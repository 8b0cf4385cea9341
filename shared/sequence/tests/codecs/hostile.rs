//! Cut, flipped and invented payloads: samples or an error, never a panic.

use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::codecs::{CodecError, ColorDecoder, DepthDecoder, DepthEncoder, depth_table_id};

use crate::frames::*;

/// Payloads of each depth codec, with the table of those that need one.
fn depth_payloads() -> (DepthEncoder, Vec<Vec<u8>>) {
    let mut random = Pcg64Mcg::seed_from_u64(16);
    let mut encoder = DepthEncoder::of_values(24, 18, None).unwrap();
    let scene = shifts(24, 18, &mut random);
    let steps = Frame {
        samples: scene.samples.iter().map(|s| s / 8 * 8).collect(),
        ..scene
    };
    let mut payloads: Vec<_> = BOTH
        .map(|codec| payload_of(&mut encoder, &steps, codec).1)
        .to_vec();
    assert!(
        payloads
            .iter()
            .all(|payload| depth_table_id(payload) == Ok(Some(1)))
    );
    let (encoded, raw) = payload_of(&mut encoder, &noise(24, 18, &mut random), BOTH[0]);
    assert!(
        encoded.is_raw && !encoded.has_new_table,
        "noise does not extend a table"
    );
    payloads.push(raw);
    payloads.push(
        payload_of(
            &mut DepthEncoder::of_codes(24, 18).unwrap(),
            &scene,
            BOTH[1],
        )
        .1,
    );
    (encoder, payloads)
}

#[test]
fn every_cut_of_a_depth_payload_is_an_error() {
    let (encoder, payloads) = depth_payloads();
    for payload in &payloads {
        for length in 0..payload.len() {
            assert!(
                decoded(&payload[..length], encoder.table(), 24, 18).is_err(),
                "{length} of {}",
                payload.len()
            );
        }
        let longer = [payload.as_slice(), &[0]].concat();
        assert!(decoded(&longer, encoder.table(), 24, 18).is_err());
    }
}

#[test]
fn flipped_bits_of_a_depth_payload_do_no_harm() {
    let (encoder, payloads) = depth_payloads();
    let mut decoder = DepthDecoder::new(24, 18).unwrap();
    let mut samples = vec![0; 24 * 18];
    for payload in &payloads {
        let mut error_count = 0;
        for bit in 0..8 * payload.len() {
            let mut flipped = payload.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            error_count += usize::from(
                decoder
                    .decode(&flipped, encoder.table(), &mut samples)
                    .is_err(),
            );
        }
        assert!(error_count > 0);
        // The decoder is as good as new.
        assert!(
            decoder
                .decode(payload, encoder.table(), &mut samples)
                .is_ok()
        );
    }
}

#[test]
fn invented_depth_payloads_do_no_harm() {
    let (encoder, _) = depth_payloads();
    let mut random = Pcg64Mcg::seed_from_u64(17);
    let mut decoder = DepthDecoder::new(24, 18).unwrap();
    let mut samples = vec![0; 24 * 18];
    for round in 0..20_000 {
        let mut bytes = vec![0; random.random_range(0..300)];
        random.fill_bytes(&mut bytes);
        let bytes = match round % 4 {
            0 => bytes,
            // A valid head, and a stream that may begin as one.
            1 => [&[2, (round / 4 % 2) as u8, 0, 0], bytes.as_slice()].concat(),
            // Valid zstd around tokens that are none.
            2 => [
                &[1, (round / 4 % 2) as u8, 0],
                zstd::bulk::compress(&bytes, 1).unwrap().as_slice(),
            ]
            .concat(),
            _ => [&[1, 0, 0, 0x28, 0xb5, 0x2f, 0xfd], bytes.as_slice()].concat(),
        };
        let _ = decoder.decode(&bytes, encoder.table(), &mut samples);
    }
    let unknown = CodecError::UnknownCodec(3);
    assert_eq!(
        decoder.decode(&[3, 0, 0, 0], None, &mut samples),
        Err(unknown)
    );
}

#[test]
fn two_zstd_frames_are_not_one() {
    // The content of both together is a frame; each payload holds one.
    let halves: [&[u8]; 2] = [&[1, 2, 3, 4, 5, 6], &[7, 8, 9, 10, 11, 12]];
    let packed = halves.map(|half| zstd::bulk::compress(half, 1).unwrap());
    let payload = [&[1], packed.concat().as_slice()].concat();
    let format = sequence::codecs::ColorFormat::BayerGrbg;
    assert_eq!(
        color_decoded(format, 4, 3, &payload),
        Err(CodecError::Surplus)
    );
    let whole = zstd::bulk::compress(&halves.concat(), 1).unwrap();
    assert!(color_decoded(format, 4, 3, &[&[1], whole.as_slice()].concat()).is_ok());
}

#[test]
fn a_code_beyond_its_table_is_an_error() {
    let (encoder, payloads) = depth_payloads();
    let table = encoder.table().unwrap();
    let short = sequence::codecs::CodeTable::new(1, &table.values()[..3]).unwrap();
    for payload in &payloads[..2] {
        let beyond = CodecError::Damaged("a code beyond its table");
        assert_eq!(decoded(payload, Some(&short), 24, 18), Err(beyond));
    }
}

#[test]
fn cut_flipped_and_invented_color_payloads_do_no_harm() {
    let mut random = Pcg64Mcg::seed_from_u64(18);
    for format in FORMATS {
        let bytes = color_bytes(format, 22, 15, 5, &mut random);
        let payload = color_payload(format, 22, 15, &bytes);
        let mut decoder = ColorDecoder::new(format, 22, 15).unwrap();
        let mut frame = vec![0; bytes.len()];
        for length in 0..payload.len() {
            assert!(decoder.decode(&payload[..length], &mut frame).is_err());
        }
        for bit in 0..8 * payload.len() {
            let mut flipped = payload.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let _ = decoder.decode(&flipped, &mut frame);
        }
        for round in 0..2_000 {
            let mut invented = vec![0; random.random_range(0..300)];
            random.fill_bytes(&mut invented);
            if let (1.., Some(first)) = (round % 3, invented.first_mut()) {
                *first = 1;
            }
            let _ = decoder.decode(&invented, &mut frame);
        }
        assert_eq!(
            decoder.decode(&[2, 1, 1], &mut frame),
            Err(CodecError::UnknownCodec(2))
        );
        decoder.decode(&payload, &mut frame).unwrap();
        assert_eq!(frame, bytes);
    }
}
