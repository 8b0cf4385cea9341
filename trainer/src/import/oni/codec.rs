//! The codecs of OpenNI: 16z, 16z with a table, and 8z (oni-format section 4).
//!
//! A picture that does not end exactly with its bytes is damaged: nothing is filled in.

use super::OniDamage;

/// Half a byte that closes a pair.
const NOTHING: u8 = 0xD;
/// Half a byte after which a large step follows.
const LARGE: u8 = 0xF;

/// Pixels that are written one after the other.
struct Output<'a, T> {
    pixels: &'a mut [T],
    done: usize,
}

impl<T: Copy> Output<'_, T> {
    fn push(&mut self, value: T, count: usize) -> Result<(), OniDamage> {
        let pixels = self.pixels.get_mut(self.done..self.done + count);
        pixels.ok_or(OniDamage::TooManyPixels)?.fill(value);
        self.done += count;
        Ok(())
    }

    fn finish(self) -> Result<(), OniDamage> {
        if self.done == self.pixels.len() {
            return Ok(());
        }
        Err(OniDamage::TooFewPixels {
            done: self.done,
            expected: self.pixels.len(),
        })
    }
}

/// Decodes 16z.
///
/// # Errors
/// When `payload` holds more or fewer values than `values`.
pub fn decode_16z(payload: &[u8], values: &mut [u16]) -> Result<(), OniDamage> {
    let mut output = Output {
        pixels: values,
        done: 0,
    };
    let (first, rest) = payload.split_first_chunk().ok_or(OniDamage::TooShort)?;
    let mut previous = u16::from_le_bytes(*first);
    output.push(previous, 1)?;
    let mut bytes = rest.iter().copied();
    while let Some(byte) = bytes.next() {
        match byte {
            0xE0 => return Err(OniDamage::Token),
            0xE1..=0xEF => {
                output.push(previous, 2 * usize::from(byte - 0xE0))?;
                continue;
            }
            0xFF => {}
            _ => {
                let (high, low) = (byte >> 4, byte & 0xF);
                previous = small_step(previous, high)?;
                output.push(previous, 1)?;
                match low {
                    NOTHING => continue,
                    LARGE => {}
                    _ => {
                        previous = small_step(previous, low)?;
                        output.push(previous, 1)?;
                        continue;
                    }
                }
            }
        }
        let head = bytes.next().ok_or(OniDamage::TooShort)?;
        previous = if head & 0x80 == 0 {
            u16::from_be_bytes([head, bytes.next().ok_or(OniDamage::TooShort)?])
        } else {
            previous.wrapping_sub(u16::from(head).wrapping_sub(192))
        };
        output.push(previous, 1)?;
    }
    output.finish()
}

/// The value after a difference of −6 to 6.
fn small_step(previous: u16, nibble: u8) -> Result<u16, OniDamage> {
    if nibble > 12 {
        return Err(OniDamage::Token);
    }
    Ok(previous.wrapping_sub(u16::from(nibble).wrapping_sub(6)))
}

/// Decodes 16z of places in a table that comes first.
///
/// # Errors
/// As [`decode_16z`], and when a place is beyond the table.
pub fn decode_16z_with_table(payload: &[u8], values: &mut [u16]) -> Result<(), OniDamage> {
    let (count, rest) = payload.split_first_chunk().ok_or(OniDamage::TooShort)?;
    let table_len = 2 * usize::from(u16::from_le_bytes(*count));
    let (table, rest) = rest
        .split_at_checked(table_len)
        .ok_or(OniDamage::TooShort)?;
    let table = table.as_chunks::<2>().0;
    decode_16z(rest, values)?;
    for value in values {
        let entry = table.get(usize::from(*value)).ok_or(OniDamage::Token)?;
        *value = u16::from_le_bytes(*entry);
    }
    Ok(())
}

/// Decodes 8z.
///
/// # Errors
/// When `payload` holds more or fewer values than `values`.
pub fn decode_8z(payload: &[u8], values: &mut [u8]) -> Result<(), OniDamage> {
    let mut output = Output {
        pixels: values,
        done: 0,
    };
    let (&first, rest) = payload.split_first().ok_or(OniDamage::TooShort)?;
    let mut previous = first;
    output.push(previous, 1)?;
    let mut bytes = rest.iter().copied();
    let mut next = || bytes.next().ok_or(OniDamage::TooShort);
    while let Ok(byte) = next() {
        let (high, mut low) = (byte >> 4, byte & 0xF);
        match byte {
            0xE0 => return Err(OniDamage::Token),
            0xE1..=0xEF => {
                output.push(previous, 2 * usize::from(low))?;
                continue;
            }
            0xF0.. => {
                let tail = next()?;
                previous = low << 4 | tail >> 4;
                low = tail & 0xF;
            }
            _ => previous = small_step_8(previous, high)?,
        }
        output.push(previous, 1)?;
        match low {
            NOTHING => {}
            LARGE => {
                previous = next()?;
                output.push(previous, 1)?;
            }
            _ => {
                previous = small_step_8(previous, low)?;
                output.push(previous, 1)?;
            }
        }
    }
    output.finish()
}

fn small_step_8(previous: u8, nibble: u8) -> Result<u8, OniDamage> {
    if nibble > 12 {
        return Err(OniDamage::Token);
    }
    Ok(previous.wrapping_sub(nibble.wrapping_sub(6)))
}

#[cfg(test)]
mod tests {
    use super::*;

    // The worked examples of oni-format section 4.

    #[test]
    fn depth_decodes_by_hand() {
        let bytes = [0xE8, 0x03, 0xE2, 0x3B, 0xFF, 0xA0, 0xFF, 0x13, 0x88, 0xE1];
        let mut values = [0; 11];
        decode_16z(&bytes, &mut values).unwrap();
        let expected = [
            1000, 1000, 1000, 1000, 1000, 1003, 998, 1030, 5000, 5000, 5000,
        ];
        assert_eq!(values, expected);
    }

    #[test]
    fn places_in_a_table_decode_by_hand() {
        let bytes = [
            4, 0, 0, 0, 0x20, 3, 0xDC, 5, 0xE0, 5, 0, 0, 0xE1, 0x46, 0x58, 0x67,
        ];
        let mut values = [1; 9];
        decode_16z_with_table(&bytes, &mut values).unwrap();
        assert_eq!(values, [0, 0, 0, 1500, 1500, 1504, 800, 800, 0]);
    }

    #[test]
    fn bytes_decode_by_hand() {
        let bytes = [0x64, 0xE1, 0xFC, 0x85, 0x4F, 0x32, 0xE1, 0x6D];
        let mut values = [0; 10];
        decode_8z(&bytes, &mut values).unwrap();
        assert_eq!(values, [100, 100, 100, 200, 201, 203, 50, 50, 50, 50]);
    }

    #[test]
    fn the_order_of_the_file_counts() {
        // As OpenNI writes the end of a frame: a lone half byte before the run that came first.
        let mut values = [0; 4];
        decode_16z(&[0xE8, 0x03, 0x3D, 0xE1], &mut values).unwrap();
        assert_eq!(values, [1000, 1003, 1003, 1003]);
    }

    #[test]
    fn a_picture_ends_with_its_bytes() {
        let bytes = [0xE8, 0x03, 0xE2, 0x3B];
        let decode = |count| decode_16z(&bytes, &mut vec![0; count]);
        assert_eq!(decode(7), Ok(()));
        assert_eq!(decode(6), Err(OniDamage::TooManyPixels));
        let short = OniDamage::TooFewPixels {
            done: 7,
            expected: 8,
        };
        assert_eq!(decode(8), Err(short));
        assert_eq!(decode_16z(&[1], &mut [0]), Err(OniDamage::TooShort));
        let mut values = [0; 2];
        assert_eq!(
            decode_16z(&[0, 0, 0xDD], &mut values),
            Err(OniDamage::Token)
        );
        let beyond = decode_16z_with_table(&[1, 0, 7, 0, 1, 0], &mut values[..1]);
        assert_eq!(beyond, Err(OniDamage::Token));
    }
}
