//! Which points of a reference surface the camera saw: the rest is not missing in a reconstruction.

use geometry::Pose;
use rayon::prelude::*;
use raytrace::{NO_TRIANGLE, Ray, Scene, visibility_buffer};
use sequence::DepthCamera;

use super::read::SurfaceMesh;
use super::samples::SurfacePoint;

/// Frames that must have seen a point.
const LEAST_SIGHTINGS: u8 = 3;
/// How far a point may lie behind what its pixel shows before it is certainly hidden, metres: a surface seen at a
/// grazing angle changes by this much within a pixel.
const FARTHEST_BEHIND: f32 = 0.05;
/// Share of the way to a point that its own surface takes up: f32 rounds to a thousandth of that.
const OWN_SURFACE: f32 = 1e-4;

/// Where the depth camera stood, in the world of the reference.
#[derive(Clone, Debug)]
pub struct Sightings<'a> {
    /// The camera.
    pub camera: &'a DepthCamera,
    /// World from depth camera.
    pub world_from_depth: Vec<Pose>,
}

/// The points that at least three frames see within the camera's range, in their order.
pub(super) fn seen_points(
    mesh: &SurfaceMesh,
    scene: &Scene,
    points: Vec<SurfacePoint>,
    sightings: &Sightings<'_>,
    progress: &dyn Fn(usize, usize),
) -> Vec<SurfacePoint> {
    let camera = &sightings.camera.intrinsics;
    let mesh_from_world = Pose::from_translation(-mesh.origin);
    let mut counts = vec![0_u8; points.len()];
    let frame_count = sightings.world_from_depth.len();
    for (done, world_from_depth) in sightings.world_from_depth.iter().enumerate() {
        let mesh_from_camera = mesh_from_world * *world_from_depth;
        let camera_from_mesh = mesh_from_camera.inverse();
        let buffer = visibility_buffer(
            scene,
            &mesh.positions,
            &mesh.triangles,
            camera,
            &mesh_from_camera,
        );
        let eye = mesh_from_camera.translation().as_vec3();
        let is_seen = |sample: &SurfacePoint| -> Option<bool> {
            let in_camera = camera_from_mesh.transform_point(sample.point.as_dvec3());
            let pixel = camera.pixel_from_camera(in_camera)?.round();
            let (width, height) = (f64::from(camera.width()), f64::from(camera.height()));
            let is_inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width && pixel.y < height;
            let z = in_camera.z as f32;
            if !is_inside || !sightings.camera.depth_range.contains(&z) {
                return None;
            }
            let index = pixel.y as usize * camera.width() as usize + pixel.x as usize;
            // What is far behind the surface in its pixel is hidden; only the rest is worth a ray.
            let is_hit = buffer.triangle[index] != NO_TRIANGLE;
            if is_hit && z > buffer.depth[index] + FARTHEST_BEHIND {
                return Some(false);
            }
            let to_point = Ray {
                greatest: 1.0 - OWN_SURFACE,
                ..Ray::new(eye, sample.point - eye)
            };
            Some(!scene.is_blocked(&to_point))
        };
        counts
            .par_iter_mut()
            .zip(&points)
            .filter(|(count, _)| **count < LEAST_SIGHTINGS)
            .for_each(|(count, sample)| {
                *count += u8::from(is_seen(sample) == Some(true));
            });
        progress(done + 1, frame_count);
    }
    let seen = points.into_iter().zip(counts);
    seen.filter(|(_, count)| *count >= LEAST_SIGHTINGS)
        .map(|(point, _)| point)
        .collect()
}
