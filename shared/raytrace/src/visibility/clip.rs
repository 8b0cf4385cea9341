//! Cuts triangles at the near plane and far outside the image, in camera axes.

use geometry::camera::Z_NEAR;
use geometry::{DVec3, Intrinsics};

/// Farthest drawn pixel coordinate: fixed point with 8 bits then fits products of 62 bits (hard-cases E10).
pub(super) const GUARD_PIXELS: f64 = (1 << 21) as f64;

/// Corners of a triangle cut by five planes.
const CORNER_LIMIT: usize = 8;

/// A half space: `normal · point >= offset` is kept.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: DVec3,
    offset: f64,
}

/// A convex polygon in camera axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    corners: [DVec3; CORNER_LIMIT],
    count: usize,
}

impl Polygon {
    /// The corners in order; fewer than 3 when nothing is left.
    pub(super) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    fn push(&mut self, corner: DVec3) {
        self.corners[self.count] = corner;
        self.count += 1;
    }
}

/// The part of a triangle in front of [`Z_NEAR`] and within [`GUARD_PIXELS`] of the image's origin.
///
/// A cut point is always computed from the corner inside, so neighbours that share an edge share the point to
/// the bit.
pub(super) fn clip(triangle: [DVec3; 3], camera: &Intrinsics) -> Polygon {
    let mut polygon = Polygon {
        corners: [DVec3::ZERO; CORNER_LIMIT],
        count: 0,
    };
    triangle.into_iter().for_each(|corner| polygon.push(corner));
    for plane in planes(camera) {
        polygon = cut(&polygon, plane);
    }
    polygon
}

fn planes(camera: &Intrinsics) -> [Plane; 5] {
    let (focal, center) = (camera.focal(), camera.center());
    let side = |x: f64, y: f64, z: f64| Plane {
        normal: DVec3::new(x, y, z),
        offset: 0.0,
    };
    [
        Plane {
            normal: DVec3::Z,
            offset: Z_NEAR,
        },
        side(focal.x, 0.0, GUARD_PIXELS + center.x),
        side(-focal.x, 0.0, GUARD_PIXELS - center.x),
        side(0.0, focal.y, GUARD_PIXELS + center.y),
        side(0.0, -focal.y, GUARD_PIXELS - center.y),
    ]
}

/// Sutherland and Hodgman's cut.
fn cut(polygon: &Polygon, plane: Plane) -> Polygon {
    let mut kept = Polygon {
        corners: [DVec3::ZERO; CORNER_LIMIT],
        count: 0,
    };
    let corners = polygon.corners();
    let height = |p: DVec3| plane.normal.dot(p) - plane.offset;
    for (index, &from) in corners.iter().enumerate() {
        let to = corners[(index + 1) % corners.len()];
        let (from_height, to_height) = (height(from), height(to));
        if from_height >= 0.0 {
            kept.push(from);
        }
        if (from_height >= 0.0) != (to_height >= 0.0) {
            let (inside, outside, inner, outer) = if from_height >= 0.0 {
                (from, to, from_height, to_height)
            } else {
                (to, from, to_height, from_height)
            };
            kept.push(inside + (outside - inside) * (inner / (inner - outer)));
        }
    }
    kept
}
