//! Blocks that come in parts.

use core::fmt;

/// Why the parts make no block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BlockError {
    /// An empty part before the block was full.
    Short {
        /// Bytes that are there.
        got_bytes: usize,
        /// Bytes of the block.
        expected_bytes: usize,
    },
    /// A part is longer than the rest of the block, or ends within the unit that offsets count in.
    PartSize {
        /// Bytes of the part.
        part_bytes: usize,
    },
}

impl fmt::Display for BlockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short {
                got_bytes,
                expected_bytes,
            } => write!(f, "block ends at byte {got_bytes} of {expected_bytes}"),
            Self::PartSize { part_bytes } => {
                write!(f, "part of {part_bytes} bytes does not fit the block")
            }
        }
    }
}

impl core::error::Error for BlockError {}

/// Puts a block of `BYTES` together from the replies to requests with rising offsets.
#[derive(Clone, Debug)]
pub struct BlockCollector<const BYTES: usize> {
    bytes: [u8; BYTES],
    filled: usize,
    unit_bytes: usize,
}

impl<const BYTES: usize> BlockCollector<BYTES> {
    /// For offsets in 32-bit units: GET_FIXED_PARAMS.
    pub fn of_double_words() -> Self {
        Self::new(4)
    }

    /// For offsets in words: ALGORITHM_PARAMS.
    pub fn of_words() -> Self {
        Self::new(2)
    }

    fn new(unit_bytes: usize) -> Self {
        Self {
            bytes: [0; BYTES],
            filled: 0,
            unit_bytes,
        }
    }

    /// The offset to ask for; `None` when the block is there.
    pub fn next_offset(&self) -> Option<u16> {
        let offset = u16::try_from(self.filled / self.unit_bytes).ok()?;
        (self.filled < BYTES).then_some(offset)
    }

    /// Takes the data of the reply.
    ///
    /// # Errors
    /// An empty part and one that does not fit.
    pub fn push(&mut self, part: &[u8]) -> Result<(), BlockError> {
        if part.is_empty() {
            return Err(BlockError::Short {
                got_bytes: self.filled,
                expected_bytes: BYTES,
            });
        }
        let end = self.filled + part.len();
        let place = self.bytes.get_mut(self.filled..end);
        let is_whole = end == BYTES || end.is_multiple_of(self.unit_bytes);
        let place = place.filter(|_| is_whole).ok_or(BlockError::PartSize {
            part_bytes: part.len(),
        })?;
        place.copy_from_slice(part);
        self.filled = end;
        Ok(())
    }

    /// The block, when all of it is there.
    pub fn block(&self) -> Option<&[u8; BYTES]> {
        (self.filled == BYTES).then_some(&self.bytes)
    }
}
