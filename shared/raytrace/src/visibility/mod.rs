//! What each pixel of a camera sees.
//!
//! One buffer of triangle and barycentrics is the source of everything that is drawn per pixel (hard-cases
//! E12). Primaries are rasterised where the camera has no distortion. Pixels that a rasteriser cannot settle,
//! and cameras with distortion, are traced.

mod clip;
mod coverage;
mod draw;
mod project;

use geometry::camera::Z_NEAR;
use geometry::{DVec2, Intrinsics, Pose};
use glam::Vec3;
use rayon::prelude::*;

use crate::ray::{Hit, NO_TRIANGLE, Ray};
use crate::scene::Scene;

/// Per pixel, row-major: the nearest triangle and where it is met. All four arrays are `width · height` long.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibilityBuffer {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Index of the triangle, or [`NO_TRIANGLE`].
    pub triangle: Vec<u32>,
    /// Distance along the camera's z axis in metres, 0 where nothing is seen.
    pub depth: Vec<f32>,
    /// Barycentric weight of the triangle's second vertex, perspective-correct.
    pub u: Vec<f32>,
    /// Barycentric weight of the triangle's third vertex; the first has 1 − u − v.
    pub v: Vec<f32>,
}

impl VisibilityBuffer {
    fn empty(camera: &Intrinsics) -> Self {
        let pixel_count = camera.width() as usize * camera.height() as usize;
        Self {
            width: camera.width(),
            height: camera.height(),
            triangle: vec![NO_TRIANGLE; pixel_count],
            depth: vec![0.0; pixel_count],
            u: vec![0.0; pixel_count],
            v: vec![0.0; pixel_count],
        }
    }
}

/// What `camera` sees of a mesh (vertex positions in metres, triangles as vertex indices, both sides drawn)
/// from `mesh_from_camera`, nearer than 1 cm left out. Triangles with an index out of range or a corner that
/// is not finite are not drawn.
///
/// Drawn with 8 sub-pixel bits, so a pixel whose centre is within 1/256 pixel of an edge may get the neighbour;
/// [`visibility_buffer`] settles those. A camera with distortion is traced instead, which builds a tree first.
/// Parallel over rows; the result does not depend on the number of threads.
pub fn rasterise(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    camera: &Intrinsics,
    mesh_from_camera: &Pose,
) -> VisibilityBuffer {
    if camera.distortion().is_none() {
        return draw::draw(positions, triangles, camera, mesh_from_camera).buffer;
    }
    let usable: Vec<[u32; 3]> = triangles
        .iter()
        .map(|corners| {
            let exists = corners.iter().all(|&v| (v as usize) < positions.len());
            // A repeated vertex keeps the numbering and is not traced.
            if exists { *corners } else { [0; 3] }
        })
        .collect();
    match Scene::new(positions, &usable) {
        Ok(scene) => traced(&scene, camera, mesh_from_camera),
        // No vertices, or more triangles than can be named.
        Err(_) => VisibilityBuffer::empty(camera),
    }
}

/// As [`rasterise`], with `scene` (of the same mesh) to settle what rasterising cannot.
pub fn visibility_buffer(
    scene: &Scene,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    camera: &Intrinsics,
    mesh_from_camera: &Pose,
) -> VisibilityBuffer {
    if !camera.distortion().is_none() {
        return traced(scene, camera, mesh_from_camera);
    }
    let draw::Drawing {
        mut buffer,
        unsettled,
    } = draw::draw(positions, triangles, camera, mesh_from_camera);
    let indices: Vec<usize> = (0..unsettled.len()).filter(|&i| unsettled[i]).collect();
    let width = camera.width() as usize;
    let hits: Vec<Hit> = indices
        .par_chunks(width)
        .flat_map_iter(|indices| {
            let pixels = indices.iter().map(|&i| (i % width, i / width));
            trace_pixels(scene, camera, mesh_from_camera, pixels)
        })
        .collect();
    for (&index, hit) in indices.iter().zip(&hits) {
        buffer.triangle[index] = hit.triangle;
        buffer.depth[index] = if hit.is_hit() { hit.t } else { 0.0 };
        buffer.u[index] = hit.u;
        buffer.v[index] = hit.v;
    }
    buffer
}

/// Every pixel by a ray.
fn traced(scene: &Scene, camera: &Intrinsics, mesh_from_camera: &Pose) -> VisibilityBuffer {
    let mut buffer = VisibilityBuffer::empty(camera);
    let width = camera.width() as usize;
    buffer
        .triangle
        .par_chunks_mut(width)
        .zip(buffer.depth.par_chunks_mut(width))
        .zip(buffer.u.par_chunks_mut(width))
        .zip(buffer.v.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, (((triangle, depth), u), v))| {
            let pixels = (0..width).map(|x| (x, y));
            let hits = trace_pixels(scene, camera, mesh_from_camera, pixels);
            for (x, hit) in hits.iter().enumerate().filter(|(_, hit)| hit.is_hit()) {
                (triangle[x], depth[x], u[x], v[x]) = (hit.triangle, hit.t, hit.u, hit.v);
            }
        });
    buffer
}

/// The hits of pixels (column, row), t along the camera's z axis.
fn trace_pixels(
    scene: &Scene,
    camera: &Intrinsics,
    mesh_from_camera: &Pose,
    pixels: impl Iterator<Item = (usize, usize)>,
) -> Vec<Hit> {
    let origin = mesh_from_camera.translation().as_vec3();
    let rays: Vec<Ray> = pixels
        .map(|(x, y)| {
            // Beyond the fold of a distortion nothing is seen: a ray without direction hits nothing.
            let direction = camera
                .camera_from_pixel(DVec2::new(x as f64, y as f64))
                .map_or(Vec3::ZERO, |d| {
                    mesh_from_camera.transform_vector(d).as_vec3()
                });
            Ray {
                least: Z_NEAR as f32,
                ..Ray::new(origin, direction)
            }
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.closest_batch(&rays, &mut hits);
    hits
}

#[cfg(test)]
mod tests;
