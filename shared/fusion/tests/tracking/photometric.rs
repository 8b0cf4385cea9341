//! The photometric term (hard-cases C09, C10).

use fusion::ModelView;
use fusion::tracking::equations::NormalEquations;
use fusion::tracking::photometric::PhotometricTerm;
use fusion::tracking::points::half_camera;
use fusion::tracking::{GreyFrame, Icp, IcpConfig, IcpInput, Photometric};
use geometry::{DVec2, DVec3, Intrinsics, Pose};
use imaging::DepthImage;

use crate::shapes;

/// A plane one metre away with the texture `texture` (of x and y in metres), as a model and as a frame taken from
/// `live` with gain and offset.
struct Scene {
    view: ModelView,
    depth: DepthImage,
    grey: GreyFrame,
}

fn scene(texture: fn(f64, f64) -> f64, live: &Pose, gain: f64, offset: f64) -> Scene {
    let full = shapes::camera();
    let camera = half_camera(&full).expect("a camera");
    let view = shapes::view(shapes::PLANE, &camera, &Pose::IDENTITY, 0.0, |p| {
        texture(p.x, p.y) as f32
    });
    let mut grey = GreyFrame::new(&camera, Pose::IDENTITY, 2);
    let seen = |camera: &Intrinsics, x: u32, y: u32| {
        let ray = camera.camera_from_pixel(DVec2::new(x.into(), y.into()));
        let direction = live.transform_vector(ray.expect("no distortion"));
        let eye = live.translation();
        eye + direction * ((1.0 - eye.z) / direction.z)
    };
    let finest = grey.finest_mut();
    for y in 0..camera.height() {
        for x in 0..camera.width() {
            let at = seen(&camera, x, y);
            *finest.at_mut(x, y) = (gain * texture(at.x, at.y) + offset) as f32;
        }
    }
    grey.finish();
    Scene {
        view,
        depth: shapes::depth(shapes::PLANE, &full, live),
        grey,
    }
}

fn waves(x: f64, y: f64) -> f64 {
    0.4 + 0.15 * (17.0 * x + 3.0 * y).sin() + 0.15 * (14.0 * y - 5.0 * x).cos()
}

fn found(scene: &Scene, photometric: &mut Photometric) -> Pose {
    let points = shapes::points(&scene.depth, &shapes::camera());
    let input = IcpInput {
        points: &points,
        view: &scene.view,
        grey: Some(&scene.grey),
    };
    let mut pose = Pose::IDENTITY;
    let mut icp = Icp::new(IcpConfig::default());
    for _ in 0..3 {
        pose = icp
            .align(input, photometric, pose, 0..3)
            .expect("there are points")
            .view_from_live;
    }
    pose
}

#[test]
fn texture_shows_what_a_plane_hides() {
    let live = Pose::new(
        geometry::rotation::exp(DVec3::new(0.002, -0.003, 0.006)),
        DVec3::new(0.006, -0.004, 0.003),
    )
    .expect("a pose");
    let scene = scene(waves, &live, 1.0, 0.0);
    let error = live.inverse() * found(&scene, &mut Photometric::default());
    assert!(error.translation().length() < 5e-4, "{error:?}");
    assert!(geometry::rotation::log(error.rotation()).length() < 5e-4);
}

#[test]
fn hc_c09_brightness_is_not_motion() {
    let tolerance = 1e-6;
    // A grey wall, 10 % brighter: nothing to hold on to.
    let wall = scene(|_, _| 0.5, &Pose::IDENTITY, 1.1, 0.0);
    let term =
        Photometric::default().equations(&wall.view, &wall.grey, &Pose::IDENTITY, DVec3::Z, 0.5, 0);
    assert!(term.is_none(), "no gradient, no term");
    let still = found(&wall, &mut Photometric::default());
    let slide = still.translation().truncate().length();
    // A wall with waves, brighter and with an offset. Without gain and offset the difference is motion.
    let waved = scene(waves, &Pose::IDENTITY, 1.1, 0.02);
    let kept = found(&waved, &mut Photometric::default());
    let held = kept.translation().truncate().length();
    let naive = naive_slide(&waved);
    println!(
        "C09: grey wall {slide:.1e} m (tolerance {tolerance:.0e}), waves {:.2} mm, without gain {:.2} mm",
        1e3 * held,
        1e3 * naive
    );
    assert!(slide <= tolerance);
    assert!(naive > 5e-4);
    assert!(held < 1e-4);
}

/// The slide that least squares without gain and offset takes in one step.
fn naive_slide(scene: &Scene) -> f64 {
    let (camera, image) = &scene.grey.levels[0];
    let (mut hessian, mut gradient) = ([[0.0; 2]; 2], [0.0; 2]);
    for y in 1..camera.height() - 1 {
        for x in 1..camera.width() - 1 {
            let model = f64::from(scene.view.at(x as usize, y as usize).grey);
            let r = f64::from(image.at(x, y)) - model;
            let du = f64::from(image.at(x + 1, y) - image.at(x - 1, y)) / 2.0;
            let dv = f64::from(image.at(x, y + 1) - image.at(x, y - 1)) / 2.0;
            let row = [-du * camera.focal().x, -dv * camera.focal().y];
            for i in 0..2 {
                for j in 0..2 {
                    hessian[i][j] += row[i] * row[j];
                }
                gradient[i] += row[i] * r;
            }
        }
    }
    let [[a, b], [_, c]] = hessian;
    let determinant = a * c - b * b;
    let slide = DVec2::new(
        c * gradient[0] - b * gradient[1],
        a * gradient[1] - b * gradient[0],
    );
    (slide / determinant).length()
}

#[test]
fn hc_c10_units_do_not_weigh() {
    // One geometric and one photometric equation set, each over its own variance, in two systems of units.
    let step_in = |metres: f64, white: f64, divided: bool| {
        let sigma = |value: f64, unit: f64| if divided { value * unit } else { 1.0 };
        let mut geometry = NormalEquations::ZERO;
        let mut photometry = NormalEquations::ZERO;
        for sample in 0..200_u32 {
            let t = f64::from(sample);
            let row: [f64; 6] = std::array::from_fn(|axis| (t * (1.3 + axis as f64)).sin());
            let shape = [row[0], row[1], 0.1 * row[2], 0.0, 0.0, row[5]];
            let texture = [0.2 * row[3], row[4], row[2], row[3], row[1], 0.0].map(|v| v * 3.0);
            // Jacobians are (unit of residual) per metre of motion.
            add(
                &mut geometry,
                &shape,
                0.002 * row[4] * metres,
                sigma(0.002, metres),
                1.0,
            );
            add(
                &mut photometry,
                &texture,
                0.02 * row[0] * white,
                sigma(0.02, white),
                white / metres,
            );
        }
        geometry
            .blend(&photometry, 0.01)
            .solve(1e-12)
            .step
            .map(|s| s / metres)
    };
    let difference = |one: [f64; 6], other: [f64; 6]| {
        let largest = one.iter().fold(0.0_f64, |l, s| l.max(s.abs()));
        let worst = one
            .iter()
            .zip(&other)
            .fold(0.0_f64, |w, (a, b)| w.max((a - b).abs()));
        worst / largest
    };
    let held = difference(step_in(1.0, 1.0, true), step_in(1e3, 255.0, true));
    let naive = difference(step_in(1.0, 1.0, false), step_in(1e3, 255.0, false));
    println!("C10: the step differs by {held:.1e}, undivided by {naive:.1e}, tolerance 1e-9");
    assert!(naive > 1e-2);
    assert!(held <= 1e-9);
}

#[test]
fn photographs_count_where_shape_leaves_directions_open() {
    const KNEE: f64 = 0.01;
    let with_least = |least: f64| {
        let mut equations = NormalEquations::ZERO;
        for axis in 0..6 {
            equations.hessian[axis][axis] = if axis == 2 { least } else { 1.0 };
        }
        equations
    };
    let mut photometry = with_least(1.0);
    photometry.gradient = [1.0; 6];
    for (least, share) in [
        (0.0, 1.0),
        (KNEE, 0.5),
        (1.9 * KNEE, 0.05),
        (2.0 * KNEE, 0.0),
    ] {
        let geometry = with_least(least);
        assert_eq!(geometry.has_open(KNEE), share > 0.0, "{least}");
        let sum = geometry.blend(&photometry, KNEE);
        for axis in 0..6 {
            let added = sum.hessian[axis][axis] - geometry.hessian[axis][axis];
            let expected = if axis == 2 { share } else { 0.0 };
            assert!(
                (added - expected).abs() < 1e-12,
                "{least}, axis {axis}: {added}"
            );
        }
    }
    assert!(
        NormalEquations::ZERO.has_open(KNEE),
        "no data leaves all open"
    );
}

fn add(to: &mut NormalEquations, row: &[f64; 6], residual: f64, sigma: f64, unit: f64) {
    let weight = 1.0 / (sigma * sigma);
    for i in 0..6 {
        for j in 0..6 {
            to.hessian[i][j] += weight * row[i] * row[j] * unit * unit;
        }
        to.gradient[i] += weight * row[i] * unit * residual;
    }
}

#[test]
fn a_highlight_that_wandered_loses_its_weight() {
    let still = scene(waves, &Pose::IDENTITY, 1.0, 0.0);
    let mut lit = scene(waves, &Pose::IDENTITY, 1.0, 0.0);
    for y in 20..40 {
        for x in 30..50 {
            *lit.grey.finest_mut().at_mut(x, y) += 0.5;
        }
    }
    lit.grey.finish();
    let term = |scene: &Scene| -> PhotometricTerm {
        let mut photometric = Photometric::default();
        let mut last = None;
        for _ in 0..3 {
            last =
                photometric.equations(&scene.view, &scene.grey, &Pose::IDENTITY, DVec3::Z, 0.5, 0);
        }
        last.expect("texture")
    };
    let slide = |scene: &Scene| -> f64 {
        let step = term(scene).equations.solve(1e-9).step;
        step[3].hypot(step[4])
    };
    assert!(slide(&lit) < slide(&still) + 5e-4, "{}", slide(&lit));
}
