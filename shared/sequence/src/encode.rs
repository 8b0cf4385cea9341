//! Images into payloads, for the two streams of a recording.

use crate::cameras::{ColorEncoding, DepthSamples, Streams};
use crate::codecs::{CodeTable, ColorEncoder, DepthCodec, DepthEncoder};
use crate::error::SequenceError;

/// Encodes the depth stream of one recording.
pub struct DepthStreamEncoder {
    encoder: DepthEncoder,
    codec: DepthCodec,
    payload: Vec<u8>,
}

impl DepthStreamEncoder {
    /// An encoder for the depth of `streams`.
    pub fn new(streams: &Streams, codec: DepthCodec) -> Result<Self, SequenceError> {
        let camera = &streams.depth.intrinsics;
        let (width, height) = (camera.width(), camera.height());
        let encoder = match streams.depth.samples {
            DepthSamples::Codes => DepthEncoder::of_codes(width, height),
            DepthSamples::Values => DepthEncoder::of_values(width, height, None),
        }?;
        let payload = vec![0; encoder.max_payload_bytes()];
        Ok(Self {
            encoder,
            codec,
            payload,
        })
    }

    /// Chooses how much work goes into the next frames.
    pub fn set_codec(&mut self, codec: DepthCodec) {
        self.codec = codec;
    }

    /// Most bytes that a payload can have.
    pub fn max_payload_bytes(&self) -> usize {
        self.payload.len()
    }

    /// The payload of a frame, and the table that must be stored before it when it is the first to need it.
    /// `samples` are rows from the top.
    pub fn encode(
        &mut self,
        samples: &[u16],
    ) -> Result<(&[u8], Option<&CodeTable>), SequenceError> {
        let encoded = self
            .encoder
            .encode(samples, self.codec, &mut self.payload)?;
        let table = if encoded.has_new_table {
            self.encoder.table()
        } else {
            None
        };
        Ok((&self.payload[..encoded.byte_count], table))
    }
}

/// Encodes the colour stream of one recording.
pub struct ColorStreamEncoder {
    /// `None` where the payload is the image as it came.
    encoder: Option<ColorEncoder>,
    payload: Vec<u8>,
}

impl ColorStreamEncoder {
    /// An encoder for the colour of `streams`.
    pub fn new(streams: &Streams) -> Result<Self, SequenceError> {
        let camera = &streams.color.intrinsics;
        let encoding: ColorEncoding = streams.color.encoding;
        let encoder = match encoding.lossless() {
            Some(format) => Some(ColorEncoder::new(format, camera.width(), camera.height())?),
            None => None,
        };
        let room = encoder.as_ref().map_or(0, ColorEncoder::max_payload_bytes);
        Ok(Self {
            encoder,
            payload: vec![0; room],
        })
    }

    /// Most bytes that an encoded payload can have; 0 where the payload is the image as it came.
    pub fn max_payload_bytes(&self) -> usize {
        self.payload.len()
    }

    /// The payload of a frame: a raw frame in the stream's format ([`crate::codecs::ColorFormat`]), or the
    /// bytes of a JPEG, which are the payload.
    pub fn encode<'a>(&'a mut self, frame: &'a [u8]) -> Result<&'a [u8], SequenceError> {
        match &mut self.encoder {
            None => Ok(frame),
            Some(encoder) => {
                let count = encoder.encode(frame, &mut self.payload)?;
                Ok(&self.payload[..count])
            }
        }
    }
}
