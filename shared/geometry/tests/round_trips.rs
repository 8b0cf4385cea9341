//! There and back: cameras, rotations, twists, the panorama; and robust statistics by hand.

mod sampling;

use geometry::direction::{angle_between, reflect};
use geometry::robust::{MAD_TO_SIGMA, mad_sigma, median, quantile, weighted_median};
use geometry::rotation::{exp, exp_twist, from_matrix, log, log_twist};
use geometry::{CameraError, DMat3, DVec2, DVec3, Distortion, Intrinsics, PanoramaSize, Pose};
use sampling::{generator, uniform, unit_vector};
use std::f64::consts::PI;

/// A VGA camera with a lens as RGB-D cameras have them.
fn camera() -> Intrinsics {
    let lens = Distortion {
        k1: 0.26,
        k2: -0.95,
        p1: -0.0054,
        p2: 0.0026,
        k3: 1.16,
    };
    Intrinsics::new(640, 480, 517.3, 516.5, 318.6, 255.3, lens).expect("the lens of TUM freiburg1")
}

#[test]
fn a_pixel_comes_back_from_its_ray() {
    let camera = camera();
    let mut rng = generator(1);
    for _ in 0..20_000 {
        let pixel = DVec2::new(
            uniform(&mut rng, -0.5, 639.5),
            uniform(&mut rng, -0.5, 479.5),
        );
        let ray = camera.camera_from_pixel(pixel).expect("inside the image");
        assert_eq!(ray.z, 1.0);
        let depth = uniform(&mut rng, 0.02, 10.0);
        let back = camera.pixel_from_camera(ray * depth).expect("in front");
        assert!(
            (back - pixel).length() < 1e-10,
            "{pixel} came back as {back}"
        );
    }
}

#[test]
fn a_point_comes_back_from_its_pixel_and_depth() {
    let (camera, mut rng) = (camera(), generator(2));
    for _ in 0..20_000 {
        let z = uniform(&mut rng, 0.02, 10.0);
        let point = DVec3::new(
            uniform(&mut rng, -0.6, 0.6) * z,
            uniform(&mut rng, -0.45, 0.45) * z,
            z,
        );
        let pixel = camera.pixel_from_camera(point).expect("in front");
        let back = camera.camera_from_pixel(pixel).expect("seen") * z;
        assert!(
            (back - point).length() < 1e-11 * z,
            "{point} came back as {back}"
        );
    }
}

#[test]
fn a_pinhole_projects_by_hand() {
    let camera = Intrinsics::pinhole(640, 480, 500.0, 400.0, 320.0, 240.0).expect("a camera");
    let pixel = camera
        .pixel_from_camera(DVec3::new(0.2, -0.1, 2.0))
        .expect("in front");
    assert!(
        (pixel - DVec2::new(370.0, 220.0)).length() < 1e-12,
        "right and up of the centre"
    );
    let ray = camera
        .camera_from_pixel(DVec2::new(370.0, 220.0))
        .expect("a pixel");
    assert!((ray - DVec3::new(0.1, -0.05, 1.0)).length() < 1e-15);
    assert_eq!(camera.camera_from_pixel(DVec2::new(f64::NAN, 0.0)), None);
}

#[test]
fn distortion_follows_brown_and_conrady() {
    let lens = Distortion {
        k1: 0.1,
        k2: 0.2,
        p1: 0.01,
        p2: 0.02,
        k3: 0.3,
    };
    // By hand at (0.5, 1): r² = 1.25, radial = 1 + 0.125 + 0.3125 + 0.5859375.
    let expected = DVec2::new(
        0.5 * 2.023_437_5 + 2.0 * 0.01 * 0.5 + 0.02 * (1.25 + 0.5),
        2.023_437_5 + 0.01 * (1.25 + 2.0) + 2.0 * 0.02 * 0.5,
    );
    assert!((lens.distort(DVec2::new(0.5, 1.0)) - expected).length() < 1e-15);
}

#[test]
fn numbers_that_are_no_camera_are_refused() {
    let usual = |w, h, f, cx, cy| Intrinsics::pinhole(w, h, f, f, cx, cy);
    assert_eq!(
        usual(0, 480, 500.0, 0.0, 0.0),
        Err(CameraError::Size {
            width: 0,
            height: 480
        })
    );
    assert_eq!(
        usual(640, 16_385, 500.0, 0.0, 0.0),
        Err(CameraError::Size {
            width: 640,
            height: 16_385
        })
    );
    for focal in [0.0, -500.0, 100.0, 6401.0, f64::INFINITY] {
        let refused = usual(640, 480, focal, 320.0, 240.0);
        assert_eq!(refused, Err(CameraError::Focal { focal, width: 640 }));
    }
    assert!(matches!(
        usual(640, 480, f64::NAN, 320.0, 240.0),
        Err(CameraError::Focal { .. })
    ));
    for (cx, cy) in [(-1.0, 240.0), (641.0, 240.0), (320.0, 481.0)] {
        assert_eq!(
            usual(640, 480, 500.0, cx, cy),
            Err(CameraError::PrincipalPoint { cx, cy })
        );
    }
    assert!(matches!(
        usual(640, 480, 500.0, f64::NAN, 240.0),
        Err(CameraError::PrincipalPoint { .. })
    ));
}

#[test]
fn rotations_come_back_from_vectors_and_matrices() {
    let mut rng = generator(3);
    for _ in 0..20_000 {
        let vector = unit_vector(&mut rng) * uniform(&mut rng, 0.0, PI - 1e-9);
        let rotation = exp(vector);
        assert!((rotation.length() - 1.0).abs() < 1e-15);
        assert!((log(rotation) - vector).length() < 1e-14);
        assert!(
            (log(-rotation) - vector).length() < 1e-14,
            "q and -q are one rotation"
        );
        let again = from_matrix(DMat3::from_quat(rotation));
        assert!(
            (log(again) - vector).length() < 1e-7,
            "a matrix near pi knows less of its axis"
        );
        assert!(again.w >= 0.0);
        assert!((again.dot(rotation).abs() - 1.0).abs() < 1e-15);
        let point = unit_vector(&mut rng);
        let (turned, by_matrix) = (rotation * point, DMat3::from_quat(again) * point);
        assert!((turned - by_matrix).length() < 1e-14);
    }
}

#[test]
fn a_quarter_turn_about_z_takes_x_to_y() {
    let turn = Pose::from_axis_angle(DVec3::Z * 7.0, PI / 2.0);
    assert!((turn.transform_vector(DVec3::X) - DVec3::Y).length() < 1e-15);
    let world_from_camera = Pose::from_translation(DVec3::new(1.0, 2.0, 3.0)) * turn;
    let seen = world_from_camera.transform_point(DVec3::X);
    assert!(
        (seen - DVec3::new(1.0, 3.0, 3.0)).length() < 1e-15,
        "rotate, then translate"
    );
    let (z, y, x) = turn.euler_zyx();
    assert!((z - PI / 2.0).abs() < 1e-15 && y.abs() < 1e-15 && x.abs() < 1e-15);
}

#[test]
fn twists_compose_along_their_axis() {
    let mut rng = generator(4);
    for _ in 0..5000 {
        let w = unit_vector(&mut rng) * uniform(&mut rng, 0.0, 3.0);
        let v = unit_vector(&mut rng) * uniform(&mut rng, 0.0, 3.0);
        let whole = exp_twist(w, v);
        let halves = exp_twist(w * 0.5, v * 0.5) * exp_twist(w * 0.5, v * 0.5);
        assert!((whole.translation() - halves.translation()).length() < 1e-14);
        assert!((whole.rotation().dot(halves.rotation()).abs() - 1.0).abs() < 1e-15);
        let back = exp_twist(-w, -v);
        assert!((whole.inverse().translation() - back.translation()).length() < 1e-14);
        let (w_again, v_again) = log_twist(&whole);
        assert!((w_again - w).length() < 1e-13 && (v_again - v).length() < 1e-12);
    }
}

#[test]
fn a_small_twist_moves_points_by_its_velocity() {
    let (w, v, p) = (
        DVec3::new(0.1, -0.2, 0.3),
        DVec3::new(1.0, 2.0, -1.0),
        DVec3::new(0.4, 0.5, 0.6),
    );
    let step = 1e-6;
    let moved = exp_twist(w * step, v * step).transform_point(p);
    let difference = (moved - exp_twist(w * -step, v * -step).transform_point(p)) / (2.0 * step);
    assert!(
        (difference - (w.cross(p) + v)).length() < 1e-9,
        "d/dt exp(t xi) p = w x p + v"
    );
}

#[test]
fn composition_is_associative_and_inverts() {
    let mut rng = generator(5);
    let mut pose = || exp_twist(unit_vector(&mut rng) * 2.0, unit_vector(&mut rng) * 5.0);
    for _ in 0..2000 {
        let (a, b, c) = (pose(), pose(), pose());
        let p = DVec3::new(0.3, -0.4, 1.5);
        let left = ((a * b) * c).transform_point(p);
        assert!((left - (a * (b * c)).transform_point(p)).length() < 1e-13);
        assert!(
            (left - a.transform_point(b.transform_point(c.transform_point(p)))).length() < 1e-13
        );
        let back = (a * b)
            .inverse()
            .transform_point(a.transform_point(b.transform_point(p)));
        assert!((back - p).length() < 1e-13);
    }
}

#[test]
fn reflecting_twice_gives_the_direction_back() {
    let mut rng = generator(6);
    for _ in 0..10_000 {
        let (outgoing, normal) = (unit_vector(&mut rng), unit_vector(&mut rng));
        let once = reflect(outgoing.as_vec3(), normal.as_vec3());
        let twice = reflect(once, normal.as_vec3()).as_dvec3();
        assert!(
            angle_between(twice, outgoing) < 2e-6,
            "f32 rounds each reflection to 4e-7"
        );
    }
}

#[test]
fn texels_and_directions_are_one_to_one() {
    for height in [1, 2, 3, 16, 125, 250] {
        let size = PanoramaSize::from_height(height).expect("a size");
        for index in 0..size.texel_count() {
            let column = (index % size.width() as usize) as f64;
            let row = (index / size.width() as usize) as f64;
            let direction = size.direction_from_texel(DVec2::new(column, row));
            assert!((direction.length() - 1.0).abs() < 1e-15);
            assert_eq!(size.index_from_direction(direction), index);
            let texel = size.texel_from_direction(direction * 1e-20);
            assert!(
                (texel - DVec2::new(column, row)).length() < 1e-10,
                "{texel}"
            );
        }
    }
    let size = PanoramaSize::from_height(250).expect("a size");
    let mut rng = generator(7);
    for _ in 0..50_000 {
        let direction = unit_vector(&mut rng);
        let back = size.direction_from_texel(size.texel_from_direction(direction));
        assert!(angle_between(back, direction) < 1e-14);
    }
}

#[test]
fn a_texel_looked_up_at_its_centre_is_itself() {
    let size = PanoramaSize::from_height(16).expect("a size");
    for row in 0..16 {
        for column in 0..32 {
            let centre = DVec2::new(f64::from(column), f64::from(row));
            let taps = size.taps(size.direction_from_texel(centre));
            let own = size.wrap(i64::from(column), i64::from(row));
            let weight: f32 = taps
                .texels
                .iter()
                .zip(taps.weights)
                .filter(|(t, _)| **t == own)
                .map(|(_, w)| w)
                .sum();
            assert!(
                (weight - 1.0).abs() < 1e-6,
                "texel ({column}, {row}) has weight {weight}"
            );
        }
    }
}

#[test]
fn rows_beyond_a_pole_are_half_a_turn_on() {
    let size = PanoramaSize::from_height(4).expect("a size");
    assert_eq!(size.wrap(0, -1), 4);
    assert_eq!(size.wrap(6, -1), 2);
    assert_eq!(size.wrap(1, 4), 3 * 8 + 5);
    assert_eq!(size.wrap(-1, 2), 2 * 8 + 7);
    assert_eq!(size.wrap(8, 2), 2 * 8);
    // The continuous mapping agrees: beyond the pole it comes down on the other side.
    let beyond = size.direction_from_texel(DVec2::new(1.0, -1.0));
    assert!((beyond - size.direction_from_texel(DVec2::new(5.0, 0.0))).length() < 1e-15);
    assert_eq!(PanoramaSize::from_height(0), None);
    assert_eq!(PanoramaSize::from_height(32_769), None);
}

#[test]
fn latitudes_fall_from_up_to_down() {
    let size = PanoramaSize::from_height(4).expect("a size");
    let expected = [67.5_f64, 22.5, -22.5, -67.5];
    for (row, degrees) in (0..4).zip(expected) {
        assert!((size.latitude(row).to_degrees() - degrees).abs() < 1e-12);
        let direction = size.direction_from_texel(DVec2::new(3.0, f64::from(row)));
        assert!(
            (direction.y + size.latitude(row).sin()).abs() < 1e-15,
            "up is -y"
        );
    }
}

#[test]
fn quantiles_by_hand() {
    let list = || vec![3.0, f64::NAN, 1.0, 2.0, 4.0];
    assert_eq!(median(&mut list()), Some(2.5));
    assert_eq!(quantile(&mut list(), 0.0), Some(1.0));
    assert_eq!(quantile(&mut list(), 1.0), Some(4.0));
    assert_eq!(quantile(&mut list(), 0.25), Some(1.75));
    assert_eq!(quantile(&mut list(), 7.0), Some(4.0));
    assert_eq!(median(&mut vec![f64::NAN]), None);
    // An infinite outlier does not reach a quantile it does not stand at.
    assert_eq!(quantile(&mut vec![1.0, f64::INFINITY], 0.0), Some(1.0));
    assert_eq!(median(&mut vec![1.0, 2.0, f64::INFINITY]), Some(2.0));
}

#[test]
fn weighted_medians_by_hand() {
    assert_eq!(
        weighted_median(&mut vec![(5.0, 1.0), (1.0, 1.0), (9.0, 3.0)]),
        Some(9.0)
    );
    assert_eq!(
        weighted_median(&mut vec![(5.0, 1.0), (1.0, 1.0)]),
        Some(1.0)
    );
    let mut dirty = vec![
        (f64::NAN, 9.0),
        (1.0, f64::NAN),
        (2.0, -1.0),
        (3.0, 0.0),
        (4.0, 1e-300),
    ];
    assert_eq!(weighted_median(&mut dirty), Some(4.0));
    assert_eq!(weighted_median(&mut vec![(3.0, 0.0)]), None);
}

#[test]
fn the_robust_scale_ignores_an_outlier() {
    assert_eq!(
        mad_sigma(&[1.0, 2.0, 3.0, 4.0, 1e9], 0.0),
        Some(MAD_TO_SIGMA)
    );
    assert_eq!(mad_sigma(&[2.0; 9], 0.5), Some(0.5), "the floor");
    assert_eq!(mad_sigma(&[], 0.5), None);
}
