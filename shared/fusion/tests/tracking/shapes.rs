//! Analytic surfaces, seen by a small depth camera.

use fusion::tracking::{DepthNoise, PointPyramid};
use fusion::{ModelView, Surfel};
use geometry::{DVec3, Intrinsics, Pose};
use imaging::DepthImage;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

/// Signed distance of a surface, world axes, metres.
pub(crate) type Distance = fn(DVec3) -> f64;

pub(crate) const PLANE: Distance = |p| 1.0 - p.z;
pub(crate) const SPHERE: Distance = |p| (p - DVec3::new(0.0, 0.0, 0.8)).length() - 0.3;
/// Along y, so that turning about it and sliding along it are free.
pub(crate) const CYLINDER: Distance = |p| DVec3::new(p.x, 0.0, p.z - 0.8).length() - 0.25;
/// Half slope 0.3, axis y, wide end down.
pub(crate) const CONE: Distance = |p| {
    let radius = 0.25 + 0.3 * p.y;
    (DVec3::new(p.x, 0.0, p.z - 0.9).length() - radius) / 1.09_f64.sqrt()
};
pub(crate) const TORUS: Distance = |p| {
    let q = p - DVec3::new(0.0, 0.0, 0.9);
    // Axis along z, tilted towards the eye by being looked at from the side.
    let ring = q.x.hypot(q.y) - 0.25;
    ring.hypot(q.z) - 0.1
};
/// Three walls that meet at right angles, all tilted to the camera.
pub(crate) const CORNER: Distance = |p| {
    let q = p - DVec3::new(0.0, 0.0, 1.2);
    let walls = [
        DVec3::new(3.0_f64.sqrt(), 1.0, -2.0_f64.sqrt()),
        DVec3::new(-(3.0_f64.sqrt()), 1.0, -2.0_f64.sqrt()),
        DVec3::new(0.0, -2.0, -2.0_f64.sqrt()),
    ];
    let distance = |wall: &DVec3| wall.normalize().dot(q);
    walls.iter().map(distance).fold(f64::INFINITY, f64::min)
};

/// 160 x 120 pixels, 58 degrees wide.
pub(crate) fn camera() -> Intrinsics {
    Intrinsics::pinhole(160, 120, 144.0, 144.0, 79.5, 59.5).expect("a camera")
}

/// What a camera sees of a surface: depth in metres, 0 where the ray misses or grazes.
pub(crate) fn depth(
    surface: Distance,
    camera: &Intrinsics,
    world_from_camera: &Pose,
) -> DepthImage {
    DepthImage::from_fn(camera.width(), camera.height(), |x, y| {
        hit(surface, camera, world_from_camera, x, y).map_or(0.0, |(z, _)| z as f32)
    })
}

/// What the model looks like: exact positions, normals with noise of `normal_sigma` radians per axis.
pub(crate) fn view(
    surface: Distance,
    camera: &Intrinsics,
    world_from_camera: &Pose,
    normal_sigma: f64,
    grey: impl Fn(DVec3) -> f32,
) -> ModelView {
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let mut view = ModelView::new(camera, world_from_camera);
    let camera_from_world = world_from_camera.inverse();
    for y in 0..camera.height() {
        for x in 0..camera.width() {
            let Some((z, point)) = hit(surface, camera, world_from_camera, x, y) else {
                continue;
            };
            let position = camera.camera_from_pixel(geometry::DVec2::new(x.into(), y.into()));
            let position = position.expect("no distortion") * z;
            let noise = DVec3::from_array(std::array::from_fn(|_| normal(&mut random)));
            let normal = camera_from_world.transform_vector(gradient(surface, point));
            let normal = (normal + noise * normal_sigma).normalize();
            view.surfels[(y * camera.width() + x) as usize] = Surfel {
                position: position.as_vec3().to_array(),
                grey: grey(point),
                normal: normal.as_vec3().to_array(),
                weight: 1.0,
            };
        }
    }
    view
}

/// The points of a depth image.
pub(crate) fn points(depth: &DepthImage, camera: &Intrinsics) -> PointPyramid {
    let mut points = PointPyramid::new(camera, 3, DepthNoise::default());
    points.load(depth);
    points
}

/// A sample of the normal distribution.
pub(crate) fn normal(random: &mut Pcg64Mcg) -> f64 {
    let (a, b): (f64, f64) = (
        random.random_range(1e-12..1.0),
        random.random_range(0.0..1.0),
    );
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// Depth and world position of what a pixel sees, up to 75 degrees of slant.
fn hit(
    surface: Distance,
    camera: &Intrinsics,
    world_from_camera: &Pose,
    x: u32,
    y: u32,
) -> Option<(f64, DVec3)> {
    let ray = camera.camera_from_pixel(geometry::DVec2::new(x.into(), y.into()))?;
    let direction = world_from_camera.transform_vector(ray);
    let eye = world_from_camera.translation();
    let mut z = 0.1;
    for _ in 0..200 {
        let distance = surface(eye + direction * z);
        if distance.abs() < 1e-12 {
            break;
        }
        z += distance / direction.length();
        if !(0.05..3.0).contains(&z) {
            return None;
        }
    }
    let point = eye + direction * z;
    let slant = -gradient(surface, point).dot(direction.normalize());
    (surface(point).abs() < 1e-9 && slant > 0.26).then_some((z, point))
}

fn gradient(surface: Distance, at: DVec3) -> DVec3 {
    let step = 1e-5;
    let along = |axis: DVec3| surface(at + axis * step) - surface(at - axis * step);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)).normalize()
}
