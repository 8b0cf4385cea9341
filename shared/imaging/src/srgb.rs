//! The sRGB transfer function (IEC 61966-2-1).

use crate::image::{Image, LinearImage, Rgb8Image};

/// An sRGB-encoded pixel, 8 bits a channel. A type of its own, so that encoded and linear values do not mix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Srgb8(pub [u8; 3]);

impl Srgb8 {
    /// Encodes a linear colour; values outside [0, 1] are clipped, NaN becomes 0.
    pub fn from_linear(linear: [f32; 3]) -> Self {
        // A cast from float saturates and maps NaN to 0: exactly the clipping promised.
        Self(linear.map(|value| (encode(value.clamp(0.0, 1.0)) * 255.0).round() as u8))
    }

    /// The linear colour, each channel in [0, 1].
    pub fn to_linear(self) -> [f32; 3] {
        self.0.map(|code| decode(f32::from(code) / 255.0))
    }
}

/// Linear value to sRGB-encoded value; 0 ↦ 0 and 1 ↦ 1. Values outside [0, 1] are not clipped: negative ones
/// follow the linear part, those above 1 the power.
#[inline]
pub fn encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// sRGB-encoded value to linear value, the inverse of [`encode`].
#[inline]
pub fn decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// Encodes an image for a screen or an 8-bit file.
pub fn rgb8_from_linear(linear: &LinearImage) -> Rgb8Image {
    linear.map(|pixel| Srgb8::from_linear(pixel).0)
}

/// 8-bit codes as encoded values in [0, 1]: what [`crate::measures`] takes for views (hard-cases L13).
pub fn encoded_from_rgb8(codes: &Rgb8Image) -> Image<[f32; 3]> {
    codes.map(|pixel| pixel.map(|code| f32::from(code) / 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_survives_the_round_trip() {
        for code in 0..=255 {
            let pixel = Srgb8([code; 3]);
            assert_eq!(Srgb8::from_linear(pixel.to_linear()), pixel);
        }
    }

    #[test]
    fn known_values_of_the_standard() {
        // Middle grey: linear 0.5 is code 187.5 of 255, code 128 is linear 0.21586.
        assert!((encode(0.5) - 0.735_357).abs() < 1e-5);
        assert!((decode(128.0 / 255.0) - 0.215_861).abs() < 1e-5);
        assert!((encode(0.003_130_8) - 0.040_45).abs() < 1e-5);
        assert_eq!(Srgb8::from_linear([-1.0, 2.0, f32::NAN]).0, [0, 255, 0]);
    }
}
