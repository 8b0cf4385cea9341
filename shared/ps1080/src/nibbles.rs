//! Half bytes, the high one of each byte first.

use crate::damage::NoRoom;

/// Writes nibbles into a buffer.
pub(crate) struct NibbleWriter<'a> {
    out: &'a mut [u8],
    nibble_count: usize,
}

/// The nibble that means nothing.
pub(crate) const FILLER: u8 = 0xD;

impl<'a> NibbleWriter<'a> {
    pub(crate) fn new(out: &'a mut [u8]) -> Self {
        Self {
            out,
            nibble_count: 0,
        }
    }

    /// Appends the low `count` nibbles of `value`, the highest first.
    pub(crate) fn push(&mut self, value: u32, count: u32) -> Result<(), NoRoom> {
        for index in (0..count).rev() {
            // Four bits of it.
            let nibble = (value >> (4 * index)) as u8 & 0xF;
            let place = self.out.get_mut(self.nibble_count / 2).ok_or(NoRoom)?;
            *place = if self.nibble_count.is_multiple_of(2) {
                nibble << 4 | FILLER
            } else {
                *place & 0xF0 | nibble
            };
            self.nibble_count += 1;
        }
        Ok(())
    }

    /// Whether the next nibble begins a byte.
    pub(crate) fn is_aligned(&self) -> bool {
        self.nibble_count.is_multiple_of(2)
    }

    /// A filler where a byte is half full.
    pub(crate) fn align(&mut self) -> Result<(), NoRoom> {
        if self.is_aligned() {
            return Ok(());
        }
        self.push(FILLER.into(), 1)
    }

    /// Bytes begun; the rest of the last is a filler.
    pub(crate) fn byte_count(&self) -> usize {
        self.nibble_count.div_ceil(2)
    }
}
