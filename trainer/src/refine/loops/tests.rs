//! Which alignments of keyframes are believed.

use fusion::Surfel;
use fusion::tracking::points::half_camera;
use fusion::tracking::{DepthNoise, PointPyramid};
use geometry::{DVec3, Intrinsics, rotation};
use glam::DVec2;
use imaging::Image;

use super::*;

/// A place: depth along the ray of a pixel of the camera that looks straight at it, metres.
type Place = fn(f64, f64) -> f64;

fn camera() -> Intrinsics {
    Intrinsics::pinhole(320, 240, 280.0, 280.0, 159.5, 119.5).unwrap()
}

fn hills(x: f64, y: f64) -> f64 {
    1.0 + 0.06 * (9.0 * x).sin() * (8.0 * y + 0.4).cos() + 0.04 * (5.0 * x - 3.0 * y).sin()
}

fn other_hills(x: f64, y: f64) -> f64 {
    1.0 + 0.06 * (14.0 * x + 2.0).cos() * (4.0 * y).sin() - 0.05 * (3.0 * x + 9.0 * y).cos()
}

/// The surface z = place(x, y) where the ray of a pixel meets it.
fn met(place: Place, eye: &Pose, ray: DVec3) -> DVec3 {
    let (from, toward) = (eye.translation(), eye.transform_vector(ray));
    let mut t = 1.0;
    for _ in 0..60 {
        let point = from + toward * t;
        t += 0.6 * (place(point.x, point.y) - point.z);
    }
    from + toward * t
}

fn view_of(place: Place) -> ModelView {
    let camera = half_camera(&camera()).unwrap();
    let mut view = ModelView::new(&camera, &Pose::IDENTITY);
    for (index, surfel) in view.surfels.iter_mut().enumerate() {
        let pixel = DVec2::new((index % 160) as f64, (index / 160) as f64);
        let p = met(
            place,
            &Pose::IDENTITY,
            camera.camera_from_pixel(pixel).unwrap(),
        );
        let step = 1e-4;
        let slope = |dx: f64, dy: f64| {
            (place(p.x + dx, p.y + dy) - place(p.x - dx, p.y - dy)) / (2.0 * step)
        };
        let normal = DVec3::new(slope(step, 0.0), slope(0.0, step), -1.0).normalize();
        *surfel = Surfel {
            position: p.as_vec3().to_array(),
            grey: 0.0,
            normal: normal.as_vec3().to_array(),
            weight: 10.0,
        };
    }
    view
}

fn frame_of(place: Place, pose: &Pose) -> LoadedFrame {
    let camera = camera();
    let depth = Image::from_fn(320, 240, |x, y| {
        let ray = camera
            .camera_from_pixel(DVec2::new(x.into(), y.into()))
            .unwrap();
        pose.inverse().transform_point(met(place, pose, ray)).z as f32
    });
    let mut points = PointPyramid::new(&camera, 3, DepthNoise::default());
    points.load(&depth);
    LoadedFrame {
        depth,
        points,
        photograph: None,
    }
}

#[test]
fn a_place_is_recognised_from_nearby_and_another_is_refused() {
    let view = view_of(hills);
    let moved = rotation::exp_twist(
        DVec3::new(0.01, -0.02, 0.015),
        DVec3::new(0.02, -0.01, 0.015),
    );
    let right = frame_of(hills, &moved);
    let found = verified(&view, &right, &Pose::IDENTITY, Reason::Overlap).expect("the same place");
    let error = moved.inverse() * found.view_from_live;
    println!("off by {:.6} m", error.translation().length());
    assert!(error.translation().length() < 5e-4);
    let wrong = frame_of(other_hills, &Pose::IDENTITY);
    for reason in [Reason::Overlap, Reason::Looks] {
        assert!(verified(&view, &wrong, &Pose::IDENTITY, reason).is_none());
    }
    let blank = LoadedFrame {
        depth: Image::new(320, 240, 0.0),
        points: PointPyramid::new(&camera(), 3, DepthNoise::default()),
        photograph: None,
    };
    assert!(verified(&view, &blank, &Pose::IDENTITY, Reason::Overlap).is_none());
}

#[test]
fn unobserved_directions_carry_no_information() {
    let mut information = [[0.0; 6]; 6];
    for (axis, row) in information.iter_mut().enumerate().take(5) {
        row[axis] = 1e10;
    }
    let floored = with_floor(&information, FLOOR);
    assert!((floored[5][5] - LEAST_INFORMATION).abs() < 1e-6);
    let expected = 1.0 / (FLOOR[0] * FLOOR[0] + 1e-10);
    assert!((floored[0][0] / expected - 1.0).abs() < 1e-9);
    let not_a_number = with_floor(&[[f64::NAN; 6]; 6], FLOOR);
    assert!(not_a_number.iter().flatten().all(|entry| entry.is_finite()));
}
