//! PNG. The header is read here, pixels are decoded by `image`.

use std::io::Cursor;

use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{ColorType, ExtendedColorType, ImageDecoder as _, ImageEncoder as _};

use super::require_plausible_size;
use crate::error::ImagingError;
use crate::image::{Image, Mask, Rgb8Image};

const FORMAT: &str = "png";
const SIGNATURE: [u8; 8] = [137, 80, 78, 71, 13, 10, 26, 10];

/// The fields of an IHDR chunk that matter here.
struct Header {
    width: u32,
    height: u32,
    bit_depth: u8,
    /// 0 grey, 2 RGB, 3 palette, 4 grey + alpha, 6 RGBA.
    color_type: u8,
}

impl Header {
    fn describe(&self) -> String {
        let kind = match self.color_type {
            0 => "grey",
            2 => "RGB",
            3 => "palette",
            4 => "grey with alpha",
            6 => "RGB with alpha",
            _ => "unknown",
        };
        format!("{kind}, {} bits", self.bit_depth)
    }

    fn wrong_type(&self, expected: &'static str) -> ImagingError {
        ImagingError::PixelType {
            format: FORMAT,
            got: self.describe(),
            expected,
        }
    }
}

/// Decodes 8-bit colour: RGB, palette (looked up) or grey (repeated). Alpha is dropped; 16-bit files are
/// refused, since narrowing would lose data.
pub fn decode_png_rgb8(bytes: &[u8]) -> Result<Rgb8Image, ImagingError> {
    let header = header_of(bytes)?;
    let (color_type, buffer) = decode(bytes, &header)?;
    let pixels = match color_type {
        ColorType::Rgb8 => buffer.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect(),
        ColorType::Rgba8 => buffer.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect(),
        ColorType::L8 => buffer.iter().map(|&grey| [grey; 3]).collect(),
        ColorType::La8 => buffer.chunks_exact(2).map(|p| [p[0]; 3]).collect(),
        _ => return Err(header.wrong_type("8 bits a channel")),
    };
    Image::from_vec(header.width, header.height, pixels)
}

/// Decodes 16-bit grey codes (depth). Files of fewer bits are refused: their codes would be scaled.
pub fn decode_png_gray16(bytes: &[u8]) -> Result<Image<u16>, ImagingError> {
    let header = header_of(bytes)?;
    let (color_type, buffer) = decode(bytes, &header)?;
    let sample_bytes = match color_type {
        ColorType::L16 => 2,
        ColorType::La16 => 4,
        _ => return Err(header.wrong_type("grey, 16 bits")),
    };
    // `image` gives 16-bit samples in the machine's own order.
    let codes = buffer
        .chunks_exact(sample_bytes)
        .map(|s| u16::from_ne_bytes([s[0], s[1]]))
        .collect();
    Image::from_vec(header.width, header.height, codes)
}

/// Decodes 8-bit grey; grey of 1, 2 or 4 bits is scaled to 0…255. A palette image gives the index of each
/// pixel, unscaled: what object and class images mean.
pub fn decode_png_gray8(bytes: &[u8]) -> Result<Image<u8>, ImagingError> {
    let header = header_of(bytes)?;
    if header.color_type == 3 {
        return palette_indices(bytes, &header);
    }
    let (color_type, buffer) = decode(bytes, &header)?;
    let codes = match color_type {
        ColorType::L8 => buffer,
        ColorType::La8 => buffer.chunks_exact(2).map(|s| s[0]).collect(),
        _ => return Err(header.wrong_type("grey of at most 8 bits or a palette")),
    };
    Image::from_vec(header.width, header.height, codes)
}

/// Decodes the samples of a sensor's mosaic: grey of exactly 8 bits. Everything else is refused, since scaled
/// codes or indices of a palette are no samples.
pub fn decode_png_mosaic8(bytes: &[u8]) -> Result<Image<u8>, ImagingError> {
    let header = header_of(bytes)?;
    if (header.color_type, header.bit_depth) != (0, 8) {
        return Err(header.wrong_type("grey, 8 bits"));
    }
    decode_png_gray8(bytes)
}

/// Decodes a mask: true where the grey code or the palette index is not 0.
pub fn decode_png_mask(bytes: &[u8]) -> Result<Mask, ImagingError> {
    Ok(decode_png_gray8(bytes)?.map(|code| code != 0))
}

/// Encodes 8-bit RGB. The same image gives the same bytes.
pub fn encode_png_rgb8(codes: &Rgb8Image) -> Result<Vec<u8>, ImagingError> {
    encode(
        codes.pixels().as_flattened(),
        codes.width(),
        codes.height(),
        ExtendedColorType::Rgb8,
    )
}

/// Encodes 16-bit grey.
pub fn encode_png_gray16(codes: &Image<u16>) -> Result<Vec<u8>, ImagingError> {
    let samples: Vec<u8> = codes
        .pixels()
        .iter()
        .flat_map(|code| code.to_ne_bytes())
        .collect();
    encode(
        &samples,
        codes.width(),
        codes.height(),
        ExtendedColorType::L16,
    )
}

/// Encodes a mask as 8-bit grey, 255 where true: the form [`decode_png_mask`] and other programs read.
pub fn encode_png_mask(mask: &Mask) -> Result<Vec<u8>, ImagingError> {
    let samples: Vec<u8> = mask
        .pixels()
        .iter()
        .map(|&marked| if marked { 255 } else { 0 })
        .collect();
    encode(&samples, mask.width(), mask.height(), ExtendedColorType::L8)
}

fn encode(
    samples: &[u8],
    width: u32,
    height: u32,
    kind: ExtendedColorType,
) -> Result<Vec<u8>, ImagingError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(samples, width, height, kind)
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

/// Reads IHDR, which is the first chunk of every PNG, and refuses sizes that the file cannot hold.
fn header_of(bytes: &[u8]) -> Result<Header, ImagingError> {
    if bytes.get(..8) != Some(&SIGNATURE) {
        return Err(damaged(0, "no PNG signature"));
    }
    let Some(
        &[
            b'I',
            b'H',
            b'D',
            b'R',
            w3,
            w2,
            w1,
            w0,
            h3,
            h2,
            h1,
            h0,
            bit_depth,
            color_type,
            ..,
        ],
    ) = bytes.get(12..29)
    else {
        return Err(damaged(8, "no header chunk"));
    };
    let width = u32::from_be_bytes([w3, w2, w1, w0]);
    let height = u32::from_be_bytes([h3, h2, h1, h0]);
    let channels = match color_type {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    // Pixels of less than a byte grow to one when decoded; eight of them may share a byte of deflated data.
    let bytes_per_pixel = if bit_depth < 8 {
        0
    } else {
        channels * u64::from(bit_depth / 8)
    };
    let budget = if bytes_per_pixel == 0 {
        bytes.len() as u64 * 8
    } else {
        bytes.len() as u64
    };
    require_plausible_size(
        FORMAT,
        u64::from(width),
        u64::from(height),
        bytes_per_pixel,
        budget,
    )
    .map_err(|_| ImagingError::TooLarge {
        format: FORMAT,
        width: u64::from(width),
        height: u64::from(height),
        file_bytes: bytes.len() as u64,
    })?;
    Ok(Header {
        width,
        height,
        bit_depth,
        color_type,
    })
}

fn decode(bytes: &[u8], header: &Header) -> Result<(ColorType, Vec<u8>), ImagingError> {
    let codec = |source| ImagingError::Codec {
        format: FORMAT,
        source,
    };
    let decoder = PngDecoder::new(Cursor::new(bytes)).map_err(codec)?;
    let color_type = decoder.color_type();
    let expected = u64::from(header.width)
        * u64::from(header.height)
        * u64::from(color_type.bytes_per_pixel());
    if decoder.total_bytes() != expected {
        return Err(damaged(
            8,
            "the header chunk is contradicted by another one",
        ));
    }
    let mut buffer = vec![0; expected as usize];
    decoder.read_image(&mut buffer).map_err(codec)?;
    Ok((color_type, buffer))
}

/// The indices of a palette image.
///
/// `image` looks colours up and drops the indices. The same pixel data under a header that says "grey" are
/// the indices, scaled to 0…255; only the palette chunks must go, which grey files may not have.
fn palette_indices(bytes: &[u8], header: &Header) -> Result<Image<u8>, ImagingError> {
    let mut grey = SIGNATURE.to_vec();
    let mut at = SIGNATURE.len();
    while let Some((kind, whole)) = chunk_at(bytes, at) {
        match &kind {
            b"IHDR" => {
                let mut chunk = whole[..whole.len() - 4].to_vec();
                if chunk.len() != 21 {
                    return Err(damaged(at, "the header chunk has a wrong length"));
                }
                chunk[17] = 0;
                let check = crc32(&chunk[4..]);
                grey.extend(chunk);
                grey.extend(check.to_be_bytes());
            }
            b"IDAT" | b"IEND" => grey.extend(whole),
            _ => {}
        }
        at += whole.len();
    }
    let grey_header = Header {
        color_type: 0,
        ..*header
    };
    let (color_type, mut codes) = decode(&grey, &grey_header)?;
    if color_type != ColorType::L8 || !matches!(header.bit_depth, 1 | 2 | 4 | 8) {
        return Err(header.wrong_type("a palette of 1, 2, 4 or 8 bits"));
    }
    let scale = (255_u16 / ((1 << header.bit_depth) - 1)) as u8;
    codes.iter_mut().for_each(|code| *code /= scale);
    Image::from_vec(header.width, header.height, codes)
}

/// Type and all bytes (length, type, data, check) of the chunk at `at`; `None` where the file ends.
fn chunk_at(bytes: &[u8], at: usize) -> Option<([u8; 4], &[u8])> {
    let &[l3, l2, l1, l0, a, b, c, d] = bytes.get(at..at + 8)? else {
        return None;
    };
    let length = u32::from_be_bytes([l3, l2, l1, l0]) as usize;
    Some((
        [a, b, c, d],
        bytes.get(at..at.checked_add(length)?.checked_add(12)?)?,
    ))
}

/// CRC-32 of PNG (ISO 3309), for the one header that is rewritten; 17 bytes need no table.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg())
        })
    })
}
