//! The parser: every place to cut, every kind of packet, magics by chance.

use ps1080::samples::SampleFormat;
use ps1080::stream::{
    HEADER_BYTES, MAX_PACKET_BYTES, PacketHeader, PacketKind, PacketParser, Packetiser, PartKind,
    Piece, StreamKind,
};

use super::receive::{Host, Outcome, packets, ticks_of};

/// Three frames of four samples each; the middle one's payload looks like headers.
fn stream() -> (Vec<u8>, Vec<Outcome>) {
    let frames = [
        vec![1, 2, 3, 4],
        vec![0x4252, 0x7100, 0x4252, 0x5252],
        vec![5, 6, 0x4252, 0x4242],
    ];
    let payloads: Vec<Vec<u8>> = frames
        .iter()
        .map(|codes: &Vec<u16>| codes.iter().flat_map(|code| code.to_le_bytes()).collect())
        .collect();
    let expected = frames
        .into_iter()
        .enumerate()
        .map(|(index, codes)| Outcome::Frame(ticks_of(index), codes))
        .collect();
    (packets(&payloads, HEADER_BYTES + 3).concat(), expected)
}

#[test]
fn a_stream_may_be_cut_at_any_two_places() {
    let (stream, expected) = stream();
    for first in 0..=stream.len() {
        for second in first..=stream.len() {
            let mut host = Host::new(SampleFormat::Raw16, 4);
            host.transfer(&stream[..first]);
            host.transfer(&stream[first..second]);
            host.transfer(&stream[second..]);
            assert_eq!(host.outcomes, expected, "cut at {first} and {second}");
        }
    }
}

#[test]
fn garbage_before_a_stream_is_counted_and_costs_nothing() {
    let (stream, expected) = stream();
    let mut false_header = [0x52, 0x42, 0x00, 0x71, 0, 0, 0, 11, 0, 0, 0, 0];
    for garbage in [
        &[0x00, 0x52, 0x42, 0x52][..],
        &[0x52, 0x52, 0x52],
        &[0x52, 0x42, 0x52, 0x42, 0x52, 0x42],
        // A magic with an unknown type, and a size below the header's own.
        &[0x52, 0x42, 0x01, 0x71, 1, 0, 0, 12, 0, 0, 0, 0],
        &false_header.clone(),
    ] {
        for cut in 0..garbage.len() + 3 {
            let bytes = [garbage, &stream].concat();
            let mut host = Host::new(SampleFormat::Raw16, 4);
            host.transfer(&bytes[..cut]);
            host.transfer(&bytes[cut..]);
            assert_eq!(host.outcomes, expected, "{garbage:02X?} cut at {cut}");
            assert_eq!(host.receiver.counts().garbage_bytes, garbage.len() as u64);
        }
    }
    // The same header with a size that may be.
    false_header[7] = 12;
    assert!(PacketHeader::decode(&false_header).is_some());
}

#[test]
fn pieces_add_up_to_the_bytes() {
    let (stream, _) = stream();
    let noise = [&[9, 9, 0x52], &stream[..], &[0x52, 0x42, 7]].concat();
    for size in 1..noise.len() {
        let mut parser = PacketParser::new();
        let mut seen = 0;
        for mut transfer in noise.chunks(size) {
            while let Some(piece) = parser.next(&mut transfer) {
                seen += match piece {
                    Piece::Header(_) => HEADER_BYTES,
                    Piece::Payload(bytes) => bytes.len(),
                    Piece::Garbage(count) => count,
                    Piece::Complete => 0,
                };
            }
            assert!(transfer.is_empty());
        }
        // The last three bytes begin with a magic, which may go on.
        assert_eq!(seen, noise.len() - 3, "pieces of {size}");
    }
}

#[test]
fn all_kinds_of_packets_have_a_code_and_no_other_has() {
    let mut known = 0;
    for code in 0..=u16::MAX {
        if let Some(kind) = PacketKind::from_code(code) {
            assert_eq!(kind.code(), code);
            known += 1;
        }
    }
    assert_eq!(known, 17);
}

#[test]
fn headers_of_any_size_are_what_they_were() {
    for payload_bytes in 0..=MAX_PACKET_BYTES - HEADER_BYTES {
        let header = PacketHeader {
            kind: PacketKind::Frame(StreamKind::Image, PartKind::Buffer),
            id: 0xFF00,
            payload_bytes: payload_bytes as u16,
            field: 0x1234_5678,
        };
        let bytes = header.encode().unwrap();
        assert_eq!(PacketHeader::decode(&bytes), Some(header));
    }
    let too_long = PacketHeader {
        kind: PacketKind::Audio,
        id: 0,
        payload_bytes: (MAX_PACKET_BYTES - HEADER_BYTES + 1) as u16,
        field: 0,
    };
    assert_eq!(too_long.encode(), None);
    for packet_bytes in [0, HEADER_BYTES, MAX_PACKET_BYTES + 1] {
        assert!(Packetiser::new(StreamKind::Depth, packet_bytes).is_none());
    }
}
