//! The camera's side of samples.

use crate::damage::NoRoom;
use crate::samples::{SampleFormat, compressed, packed};

/// Encodes a frame of lines of `width` samples into `out`: how many bytes.
/// [`SampleFormat::max_bytes`] are always enough.
///
/// # Errors
/// [`NoRoom`] also for a code above [`SampleFormat::max_code`], for which the format has no room.
pub fn encode_samples(
    format: SampleFormat,
    codes: &[u16],
    width: usize,
    out: &mut [u8],
) -> Result<usize, NoRoom> {
    let byte_count = match format {
        SampleFormat::Compressed => compressed::encode(codes, width, out),
        SampleFormat::Raw16 => encode_raw(codes, out),
        SampleFormat::Packed10 => packed::pack_bits(10, codes, out),
        SampleFormat::Packed11 => packed::pack_bits(11, codes, out),
        SampleFormat::Packed12 => packed::pack_bits(12, codes, out),
    };
    byte_count.ok_or(NoRoom)
}

fn encode_raw(codes: &[u16], out: &mut [u8]) -> Option<usize> {
    let byte_count = codes.len().checked_mul(2)?;
    let places = out.get_mut(..byte_count)?.as_chunks_mut().0;
    for (place, code) in places.iter_mut().zip(codes) {
        *place = code.to_le_bytes();
    }
    Some(byte_count)
}
