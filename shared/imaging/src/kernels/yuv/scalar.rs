//! The specification.

use super::{Gains, HALF, LUMA_BITS, PairOrder};

/// Chroma about its zero.
#[derive(Clone, Copy)]
struct Chroma {
    u: i32,
    v: i32,
}

impl PairOrder {
    #[inline(always)]
    fn luma(self, pair: [u8; 4]) -> [u8; 2] {
        match self {
            Self::Uyvy => [pair[1], pair[3]],
            Self::Yuyv => [pair[0], pair[2]],
        }
    }

    /// Chroma in whole codes.
    #[inline(always)]
    fn chroma(self, pair: [u8; 4]) -> Chroma {
        let (u, v) = match self {
            Self::Uyvy => (pair[0], pair[2]),
            Self::Yuyv => (pair[1], pair[3]),
        };
        Chroma {
            u: i32::from(u) - 128,
            v: i32::from(v) - 128,
        }
    }
}

impl Gains {
    #[inline(always)]
    fn of_luma(&self, y: u8) -> i32 {
        self.luma * (i32::from(y) - self.black) + HALF
    }

    /// What chroma, in quarters, adds to red, green, blue.
    #[inline(always)]
    fn of_chroma(&self, Chroma { u, v }: Chroma) -> [i32; 3] {
        [
            self.red_of_v * v,
            self.green_of_u * u + self.green_of_v * v,
            self.blue_of_u * u,
        ]
    }

    #[inline(always)]
    fn rgb(&self, y: u8, quarters: Chroma) -> [u8; 3] {
        let luma = self.of_luma(y);
        // The largest sum is below 2²⁷.
        self.of_chroma(quarters)
            .map(|part| ((luma + part) >> LUMA_BITS).clamp(0, 255) as u8)
    }
}

#[inline(always)]
fn mixed(shares: [i16; 3], chroma: [Chroma; 3]) -> Chroma {
    let sum = |part: fn(&Chroma) -> i32| {
        let products = shares.iter().zip(&chroma);
        products
            .map(|(&share, chroma)| i32::from(share) * part(chroma))
            .sum()
    };
    Chroma {
        u: sum(|chroma| chroma.u),
        v: sum(|chroma| chroma.v),
    }
}

/// See [`super::rgb`].
#[inline(always)]
pub(super) fn rgb(gains: &Gains, y: u8, u: u8, v: u8) -> [u8; 3] {
    let [u, v] = [u, v].map(|code| 4 * (i32::from(code) - 128));
    gains.rgb(y, Chroma { u, v })
}

/// See [`super::rgb_row`].
pub(super) fn rgb_row(gains: &Gains, order: PairOrder, pairs: &[[u8; 4]], codes: &mut [[u8; 3]]) {
    for (at, codes) in codes.as_chunks_mut::<2>().0.iter_mut().enumerate() {
        *codes = rgb_pair(gains, order, pairs, at);
    }
}

/// The codes of pair `at` of a row.
#[inline(always)]
pub(super) fn rgb_pair(
    gains: &Gains,
    order: PairOrder,
    pairs: &[[u8; 4]],
    at: usize,
) -> [[u8; 3]; 2] {
    let own = pairs[at];
    let before = if at == 0 { own } else { pairs[at - 1] };
    let after = pairs.get(at + 1).copied().unwrap_or(own);
    let chroma = [before, own, after].map(|pair| order.chroma(pair));
    let [left, right] = order.luma(own);
    [
        gains.rgb(left, mixed(gains.left, chroma)),
        gains.rgb(right, mixed(gains.right, chroma)),
    ]
}

/// See [`super::saturated_row`]; `limit` is in fixed point.
pub(super) fn saturated_row(
    gains: &Gains,
    order: PairOrder,
    limit: i32,
    pairs: &[[u8; 4]],
    marks: &mut [bool],
) {
    for (marks, &pair) in marks.as_chunks_mut::<2>().0.iter_mut().zip(pairs) {
        let Chroma { u, v } = order.chroma(pair);
        let [red, green, blue] = gains.of_chroma(Chroma { u: 4 * u, v: 4 * v });
        let largest = red.max(green).max(blue);
        *marks = order
            .luma(pair)
            .map(|y| gains.of_luma(y) + largest >= limit);
    }
}
