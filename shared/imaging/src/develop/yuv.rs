//! YUV to codes of red, green, blue in integers, with clamping (hard-cases B15).

use super::layout::{ChromaSiting, YuvCoding, YuvRange};
use crate::kernels::Level;
pub(super) use crate::kernels::yuv::PairOrder;
use crate::kernels::yuv::{CHROMA_BITS, Gains, LUMA_BITS, rgb, rgb_row, saturated_row};
use crate::radiance::SATURATION_CODE;

/// Luma and chroma codes to codes of red, green, blue. i32 throughout: the largest sum is below 2²⁷.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct YuvConverter {
    gains: Gains,
}

impl YuvConverter {
    /// Gains of a coding, rounded to 2⁻¹⁶ for luma and 2⁻¹⁴ for chroma: together below 0.01 code.
    pub fn new(coding: YuvCoding) -> Self {
        let (red, blue) = coding.matrix.red_blue();
        let green = 1.0 - red - blue;
        let (luma, chroma, black) = match coding.range {
            YuvRange::Full => (1.0, 1.0, 0),
            YuvRange::Limited => (255.0 / 219.0, 255.0 / 224.0, 16),
        };
        let (left, right) = match coding.siting {
            ChromaSiting::Left => ([0, 4, 0], [0, 2, 2]),
            ChromaSiting::Center => ([1, 3, 0], [0, 3, 1]),
        };
        // Gains are below 2.2, so the casts are exact after rounding.
        let gain = |value: f64, bits: u32| (value * f64::from(1 << bits)).round() as i32;
        Self {
            gains: Gains {
                luma: gain(luma, LUMA_BITS),
                black,
                red_of_v: gain(2.0 * chroma * (1.0 - red), CHROMA_BITS),
                green_of_u: gain(-2.0 * chroma * (1.0 - blue) * blue / green, CHROMA_BITS),
                green_of_v: gain(-2.0 * chroma * (1.0 - red) * red / green, CHROMA_BITS),
                blue_of_u: gain(2.0 * chroma * (1.0 - blue), CHROMA_BITS),
                left,
                right,
            },
        }
    }

    /// Codes of red, green, blue, rounded and clamped to [0, 255].
    #[inline]
    pub fn rgb(&self, y: u8, u: u8, v: u8) -> [u8; 3] {
        rgb(&self.gains, y, u, v)
    }

    /// A row of 4:2:2 samples as codes, two a pair.
    pub(super) fn rgb_row(
        &self,
        level: Level,
        order: PairOrder,
        samples: &[u8],
        codes: &mut [[u8; 3]],
    ) {
        rgb_row(level, &self.gains, order, samples.as_chunks().0, codes);
    }

    /// Which pixels of a row stand for a clipped colour: by their own luma and the chroma stored for them, before
    /// any interpolation, some channel reaches [`SATURATION_CODE`].
    pub(super) fn saturated_row(
        &self,
        level: Level,
        order: PairOrder,
        samples: &[u8],
        marks: &mut [bool],
    ) {
        let pairs = samples.as_chunks().0;
        saturated_row(level, &self.gains, order, SATURATION_CODE, pairs, marks);
    }
}
