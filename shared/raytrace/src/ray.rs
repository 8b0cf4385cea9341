//! Rays and what they hit.

use glam::Vec3;

/// The triangle of a ray or pixel that meets nothing.
pub const NO_TRIANGLE: u32 = u32::MAX;

/// A ray, in the axes of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, metres.
    pub origin: Vec3,
    /// Where it goes; of any length from 1e-9 to 1e9.
    pub direction: Vec3,
    /// Hits closer than this are ignored, in lengths of `direction`.
    pub least: f32,
    /// Hits farther than this are ignored, in lengths of `direction`; infinity for no limit.
    pub greatest: f32,
}

impl Ray {
    /// A ray from `origin` along `direction` without limits but its start.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self {
            origin,
            direction,
            least: 0.0,
            greatest: f32::INFINITY,
        }
    }
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle as the caller of [`crate::Scene::new`] counts, or [`NO_TRIANGLE`].
    pub triangle: u32,
    /// Distance along the ray, in lengths of its direction.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex; the first has 1 − u − v.
    pub v: f32,
}

impl Hit {
    /// What a batch query writes for a ray that meets nothing.
    pub const MISS: Self = Self {
        triangle: NO_TRIANGLE,
        t: f32::INFINITY,
        u: 0.0,
        v: 0.0,
    };

    /// Whether the ray met anything.
    pub fn is_hit(&self) -> bool {
        self.triangle != NO_TRIANGLE
    }
}
