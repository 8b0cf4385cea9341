//! YUV to codes of red, green, blue in integers, with clamping (hard-cases B15).

use super::layout::{ChromaSiting, YuvCoding, YuvRange};
use crate::radiance::SATURATION_CODE;

/// Fraction bits of the gain of luma.
const LUMA_BITS: u32 = 16;
/// Chroma is interpolated to quarters of a code, so its gains have two bits less.
const CHROMA_BITS: u32 = LUMA_BITS - 2;
/// One half in the sum.
const HALF: i32 = 1 << (LUMA_BITS - 1);

/// Luma and chroma codes to codes of red, green, blue. i32 throughout: the largest sum is below 2²⁷.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct YuvConverter {
    coding: YuvCoding,
    luma_gain: i32,
    black: i32,
    red_of_v: i32,
    green_of_u: i32,
    green_of_v: i32,
    blue_of_u: i32,
}

/// Chroma of a pixel, quarters of a code about its zero.
#[derive(Clone, Copy)]
struct Chroma {
    u: i32,
    v: i32,
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
        // Gains are below 2.2, so the casts are exact after rounding.
        let gain = |value: f64, bits: u32| (value * f64::from(1 << bits)).round() as i32;
        Self {
            coding,
            luma_gain: gain(luma, LUMA_BITS),
            black,
            red_of_v: gain(2.0 * chroma * (1.0 - red), CHROMA_BITS),
            green_of_u: gain(-2.0 * chroma * (1.0 - blue) * blue / green, CHROMA_BITS),
            green_of_v: gain(-2.0 * chroma * (1.0 - red) * red / green, CHROMA_BITS),
            blue_of_u: gain(2.0 * chroma * (1.0 - blue), CHROMA_BITS),
        }
    }

    /// Codes of red, green, blue, rounded and clamped to [0, 255].
    #[inline]
    pub fn rgb(&self, y: u8, u: u8, v: u8) -> [u8; 3] {
        let [u, v] = [u, v].map(|sample| 4 * (i32::from(sample) - 128));
        self.rgb_of(y, Chroma { u, v })
    }

    #[inline(always)]
    fn luma(&self, y: u8) -> i32 {
        self.luma_gain * (i32::from(y) - self.black) + HALF
    }

    #[inline(always)]
    fn parts(&self, chroma: Chroma) -> [i32; 3] {
        let Chroma { u, v } = chroma;
        [
            self.red_of_v * v,
            self.green_of_u * u + self.green_of_v * v,
            self.blue_of_u * u,
        ]
    }

    #[inline(always)]
    fn rgb_of(&self, y: u8, chroma: Chroma) -> [u8; 3] {
        let luma = self.luma(y);
        self.parts(chroma)
            .map(|part| ((luma + part) >> LUMA_BITS).clamp(0, 255) as u8)
    }

    /// A row of 4:2:2 samples as codes; `samples` holds pairs of pixels, chroma at `u_at` and `v_at`, luma at
    /// `y_at` and two further.
    pub(super) fn rgb_row(&self, order: PairOrder, samples: &[[u8; 4]], codes: &mut [[u8; 3]]) {
        let pairs = codes.as_chunks_mut::<2>().0;
        let Some(&first) = samples.first() else {
            return;
        };
        let mut before = order.chroma(first);
        let mut own = before;
        for (x, (pair, &sample)) in pairs.iter_mut().zip(samples).enumerate() {
            let after = samples.get(x + 1).map_or(own, |&next| order.chroma(next));
            let [left, right] = self.at_both(before, own, after);
            let [y_left, y_right] = order.luma(sample);
            *pair = [self.rgb_of(y_left, left), self.rgb_of(y_right, right)];
            (before, own) = (own, after);
        }
    }

    /// Chroma at both pixels of a pair, from the samples of the pairs before, at and after it.
    #[inline(always)]
    fn at_both(&self, before: Chroma, own: Chroma, after: Chroma) -> [Chroma; 2] {
        let mix = |a: Chroma, a_share: i32, b: Chroma, b_share: i32| Chroma {
            u: a_share * a.u + b_share * b.u,
            v: a_share * a.v + b_share * b.v,
        };
        match self.coding.siting {
            ChromaSiting::Left => [mix(own, 4, own, 0), mix(own, 2, after, 2)],
            ChromaSiting::Center => [mix(own, 3, before, 1), mix(own, 3, after, 1)],
        }
    }

    /// Which pixels of a row stand for a clipped colour: by their own luma and the chroma stored for them, before
    /// any interpolation, some channel reaches [`SATURATION_CODE`].
    pub(super) fn saturated_row(&self, order: PairOrder, samples: &[[u8; 4]], marks: &mut [bool]) {
        let limit = i32::from(SATURATION_CODE) << LUMA_BITS;
        for (marks, &sample) in marks.as_chunks_mut::<2>().0.iter_mut().zip(samples) {
            let Chroma { u, v } = order.chroma(sample);
            let [red, green, blue] = self.parts(Chroma { u: 4 * u, v: 4 * v });
            let largest = red.max(green).max(blue);
            *marks = order.luma(sample).map(|y| self.luma(y) + largest >= limit);
        }
    }
}

/// Order of the samples of a pair.
#[derive(Clone, Copy, Debug)]
pub(super) enum PairOrder {
    Uyvy,
    Yuyv,
}

impl PairOrder {
    #[inline(always)]
    fn luma(self, sample: [u8; 4]) -> [u8; 2] {
        match self {
            Self::Uyvy => [sample[1], sample[3]],
            Self::Yuyv => [sample[0], sample[2]],
        }
    }

    /// Chroma about its zero, whole codes.
    #[inline(always)]
    fn chroma(self, sample: [u8; 4]) -> Chroma {
        let [u, v] = match self {
            Self::Uyvy => [sample[0], sample[2]],
            Self::Yuyv => [sample[1], sample[3]],
        };
        Chroma {
            u: i32::from(u) - 128,
            v: i32::from(v) - 128,
        }
    }
}
