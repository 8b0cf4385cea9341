//! Mutants of what a camera and a host say, and what must hold of them whatever was done. Shared with the example
//! `wire_fuzz`, which runs longer.

use ps1080::Damage;
use ps1080::blocks::{Presets, Text, decode_platform_string};
use ps1080::color::{ColorDecoder, ColorFormat, encode_color};
use ps1080::firmware::Version;
use ps1080::host::{MAX_HOST_PACKET_BYTES, Opcode, Received, ReplyReader, Request, encode_reply};
use ps1080::samples::{SampleDecoder, SampleFormat, encode_samples};
use ps1080::stream::{LossCause, Padding};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use super::made;
use super::receive::{Host, Outcome, packets};

/// What executions came to; all of it must occur.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) execution_count: u64,
    pub(crate) frame_count: u64,
    pub(crate) lost_count: u64,
    pub(crate) damaged_count: u64,
    pub(crate) reply_count: u64,
    pub(crate) refused_count: u64,
}

/// What is fed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// Packets of damaged streams.
    Stream,
    /// Replies and requests.
    Host,
    /// Payload of depth and infrared.
    Samples,
    /// Payload of colour.
    Color,
}

impl Target {
    pub(crate) const ALL: [Self; 4] = [Self::Stream, Self::Host, Self::Samples, Self::Color];
}

/// One execution.
pub(crate) fn execute(target: Target, random: &mut Pcg64Mcg, counts: &mut Counts) {
    counts.execution_count += 1;
    match target {
        Target::Stream => stream(random, counts),
        Target::Host => host(random, counts),
        Target::Samples => samples(random, counts),
        Target::Color => color(random, counts),
    }
}

/// Flips, overwrites, cuts out, puts in: up to three times.
fn mutate(bytes: &mut Vec<u8>, random: &mut Pcg64Mcg) {
    for _ in 0..random.random_range(0..4) {
        let place = random.random_range(0..=bytes.len());
        match (random.random_range(0..6), bytes.get_mut(place)) {
            (0, _) => bytes.truncate(place),
            (1, _) => bytes.insert(place, random.random()),
            (2, Some(_)) => {
                let count = random.random_range(0..20).min(bytes.len() - place);
                bytes.drain(place..place + count);
            }
            (3, Some(byte)) => *byte = [0, 0x7F, 0x80, 0xFF, 0xDD][random.random_range(0..5)],
            (_, Some(byte)) => *byte ^= 1 << random.random_range(0..8),
            (_, None) => {}
        }
    }
}

/// Packets are lost, repeated, swapped, cut, preceded by garbage, their headers damaged; payload is never changed. A
/// frame that comes out is one that went in, or it is doubted.
fn stream(random: &mut Pcg64Mcg, counts: &mut Counts) {
    let format = SampleFormat::ALL[random.random_range(0..5)];
    let count = 8 * random.random_range(1..6);
    let frames: Vec<Vec<u16>> = (0..4)
        .map(|_| made::samples(format, count, random))
        .collect();
    let payloads: Vec<Vec<u8>> = frames
        .iter()
        .map(|codes| encoded_samples(format, codes, 8))
        .collect();
    let mut packets = packets(&payloads, random.random_range(16..60));
    // One kind of damage a stream, of the last two one alone: two can undo each other's traces, as two cuts of one
    // length.
    let kind = random.random_range(0..6);
    let damage_count = if kind < 4 {
        random.random_range(0..4)
    } else {
        1
    };
    for _ in 0..damage_count {
        damage_packets(&mut packets, kind, random);
    }
    let mut host = Host::new(format, count);
    for piece in made::pieces(&packets.concat(), random) {
        host.transfer(piece);
    }
    for (index, outcome) in host.outcomes.iter().enumerate() {
        match outcome {
            Outcome::Frame(_, codes) => {
                counts.frame_count += 1;
                let doubt = Outcome::Lost(LossCause::GarbageAfterEnd, 0);
                let next = host.outcomes.get(index + 1);
                // Behind the last frame nothing may come that would tell.
                let may_be_wrong = next.is_none_or(|next| *next == doubt);
                let is_right = frames.contains(codes);
                assert!(is_right || may_be_wrong, "{:?}", host.outcomes);
            }
            Outcome::Damaged(_) => counts.damaged_count += 1,
            Outcome::Lost(..) => counts.lost_count += 1,
            Outcome::Fault(_) => {}
        }
    }
}

fn damage_packets(packets: &mut Vec<Vec<u8>>, kind: u32, random: &mut Pcg64Mcg) {
    let chosen = random.random_range(0..packets.len());
    let other = random.random_range(0..packets.len());
    match kind {
        0 => packets.insert(chosen, packets[chosen].clone()),
        1 => packets.swap(chosen, other),
        2 if packets.len() > 1 => {
            packets.remove(chosen);
        }
        3 => {
            let garbage = (0..random.random_range(1..30)).map(|_| random.random::<u8>());
            let garbage: Vec<u8> = garbage.collect();
            packets.insert(chosen, garbage);
        }
        // A bit of the magic, the type, the id or the size; stamps and padding are nobody's to check.
        4 => {
            let at = random.random_range(0..8);
            if let Some(byte) = packets[chosen].get_mut(at) {
                *byte ^= 1 << random.random_range(0..8);
            }
        }
        5 => {
            let packet = &mut packets[chosen];
            let keep = random.random_range(0..=packet.len());
            packet.truncate(keep);
        }
        _ => {}
    }
}

fn encoded_samples(format: SampleFormat, codes: &[u16], width: usize) -> Vec<u8> {
    let mut payload = vec![0; format.max_bytes(codes.len(), width)];
    let byte_count =
        encode_samples(format, codes, width, &mut payload).expect("a buffer of the largest size");
    payload.truncate(byte_count);
    payload
}

/// What payload decodes to does not depend on its pieces.
fn samples(random: &mut Pcg64Mcg, counts: &mut Counts) {
    let format = SampleFormat::ALL[random.random_range(0..5)];
    let count = random.random_range(1..60);
    let mut payload = encoded_samples(format, &made::samples(format, count, random), 16);
    mutate(&mut payload, random);
    let padding = if random.random_bool(0.2) {
        Padding {
            before: random.random_range(0..70),
            after: random.random_range(0..70),
        }
    } else {
        Padding::default()
    };
    let decode = |pieces: &[&[u8]]| -> Result<Vec<u16>, Damage> {
        let mut decoder = SampleDecoder::new(format, count);
        let mut codes = vec![0x5A5A; count];
        decoder.begin(padding);
        for piece in pieces {
            decoder.push(piece, &mut codes)?;
        }
        decoder.finish(&mut codes).map(|()| codes)
    };
    let whole = decode(&[&payload]);
    assert_eq!(whole, decode(&made::pieces(&payload, random)));
    assert_eq!(whole, decode(&payload.chunks(1).collect::<Vec<_>>()));
    counts.damaged_count += u64::from(whole.is_err());
}

fn color(random: &mut Pcg64Mcg, counts: &mut Counts) {
    let format = ColorFormat::ALL[random.random_range(0..8)];
    let (width, height) = (2 * random.random_range(1..30), random.random_range(1..5));
    let line_bytes = format.line_bytes(width).unwrap_or(16);
    let frame_bytes = line_bytes * usize::from(height);
    let mut payload = vec![0; format.max_bytes(frame_bytes, line_bytes)];
    let frame = made::color(frame_bytes, random);
    let byte_count = encode_color(format, &frame, line_bytes, &mut payload)
        .expect("a buffer of the largest size");
    payload.truncate(byte_count);
    if format.is_jpeg() {
        let head = [0xFF, 0xD8, 0xFF, 0xDA, 0, 3, 7];
        payload = [&head, &payload[..], &[0xFF, 0xD9]].concat();
    }
    mutate(&mut payload, random);
    // A JPEG stream may grow.
    let spare_bytes = if format.is_jpeg() { 64 } else { 0 };
    let decode = |pieces: &[&[u8]]| -> Result<Vec<u8>, Damage> {
        let mut decoder = ColorDecoder::new(format, width, height).expect("the width is even");
        let mut decoded = vec![0x5A; frame_bytes + spare_bytes];
        decoder.begin();
        for piece in pieces {
            decoder.push(piece, &mut decoded)?;
        }
        let bytes = decoder.finish()?;
        decoded.truncate(bytes);
        Ok(decoded)
    };
    let whole = decode(&[&payload]);
    assert_eq!(whole, decode(&made::pieces(&payload, random)), "{format:?}");
    assert_eq!(
        whole,
        decode(&payload.chunks(1).collect::<Vec<_>>()),
        "{format:?}"
    );
    counts.damaged_count += u64::from(whole.is_err());
}

/// Replies and requests, whole, damaged, or of random bytes; blocks of whatever a reply holds.
fn host(random: &mut Pcg64Mcg, counts: &mut Counts) {
    let opcode = Opcode::ALL[random.random_range(0..Opcode::ALL.len())];
    let data: Vec<u8> = (0..2 * random.random_range(0..20))
        .map(|_| random.random())
        .collect();
    let mut packet = [0; MAX_HOST_PACKET_BYTES];
    let id = random.random_range(0..3);
    let byte_count = encode_reply(opcode.code(), id, Ok(&data), &mut packet).expect("little data");
    let mut reply = packet[..byte_count].to_vec();
    mutate(&mut reply, random);
    let mut reader = ReplyReader::new(opcode, random.random_range(0..3));
    for piece in made::pieces(&reply, random) {
        match reader.receive(piece) {
            Ok(Received::Data(data)) => {
                counts.reply_count += 1;
                let _ = Version::decode(data);
                let _ = decode_platform_string(data);
                assert!(Text::<32>::decode(data).as_str().len() <= 32);
                assert!(Presets::decode(data).all(|preset| preset.fps != 0));
            }
            Ok(Received::Refused(_)) | Err(_) => counts.refused_count += 1,
            Ok(_) => {}
        }
    }
    // A mutant that is taken for a request is one: it is written as it was read.
    let words: Vec<u16> = (0..random.random_range(0..12))
        .map(|_| random.random())
        .collect();
    let head = [0x4D47, words.len() as u16, opcode.code(), id];
    let mut request: Vec<u8> = head
        .iter()
        .chain(&words)
        .flat_map(|word| word.to_le_bytes())
        .collect();
    mutate(&mut request, random);
    match Request::decode(&request) {
        Ok((id, read)) => {
            let byte_count = read.encode(id, &mut packet);
            // The format of an algorithm block is always 0, the rest must be the same.
            let is_algorithm = read.opcode() == Opcode::AlgorithmParams;
            assert!(
                is_algorithm || packet[..byte_count] == request[..],
                "{read:?}"
            );
        }
        Err(_) => counts.refused_count += 1,
    }
}
