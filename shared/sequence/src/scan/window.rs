//! Stretches of a source: their sums, and magic numbers in them.

use crate::error::SequenceError;
use crate::source::ByteSource;

/// CRC of a stretch, `None` when the source ends before.
pub(super) fn crc_of<S: ByteSource + ?Sized>(
    source: &S,
    mut offset: u64,
    mut bytes: u64,
) -> Result<Option<u32>, SequenceError> {
    let mut buffer = vec![0; bytes.min(WINDOW_BYTES) as usize];
    let mut crc = 0;
    while bytes > 0 {
        let count = bytes.min(WINDOW_BYTES);
        let part = &mut buffer[..count as usize];
        if source.read_exact_at(offset, part)?.is_none() {
            return Ok(None);
        }
        crc = crc32c::crc32c_append(crc, part);
        offset += count;
        bytes -= count;
    }
    Ok(Some(crc))
}

/// Bytes looked at in one read.
const WINDOW_BYTES: u64 = 1 << 18;

/// Looks for magic numbers, a block at a time, and jumps over holes.
pub(super) struct Window<'source, S: ByteSource + ?Sized> {
    source: &'source S,
    /// Where the block begins.
    start: u64,
    bytes: Vec<u8>,
}

impl<'source, S: ByteSource + ?Sized> Window<'source, S> {
    pub(super) fn new(source: &'source S) -> Self {
        Self {
            source,
            start: 0,
            bytes: Vec::new(),
        }
    }

    /// Reads a block at `offset`; false at the end.
    fn load(&mut self, offset: u64, end: u64) -> Result<bool, SequenceError> {
        let count = end.saturating_sub(offset).min(WINDOW_BYTES) as usize;
        self.bytes.resize(count, 0);
        let mut filled = 0;
        while filled < count {
            match self
                .source
                .read_at(offset + filled as u64, &mut self.bytes[filled..])
            {
                Ok(0) => break,
                Ok(more) => filled += more,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        self.bytes.truncate(filled);
        self.start = offset;
        Ok(filled > 0)
    }

    /// What is loaded from `offset` on.
    fn loaded(&self, offset: u64) -> &[u8] {
        let skipped = offset
            .checked_sub(self.start)
            .and_then(|skip| usize::try_from(skip).ok());
        skipped
            .and_then(|skip| self.bytes.get(skip..))
            .unwrap_or_default()
    }

    /// The first multiple of `step` in `offset..end` where `magic` stands.
    pub(super) fn find(
        &mut self,
        magic: &[u8],
        mut offset: u64,
        end: u64,
        step: u64,
    ) -> Result<Option<u64>, SequenceError> {
        while offset < end {
            if self.loaded(offset).is_empty() {
                let Some(data) = self.source.next_data(offset) else {
                    return Ok(None);
                };
                offset = offset.max(data / step * step);
                if !self.load(offset, end)? {
                    return Ok(None);
                }
            }
            let found = self
                .loaded(offset)
                .chunks(step as usize)
                .position(|block| block.starts_with(magic));
            if let Some(position) = found {
                let at = offset + position as u64 * step;
                return Ok((at < end).then_some(at));
            }
            offset += (self.loaded(offset).len() as u64).next_multiple_of(step);
        }
        Ok(None)
    }

    pub(super) fn has_content(&mut self, mut offset: u64, end: u64) -> Result<bool, SequenceError> {
        while offset < end {
            let Some(data) = self.source.next_data(offset) else {
                return Ok(false);
            };
            offset = offset.max(data);
            if !self.load(offset, end)? {
                return Ok(false);
            }
            if self.bytes.iter().any(|byte| *byte != 0) {
                return Ok(true);
            }
            offset += self.bytes.len() as u64;
        }
        Ok(false)
    }
}
