//! The sums of eight points at once.
#![expect(
    unsafe_code,
    reason = "vector loads and stores and surfel reads through pointers"
)]

use std::arch::x86_64::*;

use super::{
    INLIER_SIGMAS, IcpStep, IcpSums, LEAST_COSINE_SQUARED, ModelPixels, PointTile, Z_NEAR,
};
use crate::model_view::Surfel;

const LANES: usize = 8;
/// 21 of the Hessian, 6 of the gradient, and the cost.
const SUMS: usize = 28;

/// As [`super::scalar::sum_tile`], but for the order of additions.
pub(super) fn sum_tile(points: PointTile<'_>, model: ModelPixels<'_>, step: &IcpStep) -> IcpSums {
    if !std::is_x86_feature_detected!("avx2") {
        return super::scalar::sum_tile(points, model, step);
    }
    // SAFETY: AVX2 was detected above.
    unsafe { sum_lanes(points, model, step) }
}

/// Three vectors: components of eight points.
type Vector = [__m256; 3];

struct Accumulators {
    sums: [__m256; SUMS],
    met_count: u32,
    pair_count: u32,
    inlier_count: u32,
}

#[target_feature(enable = "avx2")]
fn sum_lanes(points: PointTile<'_>, model: ModelPixels<'_>, step: &IcpStep) -> IcpSums {
    if model.surfels.is_empty() {
        return IcpSums::ZERO;
    }
    let mut totals = Accumulators {
        sums: [_mm256_setzero_ps(); SUMS],
        met_count: 0,
        pair_count: 0,
        inlier_count: 0,
    };
    let whole = points.x.len() / LANES * LANES;
    for first in (0..whole).step_by(LANES) {
        let load = |values: &[f32]| load_lanes(&values[first..first + LANES]);
        let point = [load(points.x), load(points.y), load(points.z)];
        sum_eight(point, load(points.weight), model, step, &mut totals);
    }
    if whole < points.x.len() {
        // Absent points lie behind the camera.
        let load = |values: &[f32]| {
            let mut lanes = [-1.0; LANES];
            lanes[..values.len() - whole].copy_from_slice(&values[whole..]);
            load_lanes(&lanes)
        };
        let mut point = [load(points.x), load(points.y), load(points.z)];
        let present = _mm256_cmp_ps::<_CMP_GT_OQ>(
            load_lanes(&std::array::from_fn::<f32, LANES, _>(|lane| {
                (points.x.len() - whole) as f32 - lane as f32
            })),
            _mm256_setzero_ps(),
        );
        for axis in &mut point {
            *axis = _mm256_blendv_ps(_mm256_set1_ps(f32::NAN), *axis, present);
        }
        sum_eight(point, load(points.weight), model, step, &mut totals);
    }
    folded(&totals)
}

#[inline]
#[target_feature(enable = "avx2")]
fn sum_eight(
    point: Vector,
    point_weight: __m256,
    model: ModelPixels<'_>,
    step: &IcpStep,
    totals: &mut Accumulators,
) {
    let one = _mm256_set1_ps(1.0);
    let moved = |row: usize| {
        let turned = dot(splat(step.rotation[row]), point);
        _mm256_add_ps(turned, _mm256_set1_ps(step.translation[row]))
    };
    let q: Vector = [moved(0), moved(1), moved(2)];
    let in_front = _mm256_cmp_ps::<_CMP_GT_OQ>(q[2], _mm256_set1_ps(Z_NEAR));
    let inverse_z = _mm256_div_ps(one, q[2]);
    let pixel = |axis: usize| {
        let scaled = _mm256_mul_ps(_mm256_set1_ps(model.focal[axis]), q[axis]);
        let shift = _mm256_set1_ps(model.center[axis] + 0.5);
        _mm256_add_ps(_mm256_mul_ps(scaled, inverse_z), shift)
    };
    let (column, line) = (pixel(0), pixel(1));
    let within = |value: __m256, size: usize| {
        _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GE_OQ>(value, _mm256_setzero_ps()),
            _mm256_cmp_ps::<_CMP_LT_OQ>(value, _mm256_set1_ps(size as f32)),
        )
    };
    let inside = _mm256_and_ps(
        in_front,
        _mm256_and_ps(within(column, model.width), within(line, model.height)),
    );
    if _mm256_movemask_ps(inside) == 0 {
        return;
    }
    let index = _mm256_add_epi32(
        _mm256_mullo_epi32(
            _mm256_cvttps_epi32(line),
            _mm256_set1_epi32(model.width as i32),
        ),
        _mm256_cvttps_epi32(column),
    );
    // Lanes outside read the first surfel and are masked out.
    let index = _mm256_and_si256(index, _mm256_castps_si256(inside));
    // SAFETY: inside lanes have 0 <= line < height and 0 <= column < width, so index < width · height, which
    // is the number of surfels (asserted by `super::sum_tile`); the other lanes are 0, and there is a surfel.
    let (position, normal, surfel_weight) = unsafe { load_surfels(model.surfels, index) };
    let met = _mm256_and_ps(
        inside,
        _mm256_cmp_ps::<_CMP_GT_OQ>(surfel_weight, _mm256_setzero_ps()),
    );
    let difference = sub(q, position);
    let along = dot(normal, q);
    let cosine_squared = _mm256_div_ps(_mm256_mul_ps(along, along), dot(q, q));
    let near = _mm256_cmp_ps::<_CMP_LE_OQ>(
        dot(difference, difference),
        _mm256_set1_ps(step.largest_distance * step.largest_distance),
    );
    let faces = _mm256_cmp_ps::<_CMP_GE_OQ>(cosine_squared, _mm256_set1_ps(LEAST_COSINE_SQUARED));
    let paired = _mm256_and_ps(met, _mm256_and_ps(near, faces));
    totals.met_count += _mm256_movemask_ps(met).count_ones();
    totals.pair_count += _mm256_movemask_ps(paired).count_ones();

    let masked = |value: __m256| _mm256_and_ps(value, paired);
    let residual = masked(dot(normal, difference));
    let base = masked(_mm256_mul_ps(point_weight, cosine_squared));
    let square = _mm256_mul_ps(_mm256_mul_ps(residual, residual), base);
    let agrees = _mm256_cmp_ps::<_CMP_LE_OQ>(square, _mm256_set1_ps(INLIER_SIGMAS * INLIER_SIGMAS));
    totals.inlier_count += _mm256_movemask_ps(_mm256_and_ps(agrees, paired)).count_ones();
    let scale_squared = _mm256_set1_ps(step.robust_scale * step.robust_scale);
    let share = _mm256_div_ps(scale_squared, _mm256_add_ps(scale_squared, square));
    let weight = _mm256_mul_ps(base, _mm256_mul_ps(share, share));
    let turn = cross(sub(q, splat(step.center)), normal);
    // Lanes without a pair may hold what is not finite, and 0 · ∞ is NaN.
    let row = [
        masked(turn[0]),
        masked(turn[1]),
        masked(turn[2]),
        masked(normal[0]),
        masked(normal[1]),
        masked(normal[2]),
    ];
    accumulate(&row, weight, residual, &mut totals.sums);
    let cost = masked(_mm256_sub_ps(one, share));
    totals.sums[27] = _mm256_add_ps(totals.sums[27], cost);
}

#[inline]
#[target_feature(enable = "avx2")]
fn accumulate(row: &[__m256; 6], weight: __m256, residual: __m256, sums: &mut [__m256; SUMS]) {
    let mut place = 0;
    for i in 0..6 {
        let weighted = _mm256_mul_ps(weight, row[i]);
        for right in &row[i..] {
            sums[place] = _mm256_add_ps(sums[place], _mm256_mul_ps(weighted, *right));
            place += 1;
        }
        sums[21 + i] = _mm256_add_ps(sums[21 + i], _mm256_mul_ps(weighted, residual));
    }
}

/// Lanes added in f64, first to last.
#[target_feature(enable = "avx2")]
fn folded(totals: &Accumulators) -> IcpSums {
    let sum = |place: usize| -> f64 {
        let mut lanes = [0.0f32; LANES];
        // SAFETY: the array is 8 f32 long.
        unsafe { _mm256_storeu_ps(lanes.as_mut_ptr(), totals.sums[place]) };
        lanes.into_iter().map(f64::from).sum()
    };
    IcpSums {
        hessian: std::array::from_fn(sum),
        gradient: std::array::from_fn(|axis| sum(21 + axis)),
        cost: sum(27),
        met_count: totals.met_count,
        pair_count: totals.pair_count,
        inlier_count: totals.inlier_count,
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load_lanes(values: &[f32]) -> __m256 {
    let values: &[f32; LANES] = values.try_into().expect("eight lanes");
    // SAFETY: the array is 8 f32 long.
    unsafe { _mm256_loadu_ps(values.as_ptr()) }
}

/// Positions, normals and weights of eight surfels: eight loads of 32 bytes and a transposition take half the
/// time of seven gathers on Zen 3.
///
/// # Safety
/// Every lane of `index` must be an index of `surfels`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load_surfels(surfels: &[Surfel], index: __m256i) -> (Vector, Vector, __m256) {
    let mut place = [0u32; LANES];
    // SAFETY: the array is 8 u32 long.
    unsafe { _mm256_storeu_si256(place.as_mut_ptr().cast(), index) };
    // SAFETY: the index is the caller's; a surfel is 8 f32 (`repr(C)`).
    let row = |lane: usize| unsafe {
        _mm256_loadu_ps(surfels.as_ptr().add(place[lane] as usize).cast::<f32>())
    };
    let columns = transposed([
        row(0),
        row(1),
        row(2),
        row(3),
        row(4),
        row(5),
        row(6),
        row(7),
    ]);
    (
        [columns[0], columns[1], columns[2]],
        [columns[4], columns[5], columns[6]],
        columns[7],
    )
}

#[inline]
#[target_feature(enable = "avx2")]
fn splat(v: [f32; 3]) -> Vector {
    [
        _mm256_set1_ps(v[0]),
        _mm256_set1_ps(v[1]),
        _mm256_set1_ps(v[2]),
    ]
}

/// Rows to columns of an 8x8 matrix.
#[inline]
#[target_feature(enable = "avx2")]
fn transposed(rows: [__m256; 8]) -> [__m256; 8] {
    let pairs = |a: usize, b: usize| {
        (
            _mm256_unpacklo_ps(rows[a], rows[b]),
            _mm256_unpackhi_ps(rows[a], rows[b]),
        )
    };
    let [(a0, a1), (b0, b1), (c0, c1), (d0, d1)] =
        [pairs(0, 1), pairs(2, 3), pairs(4, 5), pairs(6, 7)];
    let quads = |a: __m256, b: __m256| {
        (
            _mm256_shuffle_ps::<0b01_00_01_00>(a, b),
            _mm256_shuffle_ps::<0b11_10_11_10>(a, b),
        )
    };
    let [(e0, e1), (e2, e3), (f0, f1), (f2, f3)] =
        [quads(a0, b0), quads(a1, b1), quads(c0, d0), quads(c1, d1)];
    let halves = |a: __m256, b: __m256| {
        (
            _mm256_permute2f128_ps::<0x20>(a, b),
            _mm256_permute2f128_ps::<0x31>(a, b),
        )
    };
    let [(r0, r4), (r1, r5), (r2, r6), (r3, r7)] = [
        halves(e0, f0),
        halves(e1, f1),
        halves(e2, f2),
        halves(e3, f3),
    ];
    [r0, r1, r2, r3, r4, r5, r6, r7]
}

#[inline]
#[target_feature(enable = "avx2")]
fn dot(a: Vector, b: Vector) -> __m256 {
    _mm256_add_ps(
        _mm256_add_ps(_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])),
        _mm256_mul_ps(a[2], b[2]),
    )
}

#[inline]
#[target_feature(enable = "avx2")]
fn sub(a: Vector, b: Vector) -> Vector {
    [
        _mm256_sub_ps(a[0], b[0]),
        _mm256_sub_ps(a[1], b[1]),
        _mm256_sub_ps(a[2], b[2]),
    ]
}

#[inline]
#[target_feature(enable = "avx2")]
fn cross(a: Vector, b: Vector) -> Vector {
    let component =
        |i: usize, j: usize| _mm256_sub_ps(_mm256_mul_ps(a[i], b[j]), _mm256_mul_ps(a[j], b[i]));
    [component(1, 2), component(2, 0), component(0, 1)]
}
