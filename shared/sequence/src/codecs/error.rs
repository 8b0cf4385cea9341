//! What a codec refuses.

/// Why a frame cannot be encoded or decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// A size that no stream has.
    #[error("a frame of {width}x{height} pixels cannot be coded; sides are 1 to 16384{}", if *width % 2 == 1 { ", and even in width for YUV 4:2:2" } else { "" })]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Samples or room for samples that do not fit the stream.
    #[error("{got} samples were given for a frame of {expected}")]
    SampleCount {
        /// What the size of the stream asks for.
        expected: usize,
        /// What was given.
        got: usize,
    },
    /// Room for a payload that the frame may not fit.
    #[error("a payload may take {expected} bytes and there is room for {got}")]
    Room {
        /// The most that a payload takes.
        expected: usize,
        /// What was given.
        got: usize,
    },
    /// A first byte that names no codec.
    #[error("the payload is of codec {0}, which does not exist")]
    UnknownCodec(u8),
    /// The payload ends before its frame does.
    #[error("the payload ends before the frame is complete")]
    Cut,
    /// The payload goes on after its frame.
    #[error("the payload has bytes beyond the end of the frame")]
    Surplus,
    /// Something in the payload that no encoder writes.
    #[error("the payload is damaged: {0}")]
    Damaged(&'static str),
    /// The payload refers to another table of codes.
    #[error("the payload needs table {expected} of codes, given was {got:?}")]
    Table {
        /// The table that the payload names.
        expected: u16,
        /// The table that was given.
        got: Option<u16>,
    },
    /// A table of codes that cannot be one.
    #[error("this is no table of codes: {0}")]
    NoTable(&'static str),
    /// The compressor failed, which it does only without memory.
    #[error("zstd cannot compress the frame")]
    Compressor,
}

/// Longest side of a frame, pixels: bounds what a stream's size can make us allocate (1 GiB of samples).
pub(super) const MAX_SIDE: u32 = 16_384;

/// Pixels of a frame, if its sides are within 1 to [`MAX_SIDE`].
pub(super) fn pixel_count(width: u32, height: u32) -> Result<usize, CodecError> {
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) {
        Ok(width as usize * height as usize)
    } else {
        Err(CodecError::Size { width, height })
    }
}
