//! Why a frame is no picture.

use core::fmt;

/// Why the payload of a frame is refused. What has been written of such a frame is not to be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Damage {
    /// The payload ended before the picture was full.
    Short {
        /// Samples (16-bit formats) or bytes (colour) that are missing.
        missing_count: usize,
    },
    /// There is more payload than picture.
    Excess,
    /// The payload ends within a token or a sample.
    Cut,
    /// Compressed depth does not begin with a full value: what its differences refer to is missing.
    NoFirstValue,
    /// A running value leaves its range (0 to 32 767 of depth, 0 to 255 of colour).
    OutOfRange,
    /// A line of compressed colour ends within a byte of which the rest is no filler.
    LineBorder,
    /// Not a JPEG stream, or its segments lead nowhere.
    NotJpeg,
    /// Padding announces more pixels than the picture has.
    Padding,
    /// The buffer is not of the picture's size: a mistake of the caller.
    BufferSize {
        /// Samples or bytes of the picture.
        expected_count: usize,
        /// Those of the buffer.
        got_count: usize,
    },
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short { missing_count } => write!(f, "{missing_count} samples are missing"),
            Self::Excess => f.write_str("more data than the picture holds"),
            Self::Cut => f.write_str("data end within a sample"),
            Self::NoFirstValue => f.write_str("compressed depth begins with a difference"),
            Self::OutOfRange => f.write_str("a difference leads out of range"),
            Self::LineBorder => f.write_str("a line ends within a byte"),
            Self::NotJpeg => f.write_str("not a JPEG stream"),
            Self::Padding => f.write_str("padding larger than the picture"),
            Self::BufferSize {
                expected_count,
                got_count,
            } => write!(f, "buffer of {got_count} for a picture of {expected_count}"),
        }
    }
}

impl core::error::Error for Damage {}

/// The buffer to encode into is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct NoRoom;

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the buffer is too small for the encoded data")
    }
}

impl core::error::Error for NoRoom {}
