//! Colour on the wire (protocol sections 7.5 to 7.8): streaming decoder, encoder.
//!
//! Decoded are the bytes that a recording keeps: U Y V Y or Y U Y V for two pixels, a mosaic byte for each pixel, or a
//! JPEG stream.

mod compressed;
mod decoder;
mod encoder;
mod jpeg;
mod openni2;

pub use decoder::ColorDecoder;
pub use encoder::encode_color;
pub use jpeg::JpegFramer;
pub use openni2::{openni2_rgb, openni2_rgb_pair};

/// Format of the colour stream. The numbers are values of the parameter "image format".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum ColorFormat {
    /// A mosaic in differences, 8 bits a pixel.
    CompressedBayer = 0,
    /// U Y V Y in differences.
    CompressedYuv422 = 1,
    /// JPEG.
    Jpeg = 2,
    /// JPEG with chroma at half the height as well.
    Jpeg420 = 3,
    /// JPEG in grey.
    JpegMono = 4,
    /// U Y V Y for two pixels.
    Uyvy = 5,
    /// A mosaic of 8 bits: G R in even rows, B G in odd ones.
    Bayer = 6,
    /// Y U Y V for two pixels.
    Yuyv = 7,
}

impl ColorFormat {
    /// All, by their numbers.
    pub const ALL: [Self; 8] = [
        Self::CompressedBayer,
        Self::CompressedYuv422,
        Self::Jpeg,
        Self::Jpeg420,
        Self::JpegMono,
        Self::Uyvy,
        Self::Bayer,
        Self::Yuyv,
    ];

    /// The format of a parameter's value.
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The parameter's value.
    pub fn code(self) -> u16 {
        self as u16
    }

    /// Whether frames are JPEG streams, whose size varies.
    pub fn is_jpeg(self) -> bool {
        matches!(self, Self::Jpeg | Self::Jpeg420 | Self::JpegMono)
    }

    /// Bytes of a decoded line of `width` pixels; `None` for JPEG, and for an odd width: pixels come in pairs.
    pub fn line_bytes(self, width: u16) -> Option<usize> {
        let width = usize::from(width);
        if !width.is_multiple_of(2) {
            return None;
        }
        match self {
            Self::CompressedBayer | Self::Bayer => Some(width),
            Self::CompressedYuv422 | Self::Uyvy | Self::Yuyv => Some(2 * width),
            Self::Jpeg | Self::Jpeg420 | Self::JpegMono => None,
        }
    }

    /// Most bytes on the wire of `decoded_bytes`, in lines of `line_bytes`.
    pub fn max_bytes(self, decoded_bytes: usize, line_bytes: usize) -> usize {
        match self {
            Self::CompressedBayer | Self::CompressedYuv422 => {
                // Each a full value of three nibbles, a filler a line.
                let line_count = decoded_bytes.div_ceil(line_bytes.max(1));
                (decoded_bytes.saturating_mul(3) + line_count).div_ceil(2)
            }
            _ => decoded_bytes,
        }
    }
}
