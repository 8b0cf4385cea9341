//! The marching-cubes table, generated from one rule.
//!
//! On each face of a cell, every run of negative corners is cut off by its own segment. The rule looks at
//! the face's four signs alone, so two cells that share a face cut it alike and no crack can open
//! (hard-cases D12). Segments chain into loops, loops are split into triangles.

use std::sync::LazyLock;

/// Corner `c` of a cell lies at (c & 1, c >> 1 & 1, c >> 2 & 1).
pub(super) const CORNERS: usize = 8;
/// Edges of a cell: edge `4·axis + n` runs along `axis` from the n-th corner without that bit.
pub(super) const EDGES: usize = 12;

/// Triangles of a sign pattern, as triples of cell edges, counter-clockwise from the positive side.
pub(super) struct Case {
    pub(super) triangles: Vec<[u8; 3]>,
}

/// The 256 cases; bit `c` of the index is set where corner `c` is negative.
pub(super) static CASES: LazyLock<Vec<Case>> =
    LazyLock::new(|| (0..=255u8).map(build_case).collect());

/// Axis of an edge and its lower corner.
pub(super) const fn edge_start(edge: usize) -> (usize, usize) {
    let axis = edge / 4;
    let n = edge % 4;
    // Insert a zero bit at position `axis`.
    let low = n & ((1 << axis) - 1);
    (axis, low | (n >> axis) << (axis + 1))
}

/// The edge between two corners that differ in one bit.
fn edge_between(a: usize, b: usize) -> usize {
    let axis = (a ^ b).trailing_zeros() as usize;
    let corner = a & b;
    let low = corner & ((1 << axis) - 1);
    4 * axis + (low | corner >> (axis + 1) << axis)
}

/// The corners of each face, counter-clockwise seen from outside the cell.
pub(super) fn face_corners(axis: usize, is_upper: bool) -> [usize; 4] {
    let (first, second) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = if is_upper { 1 << axis } else { 0 };
    let loop_seen_from_above = [base, base | first, base | first | second, base | second];
    if is_upper {
        loop_seen_from_above
    } else {
        let [a, b, c, d] = loop_seen_from_above;
        [a, d, c, b]
    }
}

/// Directed segments (from edge, to edge) of one face: each cuts off one run of negative corners.
pub(super) fn face_segments(signs: u8, corners: [usize; 4]) -> Vec<(usize, usize)> {
    let is_negative = |n: usize| signs >> corners[n % 4] & 1 == 1;
    let mut segments = Vec::new();
    for start in 0..4 {
        // A run enters between a positive corner and a negative one.
        if !is_negative(start) && is_negative(start + 1) {
            let mut end = start + 1;
            while is_negative(end + 1) {
                end += 1;
            }
            let enter = edge_between(corners[start], corners[(start + 1) % 4]);
            let leave = edge_between(corners[end % 4], corners[(end + 1) % 4]);
            segments.push((enter, leave));
        }
    }
    segments
}

fn build_case(signs: u8) -> Case {
    let mut next = [None; EDGES];
    for axis in 0..3 {
        for is_upper in [false, true] {
            for (from, to) in face_segments(signs, face_corners(axis, is_upper)) {
                next[from] = Some(to);
            }
        }
    }
    let mut triangles = Vec::new();
    for first in 0..EDGES {
        let mut polygon = Vec::new();
        let mut edge = first;
        while let Some(following) = next[edge].take() {
            polygon.push(edge);
            edge = following;
        }
        if polygon.len() >= 3 {
            triangles.extend(split(&polygon).1);
        }
    }
    Case { triangles }
}

/// Splits a polygon into triangles with the fewest diagonals that lie in a face of the cell: the
/// neighbour could draw the same diagonal, and the edge would then have four triangles.
/// Returns that number and the triangles.
fn split(polygon: &[usize]) -> (usize, Vec<[u8; 3]>) {
    if polygon.len() < 3 {
        return (0, Vec::new());
    }
    let last = polygon.len() - 1;
    let mut best: Option<(usize, Vec<[u8; 3]>)> = None;
    // The triangle on the side (last, 0) has some third vertex.
    for middle in 1..last {
        let is_diagonal = |a: usize, b: usize| b - a > 1;
        let in_face =
            |a: usize, b: usize| is_diagonal(a, b) && share_a_face(polygon[a], polygon[b]);
        let mut cost = usize::from(in_face(0, middle)) + usize::from(in_face(middle, last));
        let (left_cost, mut triangles) = split(&polygon[..=middle]);
        let (right_cost, right) = split(&polygon[middle..]);
        cost += left_cost + right_cost;
        if best.as_ref().is_none_or(|(known, _)| cost < *known) {
            triangles.push([polygon[0], polygon[middle], polygon[last]].map(|edge| edge as u8));
            triangles.extend(right);
            best = Some((cost, triangles));
        }
    }
    best.unwrap_or_default()
}

fn share_a_face(a: usize, b: usize) -> bool {
    (0..3).any(|axis| {
        [0, 1].iter().any(|&side| {
            let lies_in = |edge: usize| {
                let (along, corner) = edge_start(edge);
                along != axis && corner >> axis & 1 == side
            };
            lies_in(a) && lies_in(b)
        })
    })
}
