//! Vertex normals: smoothing, and how far to trust them.

use geometry::{Vec3, robust};
use rayon::prelude::*;

use crate::mesh::Mesh;

/// Rounds that suit 4 mm voxels (measured on mitsuba-dev: more hurts silhouettes).
const ROUNDS_AT_4_MM: f32 = 4.0;
/// Most rounds worth their time.
const MOST_ROUNDS: f32 = 256.0;
/// Median of a Rayleigh distribution of scale 1: the angle of a normal with isotropic noise σ per axis
/// has median 1.1774 σ.
const RAYLEIGH_MEDIAN: f64 = 1.177_410;

/// Smoothing rounds for voxels of `voxel_size` metres: 4 at 4 mm, 16 at 2 mm, 1 at 8 mm. The width of the
/// smoothing grows with voxel · √rounds, so equal widths need rounds ∝ 1/voxel².
pub fn rounds_for_voxel(voxel_size: f32) -> usize {
    let ratio = 0.004 / voxel_size;
    (ROUNDS_AT_4_MM * ratio * ratio)
        .round()
        .clamp(0.0, MOST_ROUNDS) as usize
}

/// Replaces each normal by the normalised sum of itself and its ring neighbours, `rounds` times.
/// A normal whose ring cancels is kept.
pub fn smooth_normals(mesh: &mut Mesh, rounds: usize) {
    let rings = Rings::new(mesh);
    let mut smoothed = mesh.normals.clone();
    for _ in 0..rounds {
        smoothed
            .par_iter_mut()
            .enumerate()
            .with_min_len(4096)
            .for_each(|(vertex, out)| {
                let own = mesh.normals[vertex];
                let sum = rings
                    .of(vertex)
                    .iter()
                    .fold(own, |sum, &near| sum + mesh.normals[near as usize]);
                let unit = unit_or_zero(sum);
                *out = if unit == Vec3::ZERO { own } else { unit };
            });
        std::mem::swap(&mut mesh.normals, &mut smoothed);
    }
}

/// Noise of vertex normals.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalNoise {
    /// Standard deviation per tangential axis of each vertex, radians.
    pub sigma: Vec<f32>,
    /// Median over the vertices, radians; 0 for an empty mesh.
    pub median: f32,
}

/// Noise of the `raw` normals (before smoothing, one per vertex) about the smoothed normals of `mesh`.
///
/// Per vertex: the median over the vertex and its ring of the angle between raw and smoothed, over
/// 1.177 (isotropic noise of the two tangential axes makes that angle Rayleigh-distributed). One or two
/// broken neighbours do not move it. Smoothing lowers the noise of the mesh's own normals below this, but
/// what is left of curvature and of a wrong surface is in it: use it as an upper estimate.
///
/// # Panics
/// When `raw` has not one normal per vertex.
pub fn normal_noise(mesh: &Mesh, raw: &[Vec3]) -> NormalNoise {
    assert_eq!(raw.len(), mesh.normals.len(), "one raw normal per vertex");
    let rings = Rings::new(mesh);
    let angles: Vec<f64> = raw
        .iter()
        .zip(&mesh.normals)
        // Small angles are resolved too, where an arc cosine of f32 returns 0.
        .map(|(&a, &b)| geometry::direction::angle_between(a.as_dvec3(), b.as_dvec3()))
        .collect();
    let sigma: Vec<f32> = (0..raw.len())
        .into_par_iter()
        .with_min_len(1024)
        .map(|vertex| {
            let mut near: Vec<f64> = rings
                .of(vertex)
                .iter()
                .map(|&n| angles[n as usize])
                .collect();
            near.push(angles[vertex]);
            (robust::median(&mut near).unwrap_or(0.0) / RAYLEIGH_MEDIAN) as f32
        })
        .collect();
    let median =
        robust::median(&mut sigma.iter().map(|&s| f64::from(s)).collect()).unwrap_or(0.0) as f32;
    NormalNoise { sigma, median }
}

/// Sum of the area-weighted face normals at each vertex (twice the area, not unit).
pub fn face_normal_sums(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; mesh.positions.len()];
    for &triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
        let normal = (b - a).cross(c - a);
        for vertex in triangle {
            sums[vertex as usize] += normal;
        }
    }
    sums
}

/// `v` at unit length, or zero when it is too short or not finite. Scales first: areas of small triangles
/// underflow when squared.
pub(crate) fn unit_or_zero(v: Vec3) -> Vec3 {
    let largest = v.abs().max_element();
    if largest > 0.0 && largest.is_finite() {
        (v / largest).normalize_or_zero()
    } else {
        Vec3::ZERO
    }
}

/// The vertices that share an edge with each vertex, each once, in rising order.
struct Rings {
    start: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Rings {
    fn new(mesh: &Mesh) -> Self {
        let vertex_count = mesh.positions.len();
        let mut start = vec![0u32; vertex_count + 1];
        for &vertex in mesh.triangles.iter().flatten() {
            start[vertex as usize + 1] += 2;
        }
        for vertex in 0..vertex_count {
            start[vertex + 1] += start[vertex];
        }
        let mut cursor = start.clone();
        let mut raw = vec![0u32; start[vertex_count] as usize];
        for &[a, b, c] in &mesh.triangles {
            for (at, near) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                let place = &mut cursor[at as usize];
                raw[*place as usize..*place as usize + 2].copy_from_slice(&near);
                *place += 2;
            }
        }
        // Each neighbour of an inner vertex stands twice.
        let mut neighbours = Vec::with_capacity(raw.len() / 2 + vertex_count);
        let mut packed = Vec::with_capacity(vertex_count + 1);
        for vertex in 0..vertex_count {
            packed.push(neighbours.len() as u32);
            let ring = &mut raw[start[vertex] as usize..start[vertex + 1] as usize];
            ring.sort_unstable();
            let mut last = u32::MAX;
            for &near in ring.iter() {
                if near != last {
                    neighbours.push(near);
                }
                last = near;
            }
        }
        packed.push(neighbours.len() as u32);
        Self {
            start: packed,
            neighbours,
        }
    }

    fn of(&self, vertex: usize) -> &[u32] {
        &self.neighbours[self.start[vertex] as usize..self.start[vertex + 1] as usize]
    }
}
