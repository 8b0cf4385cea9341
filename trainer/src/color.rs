//! Linear radiance to what a screen shows.

use imaging::srgb;

/// The sRGB code of a linear value, clipped to [0, 1].
pub fn srgb8_from_linear(linear: f32) -> u8 {
    let encoded = srgb::encode(linear.clamp(0.0, 1.0));
    (encoded * 255.0).round() as u8
}
