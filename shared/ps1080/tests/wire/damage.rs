//! Payload that is no picture is refused, the same way in whatever pieces it comes.

use ps1080::Damage;
use ps1080::color::{ColorDecoder, ColorFormat};
use ps1080::samples::{SampleDecoder, SampleFormat};
use ps1080::stream::Padding;

#[track_caller]
fn samples_are_refused(format: SampleFormat, count: usize, payload: &[u8], expected: Damage) {
    for piece_bytes in [1, 2, payload.len().max(1)] {
        let mut decoder = SampleDecoder::new(format, count);
        let mut codes = vec![0; count];
        decoder.begin(Padding::default());
        let mut result = Ok(());
        for piece in payload.chunks(piece_bytes) {
            result = decoder.push(piece, &mut codes);
        }
        let end = decoder.finish(&mut codes);
        assert_eq!(end, Err(expected), "pieces of {piece_bytes}");
        assert!(result.is_ok() || result == end, "damage does not change");
        // The next frame begins as if nothing had been.
        decoder.begin(Padding::default());
        assert_eq!(decoder.push(&[], &mut codes), Ok(()));
    }
}

#[track_caller]
fn color_is_refused(format: ColorFormat, size: (u16, u16), payload: &[u8], expected: Damage) {
    let (width, height) = size;
    for piece_bytes in [1, 2, payload.len().max(1)] {
        let mut decoder = ColorDecoder::new(format, width, height).unwrap();
        let bytes = format.line_bytes(width).unwrap() * usize::from(height);
        let mut frame = vec![0; bytes];
        decoder.begin();
        for piece in payload.chunks(piece_bytes) {
            // Damage shows at the end.
            let _ = decoder.push(piece, &mut frame);
        }
        assert_eq!(decoder.finish(), Err(expected), "pieces of {piece_bytes}");
    }
}

#[test]
fn packed_samples_of_a_wrong_length() {
    for (format, count, bytes) in [
        (SampleFormat::Raw16, 8, 16),
        (SampleFormat::Packed10, 8, 10),
        (SampleFormat::Packed11, 8, 11),
        (SampleFormat::Packed12, 8, 12),
        (SampleFormat::Packed11, 11, 16),
        (SampleFormat::Packed12, 7, 11),
    ] {
        let payload = vec![0; bytes + 30];
        for length in bytes + 1..bytes + 30 {
            samples_are_refused(format, count, &payload[..length], Damage::Excess);
        }
        for length in 0..bytes {
            let mut decoder = SampleDecoder::new(format, count);
            let mut codes = vec![0; count];
            decoder.push(&payload[..length], &mut codes).unwrap();
            let end = decoder.finish(&mut codes);
            assert!(matches!(end, Err(Damage::Short { .. })), "{end:?}");
        }
    }
}

#[test]
fn compressed_depth_that_leads_nowhere() {
    let refused = |payload: &[u8], count, damage| {
        samples_are_refused(SampleFormat::Compressed, count, payload, damage);
    };
    // A difference, a repetition and a large difference without a value before.
    refused(&[0x6D], 1, Damage::NoFirstValue);
    refused(&[0xE0], 1, Damage::NoFirstValue);
    refused(&[0xFC, 0x0D], 1, Damage::NoFirstValue);
    // 2 - 6, and 32 767 + 1.
    refused(&[0xF0, 0x00, 0x20], 2, Damage::OutOfRange);
    refused(&[0xF7, 0xFF, 0xF7], 2, Damage::OutOfRange);
    // A value more, a run past the end.
    refused(&[0xF0, 0x01, 0x06, 0x6D], 2, Damage::Excess);
    refused(&[0xF0, 0x01, 0x0E, 0x3D], 4, Damage::Excess);
    // The picture is full, but a token has begun.
    refused(&[0xF0, 0x01, 0x0E], 1, Damage::Cut);
    refused(&[0xF0, 0x01, 0x06], 3, Damage::Short { missing_count: 1 });
    refused(&[], 3, Damage::Short { missing_count: 3 });
}

#[test]
fn compressed_colour_that_leads_nowhere() {
    let yuv = |payload: &[u8], damage| {
        color_is_refused(ColorFormat::CompressedYuv422, (2, 2), payload, damage);
    };
    // Three full values and a difference for a line of U Y V Y: ten nibbles.
    let line = [0xF1, 0x0F, 0x20, 0xF3, 0x06];
    let whole = [line, line].concat();
    // The last byte ends the third value as well.
    yuv(&whole[..9], Damage::Short { missing_count: 2 });
    yuv(&[&whole[..], &[0xD6]].concat(), Damage::Excess);
    yuv(&[&whole[..], &[0xDF]].concat(), Damage::Cut);
    yuv(&[0x65, 0x66], Damage::OutOfRange);
    yuv(&[0x66, 0x66, 0x56, 0x66], Damage::OutOfRange);
    // Nine nibbles: the next line would begin within a byte.
    yuv(&[0xF1, 0x0F, 0x20, 0xD6, 0x66], Damage::LineBorder);
    let filled_up = [0xF1, 0x0F, 0x20, 0xD6, 0x6D];
    yuv(&filled_up, Damage::Short { missing_count: 4 });
    // A line of four pixels of a mosaic, then a line that begins in its last byte.
    let bayer = [0xF1, 0x0F, 0x20, 0x66, 0x66, 0x66];
    let size = (4, 2);
    color_is_refused(
        ColorFormat::CompressedBayer,
        size,
        &bayer[..4],
        Damage::Short { missing_count: 4 },
    );
    let odd = [0xD6, 0x66, 0x66, 0x66, 0x6D];
    color_is_refused(ColorFormat::CompressedBayer, size, &odd, Damage::LineBorder);
}

#[test]
fn raw_colour_of_a_wrong_length() {
    for format in [ColorFormat::Uyvy, ColorFormat::Yuyv, ColorFormat::Bayer] {
        let bytes = format.line_bytes(4).unwrap() * 3;
        let payload = vec![7; bytes + 9];
        color_is_refused(format, (4, 3), &payload[..bytes + 1], Damage::Excess);
        let short = Damage::Short { missing_count: 2 };
        color_is_refused(format, (4, 3), &payload[..bytes - 2], short);
    }
}

#[test]
fn a_buffer_of_another_size_is_refused() {
    let mut decoder = SampleDecoder::new(SampleFormat::Packed11, 16);
    let wrong = Damage::BufferSize {
        expected_count: 16,
        got_count: 15,
    };
    assert_eq!(decoder.push(&[0; 11], &mut [0; 15]), Err(wrong));
    let mut decoder = ColorDecoder::new(ColorFormat::Uyvy, 4, 2).unwrap();
    assert_eq!(decoder.push(&[0; 11], &mut [0; 15]), Err(wrong));
}
