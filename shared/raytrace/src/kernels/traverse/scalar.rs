//! The walk, one box and one triangle after the other.

use super::{PreparedRay, Sheared, Wanted};
use super::{edges_in_f64, finished, hit_from_edges, is_better, nothing_yet, prepare};
use crate::ray::{Hit, Ray};
use crate::tree::{LANES, LEAF_BIT, Leaf, Node, STACK_SIZE, Tree};

/// Answers `rays` in order.
pub(super) fn trace(tree: &Tree, wanted: Wanted, rays: &[Ray], hits: &mut [Hit]) {
    for (ray, hit) in rays.iter().zip(hits) {
        *hit = match prepare(ray, tree.extent) {
            Some(ray) if !tree.nodes.is_empty() => walk(tree, wanted, &ray),
            _ => Hit::MISS,
        };
    }
}

fn walk(tree: &Tree, wanted: Wanted, ray: &PreparedRay) -> Hit {
    let mut best = nothing_yet(ray.greatest);
    let mut stack = [(0_u32, 0.0_f32); STACK_SIZE];
    stack[0] = (0, ray.least);
    let mut height = 1;
    while height > 0 {
        height -= 1;
        let (reference, entry) = stack[height];
        if entry > best.t {
            continue;
        }
        if reference & LEAF_BIT == 0 {
            let node = &tree.nodes[reference as usize];
            let entries = enter(node, ray, best.t);
            for (position, order) in node.order.iter().enumerate() {
                // Which hit comes first does not matter to Wanted::Any, and sorting takes time.
                let lane = match wanted {
                    Wanted::Closest => (order >> ray.order_shift & 7) as usize,
                    Wanted::Any => position,
                };
                if let Some(entry) = entries[lane] {
                    stack[height] = (node.child[lane], entry);
                    height += 1;
                }
            }
        } else {
            test_leaf(
                &tree.leaves[(reference & !LEAF_BIT) as usize],
                ray,
                &mut best,
            );
            if wanted == Wanted::Any && best.is_hit() {
                break;
            }
        }
    }
    finished(best)
}

/// Where the ray enters each box within its range, in lengths of its direction.
fn enter(node: &Node, ray: &PreparedRay, greatest: f32) -> [Option<f32>; LANES] {
    std::array::from_fn(|lane| {
        let (mut entry, mut exit) = (ray.least, greatest);
        for axis in 0..3 {
            let near = node.planes[ray.near_row[axis]][lane];
            let far = node.planes[ray.near_row[axis] ^ 1][lane];
            entry = entry.max((near - ray.near_origin[axis]) * ray.inverse[axis]);
            exit = exit.min((far - ray.far_origin[axis]) * ray.inverse[axis]);
        }
        (entry <= exit).then_some(entry)
    })
}

fn test_leaf(leaf: &Leaf, ray: &PreparedRay, best: &mut Hit) {
    for lane in 0..LANES {
        test_lane(leaf, lane, ray, best);
    }
}

/// Tests one triangle; keeps the better hit.
pub(super) fn test_lane(leaf: &Leaf, lane: usize, ray: &PreparedRay, best: &mut Hit) {
    let sheared = shear(leaf, lane, ray);
    let mut edges = edges(&sheared);
    if edges.contains(&0.0) {
        edges = edges_in_f64(&sheared);
    }
    let hit = hit_from_edges(
        &sheared,
        edges,
        ray.shear[2],
        leaf.triangle[lane],
        ray.least,
        best.t,
    );
    if let Some(hit) = hit.filter(|hit| is_better(hit, best)) {
        *best = hit;
    }
}

/// The triangle of a lane in the ray's sheared axes.
fn shear(leaf: &Leaf, lane: usize, ray: &PreparedRay) -> Sheared {
    std::array::from_fn(|vertex| {
        let [x, y, z]: [f32; 3] =
            std::array::from_fn(|k| leaf.vertex[vertex][ray.axes[k]][lane] - ray.origin[k]);
        [x - ray.shear[0] * z, y - ray.shear[1] * z, z]
    })
}

/// Twice the signed areas opposite each vertex.
fn edges([a, b, c]: &Sheared) -> [f32; 3] {
    [
        c[0] * b[1] - c[1] * b[0],
        a[0] * c[1] - a[1] * c[0],
        b[0] * a[1] - b[1] * a[0],
    ]
}

/// The nearest hits without any box: what a tree must not change.
#[cfg(test)]
pub(super) fn trace_by_force(tree: &Tree, rays: &[Ray], hits: &mut [Hit]) {
    for (ray, hit) in rays.iter().zip(hits) {
        let Some(ray) = prepare(ray, tree.extent) else {
            continue;
        };
        let mut best = nothing_yet(ray.greatest);
        for leaf in &tree.leaves {
            test_leaf(leaf, &ray, &mut best);
        }
        *hit = finished(best);
    }
}
