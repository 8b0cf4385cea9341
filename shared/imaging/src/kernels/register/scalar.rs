//! The specification.

use super::{NearestCells, ProjectedRow, Projection, Seen};
use crate::linear_pixel::LinearPixel;

/// Nearest z that counts as in front of a camera, metres (hard-cases A12).
const Z_NEAR: f32 = geometry::camera::Z_NEAR as f32;
/// Least share of a sample's weight that valid pixels must hold.
const LEAST_WEIGHT: f32 = 0.5;

/// See [`super::project_row`].
#[inline(always)]
pub(super) fn project_row(
    projection: &Projection,
    v: usize,
    depth: &[f32],
    projected: &mut ProjectedRow,
) {
    if projection.is_distorted {
        project::<true>(projection, v, depth, projected);
    } else {
        project::<false>(projection, v, depth, projected);
    }
}

#[inline(always)]
fn project<const DISTORTED: bool>(
    projection: &Projection,
    v: usize,
    depth: &[f32],
    projected: &mut ProjectedRow,
) {
    let Projection {
        start,
        step,
        center_of_depth,
        focal,
        center,
        distortion: [k1, k2, p1, p2, k3],
        fold_square,
        end,
        ..
    } = *projection;
    let v = v as f32;
    let row: [f32; 3] = std::array::from_fn(|axis| start[axis] + v * step[axis][1]);
    let ProjectedRow {
        x: xs,
        y: ys,
        inverse_depth: inverses,
    } = projected;
    let width = depth.len();
    let (xs, ys, inverses) = (&mut xs[..width], &mut ys[..width], &mut inverses[..width]);
    for column in 0..width {
        let z = depth[column];
        let u = column as i32 as f32;
        let point: [f32; 3] =
            std::array::from_fn(|axis| z * (row[axis] + u * step[axis][0]) + center_of_depth[axis]);
        let inverse = 1.0 / point[2];
        let (mut x, mut y) = (point[0] * inverse, point[1] * inverse);
        let square = x * x + y * y;
        if DISTORTED {
            let radial = 1.0 + square * (k1 + square * (k2 + square * k3));
            let cross = 2.0 * x * y;
            (x, y) = (
                x * radial + p1 * cross + p2 * (square + 2.0 * x * x),
                y * radial + p1 * (square + 2.0 * y * y) + p2 * cross,
            );
        }
        let x = focal[0] * x + center[0];
        let y = focal[1] * y + center[1];
        // Not-a-number and infinite depths fail one of these.
        let is_seen = (z > 0.0)
            & (point[2] >= Z_NEAR)
            & (square < fold_square)
            & (x >= -0.5)
            & (x < end[0])
            & (y >= -0.5)
            & (y < end[1])
            & (inverse > 0.0);
        xs[column] = if is_seen { x } else { 0.0 };
        ys[column] = if is_seen { y } else { 0.0 };
        inverses[column] = if is_seen { inverse } else { 0.0 };
    }
}

/// See [`NearestCells::enter`].
pub(super) fn enter_row(cells: &mut NearestCells, row: &ProjectedRow) {
    let points = row.x.iter().zip(&row.y).zip(&row.inverse_depth);
    for ((&x, &y), &inverse_depth) in points {
        enter(cells, x, y, inverse_depth);
    }
}

/// Enters a point.
#[inline(always)]
pub(super) fn enter(cells: &mut NearestCells, x: f32, y: f32, inverse_depth: f32) {
    let index = cells.index(x, y);
    // What is not seen has 0 and never is the nearest.
    if let Some(nearest) = cells.inverse_depth.get_mut(index)
        && inverse_depth > *nearest
    {
        *nearest = inverse_depth;
    }
}

/// See [`super::sample_row`].
pub(super) fn sample_row(seen: &Seen, row: &ProjectedRow, pixels: &mut [LinearPixel]) {
    let points = row.x.iter().zip(&row.y).zip(&row.inverse_depth);
    for (pixel, ((&x, &y), &inverse_depth)) in pixels.iter_mut().zip(points) {
        *pixel = seen_sample(seen, x, y, inverse_depth);
    }
}

/// The colour of a point, invalid where it is not seen or hidden.
pub(super) fn seen_sample(seen: &Seen, x: f32, y: f32, inverse_depth: f32) -> LinearPixel {
    if inverse_depth == 0.0 || seen.is_hidden(x, y, inverse_depth) {
        LinearPixel::INVALID
    } else {
        sample(seen, x, y)
    }
}

/// Bilinear among the valid pixels about (x, y), which lies in the image; saturated where any of them is;
/// invalid where they hold less than half of the weight.
pub(super) fn sample(seen: &Seen, x: f32, y: f32) -> LinearPixel {
    // In the outer half of a border pixel there is nothing to mix it with.
    let corner = Corner::of(
        x.clamp(0.0, seen.width as f32 - 1.0),
        y.clamp(0.0, seen.height as f32 - 1.0),
    );
    let [left, right] = corner.x_shares;
    let [upper, lower] = corner.y_shares;
    let weights = [left * upper, left * lower, right * upper, right * lower];
    let taps = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dx, dy)| {
        let (x, y) = (corner.x + dx, corner.y + dy);
        let is_inside = (0..seen.width as i32).contains(&x) && (0..seen.height as i32).contains(&y);
        if is_inside {
            seen.color[y as usize * seen.width + x as usize]
        } else {
            LinearPixel::INVALID
        }
    });
    let mut kept = [0.0; 4];
    let mut is_saturated = false;
    for ((kept, tap), &weight) in kept.iter_mut().zip(&taps).zip(&weights) {
        if tap.is_valid() && weight > 0.0 {
            *kept = weight;
            is_saturated |= tap.is_saturated();
        }
    }
    let total = (kept[0] + kept[1]) + (kept[2] + kept[3]);
    if total < LEAST_WEIGHT {
        return LinearPixel::INVALID;
    }
    let are_all_plain = taps.iter().all(|tap| tap.0[3] == LinearPixel::VALID);
    // All four there: their weights add up to 1 but for rounding, which the division would only move.
    let norm = if are_all_plain { 1.0 } else { 1.0 / total };
    let weights = if are_all_plain { weights } else { kept };
    let channel = |c: usize| {
        let product = |tap: usize| weights[tap] * f32::from(taps[tap].0[c]);
        let sum = (product(0) + product(1)) + (product(2) + product(3));
        (sum * norm + 0.5) as u16
    };
    let saturated = if is_saturated {
        LinearPixel::SATURATED
    } else {
        0
    };
    LinearPixel([
        channel(0),
        channel(1),
        channel(2),
        LinearPixel::VALID | saturated,
    ])
}

/// The upper left one of four pixels about a position, and what share the columns and rows have.
struct Corner {
    x: i32,
    y: i32,
    x_shares: [f32; 2],
    y_shares: [f32; 2],
}

impl Corner {
    /// Of coordinates of at least 0.
    #[inline(always)]
    fn of(x: f32, y: f32) -> Self {
        let at = |value: f32| {
            // In the vector twin coordinates may be −0.5, and truncation rounds down what is positive.
            let corner = (value + 1.0) as i32 - 1;
            let share = (value - corner as f32).clamp(0.0, 1.0);
            (corner, [1.0 - share, share])
        };
        let ((x, x_shares), (y, y_shares)) = (at(x), at(y));
        Self {
            x,
            y,
            x_shares,
            y_shares,
        }
    }
}
