//! Finding the object without a mask: dominant planes and background go, each part that remains is a
//! segment.

use std::collections::BTreeMap;

use fusion::Mesh;
use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use serde::{Deserialize, Serialize};

/// A plane `normal · x = offset` that carries much of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DominantPlane {
    /// Unit normal in world axes, on the side of the cameras.
    pub normal: [f32; 3],
    /// Offset along the normal, metres (relative to the mesh's origin).
    pub offset: f32,
    /// Share of the surface's area that lies on it.
    pub area_fraction: f32,
}

/// A connected part of the surface that is no plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// Number from 1, largest area first.
    pub id: u16,
    /// Area, square metres.
    pub area: f32,
    /// Centroid, relative to the mesh's origin, metres.
    pub centroid: [f32; 3],
}

/// The object and what was left out.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectParts {
    /// Planes that were left out, largest first.
    pub planes: Vec<DominantPlane>,
    /// Segments by number.
    pub segments: Vec<Segment>,
    /// Segment of every vertex, 0 = plane, background or crumb.
    pub vertex_segment: Vec<u16>,
}

/// A box in world axes, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldBox {
    /// Smallest corner.
    pub low: [f64; 3],
    /// Largest corner.
    pub high: [f64; 3],
}

impl WorldBox {
    /// Whether a world point lies inside.
    pub fn contains(&self, point: glam::DVec3) -> bool {
        let point = point.to_array();
        (0..3).all(|axis| point[axis] >= self.low[axis] && point[axis] <= self.high[axis])
    }
}

/// A plane counts as dominant from this share of the whole area.
const LEAST_PLANE_AREA: f32 = 0.12;
/// At most this many planes are left out.
const MOST_PLANES: usize = 4;
/// Random triples tried for a plane.
const PLANE_TRIALS: usize = 400;
/// A vertex lies on a plane within this distance, metres …
const PLANE_DISTANCE: f32 = 0.006;
/// … or within this distance when its normal agrees: fused planes bulge where they are seen at a slant.
const PLANE_DISTANCE_ALIGNED: f32 = 0.012;
/// Cosine of the largest angle at which a normal agrees with a plane's (25 degrees).
const PLANE_COSINE: f32 = 0.906;
/// A segment has at least this area, square metres (a patch of 4 cm by 4 cm).
const LEAST_SEGMENT_AREA: f32 = 1.6e-3;
/// A segment has at least this share of the largest segment's area.
const LEAST_SEGMENT_SHARE: f32 = 0.02;

/// Area of every triangle.
fn triangle_areas(mesh: &Mesh) -> Vec<f32> {
    mesh.triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            0.5 * (b - a).cross(c - a).length()
        })
        .collect()
}

/// A third of the area of the triangles around each vertex.
fn vertex_areas(mesh: &Mesh, triangle_areas: &[f32]) -> Vec<f32> {
    let mut areas = vec![0.0; mesh.positions.len()];
    for (triangle, area) in mesh.triangles.iter().zip(triangle_areas) {
        for &vertex in triangle {
            areas[vertex as usize] += area / 3.0;
        }
    }
    areas
}

/// The best plane through the vertices that are still `free`, by area, refined by least squares.
fn best_plane(
    mesh: &Mesh,
    areas: &[f32],
    free: &[u32],
    rng: &mut rand_pcg::Pcg64,
) -> Option<(Vec3, f32, f32)> {
    // A subset is enough to vote; the winner is measured on all.
    let step = (free.len() / 20_000).max(1);
    let voters: Vec<u32> = free.iter().copied().step_by(step).collect();
    let supports = |normal: Vec3, offset: f32, vertex: u32| {
        let index = vertex as usize;
        (normal.dot(mesh.positions[index]) - offset).abs() < PLANE_DISTANCE
            && normal.dot(mesh.normals[index]) > PLANE_COSINE
    };
    let area_of = |normal: Vec3, offset: f32, vertices: &[u32]| -> f32 {
        vertices
            .iter()
            .filter(|&&v| supports(normal, offset, v))
            .map(|&v| areas[v as usize])
            .sum()
    };
    let mut best = (Vec3::ZERO, 0.0_f32, 0.0_f32);
    for _ in 0..PLANE_TRIALS {
        let [a, b, c] =
            [(); 3].map(|()| mesh.positions[voters[rng.random_range(0..voters.len())] as usize]);
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            continue;
        };
        for normal in [normal, -normal] {
            let offset = normal.dot(a);
            let area = area_of(normal, offset, &voters);
            if area > best.2 {
                best = (normal, offset, area);
            }
        }
    }
    if best.2 <= 0.0 {
        return None;
    }
    let (mut normal, mut offset, _) = best;
    for _ in 0..3 {
        let inliers: Vec<u32> = free
            .iter()
            .copied()
            .filter(|&v| supports(normal, offset, v))
            .collect();
        let (refined_normal, refined_offset) = fit_plane(mesh, areas, &inliers, normal)?;
        (normal, offset) = (refined_normal, refined_offset);
    }
    Some((normal, offset, area_of(normal, offset, free)))
}

/// Area-weighted mean plane of vertices: mean normal of their scatter by inverse iteration from `guess`.
fn fit_plane(mesh: &Mesh, areas: &[f32], vertices: &[u32], guess: Vec3) -> Option<(Vec3, f32)> {
    let weight: f64 = vertices.iter().map(|&v| f64::from(areas[v as usize])).sum();
    if !(weight > 0.0) {
        return None;
    }
    let weighted = |v: u32| {
        (
            mesh.positions[v as usize].as_dvec3(),
            f64::from(areas[v as usize]),
        )
    };
    let mean = vertices
        .iter()
        .map(|&v| weighted(v))
        .map(|(p, w)| p * w)
        .sum::<glam::DVec3>()
        / weight;
    let mut scatter = glam::DMat3::ZERO;
    for &vertex in vertices {
        let (position, w) = weighted(vertex);
        let d = position - mean;
        scatter += glam::DMat3::from_cols(d * d.x, d * d.y, d * d.z) * (w / weight);
    }
    // The normal belongs to the smallest eigenvalue; a small shift keeps a perfect plane invertible.
    let trace = scatter.x_axis.x + scatter.y_axis.y + scatter.z_axis.z;
    let inverse =
        (scatter + glam::DMat3::from_diagonal(glam::DVec3::splat(1e-6 * trace))).inverse();
    let mut normal = guess.as_dvec3();
    for _ in 0..8 {
        normal = (inverse * normal).try_normalize()?;
    }
    if normal.dot(guess.as_dvec3()) < 0.0 {
        normal = -normal;
    }
    Some((normal.as_vec3(), normal.dot(mean) as f32))
}

/// Finds planes and segments. `inside` narrows the object (all vertices when `None`); the result depends
/// on nothing but mesh, box and seed. Where nothing stands out from the planes, they are the object: a sheet or a
/// picture that fills the view.
pub fn find_object(mesh: &Mesh, inside: Option<&WorldBox>, seed: u64) -> ObjectParts {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let triangle_areas = triangle_areas(mesh);
    let areas = vertex_areas(mesh, &triangle_areas);
    let total: f32 = areas.iter().map(|&a| f64::from(a)).sum::<f64>() as f32;
    let mut on_plane = vec![false; mesh.positions.len()];
    let mut planes = Vec::new();
    let mut free: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    while planes.len() < MOST_PLANES && free.len() > 100 {
        let Some((normal, offset, area)) = best_plane(mesh, &areas, &free, &mut rng) else {
            break;
        };
        if area < LEAST_PLANE_AREA * total {
            break;
        }
        planes.push(DominantPlane {
            normal: normal.to_array(),
            offset,
            area_fraction: area / total,
        });
        for (index, taken) in on_plane.iter_mut().enumerate() {
            let distance = (normal.dot(mesh.positions[index]) - offset).abs();
            let aligned = normal.dot(mesh.normals[index]) > PLANE_COSINE;
            *taken |= distance < PLANE_DISTANCE || (aligned && distance < PLANE_DISTANCE_ALIGNED);
        }
        free.retain(|&v| !on_plane[v as usize]);
    }
    let outside: Vec<bool> = mesh
        .positions
        .iter()
        .map(|p| inside.is_some_and(|inside| !inside.contains(p.as_dvec3() + mesh.origin)))
        .collect();
    for (left_out, &is_outside) in on_plane.iter_mut().zip(&outside) {
        *left_out |= is_outside;
    }
    let (mut segments, mut vertex_segment) = connected_parts(mesh, &areas, &on_plane);
    if segments.is_empty() && !planes.is_empty() {
        planes.clear();
        (segments, vertex_segment) = connected_parts(mesh, &areas, &outside);
    }
    ObjectParts {
        planes,
        segments,
        vertex_segment,
    }
}

/// Connected parts of what is not left out, largest first; crumbs are dropped.
fn connected_parts(mesh: &Mesh, areas: &[f32], left_out: &[bool]) -> (Vec<Segment>, Vec<u16>) {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for triangle in &mesh.triangles {
        for (a, b) in [(triangle[0], triangle[1]), (triangle[1], triangle[2])] {
            if !left_out[a as usize] && !left_out[b as usize] {
                let (a, b) = (find(&mut parent, a), find(&mut parent, b));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    let mut parts: BTreeMap<u32, (f64, glam::DVec3)> = BTreeMap::new();
    for vertex in 0..mesh.positions.len() as u32 {
        if !left_out[vertex as usize] {
            let area = f64::from(areas[vertex as usize]);
            let part = parts.entry(find(&mut parent, vertex)).or_default();
            part.0 += area;
            part.1 += mesh.positions[vertex as usize].as_dvec3() * area;
        }
    }
    let mut order: Vec<(u32, f64, glam::DVec3)> = parts
        .into_iter()
        .map(|(root, (area, moment))| (root, area, moment / area.max(1e-12)))
        .collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let largest = order.first().map_or(0.0, |part| part.1);
    let least = f64::from(LEAST_SEGMENT_AREA).max(f64::from(LEAST_SEGMENT_SHARE) * largest);
    order.retain(|part| part.1 >= least);
    order.truncate(usize::from(u16::MAX) - 1);
    let number: BTreeMap<u32, u16> = order
        .iter()
        .enumerate()
        .map(|(position, part)| (part.0, position as u16 + 1))
        .collect();
    let vertex_segment = (0..mesh.positions.len() as u32)
        .map(|vertex| {
            if left_out[vertex as usize] {
                return 0;
            }
            number.get(&find(&mut parent, vertex)).copied().unwrap_or(0)
        })
        .collect();
    let segments = order
        .iter()
        .enumerate()
        .map(|(position, part)| Segment {
            id: position as u16 + 1,
            area: part.1 as f32,
            centroid: part.2.as_vec3().to_array(),
        })
        .collect();
    (segments, vertex_segment)
}

fn find(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        parent[node as usize] = parent[parent[node as usize] as usize];
        node = parent[node as usize];
    }
    node
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `half` metres to each side at y = 0, in squares of a centimetre, looking up.
    fn plate(half: f32) -> Mesh {
        let count = (200.0 * half).round() as u32;
        let mut mesh = Mesh::default();
        for row in 0..=count {
            for column in 0..=count {
                let at = |index: u32| 0.01 * index as f32 - half;
                mesh.positions.push(Vec3::new(at(column), 0.0, at(row)));
                mesh.normals.push(-Vec3::Y);
            }
        }
        for row in 0..count {
            for column in 0..count {
                let a = row * (count + 1) + column;
                let (b, c, d) = (a + 1, a + count + 2, a + count + 1);
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        mesh
    }

    /// A cone of 10 cm that stands apart from the plate.
    fn add_cone(mesh: &mut Mesh) {
        let first = mesh.positions.len() as u32;
        for ring in 0..=10_u32 {
            for spoke in 0..24_u32 {
                let angle = std::f32::consts::TAU * spoke as f32 / 24.0;
                let radius = 0.006 * (10 - ring) as f32 + 0.002;
                let out = Vec3::new(angle.cos(), 0.0, angle.sin());
                mesh.positions
                    .push(radius * out - Vec3::Y * (0.03 + 0.01 * ring as f32));
                mesh.normals.push((out - 0.6 * Vec3::Y).normalize());
            }
        }
        for ring in 0..10 {
            for spoke in 0..24 {
                let at = |r: u32, s: u32| first + r * 24 + s % 24;
                let (a, b) = (at(ring, spoke), at(ring, spoke + 1));
                let (c, d) = (at(ring + 1, spoke + 1), at(ring + 1, spoke));
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    #[test]
    fn what_stands_on_a_plane_is_the_object() {
        let mut mesh = plate(0.3);
        let plate_count = mesh.positions.len();
        add_cone(&mut mesh);
        let parts = find_object(&mesh, None, 1);
        assert_eq!((parts.planes.len(), parts.segments.len()), (1, 1));
        assert!(parts.vertex_segment[..plate_count].iter().all(|&s| s == 0));
    }

    #[test]
    fn a_plane_with_nothing_on_it_is_the_object_itself() {
        let mesh = plate(0.3);
        let parts = find_object(&mesh, None, 1);
        assert_eq!((parts.planes.len(), parts.segments.len()), (0, 1));
        assert!(parts.vertex_segment.iter().all(|&s| s == 1));
        // A box still narrows it.
        let half = WorldBox {
            low: [-1.0, -1.0, -1.0],
            high: [0.0, 1.0, 1.0],
        };
        let parts = find_object(&mesh, Some(&half), 1);
        let kept = parts.vertex_segment.iter().filter(|&&s| s == 1).count();
        assert!(
            kept > 1500 && kept < 2000,
            "{kept} of {}",
            mesh.positions.len()
        );
    }
}
