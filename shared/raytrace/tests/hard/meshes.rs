//! Meshes with known answers.

use std::collections::HashMap;

use glam::Vec3;

/// Positions and vertex indices.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    pub(crate) fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// Unit normal by the right-hand rule.
    pub(crate) fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        (b - a).cross(c - a).normalize().as_vec3()
    }

    /// The point with barycentric weights (1 − u − v, u, v).
    pub(crate) fn point(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        let (u, v) = (f64::from(u), f64::from(v));
        (a * (1.0 - u - v) + b * u + c * v).as_vec3()
    }

    pub(crate) fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.triangles
            .extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
    }
}

/// A unit icosahedron, every triangle split in four `level` times, corners on the sphere; outward normals.
pub(crate) fn icosphere(level: u32, radius: f32, center: Vec3) -> Mesh {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut points: Vec<glam::DVec3> = Vec::new();
    for (a, b) in [
        (-1.0, golden),
        (1.0, golden),
        (-1.0, -golden),
        (1.0, -golden),
    ] {
        points.push(glam::DVec3::new(a, b, 0.0).normalize());
    }
    for (a, b) in [
        (-1.0, golden),
        (1.0, golden),
        (-1.0, -golden),
        (1.0, -golden),
    ] {
        points.push(glam::DVec3::new(0.0, a, b).normalize());
    }
    for (a, b) in [
        (golden, -1.0),
        (golden, 1.0),
        (-golden, -1.0),
        (-golden, 1.0),
    ] {
        points.push(glam::DVec3::new(a, 0.0, b).normalize());
    }
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..level {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    let center = center.as_dvec3();
    Mesh {
        positions: points
            .iter()
            .map(|p| (center + *p * f64::from(radius)).as_vec3())
            .collect(),
        triangles,
    }
}

/// The box [least, greatest] of 12 triangles.
pub(crate) fn cuboid(least: Vec3, greatest: Vec3) -> Mesh {
    let positions = (0..8)
        .map(|corner| {
            let pick = |axis: usize| {
                if corner >> axis & 1 == 0 {
                    least[axis]
                } else {
                    greatest[axis]
                }
            };
            Vec3::new(pick(0), pick(1), pick(2))
        })
        .collect();
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = faces
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    Mesh {
        positions,
        triangles,
    }
}

/// Nearest t by Cramer's rule in f64, triangles as closed sets.
pub(crate) fn brute_force(mesh: &Mesh, origin: Vec3, direction: Vec3) -> Option<f64> {
    let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
    let hits = mesh.triangles.iter().filter_map(|triangle| {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize].as_dvec3());
        let (e1, e2, s) = (b - a, c - a, o - a);
        let determinant = e1.dot(d.cross(e2));
        let u = s.dot(d.cross(e2)) / determinant;
        let v = d.dot(s.cross(e1)) / determinant;
        let t = e2.dot(s.cross(e1)) / determinant;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
    });
    hits.min_by(f64::total_cmp)
}
