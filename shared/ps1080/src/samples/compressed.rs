//! Compressed depth: nibbles that change one running value (protocol section 7.4).

use crate::damage::{Damage, NoRoom};
use crate::nibbles::NibbleWriter;
use crate::samples::SampleFormat;

const REPEAT: u32 = 0xE;
const ESCAPE: u32 = 0xF;
/// In the nibble after the escape: a difference of 7 bits follows, else a value of 15.
const IS_DIFFERENCE: u32 = 8;
const MAX_VALUE: i32 = 0x7FFF;
/// Fewer repetitions are as short as differences of 0.
const SHORTEST_RUN: usize = 3;
const LONGEST_RUN: usize = 16;

/// The decoder's state between two pieces of payload.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RunningValue {
    value: Option<i32>,
    /// Nibbles of a token that is not complete: the token's first is the highest.
    token: u32,
    token_nibbles: u32,
}

impl RunningValue {
    /// Goes on with `data`, writes from `position` on and moves it.
    pub(crate) fn push(
        &mut self,
        data: &[u8],
        codes: &mut [u16],
        position: &mut usize,
    ) -> Result<(), Damage> {
        for &byte in data {
            self.nibble(byte >> 4, codes, position)?;
            self.nibble(byte & 0xF, codes, position)?;
        }
        Ok(())
    }

    /// Whether no token is begun.
    pub(crate) fn is_between_tokens(&self) -> bool {
        self.token_nibbles == 0
    }

    #[inline]
    fn nibble(
        &mut self,
        nibble: u8,
        codes: &mut [u16],
        position: &mut usize,
    ) -> Result<(), Damage> {
        let nibble = u32::from(nibble);
        if self.token_nibbles == 0 {
            return match nibble {
                0..=0xC => self.step(nibble.cast_signed() - 6, codes, position),
                0xD => Ok(()),
                _ => {
                    (self.token, self.token_nibbles) = (nibble, 1);
                    Ok(())
                }
            };
        }
        self.token = self.token << 4 | nibble;
        self.token_nibbles += 1;
        match (self.token_nibbles, self.token) {
            (2, token) if token >> 4 == REPEAT => {
                self.token_nibbles = 0;
                // 1 to 16 times.
                let count = (token & 0xF) as usize + 1;
                let value = self.value.ok_or(Damage::NoFirstValue)?;
                emit(value, count, codes, position)
            }
            (3, token) if token >> 4 & IS_DIFFERENCE != 0 => {
                self.token_nibbles = 0;
                self.step((token & 0x7F).cast_signed() - 64, codes, position)
            }
            (5, token) => {
                self.token_nibbles = 0;
                let value = (token & 0x7FFF).cast_signed();
                self.value = Some(value);
                emit(value, 1, codes, position)
            }
            _ => Ok(()),
        }
    }

    #[inline]
    fn step(
        &mut self,
        difference: i32,
        codes: &mut [u16],
        position: &mut usize,
    ) -> Result<(), Damage> {
        let value = self.value.ok_or(Damage::NoFirstValue)? + difference;
        if !(0..=MAX_VALUE).contains(&value) {
            return Err(Damage::OutOfRange);
        }
        self.value = Some(value);
        emit(value, 1, codes, position)
    }
}

#[inline]
fn emit(value: i32, count: usize, codes: &mut [u16], position: &mut usize) -> Result<(), Damage> {
    let places = codes.get_mut(*position..*position + count);
    // Within 15 bits.
    places.ok_or(Damage::Excess)?.fill(value as u16);
    *position += count;
    Ok(())
}

/// Encodes lines of `width` codes, the last one may be shorter. Each begins with a full value on a byte's border, where
/// a reader can take up again; how many bytes, `None` for a code above 32 767 or without room.
pub(crate) fn encode(codes: &[u16], width: usize, out: &mut [u8]) -> Option<usize> {
    let is_sendable = |&code: &u16| code <= SampleFormat::Compressed.max_code();
    if !codes.iter().all(is_sendable) {
        return None;
    }
    let mut writer = NibbleWriter::new(out);
    for line in codes.chunks(width.max(1)) {
        encode_line(line, &mut writer).ok()?;
    }
    Some(writer.byte_count())
}

fn encode_line(line: &[u16], writer: &mut NibbleWriter<'_>) -> Result<(), NoRoom> {
    let Some((&first, mut rest)) = line.split_first() else {
        return Ok(());
    };
    writer.align()?;
    full_value(first, writer)?;
    let mut last = first;
    while let Some((&code, after)) = rest.split_first() {
        let run = rest
            .iter()
            .take(LONGEST_RUN)
            .take_while(|&&next| next == last)
            .count();
        if run >= SHORTEST_RUN {
            // At most 15.
            writer.push(REPEAT << 4 | (run as u32 - 1), 2)?;
            rest = rest.get(run..).unwrap_or_default();
            continue;
        }
        let difference = i32::from(code) - i32::from(last);
        match difference {
            // Both sums are not negative.
            -6..=6 => writer.push((difference + 6) as u32, 1)?,
            -64..=63 => {
                let bits = (difference + 64) as u32;
                writer.push(ESCAPE << 8 | IS_DIFFERENCE << 4 | bits, 3)?;
            }
            _ => full_value(code, writer)?,
        }
        last = code;
        rest = after;
    }
    Ok(())
}

fn full_value(code: u16, writer: &mut NibbleWriter<'_>) -> Result<(), NoRoom> {
    writer.push(ESCAPE << 16 | u32::from(code), 5)
}
