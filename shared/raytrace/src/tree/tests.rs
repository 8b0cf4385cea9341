use super::*;

fn strip(count: u32) -> Vec<Triangle> {
    (0..count)
        .map(|index| {
            let x = index as f32;
            Triangle {
                vertices: [
                    Vec3::new(x, 0.0, 0.0),
                    Vec3::new(x + 1.0, 0.0, 0.0),
                    Vec3::new(x, 1.0, 0.5),
                ],
                index,
            }
        })
        .collect()
}

/// Every triangle index below a node, with a check that boxes hold what is below them.
fn indices_below(tree: &Tree, node: u32, seen: &mut Vec<u32>) {
    let node = &tree.nodes[node as usize];
    for lane in 0..LANES {
        if node.planes[0][lane] == f32::INFINITY {
            continue;
        }
        let before = seen.len();
        if node.child[lane] & LEAF_BIT == 0 {
            indices_below(tree, node.child[lane], seen);
            continue;
        }
        let leaf = &tree.leaves[(node.child[lane] & !LEAF_BIT) as usize];
        for slot in (0..LANES).filter(|&slot| leaf.triangle[slot] != u32::MAX) {
            seen.push(leaf.triangle[slot]);
            for vertex in leaf.vertex {
                for (axis, coordinates) in vertex.iter().enumerate() {
                    assert!(node.planes[2 * axis][lane] < coordinates[slot]);
                    assert!(node.planes[2 * axis + 1][lane] > coordinates[slot]);
                }
            }
        }
        assert!(seen.len() > before, "no leaf is empty");
    }
}

#[test]
fn every_triangle_is_in_one_leaf_inside_its_box() {
    for count in [1, 2, 7, 8, 9, 63, 64, 65, 1000] {
        let tree = Tree::new(&strip(count));
        let mut seen = Vec::new();
        indices_below(&tree, 0, &mut seen);
        seen.sort_unstable();
        assert_eq!(seen, (0..count).collect::<Vec<_>>());
    }
}

#[test]
fn halving_bounds_the_depth() {
    let triangles = strip(5000);
    let halved = binary::halve(&binary::build(&triangles), &triangles);
    let (tree, depth) = collapse::collapse(&halved, &triangles);
    assert!(depth <= 13, "2^13 > 5000, got {depth}");
    let mut seen = Vec::new();
    indices_below(&tree, 0, &mut seen);
    assert_eq!(seen.len(), 5000);
}

#[test]
fn children_are_ordered_along_the_direction() {
    let tree = Tree::new(&strip(64));
    let node = &tree.nodes[0];
    for (octant, sign) in [(0, 1.0), (1, -1.0)] {
        let met: Vec<f32> = node
            .order
            .iter()
            .map(|order| (order >> (3 * octant) & 7) as usize)
            .filter(|&lane| node.planes[0][lane].is_finite())
            .map(|lane| sign * node.planes[if octant == 0 { 0 } else { 1 }][lane])
            .collect();
        assert!(met.is_sorted_by(|a, b| a >= b), "farthest first: {met:?}");
    }
}

#[test]
fn a_chain_of_ever_larger_triangles_is_walked_to_its_end() {
    use crate::kernels::Level;
    use crate::kernels::traverse::{Wanted, trace};
    use crate::ray::{Hit, Ray};

    // Each holds all before it in its box: the worst case for depth.
    let triangles: Vec<Triangle> = (0..400_u32)
        .map(|index| {
            let size = 1e-4 * 1.07_f32.powi(index.cast_signed());
            let vertices = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * size);
            Triangle { vertices, index }
        })
        .collect();
    let tree = Tree::new(&triangles);
    let mut seen = Vec::new();
    indices_below(&tree, 0, &mut seen);
    assert_eq!(seen.len(), 400);
    for level in [Level::Scalar, Level::detect()] {
        for triangle in &triangles {
            let aim = triangle.vertices[0] * (1.0 / 3.0)
                + (triangle.vertices[1] + triangle.vertices[2]) / 3.0;
            let rays = [Ray {
                least: 0.98,
                ..Ray::new(Vec3::ZERO, aim)
            }];
            let mut hits = [Hit::MISS];
            trace(level, &tree, Wanted::Closest, &rays, &mut hits);
            assert_eq!(hits[0].triangle, triangle.index);
        }
    }
}
