//! Walks rays through a tree and tests the triangles they meet.
//!
//! Both levels do the same IEEE operations in the same order without fused multiply-add, so they agree bit for
//! bit: hits, distances and barycentrics. Fusing would also cost watertightness: two triangles must find
//! exactly opposite values for a shared edge.
//!
//! Bound: on the 300 000 triangles of `tests/peers/raycast_embree.py` a primary ray visits 11.4 nodes and 2.1
//! leaves, a mirrored one 14.4 and 2.6, any hit 5.4 and 1.4 (primary), 7.1 and 1.8 (mirrored). A node is 256 bytes
//! and 19 vector operations, about 10 cycles of two ports; a leaf 320 bytes and 60 operations, about 30. That is
//! 180 cycles a primary ray; 200 ns were measured (4.9 million rays a second, one core of an EPYC 7003, shared
//! with other work), 3 to 4 times the bound. The rest is, by sampling the program counter (that machine had no
//! hardware counters), waiting: a node is known only when its parent is tested, and the branch on how many
//! children were entered is a guess. Walking two rays in turns, preparing 16 at a time and leaving out that
//! branch were tried and are not quicker. The tree of that mesh is 22 MB, which mirrored rays, less coherent,
//! should feel in the caches. AVX2 is 5 to 6 times as fast as the scalar level.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(test)]
mod hard;
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
    let is_backwards = direction.map(|d| d.to_bits() >> 31);
    let outwards = direction.map(|d| margin.copysign(d));
    let axes = OTHER_AXES[z_axis];
    let inverse_z = 1.0 / direction[z_axis];
    Some(PreparedRay {
        near_origin: std::array::from_fn(|axis| origin[axis] + outwards[axis]),
        far_origin: std::array::from_fn(|axis| origin[axis] - outwards[axis]),
        inverse: direction.map(|d| (1.0 / d.abs().max(floor)).copysign(d)),
        near_row: std::array::from_fn(|axis| 2 * axis + is_backwards[axis] as usize),
        order_shift: 3 * (is_backwards[0] | is_backwards[1] << 1 | is_backwards[2] << 2),
        axes,
        origin: axes.map(|axis| origin[axis]),
        shear: [
            direction[axes[0]] * inverse_z,
            direction[axes[1]] * inverse_z,
            inverse_z,
        ],
        least: ray.least,
        greatest: ray.greatest,
    })
}

/// The other two axes of each, then the axis itself.
const OTHER_AXES: [[usize; 3]; 3] = [[1, 2, 0], [2, 0, 1], [0, 1, 2]];

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
