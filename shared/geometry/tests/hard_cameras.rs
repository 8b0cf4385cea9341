//! Hard cases A12 and A13: what is visible, and distortion near its fold.

mod rows;
mod sampling;

use geometry::{CameraError, DVec2, DVec3, Distortion, Intrinsics};
use rows::{bites, holds, worse};
use sampling::{generator, uniform, unit_vector};

fn vga() -> Intrinsics {
    Intrinsics::pinhole(640, 480, 525.0, 525.0, 319.5, 239.5).expect("a usual camera")
}

fn visible(camera: &Intrinsics, point: DVec3) -> Option<(u32, u32)> {
    camera.contains(camera.pixel_from_camera(point)?)
}

/// Divide, cast, compare: saturating casts land bad points on column or row 0.
fn naive_visible(point: DVec3) -> Option<(u32, u32)> {
    let u = 525.0 * point.x / point.z + 319.5;
    let v = 525.0 * point.y / point.z + 239.5;
    let (column, row) = (u as i32, v as i32);
    ((0..640).contains(&column) && (0..480).contains(&row)).then_some((column as u32, row as u32))
}

#[test]
fn hc_a12_behind_the_camera_is_not_visible() {
    let camera = vga();
    let listed = [-1.0, 0.0, -0.0, 1e-39, f64::NAN];
    let naive_count = listed
        .iter()
        .filter(|&&z| naive_visible(DVec3::new(0.0, 0.0, z)).is_some())
        .count();
    bites("a12", naive_count as f64, 0.0);
    assert_eq!(
        naive_visible(DVec3::new(0.0, 0.0, f64::NAN)),
        Some((0, 0)),
        "NaN lands on pixel (0, 0)"
    );

    let mut seen = 0.0;
    let mut rng = generator(112);
    for &z in listed.iter().chain(&[
        0.009_999,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MIN_POSITIVE,
    ]) {
        for _ in 0..500 {
            let (x, y) = (uniform(&mut rng, -1.0, 1.0), uniform(&mut rng, -1.0, 1.0));
            for point in [
                DVec3::new(x, y, z),
                DVec3::new(x * z, y * z, z),
                DVec3::new(0.0, 0.0, z),
            ] {
                seen += f64::from(u8::from(camera.pixel_from_camera(point).is_some()));
            }
        }
    }
    for _ in 0..2000 {
        let ahead = unit_vector(&mut rng);
        let behind = ahead.with_z(-ahead.z.abs()) * uniform(&mut rng, 0.0, 10.0);
        seen += f64::from(u8::from(camera.pixel_from_camera(behind).is_some()));
    }
    for point in [
        DVec3::new(f64::NAN, 0.0, 1.0),
        DVec3::new(0.0, f64::INFINITY, 1.0),
    ] {
        seen += f64::from(u8::from(camera.pixel_from_camera(point).is_some()));
    }
    holds("a12 counted as visible", seen, 0.0);
}

#[test]
fn hc_a12_left_of_the_image_is_not_column_0() {
    let camera = vga();
    // Pixel 0 reaches from -0.5 to 0.5 (design.md section 2), so -0.4 is inside and -0.6 outside.
    let at = |u: f64| DVec3::new((u - 319.5) / 525.0, 0.0, 1.0);
    assert_eq!(
        naive_visible(at(-0.6)),
        Some((0, 239)),
        "the cast truncates to column 0"
    );
    assert_eq!(visible(&camera, at(-0.6)), None);
    assert_eq!(visible(&camera, at(-0.4)), Some((0, 240)));
    assert_eq!(visible(&camera, at(639.4)), Some((639, 240)));
    assert_eq!(visible(&camera, at(639.6)), None);
    for far in [f64::NAN, f64::INFINITY, -1e300, 1e300] {
        assert_eq!(camera.contains(DVec2::new(far, 10.0)), None);
        assert_eq!(camera.contains(DVec2::new(10.0, far)), None);
    }
    let mut rng = generator(212);
    for _ in 0..2000 {
        let pixel = DVec2::new(
            uniform(&mut rng, -50.0, 690.0),
            uniform(&mut rng, -50.0, 530.0),
        );
        let inside = pixel.x >= -0.5 && pixel.x < 639.5 && pixel.y >= -0.5 && pixel.y < 479.5;
        assert_eq!(camera.contains(pixel).is_some(), inside, "{pixel}");
        if let Some((x, y)) = camera.contains(pixel) {
            let off = (pixel - DVec2::new(f64::from(x), f64::from(y))).abs();
            assert!(off.max_element() <= 0.5, "the nearest pixel");
        }
    }
}

fn radial(k1: f64) -> Distortion {
    Distortion {
        k1,
        ..Distortion::NONE
    }
}

/// The usual fixed-point iteration, 20 steps.
fn naive_undistort(k1: f64, distorted: f64) -> f64 {
    (0..20).fold(distorted, |r, _| distorted / (1.0 + k1 * r * r))
}

/// Row A13 and this crate: round trip of undistorted coordinates.
const ROUND_TRIP_TOLERANCE: f64 = 1e-10;

#[test]
fn hc_a13_undistortion_of_the_listed_radii() {
    let distorted = |k1: f64, r: f64| r * (1.0 + k1 * r * r);
    for (k1, r) in [(0.5, 1.5), (-0.3, 1.0), (-0.3, 1.2)] {
        let naive = naive_undistort(k1, distorted(k1, r));
        bites("a13", (naive - r).abs(), ROUND_TRIP_TOLERANCE);
    }
    let mut worst = 0.0;
    for (k1, r) in [
        (0.5, 1.5),
        (-0.3, 1.0),
        (-0.3, 0.7),
        (-0.3, 1.05),
        (0.0, 3.0),
    ] {
        let lens = radial(k1);
        let p = DVec2::new(r * 0.6, r * 0.8);
        let again = lens
            .undistort(lens.distort(p), lens.fold_radius())
            .expect("inside the fold");
        worst = worse(worst, (again - p).length());
    }
    holds("a13", worst, ROUND_TRIP_TOLERANCE);
    let lens = radial(-0.3);
    assert!((lens.fold_radius() - 1.0 / 0.9_f64.sqrt()).abs() < 1e-12);
    // Beyond the largest distorted radius, 2/3 of the fold radius, there is nothing to return.
    for r in [0.703, 0.8, 2.0, 1e6, f64::NAN, f64::INFINITY] {
        assert_eq!(
            lens.undistort(DVec2::new(r, 0.0), lens.fold_radius()),
            None,
            "{r}"
        );
    }
}

/// A lens as cameras have them, tangential part included; of either sign.
fn random_lens(rng: &mut rand_pcg::Pcg64) -> Distortion {
    Distortion {
        k1: uniform(rng, -0.5, 0.5),
        k2: uniform(rng, -0.3, 0.3),
        k3: uniform(rng, -0.1, 0.1),
        p1: uniform(rng, -0.003, 0.003),
        p2: uniform(rng, -0.003, 0.003),
    }
}

#[test]
fn hc_a13_round_trip_inside_the_fold_of_random_lenses() {
    let mut rng = generator(113);
    let mut worst = 0.0;
    let mut worst_near = 0.0;
    for _ in 0..1000 {
        let lens = random_lens(&mut rng);
        let fold = lens.fold_radius();
        for _ in 0..20 {
            let direction = DVec2::from_angle(uniform(&mut rng, 0.0, 7.0));
            let p = direction * uniform(&mut rng, 0.0, (0.97 * fold).min(3.0));
            let again = lens
                .undistort(lens.distort(p), fold)
                .expect("inside the fold");
            worst = worse(worst, (again - p).length());
        }
        // Without the tangential part the radial fold is the true one and can be approached.
        let lens = Distortion {
            p1: 0.0,
            p2: 0.0,
            ..lens
        };
        let p = DVec2::from_angle(uniform(&mut rng, 0.0, 7.0)) * (0.9999 * fold).min(3.0);
        let again = lens
            .undistort(lens.distort(p), fold)
            .expect("just inside the fold");
        worst_near = worse(worst_near, (again - p).length());
    }
    // Distorted points about the largest radius that the lens gives, with a tangential part that moves
    // solutions across the radial fold: an answer lies inside.
    for _ in 0..20_000 {
        let lens = random_lens(&mut rng);
        let lens = Distortion {
            p1: 40.0 * lens.p1,
            ..lens
        };
        let fold = lens.fold_radius();
        let edge = lens.distort(DVec2::X * fold.min(3.0)).length();
        let distorted =
            DVec2::from_angle(uniform(&mut rng, 0.0, 7.0)) * edge * uniform(&mut rng, 0.95, 1.05);
        if let Some(p) = lens.undistort(distorted, fold) {
            assert!(p.length() < fold, "beyond the fold");
            assert!(
                (lens.distort(p) - distorted).length() < 1e-10,
                "no solution"
            );
        }
    }
    holds("a13 random", worst, ROUND_TRIP_TOLERANCE);
    // The slope of the map there is 2e-4: a rounding of 1e-15 becomes 1e-11.
    holds(
        "a13 at 0.9999 of the fold",
        worst_near,
        ROUND_TRIP_TOLERANCE,
    );
}

#[test]
fn hc_a13_a_fold_far_out_is_found() {
    // k₁ = −1e-3 folds at r = 18.3; at r = 31.6 (88.2° off axis) the map returns to the image's centre.
    let lens = radial(-1e-3);
    let expected = (1.0_f64 / 3e-3).sqrt();
    let beyond = DVec3::new(31.6, 0.0, 1.0);
    bites(
        "a13 second branch",
        1.0 - lens.distort(beyond.truncate()).length(),
        0.9,
    );
    holds(
        "a13 far fold",
        (lens.fold_radius() / expected - 1.0).abs(),
        1e-12,
    );
    let camera = Intrinsics::new(640, 480, 525.0, 525.0, 319.5, 239.5, lens).expect("a mild lens");
    assert_eq!(
        camera.pixel_from_camera(beyond),
        None,
        "beyond the fold nothing is visible"
    );
    // A fold between two roots 1e-3 apart is not stepped over: (1 − s/4)(1 − s/4.01) with s = r².
    let (a, b) = (4.0, 4.01);
    let narrow = Distortion {
        k1: -(1.0 / a + 1.0 / b) / 3.0,
        k2: 1.0 / (a * b) / 5.0,
        ..Distortion::NONE
    };
    holds("a13 narrow fold", (narrow.fold_radius() - 2.0).abs(), 1e-9);
    assert_eq!(Distortion::NONE.fold_radius(), f64::INFINITY);
    assert_eq!(radial(0.2).fold_radius(), f64::INFINITY);
}

#[test]
fn hc_a13_no_infinite_pixel_and_no_folded_camera() {
    let lens = Distortion {
        k1: 0.1,
        k2: 0.1,
        k3: 0.1,
        ..Distortion::NONE
    };
    let camera = Intrinsics::new(640, 480, 525.0, 525.0, 319.5, 239.5, lens).expect("a lens");
    assert!(
        !lens.distort(DVec2::new(1e100, 0.0)).is_finite(),
        "r to the seventh overflows"
    );
    assert_eq!(camera.pixel_from_camera(DVec3::new(1e100, 0.0, 1.0)), None);
    let folded = Intrinsics::new(640, 480, 525.0, 525.0, 319.5, 239.5, radial(-0.9));
    assert_eq!(
        folded,
        Err(CameraError::Distortion),
        "folds at 0.61, the corner is at 0.76"
    );
    let unknown = Intrinsics::new(640, 480, 525.0, 525.0, 319.5, 239.5, radial(f64::NAN));
    assert_eq!(unknown, Err(CameraError::Distortion));
}
