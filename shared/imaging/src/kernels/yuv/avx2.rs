//! Four pairs at once: the same integers in vector lanes.
#![expect(
    unsafe_code,
    reason = "vector loads and stores through pointers, inside slices whose lengths the callers assert"
)]

use std::arch::x86_64::*;

use super::{Gains, HALF, LUMA_BITS, PairOrder, scalar};

/// See [`super::rgb_row`].
pub(super) fn rgb_row(gains: &Gains, order: PairOrder, pairs: &[[u8; 4]], codes: &mut [[u8; 3]]) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { rgb_row_avx2(gains, order, pairs, codes) }
}

/// See [`super::saturated_row`].
pub(super) fn saturated_row(
    gains: &Gains,
    order: PairOrder,
    limit: i32,
    pairs: &[[u8; 4]],
    marks: &mut [bool],
) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { saturated_row_avx2(gains, order, limit, pairs, marks) }
}

/// Where the samples of four pairs lie in their 16 bytes: luma of eight pixels, chroma twice for each pair.
struct Places {
    y: __m128i,
    u: __m128i,
    v: __m128i,
}

impl Places {
    #[inline]
    #[target_feature(enable = "avx2")]
    fn of(order: PairOrder) -> Self {
        let (y, u, v) = match order {
            PairOrder::Uyvy => (1, 0, 2),
            PairOrder::Yuyv => (0, 1, 3),
        };
        let eight =
            |bytes: [i8; 8]| _mm_set1_epi64x(i64::from_le_bytes(bytes.map(i8::cast_unsigned)));
        let twice = |at: i8| eight([0, 0, 4, 4, 8, 8, 12, 12].map(|pair| pair + at));
        Self {
            y: eight([0, 2, 4, 6, 8, 10, 12, 14].map(|pixel| pixel + y)),
            u: twice(u),
            v: twice(v),
        }
    }

    /// Luma of eight pixels.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn luma(&self, pairs: __m128i) -> __m256i {
        _mm256_cvtepu8_epi32(_mm_shuffle_epi8(pairs, self.y))
    }

    /// Chroma u and v about zero, whole codes.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn chroma(&self, pairs: __m128i) -> [__m128i; 2] {
        let zero = _mm_set1_epi16(128);
        let of = |places| _mm_sub_epi16(_mm_cvtepu8_epi16(_mm_shuffle_epi8(pairs, places)), zero);
        [of(self.u), of(self.v)]
    }
}

/// The gains in every lane.
struct WideGains {
    luma: __m256i,
    black: __m256i,
    red_of_v: __m256i,
    green_of_u: __m256i,
    green_of_v: __m256i,
    blue_of_u: __m256i,
    /// Shares of the pair before, the own one, the one after, for left and right pixels by turns.
    shares: [__m128i; 3],
}

impl WideGains {
    #[inline]
    #[target_feature(enable = "avx2")]
    fn of(gains: &Gains) -> Self {
        let wide = |gain: i32| _mm256_set1_epi32(gain);
        Self {
            luma: wide(gains.luma),
            black: wide(gains.black),
            red_of_v: wide(gains.red_of_v),
            green_of_u: wide(gains.green_of_u),
            green_of_v: wide(gains.green_of_v),
            blue_of_u: wide(gains.blue_of_u),
            shares: std::array::from_fn(|pair| {
                let (left, right) = (gains.left[pair], gains.right[pair]);
                _mm_setr_epi16(left, right, left, right, left, right, left, right)
            }),
        }
    }

    #[inline]
    #[target_feature(enable = "avx2")]
    fn of_luma(&self, y: __m256i) -> __m256i {
        let above = _mm256_mullo_epi32(self.luma, _mm256_sub_epi32(y, self.black));
        _mm256_add_epi32(above, _mm256_set1_epi32(HALF))
    }

    /// What chroma in quarters adds to red, green, blue.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn of_chroma(&self, [u, v]: [__m128i; 2]) -> [__m256i; 3] {
        let (u, v) = (_mm256_cvtepi16_epi32(u), _mm256_cvtepi16_epi32(v));
        [
            _mm256_mullo_epi32(self.red_of_v, v),
            _mm256_add_epi32(
                _mm256_mullo_epi32(self.green_of_u, u),
                _mm256_mullo_epi32(self.green_of_v, v),
            ),
            _mm256_mullo_epi32(self.blue_of_u, u),
        ]
    }

    /// Chroma at eight pixels, quarters of a code: at most 4 · 128, which 16 bits hold.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn mixed(&self, places: &Places, [before, own, after]: [__m128i; 3]) -> [__m128i; 2] {
        let [before, own, after] = [
            places.chroma(before),
            places.chroma(own),
            places.chroma(after),
        ];
        std::array::from_fn(|part| {
            _mm_add_epi16(
                _mm_add_epi16(
                    _mm_mullo_epi16(self.shares[0], before[part]),
                    _mm_mullo_epi16(self.shares[1], own[part]),
                ),
                _mm_mullo_epi16(self.shares[2], after[part]),
            )
        })
    }
}

#[target_feature(enable = "avx2")]
fn rgb_row_avx2(gains: &Gains, order: PairOrder, pairs: &[[u8; 4]], codes: &mut [[u8; 3]]) {
    let places = Places::of(order);
    let wide = WideGains::of(gains);
    // Pairs 1 to end − 1 have both neighbours.
    let mut at = 1;
    while at + 4 < pairs.len() {
        // SAFETY: pairs at − 1 to at + 4 are in the slice: 16 bytes from each of at − 1, at, at + 1.
        let near = unsafe {
            let own = pairs.as_ptr().add(at);
            [own.sub(1), own, own.add(1)].map(|pairs| _mm_loadu_si128(pairs.cast()))
        };
        let luma = wide.of_luma(places.luma(near[1]));
        let [red, green, blue] = wide
            .of_chroma(wide.mixed(&places, near))
            .map(|part| _mm256_srai_epi32::<{ LUMA_BITS as i32 }>(_mm256_add_epi32(luma, part)));
        // Both packings clamp; each half of the vector holds four pixels.
        let red_green = _mm256_packus_epi32(red, green);
        let bytes = _mm256_packus_epi16(red_green, _mm256_packus_epi32(blue, blue));
        let order = _mm256_broadcastsi128_si256(_mm_setr_epi8(
            0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11, -1, -1, -1, -1,
        ));
        let bytes = _mm256_shuffle_epi8(bytes, order);
        let second = _mm256_extracti128_si256::<1>(bytes);
        // SAFETY: eight codes from 2 · at on are 24 bytes of the slice, which holds two a pair: 16 bytes from 0,
        // 8 from 12 and 4 from 20.
        unsafe {
            let target = codes.as_mut_ptr().add(2 * at).cast::<u8>();
            _mm_storeu_si128(target.cast(), _mm256_castsi256_si128(bytes));
            _mm_storel_epi64(target.add(12).cast(), second);
            let last = _mm_extract_epi32::<2>(second);
            target.add(20).cast::<i32>().write_unaligned(last);
        }
        at += 4;
    }
    for (pair, codes) in codes.as_chunks_mut::<2>().0.iter_mut().enumerate() {
        if pair == 0 || pair >= at {
            *codes = scalar::rgb_pair(gains, order, pairs, pair);
        }
    }
}

#[target_feature(enable = "avx2")]
fn saturated_row_avx2(
    gains: &Gains,
    order: PairOrder,
    limit: i32,
    pairs: &[[u8; 4]],
    marks: &mut [bool],
) {
    let places = Places::of(order);
    let wide = WideGains::of(gains);
    let (fours, rest) = pairs.as_chunks::<4>();
    let (eights, rest_marks) = marks.as_chunks_mut::<8>();
    for (pairs, marks) in fours.iter().zip(eights) {
        // SAFETY: four pairs are 16 bytes.
        let own = unsafe { _mm_loadu_si128(pairs.as_ptr().cast()) };
        let quarters = places.chroma(own).map(|chroma| _mm_slli_epi16::<2>(chroma));
        let [red, green, blue] = wide.of_chroma(quarters);
        let largest = _mm256_max_epi32(_mm256_max_epi32(red, green), blue);
        let sum = _mm256_add_epi32(wide.of_luma(places.luma(own)), largest);
        let is_clipped = _mm256_cmpgt_epi32(sum, _mm256_set1_epi32(limit - 1));
        let bits = _mm256_movemask_ps(_mm256_castsi256_ps(is_clipped));
        *marks = std::array::from_fn(|pixel| bits & (1 << pixel) != 0);
    }
    scalar::saturated_row(gains, order, limit, rest, rest_marks);
}
