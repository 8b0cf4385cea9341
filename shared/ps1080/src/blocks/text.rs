//! Serial number, device name, platform: texts filled up with zeros.

use core::fmt;

/// A text of at most `BYTES` printable ASCII characters.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Text<const BYTES: usize> {
    bytes: [u8; BYTES],
    length: usize,
}

impl<const BYTES: usize> Text<BYTES> {
    /// The bytes before the first zero; what is no printable ASCII becomes '?', what is too long is cut off.
    pub fn decode(data: &[u8]) -> Self {
        Self::of(data.iter().copied())
    }

    fn of(characters: impl Iterator<Item = u8>) -> Self {
        let mut text = Self {
            bytes: [0; BYTES],
            length: 0,
        };
        for (place, character) in text
            .bytes
            .iter_mut()
            .zip(characters.take_while(|&character| character != 0))
        {
            let is_printable = character == b' ' || character.is_ascii_graphic();
            *place = if is_printable { character } else { b'?' };
            text.length += 1;
        }
        text
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        let text = self.bytes.get(..self.length).unwrap_or_default();
        // Always: all of it is ASCII.
        core::str::from_utf8(text).unwrap_or_default()
    }
}

impl<const BYTES: usize> fmt::Display for Text<BYTES> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl<const BYTES: usize> fmt::Debug for Text<BYTES> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

/// The answer to GET_PLATFORM_STRING, two bytes a character.
pub fn decode_platform_string(data: &[u8]) -> Text<40> {
    let words = data
        .as_chunks()
        .0
        .iter()
        .map(|word| u16::from_le_bytes(*word));
    // What no byte holds is no ASCII either.
    Text::of(words.map(|word| u8::try_from(word).unwrap_or(b'?')))
}

/// The same answer of a camera: how many bytes of `data`; a text that does not fit is cut off.
pub fn encode_platform_string(text: &Text<40>, data: &mut [u8]) -> usize {
    let mut byte_count = 0;
    for (place, character) in data.as_chunks_mut().0.iter_mut().zip(text.as_str().bytes()) {
        *place = u16::from(character).to_le_bytes();
        byte_count += 2;
    }
    byte_count
}
