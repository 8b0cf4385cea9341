//! Samples of 10, 11, 12 and 16 bits, the highest bit first (16 bits: the low byte first).
//!
//! Unpacking takes two loads and a shift a sample; what limits it is the writing of the samples.

use crate::samples::SampleFormat;

/// Bytes of the largest group.
pub(crate) const MAX_GROUP_BYTES: usize = 11;

/// The smallest group of samples that fills whole bytes: (bytes, samples).
pub(crate) fn group(format: SampleFormat) -> (usize, usize) {
    match format {
        SampleFormat::Raw16 => (2, 1),
        SampleFormat::Packed10 => (5, 4),
        SampleFormat::Packed11 => (11, 8),
        SampleFormat::Packed12 => (3, 2),
        // Not in groups.
        SampleFormat::Compressed => (1, 1),
    }
}

/// Unpacks as many whole groups as both sides hold.
pub(crate) fn unpack_groups(format: SampleFormat, bytes: &[u8], codes: &mut [u16]) {
    match format {
        SampleFormat::Raw16 => {
            for (code, bytes) in codes.iter_mut().zip(bytes.as_chunks().0) {
                *code = u16::from_le_bytes(*bytes);
            }
        }
        SampleFormat::Packed10 => each_group(bytes, codes, unpack10),
        SampleFormat::Packed11 => each_group(bytes, codes, unpack11),
        SampleFormat::Packed12 => each_group(bytes, codes, unpack12),
        SampleFormat::Compressed => {}
    }
}

#[inline(always)]
fn each_group<const BYTES: usize, const CODES: usize>(
    bytes: &[u8],
    codes: &mut [u16],
    unpack: impl Fn(&[u8; BYTES]) -> [u16; CODES],
) {
    let groups = bytes.as_chunks().0;
    for (codes, group) in codes.as_chunks_mut().0.iter_mut().zip(groups) {
        *codes = unpack(group);
    }
}

// In the three below each `as u16` keeps the low bits of a value that is masked or shorter.

#[inline(always)]
fn unpack10(&[a, b, c, d, e]: &[u8; 5]) -> [u16; 4] {
    let bits = u64::from_be_bytes([0, 0, 0, a, b, c, d, e]);
    [30, 20, 10, 0].map(|shift| (bits >> shift) as u16 & 0x3FF)
}

#[inline(always)]
fn unpack11(group: &[u8; 11]) -> [u16; 8] {
    let &[a, b, c, d, e, f, g, h, i, j, k] = group;
    // Five samples lie in the first eight bytes, three in the last eight.
    let head = u64::from_be_bytes([a, b, c, d, e, f, g, h]);
    let tail = u64::from_be_bytes([d, e, f, g, h, i, j, k]);
    let first = |shift: u32| (head >> shift) as u16 & 0x7FF;
    let last = |shift: u32| (tail >> shift) as u16 & 0x7FF;
    [
        first(53),
        first(42),
        first(31),
        first(20),
        first(9),
        last(22),
        last(11),
        last(0),
    ]
}

#[inline(always)]
fn unpack12(&[a, b, c]: &[u8; 3]) -> [u16; 2] {
    let [a, b, c] = [a, b, c].map(u16::from);
    [a << 4 | b >> 4, (b & 0xF) << 8 | c]
}

/// Unpacks bit by bit, from the first bit on: `codes` of `bits` bits, as far as the bytes go. The definition of the
/// packed formats, and what unpacks less than a group.
pub(crate) fn unpack_bits(bits: usize, bytes: &[u8], codes: &mut [u16]) {
    for (index, code) in codes.iter_mut().enumerate() {
        *code = (index * bits..(index + 1) * bits).fold(0, |value, at| {
            let byte = bytes.get(at / 8).copied().unwrap_or(0);
            value << 1 | u16::from(byte >> (7 - at % 8) & 1)
        });
    }
}

/// Packs samples of `bits` bits, at most 16, the rest of the last byte zero; how many bytes, `None` without room or
/// with a sample of more bits.
pub(crate) fn pack_bits(bits: usize, codes: &[u16], out: &mut [u8]) -> Option<usize> {
    let mut places = out.iter_mut();
    let (mut held, mut held_bits, mut byte_count) = (0u32, 0, 0);
    for &code in codes {
        if u32::from(code) >> bits != 0 {
            return None;
        }
        held = held << bits | u32::from(code);
        held_bits += bits;
        while held_bits >= 8 {
            held_bits -= 8;
            // The byte that is complete.
            *places.next()? = (held >> held_bits) as u8;
            byte_count += 1;
        }
    }
    if held_bits > 0 {
        *places.next()? = (held << (8 - held_bits)) as u8;
        byte_count += 1;
    }
    Some(byte_count)
}
