//! The adaptive binary range coder of the dense codec: 32-bit range, carries resolved by counting, the
//! arithmetic of LZMA with finer probabilities.

use super::CodecError;

/// Bits of a probability: [`Probability`] counts in 1/32768.
pub(super) const PROBABILITY_BITS: u32 = 15;
/// A probability moves by 2^-5 of its distance to the bit that came.
pub(super) const ADAPTATION_SHIFT: u32 = 5;
/// Below this the range is moved up a byte.
const TOP: u32 = 1 << 24;
/// Bytes that the end of a stream takes; also what a decoder reads before the first bit.
pub(super) const FLUSH_BYTES: usize = 5;

/// Probability that the next bit is 0, in 1/32768; stays within 31 to 32737.
pub(super) type Probability = u16;
/// Before anything is known.
pub(super) const EVEN: Probability = 1 << (PROBABILITY_BITS - 1);

/// The coder: an interval [low, low + range), of which each bit takes its share.
pub(super) struct RangeEncoder<'a> {
    out: &'a mut [u8],
    byte_count: usize,
    low: u64,
    range: u32,
    /// The byte that a carry may still change, and how many bytes of 255 follow it.
    held: u8,
    held_count: usize,
    /// `out` is full: bytes are dropped from here on.
    is_full: bool,
}

impl<'a> RangeEncoder<'a> {
    pub(super) fn new(out: &'a mut [u8]) -> Self {
        Self {
            out,
            byte_count: 0,
            low: 0,
            range: u32::MAX,
            held: 0,
            held_count: 1,
            is_full: false,
        }
    }

    /// Codes `bit` and moves `probability` towards it.
    #[inline(always)]
    pub(super) fn bit(&mut self, probability: &mut Probability, bit: bool) {
        let p = u32::from(*probability);
        let bound = (self.range >> PROBABILITY_BITS) * p;
        if bit {
            self.low += u64::from(bound);
            self.range -= bound;
            *probability -= *probability >> ADAPTATION_SHIFT;
        } else {
            self.range = bound;
            *probability += ((1 << PROBABILITY_BITS) - *probability) >> ADAPTATION_SHIFT;
        }
        while self.range < TOP {
            self.range <<= 8;
            self.shift();
        }
    }

    /// Codes the lowest `count` bits of `value`, highest first, as equally likely.
    pub(super) fn even_bits(&mut self, value: u32, count: u32) {
        for place in (0..count).rev() {
            self.range >>= 1;
            if value >> place & 1 == 1 {
                self.low += u64::from(self.range);
            }
            while self.range < TOP {
                self.range <<= 8;
                self.shift();
            }
        }
    }

    /// Moves the highest byte of `low` out, or keeps it back while a carry may still change it.
    #[cold]
    #[inline(never)]
    fn shift(&mut self) {
        if self.low < 0xff00_0000 || self.low > u64::from(u32::MAX) {
            let carry = (self.low >> 32) as u8;
            let mut byte = self.held;
            for _ in 0..self.held_count {
                match self.out.get_mut(self.byte_count) {
                    Some(place) => *place = byte.wrapping_add(carry),
                    None => self.is_full = true,
                }
                self.byte_count += 1;
                byte = 0xff;
            }
            self.held_count = 0;
            self.held = (self.low >> 24) as u8;
        }
        self.held_count += 1;
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// Whether bytes were dropped, so that the stream is lost.
    pub(super) fn is_full(&self) -> bool {
        self.is_full
    }

    /// Ends the stream and returns its length, or `None` when it did not fit.
    pub(super) fn finish(mut self) -> Option<usize> {
        for _ in 0..FLUSH_BYTES {
            self.shift();
        }
        (!self.is_full).then_some(self.byte_count)
    }
}

/// The decoder: `code` is where the stream points within the range.
pub(super) struct RangeDecoder<'a> {
    bytes: &'a [u8],
    position: usize,
    code: u32,
    range: u32,
}

impl<'a> RangeDecoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, CodecError> {
        let Some((&first, head)) = bytes.split_first() else {
            return Err(CodecError::Cut);
        };
        if first != 0 {
            return Err(CodecError::Damaged("its range coder does not begin with 0"));
        }
        let code = head.first_chunk::<4>().ok_or(CodecError::Cut)?;
        Ok(Self {
            bytes,
            position: FLUSH_BYTES,
            code: u32::from_be_bytes(*code),
            range: u32::MAX,
        })
    }

    /// Decodes a bit and moves `probability` towards it. Beyond the end the bytes are zeros; [`Self::finish`]
    /// reports that.
    #[inline(always)]
    pub(super) fn bit(&mut self, probability: &mut Probability) -> bool {
        let p = u32::from(*probability);
        let bound = (self.range >> PROBABILITY_BITS) * p;
        let bit = self.code >= bound;
        if bit {
            self.code -= bound;
            self.range -= bound;
            *probability -= *probability >> ADAPTATION_SHIFT;
        } else {
            self.range = bound;
            *probability += ((1 << PROBABILITY_BITS) - *probability) >> ADAPTATION_SHIFT;
        }
        while self.range < TOP {
            self.range <<= 8;
            self.shift();
        }
        bit
    }

    /// Decodes `count` bits, highest first, that were coded as equally likely.
    pub(super) fn even_bits(&mut self, count: u32) -> u32 {
        let mut value = 0;
        for _ in 0..count {
            self.range >>= 1;
            let bit = self.code >= self.range;
            if bit {
                self.code -= self.range;
            }
            value = value << 1 | u32::from(bit);
            while self.range < TOP {
                self.range <<= 8;
                self.shift();
            }
        }
        value
    }

    #[inline(always)]
    fn shift(&mut self) {
        let byte = self.bytes.get(self.position).copied().unwrap_or(0);
        self.position += 1;
        self.code = self.code << 8 | u32::from(byte);
    }

    /// Whether the stream has been read beyond its end.
    pub(super) fn is_past_end(&self) -> bool {
        self.position > self.bytes.len()
    }

    /// A stream is whole when it is read to its last byte and no further.
    pub(super) fn finish(self) -> Result<(), CodecError> {
        match self.position.cmp(&self.bytes.len()) {
            std::cmp::Ordering::Equal => Ok(()),
            std::cmp::Ordering::Less => Err(CodecError::Surplus),
            std::cmp::Ordering::Greater => Err(CodecError::Cut),
        }
    }
}
