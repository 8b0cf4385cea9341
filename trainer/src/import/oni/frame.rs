//! The samples of a frame.

use imaging::decode_jpeg;

use super::OniDamage;
use super::codec::{decode_8z, decode_16z, decode_16z_with_table};
use super::container::{OniCodec, OniFrame, OniNode, ReadAt};
use super::properties::{OniPixels, OniShape};

/// A frame as the recording keeps it.
#[derive(Clone, Debug, PartialEq)]
pub enum OniSamples {
    /// 16-bit samples: depth, shifts, infrared.
    Words(Vec<u16>),
    /// 8-bit samples in the order of [`OniPixels`].
    Bytes(Vec<u8>),
    /// A JPEG file that decodes to the size of the frame.
    Jpeg(Vec<u8>),
}

/// Reads and decodes a frame. Of a JPEG, whatever follows its end is cut off.
///
/// # Errors
/// When the bytes are not a frame of the size and samples that the node's properties announce.
pub fn read_frame(
    source: &impl ReadAt,
    node: &OniNode,
    frame: &OniFrame,
) -> Result<OniSamples, OniDamage> {
    let shape = frame.shape.ok_or(OniDamage::NoShape)?;
    // Within the file: whoever made the frame has seen to that.
    let mut payload = vec![0; (frame.payload.end - frame.payload.start) as usize];
    source
        .read_at(&mut payload, frame.payload.start)
        .map_err(|error| OniDamage::io(&error))?;
    decode_frame(node.codec, shape, payload)
}

/// Decodes a frame from its bytes.
///
/// # Errors
/// As [`read_frame`].
pub fn decode_frame(
    codec: OniCodec,
    shape: OniShape,
    payload: Vec<u8>,
) -> Result<OniSamples, OniDamage> {
    let area = shape.area();
    let is_wide = shape.pixels.is_depth() || shape.pixels == OniPixels::Gray16;
    match codec {
        OniCodec::Raw => {
            let expected = area * shape.pixels.byte_count();
            if payload.len() != expected {
                return Err(OniDamage::RawSize {
                    bytes: payload.len(),
                    expected,
                });
            }
            if !is_wide {
                return Ok(OniSamples::Bytes(payload));
            }
            let words = payload.as_chunks::<2>().0;
            let words = words.iter().map(|&bytes| u16::from_le_bytes(bytes));
            Ok(OniSamples::Words(words.collect()))
        }
        OniCodec::Jpeg if matches!(shape.pixels, OniPixels::Rgb8 | OniPixels::Gray8) => {
            let image =
                decode_jpeg(&payload).map_err(|error| OniDamage::Jpeg(error.to_string()))?;
            if (image.width(), image.height()) != (shape.width, shape.height) {
                return Err(OniDamage::Jpeg(format!(
                    "it has {} x {} pixels instead of {} x {}",
                    image.width(),
                    image.height(),
                    shape.width,
                    shape.height
                )));
            }
            Ok(OniSamples::Jpeg(payload))
        }
        OniCodec::Z16 | OniCodec::Z16Table if is_wide => {
            // A token makes at most 30 pixels: a size that was made up costs nothing.
            if area > 30 * payload.len() {
                return Err(OniDamage::TooShort);
            }
            let mut words = vec![0; area];
            if codec == OniCodec::Z16 {
                decode_16z(&payload, &mut words)?;
            } else {
                decode_16z_with_table(&payload, &mut words)?;
            }
            Ok(OniSamples::Words(words))
        }
        OniCodec::Z8 if !is_wide => {
            let expected = area * shape.pixels.byte_count();
            if expected > 30 * payload.len() {
                return Err(OniDamage::TooShort);
            }
            let mut bytes = vec![0; expected];
            decode_8z(&payload, &mut bytes)?;
            Ok(OniSamples::Bytes(bytes))
        }
        _ => Err(OniDamage::Codec),
    }
}
