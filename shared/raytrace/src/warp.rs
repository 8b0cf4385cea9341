//! Whether two views see one point: the depth test of warps.

/// Share of the depth that a point may be off when seen head on (hard-cases E13).
const RELATIVE_TOLERANCE: f32 = 0.01;

/// Smallest cosine the tolerance follows: beyond 87 degrees a pixel says nothing about depth.
const LEAST_COSINE: f32 = 0.05;

/// Whether `depth`, read from a view's depth buffer, and `expected`, the depth of the warped point in that
/// view, are one surface: |Δz| ≤ max(2 · `step`, 0.01 · z / (n·v)). All metres along the view's axis; `step`
/// is the depth difference that the buffer resolves at `expected`; `cosine` is that between the normal and
/// the direction to the view. False where nothing was measured (0) and for NaN.
pub fn sees_same_surface(depth: f32, expected: f32, step: f32, cosine: f32) -> bool {
    let slant = (RELATIVE_TOLERANCE * expected / cosine.max(LEAST_COSINE)).max(2.0 * step);
    depth > 0.0 && expected > 0.0 && (depth - expected).abs() <= slant
}
