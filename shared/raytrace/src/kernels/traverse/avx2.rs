//! The walk, 8 boxes and 8 triangles at once.
//!
//! The whole loop over rays is compiled for AVX2: nothing is dispatched a ray. A ray that enters one child of a
//! node, the commonest case, goes on with it at once. Where it enters more, all are put on the stack without a
//! further branch: a table turns the mask of entered lanes into a permutation that moves them, in the order of
//! the ray's octant, to the front of one store.
#![expect(
    unsafe_code,
    reason = "vector loads and stores through pointers, and indices that the tree guarantees"
)]

use std::arch::x86_64::*;
use std::mem::MaybeUninit;

use super::{PreparedRay, Wanted};
use super::{finished, is_better, nothing_yet, prepare};
use crate::kernels::has_avx2;
use crate::ray::{Hit, Ray};
use crate::tree::{LANES, LEAF_BIT, Leaf, Node, STACK_SIZE, Tree};

/// As [`super::scalar::trace`], bit for bit.
pub(super) fn trace(tree: &Tree, wanted: Wanted, rays: &[Ray], hits: &mut [Hit]) {
    // Anyone can write `Level::Avx2`; asking costs a few loads.
    if !has_avx2() {
        return super::scalar::trace(tree, wanted, rays, hits);
    }
    if tree.nodes.is_empty() {
        hits.fill(Hit::MISS);
        return;
    }
    // SAFETY: the features were detected above.
    unsafe {
        match wanted {
            Wanted::Closest => trace_all::<false>(tree, rays, hits),
            Wanted::Any => trace_all::<true>(tree, rays, hits),
        }
    }
}

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn trace_all<const ANY: bool>(tree: &Tree, rays: &[Ray], hits: &mut [Hit]) {
    let mut stack = Stack {
        references: MaybeUninit::uninit(),
        entries: MaybeUninit::uninit(),
    };
    for (ray, hit) in rays.iter().zip(hits) {
        *hit = match prepare(ray, tree.extent) {
            Some(ray) => walk::<ANY>(tree, &ray, &mut stack),
            None => Hit::MISS,
        };
    }
}

/// What is left to visit: entries up to a height that the walk keeps. Not cleared: 2 KiB are worth a node
/// visit or two, and a query for one ray has its own.
struct Stack {
    /// Nodes and leaves.
    references: MaybeUninit<[u32; STACK_SIZE]>,
    /// Where the ray enters them.
    entries: MaybeUninit<[f32; STACK_SIZE]>,
}

/// A ray in registers.
#[derive(Clone, Copy)]
struct WideRay {
    near_origin: [__m256; 3],
    far_origin: [__m256; 3],
    inverse: [__m256; 3],
    least: __m256,
    order_shift: __m128i,
}

/// Lanes to the front: entry m lists the set bits of m from the lowest, one nibble each.
const COMPRESS: [u32; 256] = {
    let mut table = [0; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut place) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                table[mask] |= (lane as u32) << (4 * place);
                place += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn walk<const ANY: bool>(tree: &Tree, ray: &PreparedRay, stack: &mut Stack) -> Hit {
    let splat = |x: f32| _mm256_set1_ps(x);
    let wide = WideRay {
        near_origin: ray.near_origin.map(splat),
        far_origin: ray.far_origin.map(splat),
        inverse: ray.inverse.map(splat),
        least: splat(ray.least),
        order_shift: _mm_cvtsi32_si128(ray.order_shift.cast_signed()),
    };
    let mut best = nothing_yet(ray.greatest);
    let mut height = 0;
    let mut reference = 0_u32;
    loop {
        if reference & LEAF_BIT == 0 {
            debug_assert!((reference as usize) < tree.nodes.len() && height + LANES <= STACK_SIZE);
            // SAFETY: the tree refers to its own nodes only (`collapse`).
            let node = unsafe { tree.nodes.get_unchecked(reference as usize) };
            // SAFETY: a walk never holds more than 7 entries a level, and the depth is limited so that one
            // more store of 8 fits (`tree::DEPTH_LIMIT`).
            let nearest = unsafe { enter::<ANY>(node, ray, &wide, best.t, stack, &mut height) };
            if let Some(nearest) = nearest {
                reference = nearest;
                continue;
            }
        } else {
            let index = (reference & !LEAF_BIT) as usize;
            debug_assert!(index < tree.leaves.len());
            // SAFETY: the tree refers to its own leaves only (`collapse`).
            test_leaf(unsafe { tree.leaves.get_unchecked(index) }, ray, &mut best);
            if ANY && best.is_hit() {
                return best;
            }
        }
        loop {
            if height == 0 {
                return finished(best);
            }
            height -= 1;
            // SAFETY: `height` is below a height that was pushed to, so within the array and written.
            let (entry, waiting) = unsafe {
                (
                    stack.entries.as_ptr().cast::<f32>().add(height).read(),
                    stack.references.as_ptr().cast::<u32>().add(height).read(),
                )
            };
            if entry <= best.t {
                reference = waiting;
                break;
            }
        }
    }
}

/// The nearest child that the ray enters, or `None`; the others are pushed, farthest first.
///
/// # Safety
/// The stack has room for 8 entries above `height`.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
unsafe fn enter<const ANY: bool>(
    node: &Node,
    ray: &PreparedRay,
    wide: &WideRay,
    greatest: f32,
    stack: &mut Stack,
    height: &mut usize,
) -> Option<u32> {
    let planes = node.planes.as_ptr().cast::<f32>();
    let slab = |row: usize, origin: __m256, inverse: __m256| {
        // SAFETY: `row` is below 6 and a row holds 8 floats.
        let plane = unsafe { _mm256_load_ps(planes.add(LANES * row)) };
        _mm256_mul_ps(_mm256_sub_ps(plane, origin), inverse)
    };
    let [x, y, z] = ray.near_row;
    let near_x = slab(x, wide.near_origin[0], wide.inverse[0]);
    let near_y = slab(y, wide.near_origin[1], wide.inverse[1]);
    let near_z = slab(z, wide.near_origin[2], wide.inverse[2]);
    let far_x = slab(x ^ 1, wide.far_origin[0], wide.inverse[0]);
    let far_y = slab(y ^ 1, wide.far_origin[1], wide.inverse[1]);
    let far_z = slab(z ^ 1, wide.far_origin[2], wide.inverse[2]);
    let entry = _mm256_max_ps(
        _mm256_max_ps(near_x, near_y),
        _mm256_max_ps(near_z, wide.least),
    );
    let exit = _mm256_min_ps(
        _mm256_min_ps(far_x, far_y),
        _mm256_min_ps(far_z, _mm256_set1_ps(greatest)),
    );
    let entered = _mm256_cmp_ps::<_CMP_LE_OQ>(entry, exit);
    let lanes = _mm256_movemask_ps(entered) as u32;
    if lanes & lanes.wrapping_sub(1) == 0 {
        // None, or one: no order to find.
        return (lanes != 0).then(|| node.child[(lanes.trailing_zeros() & 7) as usize]);
    }
    // SAFETY: 8 integers each.
    let (order, child) = unsafe {
        (
            _mm256_load_si256(node.order.as_ptr().cast()),
            _mm256_load_si256(node.child.as_ptr().cast()),
        )
    };
    // Permutations read the low 3 bits of each lane.
    let (order, mask) = if ANY {
        (_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7), lanes)
    } else {
        let order = _mm256_srl_epi32(order, wide.order_shift);
        let in_order = _mm256_permutevar8x32_ps(entered, order);
        (order, _mm256_movemask_ps(in_order) as u32)
    };
    let nibbles = _mm256_set1_epi32(COMPRESS[mask as usize & 255].cast_signed());
    let to_front = _mm256_srlv_epi32(nibbles, _mm256_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28));
    let lanes = _mm256_permutevar8x32_epi32(order, to_front);
    let references = _mm256_permutevar8x32_epi32(child, lanes);
    let entries = _mm256_permutevar8x32_ps(entry, lanes);
    // SAFETY: the caller left room for 8.
    unsafe {
        let place = stack.references.as_mut_ptr().cast::<u32>().add(*height);
        _mm256_storeu_si256(place.cast(), references);
        _mm256_storeu_ps(
            stack.entries.as_mut_ptr().cast::<f32>().add(*height),
            entries,
        );
    }
    *height += mask.count_ones() as usize - 1;
    // By plain loads: quicker than waiting for the store.
    let last = (31 - mask.leading_zeros()) as usize & 7;
    let lane = if ANY {
        last as u32
    } else {
        node.order[last] >> ray.order_shift
    };
    Some(node.child[lane as usize & 7])
}

/// Tests 8 triangles; keeps the best hit.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn test_leaf(leaf: &Leaf, ray: &PreparedRay, best: &mut Hit) {
    let splat = |x: f32| _mm256_set1_ps(x);
    let [shear_x, shear_y, z_scale] = ray.shear;
    let sheared: [[__m256; 3]; 3] = std::array::from_fn(|vertex| {
        let [x, y, z]: [__m256; 3] = std::array::from_fn(|k| {
            // SAFETY: a row holds 8 floats; `axes` are below 3.
            let row =
                unsafe { _mm256_load_ps(leaf.vertex[vertex].get_unchecked(ray.axes[k]).as_ptr()) };
            _mm256_sub_ps(row, splat(ray.origin[k]))
        });
        [
            _mm256_sub_ps(x, _mm256_mul_ps(splat(shear_x), z)),
            _mm256_sub_ps(y, _mm256_mul_ps(splat(shear_y), z)),
            z,
        ]
    });
    let [a, b, c] = sheared;
    let area = |p: [__m256; 3], q: [__m256; 3]| {
        _mm256_sub_ps(_mm256_mul_ps(p[0], q[1]), _mm256_mul_ps(p[1], q[0]))
    };
    let (u, v, w) = (area(c, b), area(a, c), area(b, a));
    let zero = _mm256_setzero_ps();
    let is_zero = |x: __m256| _mm256_cmp_ps::<_CMP_EQ_OQ>(x, zero);
    let on_edge = _mm256_or_ps(_mm256_or_ps(is_zero(u), is_zero(v)), is_zero(w));
    // Sign bits: set where signs differ.
    let any_negative = _mm256_or_ps(_mm256_or_ps(u, v), w);
    let all_negative = _mm256_and_ps(_mm256_and_ps(u, v), w);
    let outside = _mm256_andnot_ps(on_edge, _mm256_andnot_ps(all_negative, any_negative));
    if _mm256_movemask_ps(outside) == 255 {
        return;
    }
    if _mm256_movemask_ps(on_edge) != 0 {
        for lane in 0..LANES {
            super::scalar::test_lane(leaf, lane, ray, best);
        }
        return;
    }
    let inverse = _mm256_div_ps(splat(1.0), _mm256_add_ps(_mm256_add_ps(u, v), w));
    let depth = _mm256_add_ps(
        _mm256_add_ps(_mm256_mul_ps(u, a[2]), _mm256_mul_ps(v, b[2])),
        _mm256_mul_ps(w, c[2]),
    );
    let t = _mm256_mul_ps(_mm256_mul_ps(depth, splat(z_scale)), inverse);
    // NaN, from an empty lane or a zero sum, is out of range.
    let in_range = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GE_OQ>(t, splat(ray.least)),
        _mm256_cmp_ps::<_CMP_LE_OQ>(t, splat(best.t)),
    );
    let mut met = _mm256_movemask_ps(_mm256_andnot_ps(outside, in_range)) as u32;
    if met == 0 {
        return;
    }
    let mut rows = [[0.0_f32; LANES]; 3];
    for (row, values) in
        rows.iter_mut()
            .zip([t, _mm256_mul_ps(v, inverse), _mm256_mul_ps(w, inverse)])
    {
        // SAFETY: 8 floats.
        unsafe { _mm256_storeu_ps(row.as_mut_ptr(), values) };
    }
    // Rarely more than one.
    while met != 0 {
        let lane = (met.trailing_zeros() & 7) as usize;
        met &= met - 1;
        let hit = Hit {
            triangle: leaf.triangle[lane],
            t: rows[0][lane],
            u: rows[1][lane],
            v: rows[2][lane],
        };
        if is_better(&hit, best) {
            *best = hit;
        }
    }
}
