//! A mesh made ready for rays.

use glam::Vec3;

use crate::error::RaytraceError;
use crate::kernels::Level;
use crate::kernels::traverse::{COORDINATE_LIMIT, Wanted, trace};
use crate::ray::{Hit, Ray};
use crate::tree::{LEAF_BIT, Tree, Triangle};

/// Smallest area of a triangle that is kept, square metres: below, f32 edges at room scale have no digits
/// left (hard-cases E07).
pub const LEAST_AREA: f64 = 1e-14;

/// Rays that a query for visibility answers at a time: their hits stay on the stack.
const BLOCK: usize = 64;

/// A mesh that answers rays. Triangles are two-sided.
#[derive(Clone, Debug)]
pub struct Scene {
    tree: Tree,
    counts: TriangleCounts,
    level: Level,
}

/// What became of the triangles given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TriangleCounts {
    /// Triangles that rays can hit.
    pub kept_count: usize,
    /// Dropped: a corner is NaN, infinite or beyond 1e9 m.
    pub not_finite_count: usize,
    /// Dropped: two corners are one vertex.
    pub repeated_vertex_count: usize,
    /// Dropped: the area is below [`LEAST_AREA`].
    pub tiny_count: usize,
}

impl Scene {
    /// Builds the tree over `triangles`, vertex indices into `positions` (metres). What no ray can hit
    /// reliably is dropped and counted; no triangles at all is a scene that every ray misses. About 1 µs a
    /// triangle on one core; the result does not depend on threads.
    ///
    /// # Errors
    /// When a triangle names a vertex that does not exist, or there are 2³¹ triangles or more.
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, RaytraceError> {
        let triangle_count = triangles.len();
        if triangle_count >= LEAF_BIT as usize {
            return Err(RaytraceError::TooManyTriangles { triangle_count });
        }
        let mut counts = TriangleCounts::default();
        let mut kept = Vec::with_capacity(triangle_count);
        for (index, corners) in triangles.iter().enumerate() {
            for &vertex in corners {
                if vertex as usize >= positions.len() {
                    return Err(RaytraceError::VertexIndex {
                        triangle: index,
                        vertex,
                        vertex_count: positions.len(),
                    });
                }
            }
            let vertices = corners.map(|vertex| positions[vertex as usize]);
            if vertices
                .iter()
                .any(|p| !(p.abs().max_element() <= COORDINATE_LIMIT) || p.is_nan())
            {
                counts.not_finite_count += 1;
            } else if corners[0] == corners[1]
                || corners[1] == corners[2]
                || corners[2] == corners[0]
            {
                counts.repeated_vertex_count += 1;
            } else if area(vertices) < LEAST_AREA {
                counts.tiny_count += 1;
            } else {
                kept.push(Triangle {
                    vertices,
                    index: index as u32,
                });
            }
        }
        counts.kept_count = kept.len();
        Ok(Self {
            tree: Tree::new(&kept),
            counts,
            level: Level::detect(),
        })
    }

    /// The same scene answering with the instructions of `level`; for tests and measurements. A level that
    /// the machine lacks falls back to [`Level::Scalar`].
    #[must_use]
    pub fn with_level(self, level: Level) -> Self {
        Self { level, ..self }
    }

    pub(crate) fn tree(&self) -> &Tree {
        &self.tree
    }

    /// What became of the triangles given to [`Scene::new`].
    pub fn counts(&self) -> TriangleCounts {
        self.counts
    }

    /// The nearest hit from `ray.least` to `ray.greatest`, both included; of equally near triangles that of
    /// the lowest index. `None` also for a ray that is not finite or has no direction.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut hit = Hit::MISS;
        trace(
            self.level,
            &self.tree,
            Wanted::Closest,
            std::slice::from_ref(ray),
            std::slice::from_mut(&mut hit),
        );
        hit.is_hit().then_some(hit)
    }

    /// Whether anything lies on `ray` from `ray.least` to `ray.greatest`, both included.
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        let mut blocked = false;
        self.blocked_batch(
            std::slice::from_ref(ray),
            std::slice::from_mut(&mut blocked),
        );
        blocked
    }

    /// [`Scene::closest`] of many rays on the calling thread, [`Hit::MISS`] for a miss. Rays that lie close
    /// together should follow each other.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub fn closest_batch(&self, rays: &[Ray], hits: &mut [Hit]) {
        trace(self.level, &self.tree, Wanted::Closest, rays, hits);
    }

    /// [`Scene::is_blocked`] of many rays on the calling thread.
    ///
    /// # Panics
    /// When the slices differ in length.
    pub fn blocked_batch(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len(), "one answer a ray");
        let mut hits = [Hit::MISS; BLOCK];
        for (rays, blocked) in rays.chunks(BLOCK).zip(blocked.chunks_mut(BLOCK)) {
            let hits = &mut hits[..rays.len()];
            trace(self.level, &self.tree, Wanted::Any, rays, hits);
            for (blocked, hit) in blocked.iter_mut().zip(hits) {
                *blocked = hit.is_hit();
            }
        }
    }
}

/// Area in square metres, from f64 differences.
fn area(vertices: [Vec3; 3]) -> f64 {
    let [a, b, c] = vertices.map(Vec3::as_dvec3);
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_vertex_is_named() {
        let error =
            Scene::new(&[Vec3::ZERO, Vec3::X], &[[0, 1, 2]]).expect_err("vertex 2 is missing");
        let expected = RaytraceError::VertexIndex {
            triangle: 0,
            vertex: 2,
            vertex_count: 2,
        };
        assert_eq!(error, expected);
    }

    #[test]
    fn indices_stay_the_callers_when_triangles_are_dropped() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN];
        let triangles = [[0, 0, 1], [0, 1, 3], [0, 1, 2]];
        let scene = Scene::new(&positions, &triangles).expect("valid indices");
        let hit = scene.closest(&Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z));
        assert_eq!(hit.map(|hit| hit.triangle), Some(2));
        let counts = TriangleCounts {
            kept_count: 1,
            not_finite_count: 1,
            repeated_vertex_count: 1,
            tiny_count: 0,
        };
        assert_eq!(scene.counts(), counts);
    }

    #[test]
    fn an_empty_scene_lets_every_ray_pass() {
        let scene = Scene::new(&[], &[]).expect("nothing is a scene");
        assert_eq!(scene.closest(&Ray::new(Vec3::ZERO, Vec3::Z)), None);
        assert!(!scene.is_blocked(&Ray::new(Vec3::ZERO, Vec3::Z)));
    }

    #[test]
    fn equally_near_triangles_answer_with_the_lowest_index() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let scene = Scene::new(&positions, &[[0, 1, 2]; 100]).expect("valid indices");
        let hit = scene.closest(&Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z));
        assert_eq!(hit.map(|hit| hit.triangle), Some(0));
    }

    #[test]
    fn visibility_of_many_rays_is_that_of_each() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let scene = Scene::new(&positions, &[[0, 1, 2]]).expect("valid indices");
        let rays: Vec<Ray> = (0..150)
            .map(|i| Ray::new(Vec3::new(i as f32 / 100.0, 0.1, 1.0), -Vec3::Z))
            .collect();
        let mut blocked = vec![false; rays.len()];
        scene.blocked_batch(&rays, &mut blocked);
        for (ray, blocked) in rays.iter().zip(blocked) {
            assert_eq!(blocked, ray.origin.x <= 0.9);
            assert_eq!(blocked, scene.is_blocked(ray));
        }
    }
}
