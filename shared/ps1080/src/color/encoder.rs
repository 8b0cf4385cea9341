//! The camera's side of colour.

use crate::color::{ColorFormat, compressed};
use crate::damage::NoRoom;

/// Encodes a frame in lines of `line_bytes` into `out`: how many bytes. What is not compressed is copied, JPEG
/// streams too. [`ColorFormat::max_bytes`] are always enough.
///
/// # Errors
/// [`NoRoom`] when `out` is too small.
pub fn encode_color(
    format: ColorFormat,
    frame: &[u8],
    line_bytes: usize,
    out: &mut [u8],
) -> Result<usize, NoRoom> {
    match format {
        ColorFormat::CompressedBayer => {
            compressed::encode(compressed::Layout::Bayer, frame, line_bytes, out)
        }
        ColorFormat::CompressedYuv422 => {
            compressed::encode(compressed::Layout::Uyvy, frame, line_bytes, out)
        }
        _ => {
            let place = out.get_mut(..frame.len()).ok_or(NoRoom)?;
            place.copy_from_slice(frame);
            Ok(frame.len())
        }
    }
}
