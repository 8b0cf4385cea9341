//! The hierarchy that rays walk: 8 boxes a node, 8 triangles a leaf.
//!
//! obvhs builds a binary tree over padded boxes ([`binary`]); [`collapse`] turns it into the 8-wide tree of
//! least expected cost.

mod binary;
mod collapse;

use glam::Vec3;

/// Boxes of a node and triangles of a leaf: the lanes of one AVX register.
pub(crate) const LANES: usize = 8;

/// Set in a child reference that names a leaf.
pub(crate) const LEAF_BIT: u32 = 1 << 31;

/// Entries of a traversal stack. Each level of the tree leaves at most 7 behind.
pub(crate) const STACK_SIZE: usize = 256;

/// Deepest tree whose walk fits the stack: 7 entries a level, and a last store of 8.
const DEPTH_LIMIT: usize = (STACK_SIZE - LANES) / (LANES - 1);

/// Up to 8 children with their boxes: four cache lines.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Node {
    /// Planes by lane: row 2·axis is the least, row 2·axis + 1 the greatest coordinate. An empty lane has
    /// +∞ and −∞, which no ray enters.
    pub(crate) planes: [[f32; LANES]; 6],
    /// Index of a node, or of a leaf with [`LEAF_BIT`].
    pub(crate) child: [u32; LANES],
    /// For each of the 8 direction octants (bit = axis runs backwards), 3 bits at 3·octant in each entry:
    /// the lanes from the farthest child to the nearest.
    pub(crate) order: [u32; LANES],
}

/// Up to 8 triangles; empty lanes are NaN, which no ray hits.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub(crate) struct Leaf {
    /// Coordinates by vertex, axis, lane.
    pub(crate) vertex: [[[f32; LANES]; 3]; 3],
    /// The caller's triangle index by lane.
    pub(crate) triangle: [u32; LANES],
}

/// A whole tree. Node 0 is the root; a tree without nodes is empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node>,
    pub(crate) leaves: Vec<Leaf>,
    /// Largest absolute coordinate of any box, metres.
    pub(crate) extent: f32,
}

/// A triangle to put into the tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub(crate) vertices: [Vec3; 3],
    pub(crate) index: u32,
}

impl Tree {
    /// A tree over finite triangles.
    pub(crate) fn new(triangles: &[Triangle]) -> Self {
        if triangles.is_empty() {
            return Self::default();
        }
        let built = binary::build(triangles);
        let (tree, depth) = collapse::collapse(&built, triangles);
        if depth <= DEPTH_LIMIT {
            return tree;
        }
        // Pathological input (hard-cases E08): halving an order bounds the depth by its logarithm, 31 at most.
        let (tree, depth) = collapse::collapse(&binary::halve(&built, triangles), triangles);
        assert!(depth <= DEPTH_LIMIT, "a halved tree is at most 32 deep");
        tree
    }
}

#[cfg(test)]
mod tests;
