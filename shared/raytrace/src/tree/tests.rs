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
                for axis in 0..3 {
                    assert!(node.planes[2 * axis][lane] < vertex[axis][slot]);
                    assert!(node.planes[2 * axis + 1][lane] > vertex[axis][slot]);
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
