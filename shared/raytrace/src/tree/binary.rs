//! Binary trees over padded boxes.

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};

use super::Triangle;

/// A node of a binary tree: a triangle or two subtrees.
#[derive(Clone, Copy, Debug)]
pub(super) struct BinaryNode {
    pub(super) least: Vec3,
    pub(super) greatest: Vec3,
    pub(super) kind: Kind,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    /// Position in the list of triangles.
    Triangle(u32),
    /// Indices of both children.
    Inner(u32, u32),
}

/// A box around a triangle, 2 ulp larger on every side (hard-cases E02). What else rounding needs depends on
/// the ray, which brings its own margin.
struct PaddedBox(Aabb);

impl Boundable for PaddedBox {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

fn padded_box(triangle: &Triangle) -> (Vec3, Vec3) {
    let [a, b, c] = triangle.vertices;
    let (least, greatest) = (a.min(b).min(c), a.max(b).max(c));
    let down = |x: f32| x.next_down().next_down();
    let up = |x: f32| x.next_up().next_up();
    (least.map(down), greatest.map(up))
}

/// obvhs' `medium_build` with single triangles as leaves: leaves are formed by the collapse.
fn parameters() -> BvhBuildParams {
    BvhBuildParams {
        max_prims_per_leaf: 1,
        post_collapse_reinsertion_batch_ratio_multiplier: 0.0,
        ..BvhBuildParams::medium_build()
    }
}

/// The tree of obvhs; node 0 is the root. `triangles` must not be empty.
///
/// obvhs sorts by centroids and takes quadratic time where many are equal (hard-cases E08): triangles with one
/// centroid go in as one box, below which they are halved.
pub(super) fn build(triangles: &[Triangle]) -> Vec<BinaryNode> {
    let order = by_centroid(triangles);
    let groups: Vec<&[(Centroid, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
    let boxes: Vec<PaddedBox> = groups
        .iter()
        .map(|group| {
            let bounds = group
                .iter()
                .map(|&(_, position)| padded_box(&triangles[position as usize]));
            let (least, greatest) = bounds.reduce(union).expect("no chunk is empty");
            PaddedBox(Aabb::new(Vec3A::from(least), Vec3A::from(greatest)))
        })
        .collect();
    let bvh = build_bvh2(&boxes, parameters(), &mut Duration::default());
    let mut nodes: Vec<BinaryNode> = bvh
        .nodes
        .iter()
        .map(|node| BinaryNode {
            least: Vec3::from(node.aabb().min),
            greatest: Vec3::from(node.aabb().max),
            kind: if node.is_leaf() {
                Kind::Triangle(bvh.primitive_indices[node.first_index as usize])
            } else {
                Kind::Inner(node.first_index, node.first_index + 1)
            },
        })
        .collect();
    for index in 0..nodes.len() {
        let Kind::Triangle(group) = nodes[index].kind else {
            continue;
        };
        nodes[index].kind = match groups[group as usize] {
            [(_, position)] => Kind::Triangle(*position),
            group => {
                let positions: Vec<u32> = group.iter().map(|&(_, position)| position).collect();
                let top = halve_range(&positions, triangles, &mut nodes);
                nodes[top as usize].kind
            }
        };
    }
    nodes
}

/// Bits of a box's centre.
type Centroid = [u32; 3];

/// Positions of triangles, sorted by centroid and then position.
fn by_centroid(triangles: &[Triangle]) -> Vec<(Centroid, u32)> {
    let mut order: Vec<(Centroid, u32)> = triangles
        .iter()
        .enumerate()
        .map(|(position, triangle)| {
            let (least, greatest) = padded_box(triangle);
            (
                ((least + greatest) * 0.5).to_array().map(f32::to_bits),
                position as u32,
            )
        })
        .collect();
    order.sort_unstable();
    order
}

fn union(a: (Vec3, Vec3), b: (Vec3, Vec3)) -> (Vec3, Vec3) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// A balanced tree over the triangles in the order in which `built` visits them.
pub(super) fn halve(built: &[BinaryNode], triangles: &[Triangle]) -> Vec<BinaryNode> {
    let mut order = Vec::with_capacity(triangles.len());
    let mut waiting = vec![0_u32];
    while let Some(index) = waiting.pop() {
        match built[index as usize].kind {
            Kind::Triangle(position) => order.push(position),
            Kind::Inner(left, right) => waiting.extend([right, left]),
        }
    }
    let mut nodes = Vec::with_capacity(2 * order.len());
    halve_range(&order, triangles, &mut nodes);
    nodes
}

/// Appends the tree over `order`, root first; recursion is as deep as the logarithm of its length.
fn halve_range(order: &[u32], triangles: &[Triangle], nodes: &mut Vec<BinaryNode>) -> u32 {
    let index = nodes.len();
    if let [position] = *order {
        let (least, greatest) = padded_box(&triangles[position as usize]);
        nodes.push(BinaryNode {
            least,
            greatest,
            kind: Kind::Triangle(position),
        });
        return index as u32;
    }
    nodes.push(BinaryNode {
        least: Vec3::ZERO,
        greatest: Vec3::ZERO,
        kind: Kind::Triangle(0),
    });
    let (first, second) = order.split_at(order.len() / 2);
    let left = halve_range(first, triangles, nodes);
    let right = halve_range(second, triangles, nodes);
    let (l, r) = (nodes[left as usize], nodes[right as usize]);
    nodes[index] = BinaryNode {
        least: l.least.min(r.least),
        greatest: l.greatest.max(r.greatest),
        kind: Kind::Inner(left, right),
    };
    index as u32
}
