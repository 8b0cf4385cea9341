//! How the bytes of a raw colour frame lie and what they mean.

use crate::error::ImagingError;

/// Layout of a raw colour frame, rows without padding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColorLayout {
    /// Three bytes a pixel: red, green, blue.
    Rgb8,
    /// One byte a pixel: even rows green, red, …, odd rows blue, green, …
    BayerGrbg,
    /// Two pixels in four bytes: U Y V Y. Even widths.
    Uyvy(YuvCoding),
    /// Two pixels in four bytes: Y U Y V. Even widths.
    Yuyv(YuvCoding),
}

/// What luma and chroma mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct YuvCoding {
    /// From red, green, blue to luma.
    pub matrix: YuvMatrix,
    /// Which codes are black and white.
    pub range: YuvRange,
    /// Where in a pair of pixels chroma was sampled.
    pub siting: ChromaSiting,
}

/// Shares of red and blue in luma.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum YuvMatrix {
    /// Rec. 601: 0.299 and 0.114. What webcams and the PrimeSense firmware use.
    #[default]
    Bt601,
    /// Rec. 709: 0.2126 and 0.0722.
    Bt709,
}

/// Codes of black and white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum YuvRange {
    /// Luma 16 to 235, chroma 16 to 240: the rule of both standards.
    #[default]
    Limited,
    /// 0 to 255, as in JPEG.
    Full,
}

/// Where chroma was sampled along a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ChromaSiting {
    /// At the left pixel of a pair.
    #[default]
    Left,
    /// Halfway between both.
    Center,
}

impl YuvMatrix {
    /// Shares of red and blue in luma.
    pub(crate) fn red_blue(self) -> (f64, f64) {
        match self {
            Self::Bt601 => (0.299, 0.114),
            Self::Bt709 => (0.2126, 0.0722),
        }
    }
}

impl ColorLayout {
    /// Bytes of a frame of `width` x `height` pixels.
    pub fn frame_bytes(self, width: u32, height: u32) -> u64 {
        let bytes_a_pixel = match self {
            Self::Rgb8 => 3,
            Self::BayerGrbg => 1,
            Self::Uyvy(_) | Self::Yuyv(_) => 2,
        };
        bytes_a_pixel * u64::from(width) * u64::from(height)
    }

    /// Refuses a frame of another length, and odd widths where two pixels share their chroma.
    pub(crate) fn check(self, frame: &[u8], width: u32, height: u32) -> Result<(), ImagingError> {
        self.check_size(width, height)?;
        let expected = self.frame_bytes(width, height);
        if frame.len() as u64 == expected {
            return Ok(());
        }
        Err(ImagingError::FrameBytes {
            width,
            height,
            expected,
            got: frame.len() as u64,
        })
    }

    pub(crate) fn check_size(self, width: u32, height: u32) -> Result<(), ImagingError> {
        let is_paired = matches!(self, Self::Uyvy(_) | Self::Yuyv(_));
        if width == 0 || height == 0 || (is_paired && width % 2 == 1) {
            return Err(ImagingError::FrameSize { width, height });
        }
        Ok(())
    }
}
