//! Which pixel centres a triangle covers: fixed point, so that neighbours never both take a pixel nor both
//! leave it (hard-cases E10).

use std::ops::Range;

/// Fixed-point units a pixel: 8 sub-pixel bits.
pub(super) const UNITS: i64 = 256;

/// A point of the image in units of 1/[`UNITS`] pixel.
pub(super) type FixedPoint = [i64; 2];

/// Rounds pixel coordinates within [`super::clip::GUARD_PIXELS`] to fixed point.
pub(super) fn fixed(pixel: f64) -> i64 {
    (pixel * UNITS as f64).round() as i64
}

/// A directed edge: positive on its inner side, zero on it where its points belong to the triangle.
#[derive(Clone, Copy, Debug)]
struct Edge {
    value: i64,
    step_x: i64,
    step_y: i64,
}

impl Edge {
    /// The edge from `p` to `q` at the centre of pixel (column, row).
    ///
    /// Two triangles share an edge in opposite directions, of which exactly one counts as top or left: its
    /// triangle owns the points on it. With coordinates below 2²⁹ products stay below 2⁶⁰.
    fn new(p: FixedPoint, q: FixedPoint, column: i64, row: i64) -> Self {
        let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
        let is_top_left = dy < 0 || (dy == 0 && dx > 0);
        let (x, y) = (column * UNITS - p[0], row * UNITS - p[1]);
        Self {
            value: dx * y - dy * x - i64::from(!is_top_left),
            step_x: -dy * UNITS,
            step_y: dx * UNITS,
        }
    }
}

/// Rows or columns whose centres lie within `[least, greatest]` and `limits`.
pub(super) fn centers_within(least: i64, greatest: i64, limits: Range<i64>) -> Range<i64> {
    let first = (least + UNITS - 1).div_euclid(UNITS).max(limits.start);
    let last = (greatest.div_euclid(UNITS) + 1).min(limits.end);
    first..last
}

/// Calls `visit(column, row)` for every pixel of `columns` x `rows` whose centre the triangle covers, in scan
/// order. Corners may run either way round.
pub(super) fn cover(
    corners: [FixedPoint; 3],
    columns: Range<i64>,
    rows: Range<i64>,
    mut visit: impl FnMut(i64, i64),
) {
    let [a, mut b, mut c] = corners;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area == 0 {
        return;
    }
    if area < 0 {
        std::mem::swap(&mut b, &mut c);
    }
    let bounds = |k: usize| {
        let (p, q, r) = (a[k], b[k], c[k]);
        (p.min(q).min(r), p.max(q).max(r))
    };
    let columns = centers_within(bounds(0).0, bounds(0).1, columns);
    let rows = centers_within(bounds(1).0, bounds(1).1, rows);
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    let mut edges =
        [(a, b), (b, c), (c, a)].map(|(p, q)| Edge::new(p, q, columns.start, rows.start));
    for row in rows {
        let mut along = edges.map(|edge| edge.value);
        for column in columns.clone() {
            // The sign bit of the disjunction: any negative edge value.
            if along[0] | along[1] | along[2] >= 0 {
                visit(column, row);
            }
            for (value, edge) in along.iter_mut().zip(&edges) {
                *value += edge.step_x;
            }
        }
        for edge in &mut edges {
            edge.value += edge.step_y;
        }
    }
}

#[cfg(test)]
mod tests;
