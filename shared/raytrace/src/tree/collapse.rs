//! From a binary tree to the 8-wide tree of least expected cost.
//!
//! Ylitie, Karras, Laine: *Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs* (2017),
//! section 4.2: for every subtree the least cost C(n, i) of showing it to its parent as at most i children,
//! from the leaves upwards.

use glam::Vec3;

use super::binary::{BinaryNode, Kind};
use super::{LANES, LEAF_BIT, Leaf, Node, Tree, Triangle};

/// Expected cost of visiting a node, by area.
const NODE_COST: f32 = 1.0;
/// Expected cost of visiting a leaf. A leaf ends a chain of dependent loads where a node continues it: of 0.3,
/// 0.5, 1, 1.5 and 2.5 the quickest on the mesh of `tests/peers/raycast_embree.py`.
const LEAF_COST: f32 = 0.5;

/// The best way to show a subtree to its parent.
#[derive(Clone, Copy, Debug)]
struct Plan {
    /// Least cost with at most `i + 1` children.
    cost: [f32; LANES - 1],
    /// For at most `i + 1` children: how many the left half gets; 0 = one child suffices.
    left_share: [u8; LANES - 1],
    /// As a node of its own: how many of 8 children the left half gets; 0 = as a leaf.
    own_left_share: u8,
    /// Triangles below.
    count: u32,
}

/// Collapses `binary`; returns the tree and its depth in nodes.
pub(super) fn collapse(binary: &[BinaryNode], triangles: &[Triangle]) -> (Tree, usize) {
    let plans = plan(binary);
    let mut tree = Tree {
        nodes: vec![EMPTY_NODE],
        leaves: Vec::new(),
        extent: extent(&binary[0]),
    };
    let mut depth = 0;
    let mut waiting = vec![(0_u32, 0_usize, 1_usize)];
    let mut children = Vec::with_capacity(LANES);
    while let Some((index, place, level)) = waiting.pop() {
        depth = depth.max(level);
        children.clear();
        let own_left_share = plans[index as usize].own_left_share;
        match binary[index as usize].kind {
            // The root alone can be a leaf here.
            Kind::Inner(left, right) if own_left_share > 0 => {
                gather(left, own_left_share, binary, &plans, &mut children);
                gather(
                    right,
                    LANES as u8 - own_left_share,
                    binary,
                    &plans,
                    &mut children,
                );
            }
            _ => children.push(index),
        }
        for (lane, &child) in children.iter().enumerate() {
            let reference = if plans[child as usize].own_left_share == 0 {
                tree.leaves.push(leaf(child, binary, triangles));
                LEAF_BIT | (tree.leaves.len() - 1) as u32
            } else {
                tree.nodes.push(EMPTY_NODE);
                let next = tree.nodes.len() - 1;
                waiting.push((child, next, level + 1));
                next as u32
            };
            put(
                &mut tree.nodes[place],
                lane,
                &binary[child as usize],
                reference,
            );
        }
        tree.nodes[place].order = order(&tree.nodes[place], children.len());
    }
    (tree, depth)
}

const EMPTY_NODE: Node = Node {
    planes: {
        let (least, greatest) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        [least, greatest, least, greatest, least, greatest]
    },
    child: [0; LANES],
    order: [0; LANES],
};

fn half_area(node: &BinaryNode) -> f32 {
    let d = node.greatest - node.least;
    d.x * d.y + d.y * d.z + d.z * d.x
}

fn extent(root: &BinaryNode) -> f32 {
    root.least.abs().max(root.greatest.abs()).max_element()
}

/// Plans every subtree, children before parents.
fn plan(binary: &[BinaryNode]) -> Vec<Plan> {
    let mut parents_first = Vec::with_capacity(binary.len());
    let mut waiting = vec![0_u32];
    while let Some(index) = waiting.pop() {
        parents_first.push(index);
        if let Kind::Inner(left, right) = binary[index as usize].kind {
            waiting.extend([left, right]);
        }
    }
    let unplanned = Plan {
        cost: [0.0; LANES - 1],
        left_share: [0; LANES - 1],
        own_left_share: 0,
        count: 0,
    };
    let mut plans = vec![unplanned; binary.len()];
    for &index in parents_first.iter().rev() {
        let node = &binary[index as usize];
        let area = half_area(node);
        plans[index as usize] = match node.kind {
            Kind::Triangle(_) => Plan {
                cost: [area * LEAF_COST; LANES - 1],
                count: 1,
                ..unplanned
            },
            Kind::Inner(left, right) => {
                plan_inner(area, &plans[left as usize], &plans[right as usize])
            }
        };
    }
    plans
}

fn plan_inner(area: f32, left: &Plan, right: &Plan) -> Plan {
    // Least cost of both halves as at most `children` children of one node, and the left half's share.
    let distributed = |children: usize| {
        let mut best = (f32::INFINITY, 0_u8);
        for share in 1..children {
            let cost = left.cost[share - 1] + right.cost[children - share - 1];
            if cost < best.0 {
                best = (cost, share as u8);
            }
        }
        best
    };
    let count = left.count + right.count;
    let (below, own_left_share) = distributed(LANES);
    let as_node = area * NODE_COST + below;
    let as_leaf = area * LEAF_COST;
    let is_leaf = count as usize <= LANES && as_leaf <= as_node;
    let mut plan = Plan {
        cost: [if is_leaf { as_leaf } else { as_node }; LANES - 1],
        left_share: [0; LANES - 1],
        own_left_share: if is_leaf { 0 } else { own_left_share },
        count,
    };
    for children in 2..LANES {
        let (cost, share) = distributed(children);
        let (before, before_share) = (plan.cost[children - 2], plan.left_share[children - 2]);
        // A share planned for fewer children stays valid with more.
        (plan.cost[children - 1], plan.left_share[children - 1]) = if cost < before {
            (cost, share)
        } else {
            (before, before_share)
        };
    }
    plan
}

/// Appends the subtrees that stand for `index` among at most `limit` children.
fn gather(index: u32, limit: u8, binary: &[BinaryNode], plans: &[Plan], children: &mut Vec<u32>) {
    // Depth of recursion is below 8: every level splits the limit.
    let share = plans[index as usize].left_share[usize::from(limit) - 1];
    match binary[index as usize].kind {
        Kind::Inner(left, right) if share > 0 => {
            gather(left, share, binary, plans, children);
            gather(right, limit - share, binary, plans, children);
        }
        _ => children.push(index),
    }
}

fn leaf(index: u32, binary: &[BinaryNode], triangles: &[Triangle]) -> Leaf {
    let mut leaf = Leaf {
        vertex: [[[f32::NAN; LANES]; 3]; 3],
        triangle: [u32::MAX; LANES],
    };
    let mut waiting = vec![index];
    let mut lane = 0;
    while let Some(index) = waiting.pop() {
        match binary[index as usize].kind {
            Kind::Inner(left, right) => waiting.extend([right, left]),
            Kind::Triangle(position) => {
                let triangle = &triangles[position as usize];
                for (vertex, point) in triangle.vertices.iter().enumerate() {
                    for axis in 0..3 {
                        leaf.vertex[vertex][axis][lane] = point[axis];
                    }
                }
                leaf.triangle[lane] = triangle.index;
                lane += 1;
            }
        }
    }
    leaf
}

fn put(node: &mut Node, lane: usize, child: &BinaryNode, reference: u32) {
    for axis in 0..3 {
        node.planes[2 * axis][lane] = child.least[axis];
        node.planes[2 * axis + 1][lane] = child.greatest[axis];
    }
    node.child[lane] = reference;
}

/// The order of lanes for all octants: by the corner that a ray of the octant's diagonal meets first.
fn order(node: &Node, child_count: usize) -> [u32; LANES] {
    let mut order = [0; LANES];
    for octant in 0..8_u32 {
        let backwards = |axis: usize| octant >> axis & 1 == 1;
        let entry = |lane: usize| {
            let corner = Vec3::from_array(std::array::from_fn(|axis| {
                if backwards(axis) {
                    -node.planes[2 * axis + 1][lane]
                } else {
                    node.planes[2 * axis][lane]
                }
            }));
            if lane < child_count {
                corner.element_sum()
            } else {
                f32::INFINITY
            }
        };
        let mut lanes: [usize; LANES] = std::array::from_fn(|lane| lane);
        lanes.sort_by(|&a, &b| entry(b).total_cmp(&entry(a)));
        for (position, &lane) in lanes.iter().enumerate() {
            order[position] |= (lane as u32) << (3 * octant);
        }
    }
    order
}
