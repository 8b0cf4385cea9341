//! JPEG (ITU-T T.81). Markers are walked here, pixels are decoded by `image`.

use std::io::Cursor;

use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{ColorType, ExtendedColorType, ImageDecoder as _};

use super::require_plausible_size;
use crate::error::ImagingError;
use crate::image::{Image, Rgb8Image};

const FORMAT: &str = "jpeg";

/// What the start-of-frame marker and the walk to the end of the image tell.
struct Layout {
    width: u32,
    height: u32,
    /// Horizontal and vertical sampling factors of each component.
    sampling: Vec<(u8, u8)>,
    is_complete: bool,
}

/// Decodes a JPEG to codes as its file means them (YCbCr converted to RGB, grey repeated, no transfer curve
/// applied). A file without its end-of-image marker is refused: what is missing would come out as grey.
pub fn decode_jpeg(bytes: &[u8]) -> Result<Rgb8Image, ImagingError> {
    let layout = layout_of(bytes)?;
    if !layout.is_complete {
        return Err(damaged(
            bytes.len(),
            "the file ends before its end-of-image marker",
        ));
    }
    let (width, height) = (layout.width, layout.height);
    require_plausible_size(
        FORMAT,
        u64::from(width),
        u64::from(height),
        3,
        bytes.len() as u64,
    )?;
    let codec = |source| ImagingError::Codec {
        format: FORMAT,
        source,
    };
    let decoder = JpegDecoder::new(Cursor::new(bytes)).map_err(codec)?;
    if decoder.dimensions() != (width, height) {
        return Err(damaged(
            0,
            "the frame header is contradicted by another one",
        ));
    }
    let color_type = decoder.color_type();
    let mut buffer =
        vec![0; width as usize * height as usize * usize::from(color_type.bytes_per_pixel())];
    if decoder.total_bytes() != buffer.len() as u64 {
        return Err(damaged(
            0,
            "the frame header is contradicted by another one",
        ));
    }
    decoder.read_image(&mut buffer).map_err(codec)?;
    let pixels = match color_type {
        ColorType::Rgb8 => buffer.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
        ColorType::L8 => buffer.iter().map(|&grey| [grey; 3]).collect(),
        other => {
            return Err(ImagingError::PixelType {
                format: FORMAT,
                got: format!("{other:?}"),
                expected: "RGB or grey, 8 bits",
            });
        }
    };
    Image::from_vec(width, height, pixels)
}

/// Whether chroma is stored at a lower resolution than luma (4:2:0, 4:2:2, …), from the sampling factors of
/// the frame header. Grey images are not.
pub fn jpeg_is_subsampled(bytes: &[u8]) -> Result<bool, ImagingError> {
    let sampling = layout_of(bytes)?.sampling;
    Ok(sampling.iter().any(|factors| *factors != sampling[0]))
}

/// Encodes with `quality` 1 to 100. Chroma is stored at full resolution (4:4:4).
pub fn encode_jpeg(codes: &Rgb8Image, quality: u8) -> Result<Vec<u8>, ImagingError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100))
        .encode(
            codes.pixels().as_flattened(),
            codes.width(),
            codes.height(),
            ExtendedColorType::Rgb8,
        )
        .map_err(|source| ImagingError::Codec {
            format: FORMAT,
            source,
        })?;
    Ok(bytes)
}

fn damaged(offset: usize, reason: &'static str) -> ImagingError {
    ImagingError::Damaged {
        format: FORMAT,
        offset: offset as u64,
        reason,
    }
}

/// Walks the markers from start of image to end of image (T.81 annex B).
fn layout_of(bytes: &[u8]) -> Result<Layout, ImagingError> {
    if bytes.get(..2) != Some(&[0xFF, 0xD8]) {
        return Err(damaged(0, "no start-of-image marker"));
    }
    let mut frame: Option<Layout> = None;
    let mut at = 2;
    while let Some(marker_at) = next_marker(bytes, at) {
        let marker = bytes[marker_at + 1];
        at = marker_at + 2;
        match marker {
            0xD9 => {
                if let Some(frame) = &mut frame {
                    frame.is_complete = true;
                }
                break;
            }
            // Restart, start-of-image and temporary markers have no segment.
            0x01 | 0xD0..=0xD8 => continue,
            _ => {}
        }
        let Some(segment) = segment_at(bytes, at) else {
            break;
        };
        // Start of frame: C0 to CF without the tables DHT (C4), JPG (C8) and DAC (CC).
        if matches!(marker, 0xC0..=0xCF) && !matches!(marker, 0xC4 | 0xC8 | 0xCC) && frame.is_none()
        {
            frame = Some(frame_header(segment, at)?);
        }
        at += 2 + segment.len();
    }
    frame.ok_or(damaged(at.min(bytes.len()), "no frame header"))
}

/// Offset of the next FF that begins a marker: stuffed FF 00 is data, repeated FF is filling.
fn next_marker(bytes: &[u8], from: usize) -> Option<usize> {
    let rest = bytes.get(from..)?;
    rest.windows(2)
        .position(|pair| pair[0] == 0xFF && !matches!(pair[1], 0x00 | 0xFF))
        .map(|at| from + at)
}

/// The payload of the segment whose length field is at `at`.
fn segment_at(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let length = u16::from_be_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]);
    bytes.get(at + 2..at + usize::from(length.checked_sub(2)?) + 2)
}

fn frame_header(segment: &[u8], at: usize) -> Result<Layout, ImagingError> {
    let &[_precision, h1, h0, w1, w0, count, ref components @ ..] = segment else {
        return Err(damaged(at, "the frame header is cut"));
    };
    if count == 0 || components.len() < 3 * usize::from(count) {
        return Err(damaged(at, "the frame header is cut"));
    }
    let sampling = components
        .chunks_exact(3)
        .take(usize::from(count))
        .map(|c| (c[1] >> 4, c[1] & 15))
        .collect();
    Ok(Layout {
        width: u32::from(u16::from_be_bytes([w1, w0])),
        height: u32::from(u16::from_be_bytes([h1, h0])),
        sampling,
        is_complete: false,
    })
}
