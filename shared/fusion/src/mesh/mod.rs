//! Triangle meshes of a volume's zero surface.

mod cases;
mod components;
mod extract;
mod halo;
#[cfg(test)]
mod tests;

use geometry::{DVec3, Vec3};

pub use self::components::{components, remove_small_components};
pub use self::extract::{MeshConfig, extract_mesh};

/// A triangle mesh. The per-vertex arrays have equal length, but `radiance` may be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions relative to `origin`, world axes, metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, pointing to free space.
    pub normals: Vec<Vec3>,
    /// TSDF weight at each vertex.
    pub weights: Vec<f32>,
    /// Linear radiance at each vertex, 1.0 = white level, 0 where none was seen; empty without colour in the
    /// volume.
    pub radiance: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise seen from free space.
    pub triangles: Vec<[u32; 3]>,
    /// World position that `positions` count from, metres.
    pub origin: DVec3,
}

impl Mesh {
    /// World position of a vertex, metres.
    pub fn world_position(&self, vertex: usize) -> DVec3 {
        self.origin + self.positions[vertex].as_dvec3()
    }
}
