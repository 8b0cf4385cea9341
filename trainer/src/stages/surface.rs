//! The fused surface with what is needed to shade it, and view rays mirrored by it.

use fusion::Mesh;
use geometry::DVec3;
use glam::Vec3;
use raytrace::{Hit, MirrorQuery, NO_TRIANGLE, Ray, Scene, VisibilityBuffer};

/// The fused surface with what is needed to shade it. Positions count from `origin`.
pub struct Surface {
    /// Vertex positions, metres.
    pub positions: Vec<Vec3>,
    /// Unit vertex normals.
    pub normals: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Segment of every vertex, 0 = not the object.
    pub vertex_segment: Vec<u16>,
    /// World position of the mesh's zero.
    pub origin: DVec3,
    /// The ray tracer's view of it.
    pub scene: Scene,
    /// Start and least distance of mirrored rays.
    pub mirror: MirrorQuery,
}

impl Surface {
    /// A fused mesh of voxels of `voxel_size` metres with the segment of every vertex.
    ///
    /// # Errors
    /// More triangles than a tree holds.
    pub fn fused(mesh: Mesh, vertex_segment: Vec<u16>, voxel_size: f32) -> anyhow::Result<Self> {
        Ok(Self {
            scene: Scene::new(&mesh.positions, &mesh.triangles)?,
            mirror: MirrorQuery::for_fused(voxel_size),
            positions: mesh.positions,
            normals: mesh.normals,
            triangles: mesh.triangles,
            vertex_segment,
            origin: mesh.origin,
        })
    }

    /// The segment of a triangle: that of its vertices where they agree, else 0.
    pub fn segment(&self, triangle: u32) -> u16 {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.vertex_segment[v as usize]);
        if a == b && b == c { a } else { 0 }
    }

    /// A per-vertex value at a hit.
    pub fn interpolate(&self, values: &[Vec3], hit: &Hit) -> Vec3 {
        let [a, b, c] = self.triangles[hit.triangle as usize].map(|v| values[v as usize]);
        a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
    }

    /// Unit geometric normal of a triangle, turned to the side of its vertex normals.
    pub fn geometric_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.triangles[triangle as usize].map(|v| self.positions[v as usize]);
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The mirrored direction and first bounce at a hit, seen from `eye` (surface axes); `None` where the
    /// interpolated normal faces away or is too slanted.
    pub fn mirror(&self, hit: &Hit, eye: Vec3, least_cosine: f32) -> Option<Mirrored> {
        let mirrored = self.mirror_ray(hit, eye, least_cosine)?;
        Some(Mirrored {
            cosine: mirrored.cosine,
            direction: mirrored.ray.direction,
            first_bounce: self.scene.closest(&mirrored.ray),
        })
    }

    /// The mirrored ray at a hit, not followed.
    pub fn mirror_ray(&self, hit: &Hit, eye: Vec3, least_cosine: f32) -> Option<MirroredRay> {
        let position = self.interpolate(&self.positions, hit);
        let shading_normal = self.interpolate(&self.normals, hit).try_normalize()?;
        let outgoing = (eye - position).try_normalize()?;
        let cosine = shading_normal.dot(outgoing);
        let geometric_normal = self.geometric_normal(hit.triangle);
        if cosine < least_cosine || geometric_normal.dot(outgoing) <= 0.0 {
            return None;
        }
        let ray = self
            .mirror
            .ray(position, geometric_normal, shading_normal, outgoing);
        Some(MirroredRay { cosine, ray })
    }

    /// Where a first bounce mirrors a ray that came from `origin`, if that leaves the scene.
    pub fn second_mirror(&self, bounce: &Hit, origin: Vec3) -> Option<Vec3> {
        let mirrored = self.mirror_ray(bounce, origin, 0.0)?;
        (!self.scene.is_blocked(&mirrored.ray)).then_some(mirrored.ray.direction)
    }
}

/// A mirrored view ray.
#[derive(Clone, Copy, Debug)]
pub struct Mirrored {
    /// Cosine between normal and outgoing direction.
    pub cosine: f32,
    /// Unit direction, world axes.
    pub direction: Vec3,
    /// What it meets.
    pub first_bounce: Option<Hit>,
}

/// A mirrored view ray, not followed.
#[derive(Clone, Copy, Debug)]
pub struct MirroredRay {
    /// Cosine between normal and outgoing direction.
    pub cosine: f32,
    /// The ray.
    pub ray: Ray,
}

/// The hit of a pixel of a visibility buffer.
pub fn hit_at(buffer: &VisibilityBuffer, index: usize) -> Option<Hit> {
    let triangle = buffer.triangle[index];
    (triangle != NO_TRIANGLE).then(|| Hit {
        triangle,
        t: buffer.depth[index],
        u: buffer.u[index],
        v: buffer.v[index],
    })
}
