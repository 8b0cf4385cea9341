//! Decodes a frame of colour from payload in pieces of any size.

use crate::color::compressed::{Differences, Layout};
use crate::color::{ColorFormat, JpegFramer};
use crate::damage::Damage;

/// Decoder of the frames of one stream.
///
/// Per frame: [`begin`](Self::begin), [`push`](Self::push) for every piece of payload into the frame's one buffer,
/// [`finish`](Self::finish). The first damage is returned again by all calls until the next `begin`.
#[derive(Clone, Debug)]
pub struct ColorDecoder {
    format: ColorFormat,
    line_bytes: usize,
    /// Bytes of a picture; of JPEG it is the buffer that says.
    frame_bytes: Option<usize>,
    position: usize,
    differences: Differences,
    jpeg: JpegFramer,
    damage: Option<Damage>,
}

impl ColorDecoder {
    /// For pictures of `width` times `height` pixels; `None` for an odd width (JPEG: any).
    pub fn new(format: ColorFormat, width: u16, height: u16) -> Option<Self> {
        let line_bytes = if format.is_jpeg() {
            0
        } else {
            format.line_bytes(width)?
        };
        Some(Self {
            format,
            line_bytes,
            frame_bytes: (!format.is_jpeg()).then_some(line_bytes * usize::from(height)),
            position: 0,
            differences: Differences::default(),
            jpeg: JpegFramer::new(),
            damage: None,
        })
    }

    /// Begins a frame.
    pub fn begin(&mut self) {
        self.position = 0;
        self.differences = Differences::default();
        self.jpeg = JpegFramer::new();
        self.damage = None;
    }

    /// Decodes the next piece into `frame`, the buffer of the whole frame; for JPEG, any that is large enough.
    ///
    /// # Errors
    /// What is wrong with the frame; [`Damage::BufferSize`] for a buffer of another size.
    pub fn push(&mut self, payload: &[u8], frame: &mut [u8]) -> Result<(), Damage> {
        let result = self.try_push(payload, frame);
        self.damage = result.err();
        result
    }

    /// Ends the frame: how many bytes it has.
    ///
    /// # Errors
    /// What was wrong before; [`Damage::Short`] or [`Damage::Cut`] when payload is missing.
    pub fn finish(&mut self) -> Result<usize, Damage> {
        let result = self.try_finish();
        self.damage = result.err();
        result
    }

    fn try_push(&mut self, payload: &[u8], frame: &mut [u8]) -> Result<(), Damage> {
        if let Some(damage) = self.damage {
            return Err(damage);
        }
        if let Some(expected_count) = self.frame_bytes
            && expected_count != frame.len()
        {
            return Err(Damage::BufferSize {
                expected_count,
                got_count: frame.len(),
            });
        }
        let layout = match self.format {
            ColorFormat::CompressedYuv422 => Layout::Uyvy,
            ColorFormat::CompressedBayer => Layout::Bayer,
            _ => return self.copy(payload, frame),
        };
        self.differences
            .push(layout, payload, frame, self.line_bytes, &mut self.position)
    }

    fn copy(&mut self, payload: &[u8], frame: &mut [u8]) -> Result<(), Damage> {
        let payload = if self.format.is_jpeg() {
            let used = self.jpeg.push(payload)?;
            payload.get(..used).unwrap_or(payload)
        } else {
            payload
        };
        let end = self.position + payload.len();
        let place = frame.get_mut(self.position..end);
        place.ok_or(Damage::Excess)?.copy_from_slice(payload);
        self.position = end;
        Ok(())
    }

    fn try_finish(&self) -> Result<usize, Damage> {
        if let Some(damage) = self.damage {
            return Err(damage);
        }
        match self.frame_bytes {
            Some(bytes) if self.position < bytes => Err(Damage::Short {
                missing_count: bytes - self.position,
            }),
            None if !self.jpeg.is_complete() => Err(Damage::Cut),
            _ if !self.differences.is_between_tokens() => Err(Damage::Cut),
            _ => Ok(self.position),
        }
    }
}
