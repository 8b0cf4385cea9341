//! The point of a mesh that is nearest to a point in space.
//!
//! Boxes are tested in f32 with a margin for the rounding, triangles in f64: the distance is exact to f32 input,
//! also where it is a millionth of the coordinates.

use glam::{DVec3, Vec3};

use crate::kernels::traverse::COORDINATE_LIMIT;
use crate::ray::NO_TRIANGLE;
use crate::scene::Scene;
use crate::tree::{LANES, LEAF_BIT, Leaf, Node, STACK_SIZE, Tree};

/// Where a mesh is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Index of the triangle as the caller gave it; of equally near ones the lowest.
    pub triangle: u32,
    /// The nearest point, metres.
    pub point: DVec3,
    /// Its distance, metres.
    pub distance: f64,
}

/// Margin of a squared box distance: three squares and two sums round by less than 4 ulp, the differences of
/// coordinates by one each.
const BOX_SHARE: f32 = 1.0 - 16.0 * f32::EPSILON;

impl Scene {
    /// The point of the mesh nearest to `point` and at most `greatest` metres away (infinity for any); `None`
    /// without one, and where `point` is not finite. Takes logarithmic time for points near the mesh.
    pub fn nearest(&self, point: Vec3, greatest: f64) -> Option<Nearest> {
        let is_usable = point.abs().max_element() <= COORDINATE_LIMIT && !point.is_nan();
        if !is_usable || !(greatest >= 0.0) {
            return None;
        }
        walk(self.tree(), point, greatest)
    }
}

fn walk(tree: &Tree, point: Vec3, greatest: f64) -> Option<Nearest> {
    let mut best = Best {
        point: point.as_dvec3(),
        nearest: DVec3::ZERO,
        triangle: NO_TRIANGLE,
        square: greatest * greatest,
    };
    if tree.nodes.is_empty() {
        return None;
    }
    let mut stack = [(0_u32, 0.0_f32); STACK_SIZE];
    let mut height = 1;
    while height > 0 {
        height -= 1;
        let (reference, square) = stack[height];
        if f64::from(square * BOX_SHARE) > best.square {
            continue;
        }
        if reference & LEAF_BIT == 0 {
            height = push_children(
                &tree.nodes[reference as usize],
                point,
                &best,
                &mut stack,
                height,
            );
        } else {
            best.try_leaf(&tree.leaves[(reference & !LEAF_BIT) as usize]);
        }
    }
    (best.triangle != NO_TRIANGLE).then(|| Nearest {
        triangle: best.triangle,
        point: best.nearest,
        distance: best.square.sqrt(),
    })
}

/// Pushes the children that can hold something better, the nearest last; returns the new height.
fn push_children(
    node: &Node,
    point: Vec3,
    best: &Best,
    stack: &mut [(u32, f32); STACK_SIZE],
    height: usize,
) -> usize {
    let squares = box_squares(node, point);
    let mut top = height;
    for (lane, square) in squares.into_iter().enumerate() {
        // An empty lane is infinitely far.
        if !(square < f32::INFINITY && f64::from(square * BOX_SHARE) <= best.square) {
            continue;
        }
        let mut at = top;
        while at > height && stack[at - 1].1 < square {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = (node.child[lane], square);
        top += 1;
    }
    top
}

/// Squared distances to the boxes of a node; infinite for empty lanes.
fn box_squares(node: &Node, point: Vec3) -> [f32; LANES] {
    let mut squares = [0.0_f32; LANES];
    for (axis, coordinate) in point.to_array().into_iter().enumerate() {
        let (least, greatest) = (&node.planes[2 * axis], &node.planes[2 * axis + 1]);
        for lane in 0..LANES {
            let outside = (least[lane] - coordinate)
                .max(coordinate - greatest[lane])
                .max(0.0);
            squares[lane] += outside * outside;
        }
    }
    squares
}

/// The nearest point so far.
struct Best {
    point: DVec3,
    nearest: DVec3,
    triangle: u32,
    square: f64,
}

impl Best {
    fn try_leaf(&mut self, leaf: &Leaf) {
        for lane in 0..LANES {
            let corner = |vertex: usize| {
                let [x, y, z] = leaf.vertex[vertex].map(|axis| f64::from(axis[lane]));
                DVec3::new(x, y, z)
            };
            let nearest = nearest_on_triangle(self.point, [corner(0), corner(1), corner(2)]);
            let square = (nearest - self.point).length_squared();
            let triangle = leaf.triangle[lane];
            // NaN, from an empty lane, is not nearer.
            if square < self.square || (square == self.square && triangle < self.triangle) {
                self.square = square;
                self.nearest = nearest;
                self.triangle = triangle;
            }
        }
    }
}

/// The point of a closed triangle nearest to `p`, by the Voronoi region that `p` lies in (Ericson 2005, 5.1.5).
pub(crate) fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let along = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return b + (c - b) * along;
    }
    let sum = va + vb + vc;
    a + ab * (vb / sum) + ac * (vc / sum)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    use super::*;

    fn random_point(rng: &mut Pcg64, scale: f32) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|_| {
            scale * (2.0 * rng.random::<f32>() - 1.0)
        }))
    }

    /// The least distance to a triangle over a fine grid of its points: no region of the plane is special.
    fn by_sampling(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
        const STEPS: u32 = 60;
        let mut least = f64::INFINITY;
        for i in 0..=STEPS {
            for j in 0..=STEPS - i {
                let (u, v) = (
                    f64::from(i) / f64::from(STEPS),
                    f64::from(j) / f64::from(STEPS),
                );
                least = least.min((a + (b - a) * u + (c - a) * v - p).length());
            }
        }
        least
    }

    #[test]
    fn the_nearest_point_of_a_triangle_beats_any_sample_of_it() {
        let mut rng = Pcg64::seed_from_u64(3);
        for _ in 0..1000 {
            let corners = [(); 3].map(|()| random_point(&mut rng, 1.0).as_dvec3());
            let p = random_point(&mut rng, 2.0).as_dvec3();
            let nearest = nearest_on_triangle(p, corners);
            let distance = (nearest - p).length();
            let sampled = by_sampling(p, corners);
            assert!(distance <= sampled + 1e-12 && distance >= sampled - 0.08);
        }
    }

    fn random_mesh(rng: &mut Pcg64, count: usize, offset: Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        for _ in 0..count {
            let center = random_point(rng, 1.0) + offset;
            positions.extend([(); 3].map(|()| center + random_point(rng, 0.1)));
        }
        let triangles = (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        (positions, triangles.collect())
    }

    #[test]
    fn the_tree_finds_what_trying_every_triangle_finds() {
        let mut rng = Pcg64::seed_from_u64(7);
        for count in [1, 5, 9, 300] {
            // Far from the origin, where f32 boxes have few digits.
            for offset in [Vec3::ZERO, Vec3::new(300.0, -20.0, 1000.0)] {
                let (positions, triangles) = random_mesh(&mut rng, count, offset);
                let scene = Scene::new(&positions, &triangles).expect("valid indices");
                for _ in 0..300 {
                    let p = random_point(&mut rng, 1.5) + offset;
                    let found = scene
                        .nearest(p, f64::INFINITY)
                        .expect("there are triangles");
                    let best = triangles
                        .iter()
                        .map(|t| t.map(|v| positions[v as usize].as_dvec3()))
                        .map(|t| (nearest_on_triangle(p.as_dvec3(), t) - p.as_dvec3()).length())
                        .fold(f64::INFINITY, f64::min);
                    assert_eq!(found.distance, best);
                    assert!(scene.nearest(p, 0.999 * best).is_none());
                    assert_eq!(scene.nearest(p, 1.001 * best), Some(found));
                }
            }
        }
    }

    #[test]
    fn no_mesh_and_no_point_have_no_nearest() {
        let empty = Scene::new(&[], &[]).expect("nothing is a scene");
        assert_eq!(empty.nearest(Vec3::ZERO, f64::INFINITY), None);
        let scene = Scene::new(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]; 3]).expect("valid");
        for point in [Vec3::NAN, Vec3::INFINITY, Vec3::new(0.0, 2e9, 0.0)] {
            assert_eq!(scene.nearest(point, f64::INFINITY), None);
        }
        assert_eq!(scene.nearest(Vec3::Z, f64::NAN), None);
        let found = scene
            .nearest(Vec3::new(0.25, 0.25, 1.0), 1.0)
            .expect("at the limit");
        assert_eq!((found.triangle, found.distance), (0, 1.0));
    }
}
