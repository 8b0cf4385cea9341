//! One colour sample of the live path: linear radiance in 16-bit fixed point, so that development,
//! registration and fusion are integer arithmetic.

/// Code of radiance 1.0, the white level; a step is 6.1e-5, below half an 8-bit code everywhere.
pub const RADIANCE_ONE: u16 = 16_384;

/// Linear radiance of one pixel: `[red, green, blue, flags]`.
///
/// Channels are in units of 1 / [`RADIANCE_ONE`], 0 to 65535 (radiance 4): what vignetting lifts above white
/// fits, what lies beyond stays at the end. Flags: [`LinearPixel::VALID`] and [`LinearPixel::SATURATED`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct LinearPixel(pub [u16; 4]);

impl LinearPixel {
    /// Flag: the pixel holds a sample. Without it the channels mean nothing.
    pub const VALID: u16 = 1;
    /// Flag: a channel reached the sensor's limit, so the channels are lower bounds.
    pub const SATURATED: u16 = 2;
    /// No sample.
    pub const INVALID: Self = Self([0; 4]);

    /// From linear radiance (1.0 = white level), rounded to the nearest step. Below 0 becomes 0, beyond
    /// radiance 4 the largest code; a channel that is not a number makes the pixel invalid.
    pub fn from_radiance(radiance: [f32; 3], is_saturated: bool) -> Self {
        if radiance.iter().any(|channel| channel.is_nan()) {
            return Self::INVALID;
        }
        // The cast saturates at both ends.
        let [red, green, blue] =
            radiance.map(|channel| (channel * f32::from(RADIANCE_ONE) + 0.5).floor() as u16);
        let saturated = if is_saturated { Self::SATURATED } else { 0 };
        Self([red, green, blue, Self::VALID | saturated])
    }

    /// Linear radiance, 1.0 = white level; exact.
    #[inline]
    pub fn radiance(self) -> [f32; 3] {
        let [red, green, blue, _] = self.0;
        [red, green, blue].map(|code| f32::from(code) / f32::from(RADIANCE_ONE))
    }

    /// Whether the pixel holds a sample.
    #[inline]
    pub fn is_valid(self) -> bool {
        self.0[3] & Self::VALID != 0
    }

    /// Whether the channels are lower bounds.
    #[inline]
    pub fn is_saturated(self) -> bool {
        self.0[3] & Self::SATURATED != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_survives_the_way_through_radiance() {
        for code in 0..=u16::MAX {
            let pixel = LinearPixel([code, u16::MAX - code, code / 3, LinearPixel::VALID]);
            assert_eq!(LinearPixel::from_radiance(pixel.radiance(), false), pixel);
        }
    }

    #[test]
    fn radiance_beyond_the_range_stays_at_its_ends() {
        let pixel = LinearPixel::from_radiance([-1.0, f32::INFINITY, 4.1], true);
        assert_eq!(pixel.0[..3], [0, u16::MAX, u16::MAX]);
        assert!(pixel.is_valid() && pixel.is_saturated());
        assert_eq!(
            LinearPixel::from_radiance([0.5, f32::NAN, 0.5], false),
            LinearPixel::INVALID
        );
        assert!(!LinearPixel::INVALID.is_valid());
    }
}
