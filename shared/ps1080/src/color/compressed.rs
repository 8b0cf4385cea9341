//! Colour in differences: nibbles, each line for itself (protocol sections 7.6 and 7.7).
//!
//! A byte is predicted from the one of its component before it in the line, at first from 0: in U Y V Y luma from two
//! bytes back and chroma from four, in a mosaic every one from two back.
//!
//! Fast is [`plain_pairs`]: sixteen nibbles are looked at together, and those before the first that is no difference are
//! added up without a branch. Everything else, the last bytes of a piece among it, goes through [`Differences::nibble`],
//! which is the definition.

use crate::damage::{Damage, NoRoom};
use crate::nibbles::{FILLER, NibbleWriter};

/// Nibbles up to this are differences of -6 to 6.
const MAX_DIFFERENCE: u8 = 0xC;
const ESCAPE: u32 = 0xF;

/// Order of the components of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    /// U Y V Y.
    Uyvy,
    /// Two components by turns.
    Bayer,
}

impl Layout {
    /// How far back the byte is that predicts the one in `column`.
    fn distance(self, column: usize) -> usize {
        match self {
            Self::Uyvy if column.is_multiple_of(2) => 4,
            _ => 2,
        }
    }
}

/// What predicts the byte at `position`, in `column` of its line.
#[inline]
fn predicted(layout: Layout, frame: &[u8], position: usize, column: usize) -> u8 {
    let distance = layout.distance(column);
    if column < distance {
        return 0;
    }
    frame.get(position - distance).copied().unwrap_or(0)
}

/// The decoder's state between two pieces of payload; the predictions are in the frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Differences {
    column: usize,
    /// Nibbles of a full value that are there, the escape among them.
    token_nibbles: u8,
    high: u8,
}

impl Differences {
    /// Goes on with `data`, writes from `position` on and moves it.
    pub(crate) fn push(
        &mut self,
        layout: Layout,
        data: &[u8],
        frame: &mut [u8],
        line_bytes: usize,
        position: &mut usize,
    ) -> Result<(), Damage> {
        let mut nibble_index = 0;
        loop {
            if self.token_nibbles == 0
                && let Some(window) = window_at(data, nibble_index)
            {
                let taken = self.window(layout, window, frame, line_bytes, position)?;
                nibble_index += taken;
                if taken > 0 {
                    continue;
                }
            }
            let Some(&byte) = data.get(nibble_index / 2) else {
                return Ok(());
            };
            let is_high = nibble_index.is_multiple_of(2);
            let nibble = if is_high { byte >> 4 } else { byte & 0xF };
            let was = *position;
            self.nibble(layout, nibble, frame, line_bytes, position)?;
            let ends_line = self.column == 0 && *position != was;
            if ends_line && is_high && byte & 0xF != FILLER {
                return Err(Damage::LineBorder);
            }
            nibble_index += 1;
        }
    }

    /// Whether no token is begun.
    pub(crate) fn is_between_tokens(&self) -> bool {
        self.token_nibbles == 0
    }

    /// Takes whole pairs of plain differences off the front of 16 nibbles; how many nibbles.
    #[inline]
    fn window(
        &mut self,
        layout: Layout,
        window: u64,
        frame: &mut [u8],
        line_bytes: usize,
        position: &mut usize,
    ) -> Result<usize, Damage> {
        if !self.column.is_multiple_of(2) {
            return Ok(0);
        }
        // The last pair is left to `nibble`, which looks at the line's border.
        let left = (line_bytes - self.column).saturating_sub(2);
        let count = plain_nibbles(window).min(left) / 2 * 2;
        let column = self.column;
        let at = *position;
        let before = |back: usize| match column.checked_sub(back) {
            Some(_) => frame.get(at - back).copied().unwrap_or(0),
            None => 0,
        };
        let (first, second) = match layout {
            Layout::Uyvy => ([before(4), before(2)], before(1)),
            Layout::Bayer => ([before(2); 2], before(1)),
        };
        let Some(place) = frame.get_mut(at..at + count) else {
            return Ok(0);
        };
        let is_in_range = match layout {
            Layout::Uyvy => plain_pairs::<true>(window, first, second, place),
            Layout::Bayer => plain_pairs::<false>(window, first, second, place),
        };
        if !is_in_range {
            return Err(Damage::OutOfRange);
        }
        self.column += count;
        *position += count;
        Ok(count)
    }

    #[inline]
    fn nibble(
        &mut self,
        layout: Layout,
        nibble: u8,
        frame: &mut [u8],
        line_bytes: usize,
        position: &mut usize,
    ) -> Result<(), Damage> {
        let value = match (self.token_nibbles, nibble) {
            (0, FILLER) => return Ok(()),
            (0, 0..=MAX_DIFFERENCE) => {
                let predicted = predicted(layout, frame, *position, self.column);
                let sum = i16::from(predicted) + i16::from(nibble) - 6;
                u8::try_from(sum).map_err(|_| Damage::OutOfRange)?
            }
            (0, _) => {
                self.token_nibbles = 1;
                return Ok(());
            }
            (1, _) => {
                (self.high, self.token_nibbles) = (nibble, 2);
                return Ok(());
            }
            _ => {
                self.token_nibbles = 0;
                self.high << 4 | nibble
            }
        };
        *frame.get_mut(*position).ok_or(Damage::Excess)? = value;
        *position += 1;
        self.column += 1;
        if self.column == line_bytes {
            self.column = 0;
        }
        Ok(())
    }
}

/// Sixteen nibbles from one on, the first the highest; `None` near the end of the data.
#[inline]
fn window_at(data: &[u8], nibble_index: usize) -> Option<u64> {
    let bytes: &[u8; 9] = data.get(nibble_index / 2..)?.first_chunk()?;
    let &[a, b, c, d, e, f, g, h, next] = bytes;
    let whole = u64::from_be_bytes([a, b, c, d, e, f, g, h]);
    if nibble_index.is_multiple_of(2) {
        return Some(whole);
    }
    Some(whole << 4 | u64::from(next >> 4))
}

/// Nibbles before the first above [`MAX_DIFFERENCE`].
#[inline]
fn plain_nibbles(window: u64) -> usize {
    // The high bit of a nibble is set and its rest is 5 or more: 3 carries from the rest into the high bit.
    let carried = (window & 0x7777_7777_7777_7777) + 0x3333_3333_3333_3333;
    let special = carried & window & 0x8888_8888_8888_8888;
    special.leading_zeros() as usize / 4
}

/// Adds up pairs of differences from the front of the window into `out`, an even number of bytes. `first` are the
/// predictions of the first component of this pair and of the next, `second` that of the other. Whether all values
/// are within a byte.
#[inline]
fn plain_pairs<const FIRST_ALTERNATES: bool>(
    window: u64,
    first: [u8; 2],
    second: u8,
    out: &mut [u8],
) -> bool {
    let [mut this, mut next] = first.map(i32::from);
    let mut second = i32::from(second);
    let mut rest = window;
    let mut seen = 0;
    for pair in out.as_chunks_mut::<2>().0 {
        let value = this + (rest >> 60) as i32 - 6;
        second += (rest >> 56 & 0xF) as i32 - 6;
        rest <<= 8;
        (this, next) = if FIRST_ALTERNATES {
            (next, value)
        } else {
            (value, value)
        };
        seen |= value | second;
        // Checked below.
        *pair = [value as u8, second as u8];
    }
    (0..=0xFF).contains(&seen)
}

/// Encodes lines of `line_bytes`; how many bytes. Every line ends on a byte's border.
///
/// # Errors
/// [`NoRoom`] when `out` is too small.
pub(crate) fn encode(
    layout: Layout,
    frame: &[u8],
    line_bytes: usize,
    out: &mut [u8],
) -> Result<usize, NoRoom> {
    let mut writer = NibbleWriter::new(out);
    for line in frame.chunks(line_bytes.max(1)) {
        for (column, &value) in line.iter().enumerate() {
            // Tokens have one or three nibbles: after an odd number of them, the last one ends the byte.
            if column + 1 == line.len() && writer.is_aligned() {
                writer.push(FILLER.into(), 1)?;
            }
            let predicted = predicted(layout, line, column, column);
            match i16::from(value) - i16::from(predicted) {
                // Not negative.
                difference @ -6..=6 => writer.push((difference + 6) as u32, 1)?,
                _ => writer.push(ESCAPE << 8 | u32::from(value), 3)?,
            }
        }
    }
    Ok(writer.byte_count())
}
