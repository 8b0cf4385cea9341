//! RVL as its author published it (Wilson 2017), the baseline of lossless depth: runs of zeros and of values by
//! turns, each number in groups of three bits with a continuation bit, eight groups to a 32-bit word.

/// Writes nibbles.
struct Writer<'a> {
    words: &'a mut Vec<u8>,
    word: u32,
    count: u32,
}

impl Writer<'_> {
    fn put(&mut self, mut value: u32) {
        loop {
            let mut nibble = value & 7;
            value >>= 3;
            if value != 0 {
                nibble |= 8;
            }
            self.word = self.word << 4 | nibble;
            self.count += 1;
            if self.count == 8 {
                self.words.extend(self.word.to_le_bytes());
                (self.word, self.count) = (0, 0);
            }
            if value == 0 {
                return;
            }
        }
    }

    fn finish(self) {
        if self.count > 0 {
            let word = self.word << (4 * (8 - self.count));
            self.words.extend(word.to_le_bytes());
        }
    }
}

/// Replaces `payload` by the code of `samples`.
pub(super) fn encode(samples: &[u16], payload: &mut Vec<u8>) {
    payload.clear();
    let mut writer = Writer {
        words: payload,
        word: 0,
        count: 0,
    };
    let mut previous = 0_i32;
    let mut rest = samples;
    while !rest.is_empty() {
        let zeros = rest.iter().take_while(|s| **s == 0).count();
        let values = rest[zeros..].iter().take_while(|s| **s != 0).count();
        writer.put(zeros as u32);
        writer.put(values as u32);
        for &sample in &rest[zeros..zeros + values] {
            let difference = i32::from(sample) - previous;
            // Small magnitudes of both signs are small.
            writer.put((difference << 1 ^ difference >> 31) as u32);
            previous = i32::from(sample);
        }
        rest = &rest[zeros + values..];
    }
    writer.finish();
}

struct Reader<'a> {
    words: &'a [u8],
    word: u32,
    count: u32,
}

impl Reader<'_> {
    fn next(&mut self) -> Option<u32> {
        let mut value = 0_u32;
        for shift in (0..32).step_by(3) {
            if self.count == 0 {
                let (word, rest) = self.words.split_first_chunk::<4>()?;
                (self.word, self.words, self.count) = (u32::from_le_bytes(*word), rest, 8);
            }
            let nibble = self.word >> 28;
            self.word <<= 4;
            self.count -= 1;
            value |= (nibble & 7) << shift;
            if nibble & 8 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// Fills `samples` from a payload; `None` where it is no code of so many.
pub(super) fn decode(payload: &[u8], samples: &mut [u16]) -> Option<()> {
    let mut reader = Reader {
        words: payload,
        word: 0,
        count: 0,
    };
    let mut previous = 0_i32;
    let mut at = 0;
    while at < samples.len() {
        let zeros = reader.next()? as usize;
        samples.get_mut(at..at.checked_add(zeros)?)?.fill(0);
        at += zeros;
        let values = reader.next()? as usize;
        for sample in samples.get_mut(at..at.checked_add(values)?)? {
            let code = reader.next()?;
            let difference = (code >> 1) as i32 ^ -((code & 1) as i32);
            previous = previous.checked_add(difference)?;
            *sample = u16::try_from(previous).ok()?;
        }
        at += values;
        if zeros == 0 && values == 0 {
            return None;
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn any_samples_come_back_and_damage_does_no_harm() {
        let mut rng = Pcg64::seed_from_u64(1);
        let mut payload = Vec::new();
        for round in 0..300 {
            let length = rng.random_range(1..200);
            let samples: Vec<u16> = (0..length)
                .map(|_| match rng.random_range(0..4) {
                    0 => 0,
                    1 => u16::MAX,
                    _ => 1000 + rng.random_range(0..if round % 2 == 0 { 20 } else { 60_000 }),
                })
                .collect();
            encode(&samples, &mut payload);
            let mut decoded = vec![7; samples.len()];
            assert_eq!(decode(&payload, &mut decoded), Some(()));
            assert_eq!(decoded, samples);
            let at = rng.random_range(0..payload.len());
            payload[at] ^= 1 << rng.random_range(0..8);
            let _ = decode(&payload, &mut decoded);
            assert_eq!(decode(&payload[..0], &mut decoded), None);
        }
    }

    #[test]
    fn the_code_is_the_published_one() {
        // Two zeros, two values 5 and 4: 2, 2, zigzag(5) = 10 = 0b1_010, zigzag(-1) = 1.
        let mut payload = Vec::new();
        encode(&[0, 0, 5, 4], &mut payload);
        // Nibbles from the highest: 2, 2, 8|2, 1, 1, and three empty ones.
        assert_eq!(payload, 0x22A1_1000_u32.to_le_bytes());
    }
}
