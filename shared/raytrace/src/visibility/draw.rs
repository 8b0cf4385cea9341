//! Draws a mesh into a visibility buffer, band by band.

use geometry::camera::Z_NEAR;
use geometry::{DVec3, Intrinsics, Pose};
use glam::Vec3;
use rayon::prelude::*;

use super::VisibilityBuffer;
use super::coverage::cover;
use super::project::{BAND_ROWS, Bands, Projected, Projection};
use crate::ray::NO_TRIANGLE;

/// A drawn mesh.
pub(super) struct Drawing {
    pub(super) buffer: VisibilityBuffer,
    /// Pixels whose ray passes the drawn triangle by, within the rounding of fixed point.
    pub(super) unsettled: Vec<bool>,
}

/// Draws for a camera without distortion.
pub(super) fn draw(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    camera: &Intrinsics,
    mesh_from_camera: &Pose,
) -> Drawing {
    let projection = Projection::new(positions, triangles, camera, mesh_from_camera);
    let bands = projection.bands();
    let mut buffer = VisibilityBuffer::empty(camera);
    let mut unsettled = vec![false; buffer.depth.len()];
    let chunk = BAND_ROWS * camera.width() as usize;
    buffer
        .triangle
        .par_chunks_mut(chunk)
        .zip(buffer.depth.par_chunks_mut(chunk))
        .zip(buffer.u.par_chunks_mut(chunk))
        .zip(buffer.v.par_chunks_mut(chunk))
        .zip(unsettled.par_chunks_mut(chunk))
        .enumerate()
        .for_each(|(index, ((((triangle, depth), u), v), unsettled))| {
            let mut band = Band {
                first_row: (index * BAND_ROWS) as i64,
                width: i64::from(camera.width()),
                triangle,
                depth,
                u,
                v,
                unsettled,
            };
            band.draw(&projection, &bands, index);
        });
    Drawing { buffer, unsettled }
}

/// Some rows of a buffer.
struct Band<'a> {
    first_row: i64,
    width: i64,
    triangle: &'a mut [u32],
    depth: &'a mut [f32],
    u: &'a mut [f32],
    v: &'a mut [f32],
    unsettled: &'a mut [bool],
}

impl Band<'_> {
    fn draw(&mut self, projection: &Projection<'_>, bands: &Bands, band: usize) {
        let row_count = self.depth.len() as i64 / self.width;
        let rows = self.first_row..self.first_row + row_count;
        let (focal, center) = (projection.camera.focal(), projection.camera.center());
        for &triangle in bands.triangles(band) {
            let Some(corners) = projection.corners(triangle) else {
                continue;
            };
            let mut plane = None;
            projection.for_each_fan(&corners, |fan| {
                cover(fan, 0..self.width, rows.clone(), |column, row| {
                    let plane = plane.get_or_insert_with(|| Plane::new(&corners));
                    let ray = DVec3::new(
                        (column as f64 - center.x) / focal.x,
                        (row as f64 - center.y) / focal.y,
                        1.0,
                    );
                    let index = ((row - self.first_row) * self.width + column) as usize;
                    self.put(index, triangle, &plane.at(ray));
                });
            });
        }
    }

    /// Keeps the nearer of two surfaces, of equally near ones the lower index.
    fn put(&mut self, index: usize, triangle: u32, met: &Met) {
        let nearer = self.triangle[index] == NO_TRIANGLE
            || met.depth < self.depth[index]
            || (met.depth == self.depth[index] && triangle < self.triangle[index]);
        if nearer && met.depth >= Z_NEAR as f32 {
            self.triangle[index] = triangle;
            self.depth[index] = met.depth;
            self.u[index] = met.u;
            self.v[index] = met.v;
            self.unsettled[index] = met.is_beside;
        }
    }
}

/// A triangle's plane for rays from the camera.
///
/// Barycentrics are ratios of the volumes that ray and edges span, linear in the ray (Olano and Greer 1997):
/// nothing is divided by the depth of a corner, so corners behind the camera need no care (hard-cases E11).
struct Plane {
    /// b x c, c x a, a x b.
    volumes: [DVec3; 3],
    /// z of the corners.
    depths: [f64; 3],
}

/// Where a ray meets a plane.
struct Met {
    depth: f32,
    u: f32,
    v: f32,
    /// The ray passes beside the triangle; the values are those of its nearest point.
    is_beside: bool,
}

impl Plane {
    fn new(corners: &[Projected; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| corner.point);
        Self {
            volumes: [b.cross(c), c.cross(a), a.cross(b)],
            depths: [a.z, b.z, c.z],
        }
    }

    fn at(&self, ray: DVec3) -> Met {
        let volumes = self.volumes.map(|volume| volume.dot(ray));
        let sum = volumes[0] + volumes[1] + volumes[2];
        let weights = volumes.map(|volume| volume / sum);
        let is_inside = weights.iter().all(|&w| w >= 0.0);
        let weights = if is_inside {
            weights
        } else {
            nearest_inside(weights)
        };
        let depth =
            weights[0] * self.depths[0] + weights[1] * self.depths[1] + weights[2] * self.depths[2];
        Met {
            depth: depth as f32,
            u: weights[1] as f32,
            v: weights[2] as f32,
            is_beside: !is_inside,
        }
    }
}

/// Weights of a point of the triangle near those of a point beside it; the centre when there are none (a
/// triangle seen edge on).
fn nearest_inside(weights: [f64; 3]) -> [f64; 3] {
    let clamped = weights.map(|w| w.clamp(0.0, 1.0));
    let sum = clamped[0] + clamped[1] + clamped[2];
    if sum.is_finite() && sum > 0.0 {
        clamped.map(|w| w / sum)
    } else {
        [1.0 / 3.0; 3]
    }
}
