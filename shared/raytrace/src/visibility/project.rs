//! Vertices in camera axes and on the image, and triangles sorted into bands of rows.

use geometry::camera::Z_NEAR;
use geometry::{DVec3, Intrinsics, Pose};
use glam::Vec3;
use rayon::prelude::*;

use super::clip::{GUARD_PIXELS, clip};
use super::coverage::{FixedPoint, centers_within, fixed};

/// Rows that one task draws.
pub(super) const BAND_ROWS: usize = 16;

/// A vertex as the camera sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projected {
    /// Camera axes, metres.
    pub(super) point: DVec3,
    /// On the image; `None` when the triangles of this vertex must be clipped.
    pub(super) pixel: Option<FixedPoint>,
}

/// A mesh as the camera sees it.
pub(super) struct Projection<'a> {
    pub(super) camera: &'a Intrinsics,
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) vertices: Vec<Projected>,
}

/// Triangle indices by band of [`BAND_ROWS`] rows, ascending within a band.
pub(super) struct Bands {
    starts: Vec<usize>,
    triangles: Vec<u32>,
}

impl Bands {
    /// The triangles that may cover pixels of a band.
    pub(super) fn triangles(&self, band: usize) -> &[u32] {
        &self.triangles[self.starts[band]..self.starts[band + 1]]
    }
}

impl<'a> Projection<'a> {
    /// Projects all vertices, in parallel.
    pub(super) fn new(
        positions: &[Vec3],
        triangles: &'a [[u32; 3]],
        camera: &'a Intrinsics,
        mesh_from_camera: &Pose,
    ) -> Self {
        let camera_from_mesh = mesh_from_camera.inverse();
        let (rotation, translation) = (camera_from_mesh.matrix(), camera_from_mesh.translation());
        let vertices = positions
            .par_iter()
            .with_min_len(4096)
            .map(|position| {
                let point = rotation * position.as_dvec3() + translation;
                Projected {
                    point,
                    pixel: pixel(point, camera),
                }
            })
            .collect();
        Self {
            camera,
            triangles,
            vertices,
        }
    }

    /// The corners of a triangle; `None` for an index out of range or a corner that is not finite.
    pub(super) fn corners(&self, triangle: u32) -> Option<[Projected; 3]> {
        let mut corners = [Projected {
            point: DVec3::ZERO,
            pixel: None,
        }; 3];
        for (corner, &vertex) in corners.iter_mut().zip(&self.triangles[triangle as usize]) {
            *corner = *self.vertices.get(vertex as usize)?;
        }
        // What has a pixel is finite.
        let is_finite = corners
            .iter()
            .all(|c| c.pixel.is_some() || c.point.is_finite());
        is_finite.then_some(corners)
    }

    /// Calls `visit` with each triangle of the fan that a triangle becomes on the image.
    pub(super) fn for_each_fan(
        &self,
        corners: &[Projected; 3],
        mut visit: impl FnMut([FixedPoint; 3]),
    ) {
        if let [Some(a), Some(b), Some(c)] = corners.map(|corner| corner.pixel) {
            visit([a, b, c]);
            return;
        }
        if corners.iter().all(|corner| corner.point.z < Z_NEAR) {
            return;
        }
        let polygon = clip(corners.map(|corner| corner.point), self.camera);
        let on_image = |point: DVec3| {
            let (focal, center) = (self.camera.focal(), self.camera.center());
            // Rounding may leave a cut point a hair outside the guard band.
            let limit = |pixel: f64| fixed(pixel.clamp(-GUARD_PIXELS, GUARD_PIXELS));
            [
                limit(focal.x * point.x / point.z + center.x),
                limit(focal.y * point.y / point.z + center.y),
            ]
        };
        if let [first, rest @ ..] = polygon.corners() {
            for pair in rest.windows(2) {
                visit([on_image(*first), on_image(pair[0]), on_image(pair[1])]);
            }
        }
    }

    /// Sorts triangles into bands.
    pub(super) fn bands(&self) -> Bands {
        let height = self.camera.height() as usize;
        let band_count = height.div_ceil(BAND_ROWS);
        let ranges: Vec<(u16, u16)> = (0..self.triangles.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .map(|triangle| self.band_range(triangle))
            .collect();
        let mut starts = vec![0_usize; band_count + 1];
        for &(first, end) in &ranges {
            for band in first..end {
                starts[usize::from(band) + 1] += 1;
            }
        }
        for band in 0..band_count {
            starts[band + 1] += starts[band];
        }
        let mut next = starts.clone();
        let mut triangles = vec![0; starts[band_count]];
        for (triangle, &(first, end)) in ranges.iter().enumerate() {
            for band in first..end {
                let place = &mut next[usize::from(band)];
                triangles[*place] = triangle as u32;
                *place += 1;
            }
        }
        Bands { starts, triangles }
    }

    /// First band and one past the last that a triangle may touch. An image has at most 16384 rows.
    fn band_range(&self, triangle: u32) -> (u16, u16) {
        let Some(corners) = self.corners(triangle) else {
            return (0, 0);
        };
        let (mut least, mut greatest) = ([i64::MAX; 2], [i64::MIN; 2]);
        self.for_each_fan(&corners, |fan| {
            for [x, y] in fan {
                least = [least[0].min(x), least[1].min(y)];
                greatest = [greatest[0].max(x), greatest[1].max(y)];
            }
        });
        if least[0] > greatest[0] {
            return (0, 0);
        }
        let size = [
            i64::from(self.camera.width()),
            i64::from(self.camera.height()),
        ];
        let columns = centers_within(least[0], greatest[0], 0..size[0]);
        let rows = centers_within(least[1], greatest[1], 0..size[1]);
        if columns.is_empty() || rows.is_empty() {
            return (0, 0);
        }
        let band = |row: i64| (row as usize / BAND_ROWS) as u16;
        (band(rows.start), band(rows.end - 1) + 1)
    }
}

/// Where the camera sees a point, in fixed point; `None` near or behind the camera, far outside the image, or
/// not finite.
fn pixel(point: DVec3, camera: &Intrinsics) -> Option<FixedPoint> {
    if !(point.z >= Z_NEAR) {
        return None;
    }
    let (focal, center) = (camera.focal(), camera.center());
    let x = focal.x * point.x / point.z + center.x;
    let y = focal.y * point.y / point.z + center.y;
    (x.abs() <= GUARD_PIXELS && y.abs() <= GUARD_PIXELS).then(|| [fixed(x), fixed(y)])
}
