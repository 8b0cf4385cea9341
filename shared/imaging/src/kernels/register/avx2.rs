//! Projection: the specification compiled for AVX2, whose loop the compiler widens. Cells: the indices of eight points
//! at once. Sampling: places and hiding of eight points at once, then the lanes of two neighbouring pixels at once.
#![expect(
    unsafe_code,
    reason = "calls into code compiled for AVX2; vector loads and stores inside checked indices"
)]

use std::arch::x86_64::*;

use super::scalar;
use super::{NearestCells, ProjectedRow, Projection, Seen};
use crate::linear_pixel::LinearPixel;

/// See [`super::project_row`].
pub(super) fn project_row(
    projection: &Projection,
    v: usize,
    depth: &[f32],
    projected: &mut ProjectedRow,
) {
    #[target_feature(enable = "avx2")]
    fn widened(projection: &Projection, v: usize, depth: &[f32], projected: &mut ProjectedRow) {
        scalar::project_row(projection, v, depth, projected);
    }
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { widened(projection, v, depth, projected) }
}

/// See [`NearestCells::enter`].
pub(super) fn enter_row(cells: &mut NearestCells, row: &ProjectedRow) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { enter_row_avx2(cells, row) }
}

/// See [`super::sample_row`].
pub(super) fn sample_row(seen: &Seen, row: &ProjectedRow, pixels: &mut [LinearPixel]) {
    // SAFETY: the caller chose this level, so AVX2 is there.
    unsafe { sample_row_avx2(seen, row, pixels) }
}

/// Eight neighbouring points of a row.
#[derive(Clone, Copy)]
struct Points {
    x: __m256,
    y: __m256,
    inverse_depth: __m256,
}

impl Points {
    #[inline]
    #[target_feature(enable = "avx2")]
    fn load(x: &[f32; 8], y: &[f32; 8], inverse_depth: &[f32; 8]) -> Self {
        // SAFETY: eight floats each.
        unsafe {
            Self {
                x: _mm256_loadu_ps(x.as_ptr()),
                y: _mm256_loadu_ps(y.as_ptr()),
                inverse_depth: _mm256_loadu_ps(inverse_depth.as_ptr()),
            }
        }
    }

    /// Indices of their cells; all are below the number of cells, of which there must be one.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn cells(self, cells: &NearestCells) -> __m256i {
        let per_pixel = _mm256_set1_ps(cells.per_pixel);
        let half = _mm256_set1_ps(0.5);
        let cell =
            |at: __m256| _mm256_cvttps_epi32(_mm256_mul_ps(_mm256_add_ps(at, half), per_pixel));
        // Images have at most 16384 columns and rows, so indices fit.
        let columns = _mm256_set1_epi32(cells.columns as i32);
        let index = _mm256_add_epi32(_mm256_mullo_epi32(cell(self.y), columns), cell(self.x));
        _mm256_min_epu32(
            index,
            _mm256_set1_epi32((cells.inverse_depth.len() - 1) as i32),
        )
    }

    /// A bit for each point that is seen and not hidden.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn visible(self, seen: &Seen) -> i32 {
        let is_seen = _mm256_cmp_ps::<_CMP_NEQ_OQ>(self.inverse_depth, _mm256_setzero_ps());
        let Some((cells, [absolute, share])) = seen.hiding else {
            return _mm256_movemask_ps(is_seen);
        };
        let index = self.cells(cells);
        // SAFETY: the indices are below the length of the table.
        let nearest = unsafe { _mm256_i32gather_ps::<4>(cells.inverse_depth.as_ptr(), index) };
        let by = _mm256_max_ps(
            _mm256_set1_ps(absolute),
            _mm256_mul_ps(_mm256_set1_ps(share), self.inverse_depth),
        );
        let ahead = _mm256_sub_ps(nearest, self.inverse_depth);
        let is_hidden = _mm256_cmp_ps::<_CMP_GT_OQ>(ahead, by);
        _mm256_movemask_ps(_mm256_andnot_ps(is_hidden, is_seen))
    }
}

#[target_feature(enable = "avx2")]
fn enter_row_avx2(cells: &mut NearestCells, row: &ProjectedRow) {
    let (xs, x_rest) = row.x.as_chunks::<8>();
    let (ys, y_rest) = row.y.as_chunks::<8>();
    let (inverses, inverse_rest) = row.inverse_depth.as_chunks::<8>();
    for ((x, y), inverse_depth) in xs.iter().zip(ys).zip(inverses) {
        let mut indices = [0_u32; 8];
        let index = Points::load(x, y, inverse_depth).cells(cells);
        // SAFETY: eight integers.
        unsafe { _mm256_storeu_si256(indices.as_mut_ptr().cast(), index) };
        for (&index, &inverse_depth) in indices.iter().zip(inverse_depth) {
            // SAFETY: the indices are below the length of the table.
            let nearest = unsafe { cells.inverse_depth.get_unchecked_mut(index as usize) };
            *nearest = if inverse_depth > *nearest {
                inverse_depth
            } else {
                *nearest
            };
        }
    }
    for ((&x, &y), &inverse_depth) in x_rest.iter().zip(y_rest).zip(inverse_rest) {
        scalar::enter(cells, x, y, inverse_depth);
    }
}

#[target_feature(enable = "avx2")]
fn sample_row_avx2(seen: &Seen, row: &ProjectedRow, pixels: &mut [LinearPixel]) {
    let (eights, rest) = pixels.as_chunks_mut::<8>();
    let (xs, x_rest) = row.x.as_chunks::<8>();
    let (ys, y_rest) = row.y.as_chunks::<8>();
    let (inverses, inverse_rest) = row.inverse_depth.as_chunks::<8>();
    for (((pixels, x), y), inverse_depth) in eights.iter_mut().zip(xs).zip(ys).zip(inverses) {
        let points = Points::load(x, y, inverse_depth);
        let visible = points.visible(seen);
        let corners = Corners::of(points, seen);
        for lane in 0..8 {
            pixels[lane] = if visible & (1 << lane) == 0 {
                LinearPixel::INVALID
            } else if let Some(pixel) = corners.plain_sample(lane, seen) {
                pixel
            } else {
                scalar::sample(seen, x[lane], y[lane])
            };
        }
    }
    let points = x_rest.iter().zip(y_rest).zip(inverse_rest);
    for (pixel, ((&x, &y), &inverse_depth)) in rest.iter_mut().zip(points) {
        *pixel = scalar::seen_sample(seen, x, y, inverse_depth);
    }
}

/// Where eight points lie among the four pixels about each.
struct Corners {
    /// Index of the upper left pixel; of no use without the bit in `is_inside`.
    first: [i32; 8],
    /// A bit for each point with all four pixels in the image.
    is_inside: i32,
    /// Shares of the upper left, lower left, upper right, lower right pixel.
    weights: [[f32; 8]; 4],
}

impl Corners {
    #[inline]
    #[target_feature(enable = "avx2")]
    fn of(points: Points, seen: &Seen) -> Self {
        let (left, x_shares) = corner(points.x);
        let (upper, y_shares) = corner(points.y);
        let width = _mm256_set1_epi32(seen.width as i32);
        let within = |at: __m256i, size: usize| {
            let above = _mm256_cmpgt_epi32(at, _mm256_set1_epi32(-1));
            let below = _mm256_cmpgt_epi32(_mm256_set1_epi32(size as i32 - 1), at);
            _mm256_and_si256(above, below)
        };
        let inside = _mm256_and_si256(within(left, seen.width), within(upper, seen.height));
        let mut corners = Self {
            first: [0; 8],
            is_inside: _mm256_movemask_ps(_mm256_castsi256_ps(inside)),
            weights: [[0.0; 8]; 4],
        };
        let first = _mm256_add_epi32(_mm256_mullo_epi32(upper, width), left);
        // SAFETY: eight integers, then eight floats each.
        unsafe {
            _mm256_storeu_si256(corners.first.as_mut_ptr().cast(), first);
            let pairs = [(0, 0), (0, 1), (1, 0), (1, 1)];
            for (weights, (x, y)) in corners.weights.iter_mut().zip(pairs) {
                let product = _mm256_mul_ps(x_shares[x], y_shares[y]);
                _mm256_storeu_ps(weights.as_mut_ptr(), product);
            }
        }
        corners
    }

    /// The sample of a point where all four pixels are inside, valid and unsaturated.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn plain_sample(&self, lane: usize, seen: &Seen) -> Option<LinearPixel> {
        if self.is_inside & (1 << lane) == 0 {
            return None;
        }
        let first = self.first[lane] as usize;
        // SAFETY: both pairs of pixels, 16 bytes each, lie in the image, `width · height` pixels long by the
        // caller's assertion: the bit says that column + 1 < width and row + 1 < height.
        let (above, below) = unsafe {
            let above = seen.color.as_ptr().add(first);
            (
                _mm_loadu_si128(above.cast()),
                _mm_loadu_si128(above.add(seen.width).cast()),
            )
        };
        let valid = _mm_set1_epi64x(i64::from(LinearPixel::VALID) << 48);
        let flags = _mm_set1_epi64x((0xffff_u64 << 48).cast_signed());
        let others = _mm_or_si128(_mm_xor_si128(above, valid), _mm_xor_si128(below, valid));
        if _mm_testz_si128(others, flags) == 0 {
            return None;
        }
        let lanes = |pair: __m128i, left: f32, right: f32| {
            let weights = _mm256_set_m128(_mm_set1_ps(right), _mm_set1_ps(left));
            _mm256_mul_ps(weights, _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(pair)))
        };
        let [upper_left, lower_left, upper_right, lower_right] = &self.weights;
        let columns = _mm256_add_ps(
            lanes(above, upper_left[lane], upper_right[lane]),
            lanes(below, lower_left[lane], lower_right[lane]),
        );
        let sum = _mm_add_ps(
            _mm256_castps256_ps128(columns),
            _mm256_extractf128_ps::<1>(columns),
        );
        let rounded = _mm_cvttps_epi32(_mm_add_ps(sum, _mm_set1_ps(0.5)));
        let packed = _mm_packus_epi32(rounded, rounded);
        // The lane of flags sums to 1 but for rounding; it is set, not trusted.
        let packed = _mm_insert_epi16::<3>(packed, i32::from(LinearPixel::VALID));
        let mut pixel = LinearPixel::INVALID;
        // SAFETY: a pixel is the lower 8 bytes.
        unsafe { _mm_storel_epi64((&raw mut pixel).cast(), packed) };
        Some(pixel)
    }
}

/// The pixel at or before each coordinate, and the shares of it and of the next.
#[inline]
#[target_feature(enable = "avx2")]
fn corner(at: __m256) -> (__m256i, [__m256; 2]) {
    let one = _mm256_set1_ps(1.0);
    let pixel = _mm256_sub_epi32(
        _mm256_cvttps_epi32(_mm256_add_ps(at, one)),
        _mm256_set1_epi32(1),
    );
    let beyond = _mm256_sub_ps(at, _mm256_cvtepi32_ps(pixel));
    let share = _mm256_min_ps(_mm256_max_ps(beyond, _mm256_setzero_ps()), one);
    (pixel, [_mm256_sub_ps(one, share), share])
}
