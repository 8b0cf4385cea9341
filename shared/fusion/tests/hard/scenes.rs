//! Depth images of analytic surfaces, without noise.

use geometry::{DMat3, DVec2, DVec3, Intrinsics, Pose};

/// A camera of `width` x ¾ `width` pixels with a field of view of 53 degrees.
pub(crate) fn camera(width: u32) -> Intrinsics {
    let height = width * 3 / 4;
    let (cx, cy) = (0.5 * f64::from(width - 1), 0.5 * f64::from(height - 1));
    Intrinsics::pinhole(width, height, f64::from(width), f64::from(width), cx, cy)
        .expect("a usable camera")
}

/// A pose at `eye` that looks at `target`.
pub(crate) fn look_at(eye: DVec3, target: DVec3) -> Pose {
    let forward = (target - eye).normalize();
    let down = if forward.y.abs() < 0.9 {
        DVec3::Y
    } else {
        DVec3::X
    };
    let right = down.cross(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward);
    Pose::from_matrix(rotation, eye).expect("a rotation")
}

/// The depth image of a surface; `hit` gives the ray parameter of the nearest intersection.
pub(crate) fn render(
    camera: &Intrinsics,
    world_from_camera: &Pose,
    hit: impl Fn(DVec3, DVec3) -> Option<f64>,
) -> Vec<f32> {
    let eye = world_from_camera.translation();
    (0..camera.height())
        .flat_map(|y| (0..camera.width()).map(move |x| (x, y)))
        .map(|(x, y)| {
            let pixel = DVec2::new(f64::from(x), f64::from(y));
            // A ray with z = 1, so that its parameter is depth.
            let ray = ((pixel - camera.center()) / camera.focal()).extend(1.0);
            let depth = hit(eye, world_from_camera.transform_vector(ray));
            depth.filter(|&depth| depth > 0.0).unwrap_or(0.0) as f32
        })
        .collect()
}

/// The plane through `point`.
pub(crate) fn plane(point: DVec3, normal: DVec3) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |eye, ray| {
        let along = ray.dot(normal);
        (along != 0.0).then(|| (point - eye).dot(normal) / along)
    }
}

/// The sphere about `center`.
pub(crate) fn sphere(center: DVec3, radius: f64) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |eye, ray| {
        let offset = eye - center;
        let (a, b) = (ray.length_squared(), offset.dot(ray));
        let root = b * b - a * (offset.length_squared() - radius * radius);
        (root >= 0.0).then(|| (-b - root.sqrt()) / a)
    }
}

/// The box of half extents `half` about the origin, turned by `axes` (columns: its axes).
pub(crate) fn cuboid(axes: DMat3, half: DVec3) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |eye, ray| {
        let (eye, ray) = (axes.transpose() * eye, axes.transpose() * ray);
        let (a, b) = ((-half - eye) / ray, (half - eye) / ray);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        (enter <= leave).then_some(enter)
    }
}
