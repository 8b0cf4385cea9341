//! Walks rays through a tree and tests the triangles they meet.
//!
//! Both levels do the same IEEE operations in the same order without fused multiply-add, so they agree bit for
//! bit: hits, distances and barycentrics. Fusing would also cost watertightness: two triangles must find
//! exactly opposite values for a shared edge.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use super::Level;
use crate::ray::{Hit, NO_TRIANGLE, Ray};
use crate::tree::Tree;

/// What a query wants to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// The nearest hit; of equally near ones the lowest triangle index.
    Closest,
    /// Whether there is any hit: the one found first.
    Any,
}

/// Answers `rays` in order into `hits`.
///
/// # Panics
/// When the slices differ in length.
pub(crate) fn trace(level: Level, tree: &Tree, wanted: Wanted, rays: &[Ray], hits: &mut [Hit]) {
    assert_eq!(rays.len(), hits.len(), "one hit a ray");
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::trace(tree, wanted, rays, hits),
        _ => scalar::trace(tree, wanted, rays, hits),
    }
}

/// Directions shorter or longer than this lose digits to underflow and overflow and hit nothing, as do
/// directions that are not finite.
const LENGTH_RANGE: std::ops::RangeInclusive<f32> = 1e-9..=1e9;

/// Farthest usable origin, metres: beyond it products overflow.
pub(crate) const COORDINATE_LIMIT: f32 = 1e9;

/// A component smaller than this share of the largest counts as this share: its inverse stays finite and no
/// 0 · ∞ arises (hard-cases E01). Over the length of any ray that moves it by less than an ulp.
const LEAST_COMPONENT_SHARE: f32 = 1e-20;

/// Margin of boxes in units of the largest coordinate in play, for the roundings of the slab test and of the
/// triangle test, each below 4 ulp (hard-cases E02).
const BOX_MARGIN: f32 = 8.0 * f32::EPSILON;

/// A ray, prepared for boxes and triangles.
#[derive(Clone, Copy, Debug)]
struct PreparedRay {
    /// Origin of the slab test of entry planes, moved by the margin so that boxes start earlier.
    near_origin: [f32; 3],
    /// Origin of the slab test of exit planes.
    far_origin: [f32; 3],
    /// Inverse direction, finite and nonzero.
    inverse: [f32; 3],
    /// Row of the entry planes in a node, by axis; the exit planes are in the other row of the pair.
    near_row: [usize; 3],
    /// 3 · the octant of the direction: a shift in [`crate::tree::Node::order`].
    order_shift: u32,
    /// Axes of the triangle test; the last is the direction's largest.
    axes: [usize; 3],
    /// Origin by `axes`.
    origin: [f32; 3],
    /// Shears x and y by z so that the ray points along z; the last entry scales z to t (Woop 2013).
    shear: [f32; 3],
    least: f32,
    greatest: f32,
}

/// Prepares a ray; `None` when it can hit nothing: not finite, without length, or with an empty range.
#[inline(always)]
fn prepare(ray: &Ray, extent: f32) -> Option<PreparedRay> {
    let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
    let [dx, dy, dz] = direction.map(f32::abs);
    let z_axis = if dx > dy {
        if dx > dz { 0 } else { 2 }
    } else if dy > dz {
        1
    } else {
        2
    };
    let largest = direction[z_axis].abs();
    let reach = origin[0].abs().max(origin[1].abs()).max(origin[2].abs());
    // NaN fails every comparison; f32::max would drop it.
    let is_usable = LENGTH_RANGE.contains(&largest)
        && dx <= largest
        && dy <= largest
        && dz <= largest
        && origin.iter().all(|o| o.abs() <= COORDINATE_LIMIT)
        && ray.least <= ray.greatest;
    if !is_usable {
        return None;
    }
    let margin = BOX_MARGIN * (reach + extent);
    let floor = LEAST_COMPONENT_SHARE * largest;
    let mut prepared = PreparedRay {
        near_origin: [0.0; 3],
        far_origin: [0.0; 3],
        inverse: [0.0; 3],
        near_row: [0; 3],
        order_shift: 0,
        axes: [(z_axis + 1) % 3, (z_axis + 2) % 3, z_axis],
        origin: [0.0; 3],
        shear: [0.0; 3],
        least: ray.least,
        greatest: ray.greatest,
    };
    for axis in 0..3 {
        let component = direction[axis];
        let is_backwards = component.is_sign_negative();
        let inverse = 1.0 / component.abs().max(floor);
        prepared.inverse[axis] = if is_backwards { -inverse } else { inverse };
        let outwards = if is_backwards { -margin } else { margin };
        prepared.near_origin[axis] = origin[axis] + outwards;
        prepared.far_origin[axis] = origin[axis] - outwards;
        prepared.near_row[axis] = 2 * axis + usize::from(is_backwards);
        prepared.order_shift += 3 * (u32::from(is_backwards) << axis);
    }
    let [x, y, z] = prepared.axes;
    prepared.origin = [origin[x], origin[y], origin[z]];
    let inverse_z = 1.0 / direction[z];
    prepared.shear = [
        direction[x] * inverse_z,
        direction[y] * inverse_z,
        inverse_z,
    ];
    Some(prepared)
}

/// A triangle relative to the ray's origin, sheared so that the ray runs along z: (x, y, z) of each vertex.
type Sheared = [[f32; 3]; 3];

/// Twice the areas that the ray cuts off opposite each vertex, from differences of products in f64: products
/// of f32 are exact there, so the sign is (Woop 2013). For rays that f32 sees exactly on an edge.
#[cold]
fn edges_in_f64([a, b, c]: &Sheared) -> [f32; 3] {
    let area = |p: &[f32; 3], q: &[f32; 3]| {
        (f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])) as f32
    };
    [area(c, b), area(a, c), area(b, a)]
}

/// The hit of a triangle whose edge values are known, or `None` outside it or `[least, greatest]`.
#[inline(always)]
fn hit_from_edges(
    sheared: &Sheared,
    [u, v, w]: [f32; 3],
    z_scale: f32,
    triangle: u32,
    least: f32,
    greatest: f32,
) -> Option<Hit> {
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let inverse = 1.0 / (u + v + w);
    let [a, b, c] = sheared;
    let depth = (u * a[2] + v * b[2] + w * c[2]) * z_scale;
    let t = depth * inverse;
    // NaN, from an empty lane or a zero sum, is a miss.
    (t >= least && t <= greatest).then_some(Hit {
        triangle,
        t,
        u: v * inverse,
        v: w * inverse,
    })
}

/// Keeps the better of two hits: nearer, or as near with a lower index, so that the order of the walk does
/// not show.
#[inline(always)]
fn is_better(hit: &Hit, than: &Hit) -> bool {
    hit.t < than.t || (hit.t == than.t && hit.triangle < than.triangle)
}

/// The best hit before any was found: as far as the ray may go.
#[inline(always)]
fn nothing_yet(greatest: f32) -> Hit {
    Hit {
        triangle: NO_TRIANGLE,
        t: greatest,
        u: 0.0,
        v: 0.0,
    }
}

/// What is reported at the end of a walk.
#[inline(always)]
fn finished(best: Hit) -> Hit {
    if best.is_hit() { best } else { Hit::MISS }
}
