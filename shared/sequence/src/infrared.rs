//! Infrared pictures, which take the place of colour where a depth camera shows what its own sensor sees
//! (`docs/sequence-format.md` section 6.1, format `infrared10`).

use imaging::{Image, ImagingError, Rgb8Image};

/// The greatest brightness: 10 bits.
pub const MAX_INFRARED: u16 = 1023;
/// From 10 bits to 8.
const DROPPED_BITS: u32 = 2;

/// Brightness of each pixel of a raw `frame`, rows from the top: 0 to [`MAX_INFRARED`] in frames of glint, any 16 bits in
/// those of others.
///
/// # Errors
/// [`ImagingError`] unless the frame has two bytes for each of `width` x `height` pixels.
pub fn infrared_samples(frame: &[u8], width: u32, height: u32) -> Result<Image<u16>, ImagingError> {
    let (pairs, rest) = frame.as_chunks();
    if !rest.is_empty() {
        return Err(ImagingError::FrameBytes {
            width,
            height,
            expected: 2 * u64::from(width) * u64::from(height),
            got: frame.len() as u64,
        });
    }
    let samples = pairs.iter().map(|pair| u16::from_le_bytes(*pair)).collect();
    Image::from_vec(width, height, samples)
}

/// The picture as grey of 8 bits in three equal channels, for what shows or writes colours: the upper 8 of 10 bits.
///
/// # Errors
/// As [`infrared_samples`].
pub fn infrared_grey(frame: &[u8], width: u32, height: u32) -> Result<Rgb8Image, ImagingError> {
    let samples = infrared_samples(frame, width, height)?;
    Ok(samples.map(|sample| {
        // At most 255.
        let grey = (sample.min(MAX_INFRARED) >> DROPPED_BITS) as u8;
        [grey; 3]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_is_the_upper_8_of_10_bits() {
        let frame: Vec<u8> = [0u16, 3, 4, 512, 1023, 5000]
            .into_iter()
            .flat_map(u16::to_le_bytes)
            .collect();
        let samples = infrared_samples(&frame, 3, 2).unwrap();
        assert_eq!(samples.pixels(), [0, 3, 4, 512, 1023, 5000]);
        let grey = infrared_grey(&frame, 3, 2).unwrap();
        assert_eq!(
            grey.pixels().to_vec(),
            [0u8, 0, 1, 128, 255, 255].map(|grey| [grey; 3])
        );
        assert!(infrared_samples(&frame, 2, 2).is_err());
        assert!(infrared_samples(&frame[1..], 3, 2).is_err());
    }
}
