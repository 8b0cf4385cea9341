//! zstd around bytes whose length the reader knows a bound of.

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::find_frame_compressed_size;

use super::CodecError;

/// Level of zstd in every codec, unless an encoder is told otherwise: measured best in size among the fast ones. Depth of real frames takes 10.72 %
/// of raw at level -1 (literals stay as they are), 9.10 % at 1, 9.33 % at 3; Bayer 7.53, 4.88, 4.95 bit a
/// pixel, at four times the time for level 3.
pub(super) const LEVEL: i32 = 1;

/// A compressor that keeps its memory.
pub(super) struct Packer(Compressor<'static>);

impl Packer {
    pub(super) fn new() -> Result<Self, CodecError> {
        Compressor::new(LEVEL)
            .map(Self)
            .map_err(|_| CodecError::Compressor)
    }

    /// Another level, for measurements.
    pub(super) fn set_level(&mut self, level: i32) -> Result<(), CodecError> {
        self.0
            .set_compression_level(level)
            .map_err(|_| CodecError::Compressor)
    }

    /// Writes one zstd frame to the start of `out` and returns its length, or `None` when it does not fit.
    pub(super) fn pack(&mut self, bytes: &[u8], out: &mut [u8]) -> Option<usize> {
        self.0.compress_to_buffer(bytes, out).ok()
    }
}

/// A decompressor that keeps its memory.
///
/// It decodes in one call into the caller's slice: the window is the output, so that neither the declared
/// content size nor the declared window is ever allocated, and a bomb ends where the slice does.
pub(super) struct Unpacker(Decompressor<'static>);

impl Unpacker {
    pub(super) fn new() -> Result<Self, CodecError> {
        Decompressor::new()
            .map(Self)
            .map_err(|_| CodecError::Compressor)
    }

    /// Decompresses one frame, which is all of `packed`, into the start of `out`; returns how many bytes
    /// there are.
    pub(super) fn unpack(&mut self, packed: &[u8], out: &mut [u8]) -> Result<usize, CodecError> {
        // zstd itself would take several frames one after the other.
        match find_frame_compressed_size(packed) {
            Ok(length) if length == packed.len() => {}
            Ok(_) => return Err(CodecError::Surplus),
            Err(_) => return Err(CodecError::Damaged("its zstd frame has no end")),
        }
        self.0.decompress_to_buffer(packed, out).map_err(|_| {
            CodecError::Damaged("its zstd frame does not decode to the size of a frame")
        })
    }
}
