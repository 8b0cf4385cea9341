//! Payloads into images, for the two streams of a recording.

use std::collections::BTreeMap;

use imaging::{Image, decode_jpeg};

use crate::codecs::{CodeTable, ColorDecoder, ColorFormat, DepthDecoder, depth_table_id};
use crate::description::Description;
use crate::error::SequenceError;

/// Working memory for decoding the frames of one recording.
pub struct StreamDecoders {
    depth: DepthDecoder,
    depth_size: [u32; 2],
    color: Option<ColorDecoder>,
    color_format: Option<ColorFormat>,
    color_size: [u32; 2],
}

impl StreamDecoders {
    /// Decoders for the streams of `description`.
    pub fn new(description: &Description) -> Result<Self, SequenceError> {
        let depth = &description.streams.depth.intrinsics;
        let color = &description.streams.color.intrinsics;
        let color_format = description.streams.color.encoding.lossless();
        Ok(Self {
            depth: DepthDecoder::new(depth.width(), depth.height())?,
            depth_size: [depth.width(), depth.height()],
            color: match color_format {
                Some(format) => Some(ColorDecoder::new(format, color.width(), color.height())?),
                None => None,
            },
            color_format,
            color_size: [color.width(), color.height()],
        })
    }

    /// Depth samples of a payload of `stream`.
    pub fn depth(
        &mut self,
        payload: &[u8],
        stream: u16,
        tables: &BTreeMap<(u16, u16), CodeTable>,
    ) -> Result<Image<u16>, SequenceError> {
        let [width, height] = self.depth_size;
        let mut image = Image::new(width, height, 0);
        self.depth_into(payload, stream, tables, image.pixels_mut())?;
        Ok(image)
    }

    /// As [`StreamDecoders::depth`], into memory that is there.
    pub fn depth_into(
        &mut self,
        payload: &[u8],
        stream: u16,
        tables: &BTreeMap<(u16, u16), CodeTable>,
        samples: &mut [u16],
    ) -> Result<(), SequenceError> {
        let table = match depth_table_id(payload)? {
            None => None,
            Some(id) => Some(
                tables
                    .get(&(stream, id))
                    .ok_or(SequenceError::NoTable { id })?,
            ),
        };
        Ok(self.depth.decode(payload, table, samples)?)
    }

    /// The raw frame of a colour payload, in the stream's format; of JPEG the bytes themselves.
    pub fn color(&mut self, payload: &[u8]) -> Result<Vec<u8>, SequenceError> {
        let mut frame = Vec::new();
        self.color_into(payload, &mut frame)?;
        Ok(frame)
    }

    /// As [`StreamDecoders::color`], into memory that is there; `frame` gets the length it needs.
    pub fn color_into(&mut self, payload: &[u8], frame: &mut Vec<u8>) -> Result<(), SequenceError> {
        let (Some(decoder), Some(format)) = (&mut self.color, self.color_format) else {
            frame.clear();
            frame.extend_from_slice(payload);
            return Ok(());
        };
        let [width, height] = self.color_size;
        frame.resize(format.frame_bytes(width, height)?, 0);
        Ok(decoder.decode(payload, frame)?)
    }

    /// Refuses a colour payload that is no frame of the stream.
    pub fn check_color(&mut self, payload: &[u8]) -> Result<(), SequenceError> {
        let [camera_width, camera_height] = self.color_size;
        if self.color.is_some() {
            return self.color(payload).map(|_| ());
        }
        let image = decode_jpeg(payload)?;
        if [image.width(), image.height()] == self.color_size {
            return Ok(());
        }
        Err(SequenceError::ImageSize {
            width: image.width(),
            height: image.height(),
            camera_width,
            camera_height,
        })
    }
}

impl std::fmt::Debug for StreamDecoders {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("StreamDecoders")
    }
}
