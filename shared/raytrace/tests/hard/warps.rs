//! Hard case E13: the depth test of warps.

use geometry::{DVec2, DVec3, Intrinsics, Pose};
use glam::Vec3;
use raytrace::warp::sees_same_surface;
use raytrace::{NO_TRIANGLE, rasterise};

use crate::rows::{bites, generator, holds, uniform};

/// Depth quantisation of a structured-light camera, metres (hard-cases B02).
fn step(depth: f32) -> f32 {
    2.89e-3 * depth * depth
}

/// A plane at z = `distance`, tilted by `tilt` radians about y.
fn plane(distance: f64, tilt: f64) -> [Vec3; 3] {
    [(-20.0, -20.0), (20.0, -20.0), (0.0, 30.0)].map(|(along, y)| {
        let p = DVec3::new(along * tilt.cos(), y, distance + along * tilt.sin());
        p.as_vec3()
    })
}

/// Share of the points that view A sees of a plane, at depths of 0.4 to 1.4 m, which `same`
/// (depth, expected, cosine) finds at the nearest pixel of view B. B's plane lies `gap` metres nearer.
fn kept_share(tilt: f64, gap: f64, baseline: f64, same: impl Fn(f32, f32, f32) -> bool) -> f64 {
    let camera = Intrinsics::pinhole(160, 120, 144.0, 144.0, 79.5, 59.5).expect("a camera");
    let pose_b = Pose::from_translation(DVec3::new(baseline, 0.02, 0.0));
    let seen_by_b = rasterise(&plane(0.9 - gap, tilt), &[[0, 1, 2]], &camera, &pose_b);
    let normal = DVec3::new(-tilt.sin(), 0.0, tilt.cos());
    let (mut kept, mut count) = (0, 0);
    for y in 0..camera.height() {
        for x in 0..camera.width() {
            let ray = camera
                .camera_from_pixel(DVec2::new(f64::from(x), f64::from(y)))
                .expect("no distortion");
            let z = 0.9 * tilt.cos() / normal.dot(ray);
            let point = pose_b.inverse().transform_point(ray * z);
            let pixel = camera
                .pixel_from_camera(point)
                .and_then(|pixel| camera.contains(pixel));
            let Some((column, row)) = pixel.filter(|_| (0.4..1.4).contains(&z)) else {
                continue;
            };
            let index = (row * camera.width() + column) as usize;
            if seen_by_b.triangle[index] != NO_TRIANGLE {
                count += 1;
                let cosine = normal.dot(point.normalize()).abs() as f32;
                kept += u32::from(same(seen_by_b.depth[index], point.z as f32, cosine));
            }
        }
    }
    assert!(count > 500, "{count} correspondences");
    f64::from(kept) / f64::from(count)
}

#[test]
fn hc_e13_depth_test_of_warps() {
    let tilt = 75_f64.to_radians();
    let naive =
        |epsilon: f32| move |depth: f32, expected: f32, _: f32| (depth - expected).abs() <= epsilon;
    bites(
        "e13 true matches lost at 75 degrees",
        1.0 - kept_share(tilt, 0.0, 0.05, naive(0.005)),
        0.01,
    );
    bites(
        "e13 false matches over 2 cm",
        kept_share(0.0, 0.02, 0.05, naive(0.03)),
        0.01,
    );

    let shipped = |depth: f32, expected: f32, cosine: f32| {
        sees_same_surface(depth, expected, step(expected), cosine)
    };
    let mut rng = generator(513);
    let (mut lost, mut false_share) = (0.0_f64, 0.0_f64);
    for round in 0..20 {
        let baseline = if round == 0 {
            0.05
        } else {
            uniform(&mut rng, -0.1, 0.1)
        };
        lost = lost.max(1.0 - kept_share(tilt, 0.0, baseline, shipped));
        false_share = false_share.max(kept_share(0.0, 0.02, baseline, shipped));
    }
    holds("e13 true matches lost at 75 degrees", lost, 0.01);
    holds("e13 false matches over 2 cm", false_share, 0.01);
    assert!(
        !sees_same_surface(0.0, 1.0, 0.01, 1.0),
        "nothing was measured"
    );
    assert!(!sees_same_surface(f32::NAN, 1.0, 0.01, 1.0));
}
