//! The worked examples of the protocol document, byte for byte, in both directions.

use ps1080::blocks::{FixedField, FixedParams, RegistrationBlock, RegistrationField};
use ps1080::color::{ColorDecoder, ColorFormat, encode_color, openni2_rgb, openni2_rgb_pair};
use ps1080::firmware::{Firmware, Hardware, Version};
use ps1080::host::{
    AlgorithmKind, MAX_HOST_PACKET_BYTES, Opcode, Received, ReplyReader, Request, encode_reply,
};
use ps1080::samples::{SampleDecoder, SampleFormat, encode_samples};
use ps1080::shift::{ReferencePattern, ShiftParameters, XTION_CONSTANT_SHIFT};
use ps1080::stream::{
    DeviceTicks, PacketHeader, PacketKind, Packetiser, Padding, PartKind, StreamKind,
};

/// `payload` is what `codes` encode to, and decodes to them.
#[track_caller]
fn samples_are(format: SampleFormat, codes: &[u16], payload: &[u8]) {
    let mut encoded = [0; 64];
    let byte_count = encode_samples(format, codes, codes.len(), &mut encoded).unwrap();
    assert_eq!(&encoded[..byte_count], payload, "{format:?} encoded");
    let mut decoder = SampleDecoder::new(format, codes.len());
    decoder.begin(Padding::default());
    let mut decoded = vec![1; codes.len()];
    decoder.push(payload, &mut decoded).unwrap();
    decoder.finish(&mut decoded).unwrap();
    assert_eq!(decoded, codes, "{format:?} decoded");
}

/// The same for one line of colour of `width` pixels.
#[track_caller]
fn color_is(format: ColorFormat, width: u16, frame: &[u8], payload: &[u8]) {
    let mut encoded = [0; 64];
    let line_bytes = format.line_bytes(width).unwrap();
    let byte_count = encode_color(format, frame, line_bytes, &mut encoded).unwrap();
    assert_eq!(&encoded[..byte_count], payload, "{format:?} encoded");
    let mut decoder = ColorDecoder::new(format, width, 1).unwrap();
    decoder.begin();
    let mut decoded = vec![1; frame.len()];
    decoder.push(payload, &mut decoded).unwrap();
    assert_eq!(decoder.finish(), Ok(frame.len()));
    assert_eq!(decoded, frame, "{format:?} decoded");
}

#[test]
fn samples_of_section_7() {
    samples_are(
        SampleFormat::Packed11,
        &[100, 200, 300, 400, 500, 600, 2047, 0],
        &[
            0x0C, 0x83, 0x20, 0x96, 0x19, 0x03, 0xE8, 0x96, 0x3F, 0xF8, 0x00,
        ],
    );
    samples_are(SampleFormat::Packed12, &[100, 2047], &[0x06, 0x47, 0xFF]);
    samples_are(SampleFormat::Packed12, &[1000, 0], &[0x3E, 0x80, 0x00]);
    samples_are(
        SampleFormat::Packed10,
        &[1, 2, 512, 1023],
        &[0x00, 0x40, 0x28, 0x03, 0xFF],
    );
    samples_are(SampleFormat::Raw16, &[2047, 258], &[0xFF, 0x07, 0x02, 0x01]);
    samples_are(
        SampleFormat::Compressed,
        &[
            500, 500, 500, 500, 500, 503, 498, 530, 470, 900, 900, 0, 2047,
        ],
        &[
            0xF0, 0x1F, 0x4E, 0x39, 0x1F, 0xE0, 0xF8, 0x4F, 0x03, 0x84, 0x6F, 0x00, 0x00, 0xF0,
            0x7F, 0xFD,
        ],
    );
}

#[test]
fn colour_of_section_7() {
    color_is(
        ColorFormat::CompressedYuv422,
        4,
        &[120, 80, 130, 82, 121, 84, 129, 200],
        &[0xF7, 0x8F, 0x50, 0xF8, 0x28, 0x78, 0x5F, 0xC8],
    );
    color_is(
        ColorFormat::CompressedBayer,
        6,
        &[50, 90, 52, 92, 60, 91],
        &[0xF3, 0x2F, 0x5A, 0x88, 0xF3, 0xC5],
    );
    let pair = [0x78, 0x50, 0x82, 0x52];
    color_is(ColorFormat::Uyvy, 2, &pair, &pair);
    assert_eq!(openni2_rgb_pair(pair), [[78, 76, 58], [80, 78, 61]]);
    assert_eq!(openni2_rgb(235, 128, 128), [255, 255, 255]);
    assert_eq!(openni2_rgb(81, 90, 240), [255, 0, 0]);
}

#[test]
fn request_and_reply_of_section_2() {
    let request = [0x47, 0x4D, 1, 0, 2, 0, 0x20, 0, 0x13, 0];
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let asked = Request::GetParam { id: 19 };
    let byte_count = asked.encode(32, &mut packet);
    assert_eq!(&packet[..byte_count], request);
    assert_eq!(Request::decode(&request), Ok((32, asked)));

    let reply = [0x52, 0x42, 2, 0, 2, 0, 0x20, 0, 0, 0, 0, 0];
    let byte_count = encode_reply(2, 32, Ok(&[0, 0]), &mut packet).unwrap();
    assert_eq!(&packet[..byte_count], reply);
    let mut reader = ReplyReader::new(Opcode::GetParam, 32);
    assert_eq!(reader.receive(&reply), Ok(Received::Data(&[0, 0])));
}

#[test]
fn header_of_section_6() {
    let bytes = [0x52, 0x42, 0x00, 0x71, 0, 0, 0x0C, 0x00, 0, 0, 0, 0];
    let header = PacketHeader {
        kind: PacketKind::Frame(StreamKind::Depth, PartKind::Start),
        id: 0,
        payload_bytes: 3060,
        field: 0,
    };
    assert_eq!(PacketHeader::decode(&bytes), Some(header));
    assert_eq!(header.encode(), Some(bytes));
    let mut packetiser = Packetiser::new(StreamKind::Depth, 3072).unwrap();
    let frame = vec![7; 422_400];
    let first = packetiser
        .frame(&frame, Padding::default(), DeviceTicks(5))
        .next()
        .unwrap();
    assert_eq!((first.header, first.payload.len()), (bytes, 3060));
    // The padding that section 10 names.
    let padding = Padding::from_field(0x000A_0005);
    assert_eq!((padding.before, padding.after), (10, 5));
    assert_eq!(padding.field(), 0x000A_0005);
}

#[test]
fn version_of_section_3() {
    // 5.8.22 on a PS1080 of board RD109.
    let data = [8, 5, 0x22, 0, 0x20, 0x20, 0x20, 0, 6, 0, 1, 0];
    let version = Version {
        firmware: Firmware::new(5, 8, 22),
        chip: Version::PS1080,
        hardware_word: 6,
        system: 1,
    };
    assert_eq!(Version::decode(&data), Some(version));
    assert_eq!(version.encode(), Some(data));
    assert_eq!(version.hardware(), Hardware::Rd109);
}

#[test]
fn constants_of_the_xtion_of_section_8() {
    let bytes = FixedParams::xtion().encode();
    assert_eq!(bytes.len(), 168);
    // Where libfreenect reads the distance of the emitter.
    assert_eq!(bytes[92..96], 7.5_f32.to_le_bytes());
    let fixed = FixedParams::decode(&bytes);
    assert_eq!(fixed, FixedParams::xtion());
    assert_eq!(fixed.length_cm(FixedField::ColorDistance), 2.63);
    let shift =
        ShiftParameters::new(&fixed, XTION_CONSTANT_SHIFT, ReferencePattern::OwnSize).unwrap();
    assert_eq!(shift.zero_plane_mm, 1200.0);
    assert!((shift.zero_plane_pixel_mm - 1.052_000_001).abs() < 1e-9);
    assert!((shift.vga_focal_pixels() - 570.34).abs() < 0.005);
}

/// Depth by section 8.2 in its own units, so that the constants are those of its formula.
#[test]
fn samples_of_the_table_of_section_8() {
    let shift = ShiftParameters::new(
        &FixedParams::xtion(),
        XTION_CONSTANT_SHIFT,
        ReferencePattern::OwnSize,
    )
    .unwrap();
    let constant = shift.param_coefficient * shift.constant_shift / shift.pixel_size_factor;
    for (code, depth_mm) in [
        (1, 315),
        (100, 346),
        (400, 498),
        (800, 1193),
        (1000, 3948),
        (1050, 9331),
        (1052, 9870),
    ] {
        let pixels = (f64::from(code) - constant) / shift.param_coefficient - shift.offset_pixels;
        let along_cm = pixels * shift.zero_plane_pixel_mm / 10.0 * shift.pixel_size_factor;
        let zero_cm = shift.zero_plane_mm / 10.0;
        let depth = 10.0 * (along_cm * zero_cm / (shift.emitter_distance_cm - along_cm) + zero_cm);
        assert_eq!(depth as i32, depth_mm, "shift {code}");
    }
}

#[test]
fn registration_fields_of_section_8() {
    let fields = [
        7, 3, -2, 4, -5, 1200, -1, 2, -3, 5, -900, 100, -200, 0, 0, 9, -9, 310, -120, 220, -260,
        -6, 4, 3, -5, 0, 7, 0, -8,
    ];
    let block = RegistrationBlock { fields };
    assert_eq!(RegistrationBlock::decode(&block.encode()), block);
    assert_eq!(
        block.coefficient(RegistrationField::DxStart),
        i64::from(1200 << 9)
    );
    assert_eq!(
        block.coefficient(RegistrationField::DyStart),
        -(i64::from(900 << 9))
    );
    assert_eq!(
        block.coefficient(RegistrationField::DydydyStart),
        -(8_i64 << 8)
    );
    // Only the low 19 bits count.
    let mut dirty = block;
    dirty.fields[RegistrationField::DxStart as usize] |= 0x7FF8_0000;
    assert_eq!(
        dirty.coefficient(RegistrationField::DxStart),
        i64::from(1200 << 9)
    );
}

#[test]
fn algorithm_request_of_section_3() {
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let request = Request::algorithm(AlgorithmKind::Registration, 4, 30, 58);
    let byte_count = request.encode(0x1234, &mut packet);
    let expected = [
        0x47, 0x4D, 5, 0, 22, 0, 0x34, 0x12, 2, 0, 0, 0, 4, 0, 30, 0, 58, 0,
    ];
    assert_eq!(&packet[..byte_count], expected);
    assert_eq!(Request::decode(&expected), Ok((0x1234, request)));
}
