//! Colour in differences: nibbles, each line for itself (protocol sections 7.6 and 7.7).
//!
//! A byte is predicted from the one of its component before it in the line, at first from 0: in U Y V Y luma from two
//! bytes back and chroma from four, in a mosaic every one from two back.
//!
//! Fast is [`run`]: it looks at up to fifteen nibbles together and takes four tokens without a branch, or fourteen
//! plain differences. Everything else, fillers and the end of a line or of a piece among it, goes through
//! [`Differences::nibble`], which is the definition.

use core::hint::select_unpredictable;

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
            if self.token_nibbles == 0 && self.column.is_multiple_of(2) {
                self.run(layout, data, &mut nibble_index, frame, line_bytes, position);
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

    /// Goes as far as [`run`] goes within the line.
    fn run(
        &mut self,
        layout: Layout,
        data: &[u8],
        nibble_index: &mut usize,
        frame: &mut [u8],
        line_bytes: usize,
        position: &mut usize,
    ) {
        // The last pair is left to `nibble`: behind it the line's border is looked at.
        let left = (line_bytes - self.column).saturating_sub(2);
        let before = |back: usize| {
            let is_there = self.column >= back;
            let value = frame.get(position.wrapping_sub(back)).copied();
            i32::from(value.filter(|_| is_there).unwrap_or(0))
        };
        let predictions = match layout {
            Layout::Uyvy => [before(4), before(2), before(1)],
            Layout::Bayer => [before(2), before(2), before(1)],
        };
        let Some(line) = frame.get_mut(*position..*position + left) else {
            return;
        };
        let count = match layout {
            Layout::Uyvy => run::<true>(data, nibble_index, predictions, line),
            Layout::Bayer => run::<false>(data, nibble_index, predictions, line),
        };
        self.column += count;
        *position += count;
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

/// Differences by nibble. That of a filler and of the escape leads out of range wherever it is added.
const DIFFERENCES: [i32; 16] = {
    let mut differences = [1 << 20; 16];
    let mut nibble = 0;
    while nibble <= MAX_DIFFERENCE as usize {
        differences[nibble] = nibble as i32 - 6;
        nibble += 1;
    }
    differences
};
/// Differences that a window of 15 nibbles holds, in pairs.
const PLAIN_COUNT: usize = 14;
/// Tokens that it holds for sure.
const TOKEN_COUNT: usize = 4;

/// Of the first component of this pair, of the next pair, and of the second component.
type Predictions = [i32; 3];

/// Decodes from an even column on, as far as there are whole windows, room, and nothing but differences in range and
/// full values: how many bytes. `nibble_index` moves along. What is written behind that has no meaning.
fn run<const FIRST_ALTERNATES: bool>(
    data: &[u8],
    nibble_index: &mut usize,
    mut predictions: Predictions,
    line: &mut [u8],
) -> usize {
    let mut count = 0;
    while let Some(&bytes) = data
        .get(*nibble_index / 2..)
        .and_then(<[u8]>::first_chunk::<8>)
    {
        let window = u64::from_be_bytes(bytes) << (4 * (*nibble_index % 2));
        let room = line.get_mut(count..).unwrap_or_default();
        let taken = if is_plain(window)
            && let Some(place) = room.first_chunk_mut()
        {
            plain::<FIRST_ALTERNATES>(window, predictions, place)
                .map(|after| (after, PLAIN_COUNT, PLAIN_COUNT))
        } else if let Some(place) = room.first_chunk_mut() {
            tokens::<FIRST_ALTERNATES>(window, predictions, place)
                .map(|(after, nibble_count)| (after, nibble_count, TOKEN_COUNT))
        } else {
            None
        };
        let Some((after, nibble_count, byte_count)) = taken else {
            break;
        };
        predictions = after;
        *nibble_index += nibble_count;
        count += byte_count;
    }
    count
}

/// Whether the first [`PLAIN_COUNT`] nibbles are differences.
#[inline]
fn is_plain(window: u64) -> bool {
    // The high bit of a nibble is set and its rest is 5 or more: 3 carries from the rest into the high bit.
    let carried = (window & 0x7777_7777_7777_7777) + 0x3333_3333_3333_3333;
    carried & window & 0x8888_8888_8888_8800 == 0
}

/// Adds differences up; `None` when one leads out of range.
#[inline]
fn plain<const FIRST_ALTERNATES: bool>(
    window: u64,
    [mut this, mut next, mut second]: Predictions,
    out: &mut [u8; PLAIN_COUNT],
) -> Option<Predictions> {
    let (mut rest, mut seen) = (window, 0);
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
        // What does not fit is seen below.
        *pair = [value as u8, second as u8];
    }
    is_byte(seen).then_some([this, next, second])
}

/// Takes differences and full values, and counts nibbles; `None` when one leads out of range or is a filler.
#[inline]
fn tokens<const FIRST_ALTERNATES: bool>(
    window: u64,
    [mut this, mut next, mut second]: Predictions,
    out: &mut [u8; TOKEN_COUNT],
) -> Option<(Predictions, usize)> {
    let (mut rest, mut nibble_count, mut seen) = (window, 0, 0);
    for pair in out.as_chunks_mut::<2>().0 {
        let value = token(&mut rest, &mut nibble_count, this);
        second = token(&mut rest, &mut nibble_count, second);
        (this, next) = if FIRST_ALTERNATES {
            (next, value)
        } else {
            (value, value)
        };
        seen |= value | second;
        *pair = [value as u8, second as u8];
    }
    is_byte(seen).then_some(([this, next, second], nibble_count))
}

/// The next value, whichever way it is written: both ways are followed and one is chosen.
#[inline]
fn token(window: &mut u64, nibble_count: &mut usize, predicted: i32) -> i32 {
    // The window itself decides: this is what the next token waits for.
    let is_full = *window >= 0xE << 60;
    // Four and eight bits.
    let plain = predicted + DIFFERENCES[(*window >> 60) as usize];
    let full = (*window >> 52 & 0xFF) as i32;
    // The bit that nobody looks at keeps the two shifts apart: made one by a variable amount they take twice as long.
    *window = select_unpredictable(is_full, *window << 12 | 1, *window << 4);
    *nibble_count += select_unpredictable(is_full, 3, 1);
    select_unpredictable(is_full, full, plain)
}

/// Whether all values of which these are the bits are within a byte.
#[inline]
fn is_byte(bits: i32) -> bool {
    (0..=0xFF).contains(&bits)
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
