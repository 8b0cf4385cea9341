//! RVL (Wilson, ISS 2017) over a frame of 16-bit samples: runs of zeros, runs of others, differences.
//!
//! Numbers are groups of three bits, lowest first, each in a nibble whose bit 3 says that another follows;
//! the first nibble of a byte is its low half. Differences wrap in 16 bits, so any sample can follow any.

use super::CodecError;

/// Most bytes that [`encode`] writes for `pixel_count` samples: six nibbles for a difference are the most
/// that a pixel takes; the lengths of runs are paid by the pixels that are zero, but for five nibbles where
/// more than 32,768 others follow, and for the last half byte.
pub(super) const fn max_bytes(pixel_count: usize) -> usize {
    3 * pixel_count + pixel_count / 64 + 16
}

struct NibbleWriter<'a> {
    out: &'a mut [u8],
    byte_count: usize,
    pending: u64,
    pending_bits: u32,
}

impl NibbleWriter<'_> {
    #[inline(always)]
    fn nibble(&mut self, nibble: u32) {
        self.pending |= u64::from(nibble) << self.pending_bits;
        self.pending_bits += 4;
        if self.pending_bits == 64 {
            self.out[self.byte_count..self.byte_count + 8]
                .copy_from_slice(&self.pending.to_le_bytes());
            self.byte_count += 8;
            self.pending = 0;
            self.pending_bits = 0;
        }
    }

    #[inline(always)]
    fn number(&mut self, mut number: u32) {
        while number >= 8 {
            self.nibble(8 | (number & 7));
            number >>= 3;
        }
        self.nibble(number);
    }

    fn finish(self) -> usize {
        let rest = self.pending_bits.div_ceil(8) as usize;
        self.out[self.byte_count..self.byte_count + rest]
            .copy_from_slice(&self.pending.to_le_bytes()[..rest]);
        self.byte_count + rest
    }
}

/// Writes the tokens of `samples` to the start of `out`, which has [`max_bytes`]; returns their length.
pub(super) fn encode(samples: &[u16], out: &mut [u8]) -> usize {
    let mut writer = NibbleWriter {
        out,
        byte_count: 0,
        pending: 0,
        pending_bits: 0,
    };
    let mut rest = samples;
    let mut previous = 0_u16;
    while !rest.is_empty() {
        let zero_count = rest.iter().take_while(|&&sample| sample == 0).count();
        rest = &rest[zero_count..];
        let other_count = rest.iter().take_while(|&&sample| sample != 0).count();
        let (others, next) = rest.split_at(other_count);
        rest = next;
        // Both counts are at most the pixels of a frame, 2^28.
        writer.number(zero_count as u32);
        writer.number(other_count as u32);
        for &sample in others {
            let difference = sample.wrapping_sub(previous) as i16;
            previous = sample;
            writer.number(u32::from(((difference << 1) ^ (difference >> 15)) as u16));
        }
    }
    writer.finish()
}

struct NibbleReader<'a> {
    bytes: &'a [u8],
    /// Nibbles taken so far.
    position: usize,
}

impl NibbleReader<'_> {
    #[inline(always)]
    fn nibble(&mut self) -> Result<u32, CodecError> {
        let byte = *self.bytes.get(self.position / 2).ok_or(CodecError::Cut)?;
        let nibble = u32::from(byte) >> (4 * (self.position % 2));
        self.position += 1;
        Ok(nibble & 15)
    }

    /// A number of at most `max_nibbles` nibbles (at most 10: 30 bits).
    #[inline(always)]
    fn number(&mut self, max_nibbles: u32) -> Result<u32, CodecError> {
        let first = self.nibble()?;
        if first < 8 {
            return Ok(first);
        }
        let mut number = first & 7;
        for group in 1..max_nibbles {
            let nibble = self.nibble()?;
            number |= (nibble & 7) << (3 * group);
            if nibble < 8 {
                return Ok(number);
            }
        }
        Err(CodecError::Damaged("a number goes on for too long"))
    }
}

/// Nibbles of the longest run, 2^28 pixels, and of the longest difference, 16 bits.
const RUN_NIBBLES: u32 = 10;
const DIFFERENCE_NIBBLES: u32 = 6;

/// Fills `samples` from `bytes`; both must end together.
pub(super) fn decode(bytes: &[u8], samples: &mut [u16]) -> Result<(), CodecError> {
    let mut reader = NibbleReader { bytes, position: 0 };
    let mut rest = samples;
    let mut previous = 0_u16;
    let mut is_first = true;
    while !rest.is_empty() {
        let zero_count = reader.number(RUN_NIBBLES)? as usize;
        let other_count = reader.number(RUN_NIBBLES)? as usize;
        // A pair that covers nothing would let a payload spend time without end; the first may cover
        // others alone, a later one both.
        if zero_count == 0 && (other_count == 0 || !is_first) {
            return Err(CodecError::Damaged("an empty run"));
        }
        is_first = false;
        let (zeros, next) = rest
            .split_at_mut_checked(zero_count)
            .ok_or(CodecError::Damaged("a run beyond the frame"))?;
        let (others, next) = next
            .split_at_mut_checked(other_count)
            .ok_or(CodecError::Damaged("a run beyond the frame"))?;
        zeros.fill(0);
        for sample in others {
            let zigzag = reader.number(DIFFERENCE_NIBBLES)?;
            let zigzag = u16::try_from(zigzag).map_err(|_| CodecError::Damaged("a difference"))?;
            previous = previous.wrapping_add((zigzag >> 1) ^ (zigzag & 1).wrapping_neg());
            if previous == 0 {
                return Err(CodecError::Damaged("a zero in a run of others"));
            }
            *sample = previous;
        }
        rest = next;
    }
    if reader.position.div_ceil(2) == bytes.len() {
        Ok(())
    } else {
        Err(CodecError::Surplus)
    }
}
