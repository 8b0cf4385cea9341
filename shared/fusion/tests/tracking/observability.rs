//! Which directions are observed (hard-cases C01 to C03, C05).

use fusion::Level;
use fusion::kernels::icp::{IcpStep, IcpSums, ModelPixels, sum_tile};
use fusion::tracking::equations::NormalEquations;
use fusion::tracking::{Alignment, Icp, IcpConfig, IcpInput, Photometric};
use geometry::{DVec3, Pose, symmetric_eigen};

use crate::shapes::{self, Distance};

/// Motions of the 30 frames: up to 4 mm and 0.3 degrees.
fn motion(frame: usize) -> Pose {
    let t = frame as f64 * 0.7;
    let axis = DVec3::new(t.sin(), t.cos(), (2.0 * t).sin());
    Pose::new(
        geometry::rotation::exp(axis.normalize() * 0.005),
        DVec3::new((3.0 * t).cos(), (2.0 * t).cos(), t.sin()) * 0.004,
    )
    .expect("a pose")
}

fn aligned(surface: Distance, live: &Pose, normal_sigma: f64) -> Alignment {
    let camera = shapes::camera();
    let view = shapes::view(surface, &camera, &Pose::IDENTITY, normal_sigma, |_| 0.0);
    let points = shapes::points(&shapes::depth(surface, &camera, live), &camera);
    let input = IcpInput {
        points: &points,
        view: &view,
        grey: None,
    };
    let mut icp = Icp::new(IcpConfig::default());
    icp.align(input, &mut Photometric::default(), Pose::IDENTITY, 0..3)
        .expect("there are points")
}

/// Names, surfaces and the number of directions that slide on them.
const SURFACES: [(&str, Distance, usize); 6] = [
    ("plane", shapes::PLANE, 3),
    ("sphere", shapes::SPHERE, 3),
    ("cylinder", shapes::CYLINDER, 2),
    ("cone", shapes::CONE, 1),
    ("torus", shapes::TORUS, 1),
    ("corner", shapes::CORNER, 0),
];

#[test]
fn hc_c01_directions_that_slide_keep_the_prediction() {
    let tolerance = 1e-6;
    let (mut worst, mut naive_worst) = (0.0_f64, 0.0_f64);
    for (name, surface, null) in SURFACES {
        for frame in 0..30 {
            let found = aligned(surface, &motion(frame), 0.01);
            assert_eq!(found.solution.rank, 6 - null, "{name}, frame {frame}");
            // The step that is left along what nothing observes: none was taken.
            for vector in &found.solution.eigen.vectors[6 - null..] {
                let kept: f64 = vector
                    .iter()
                    .zip(&found.solution.step)
                    .map(|(v, s)| v * s)
                    .sum();
                worst = worst.max(kept.abs());
            }
            // A plain solve fills them from the noise of the normals.
            let naive = found.equations.solve(0.0);
            for vector in &found.solution.eigen.vectors[6 - null..] {
                let slid: f64 = vector.iter().zip(&naive.step).map(|(v, s)| v * s).sum();
                naive_worst = naive_worst.max(slid.abs());
            }
        }
    }
    println!("C01: worst slide {worst:.1e} m, plain solve {naive_worst:.1e} m, tolerance {tolerance:.0e}");
    assert!(naive_worst > 100.0 * tolerance);
    assert!(worst <= tolerance);
}

#[test]
fn hc_c01_what_a_surface_shows_is_found() {
    for (name, surface, null) in SURFACES {
        let live = motion(3);
        let found = aligned(surface, &live, 0.0);
        let error = live.inverse() * found.view_from_live;
        if null == 0 {
            assert!(error.translation().length() < 2e-4, "{name}: {error:?}");
        }
        // Along the axis of the camera every one of them is observed.
        let depth_error = (found.view_from_live.translation() - live.translation()).z;
        assert!(depth_error.abs() < 1e-3, "{name}: {depth_error}");
    }
}

#[test]
fn hc_c01_the_slope_of_a_cone_is_kept() {
    let found = aligned(shapes::CONE, &motion(1), 0.0);
    let values = found.solution.eigen.values;
    let (least, false_one) = (values[4] / values[0], values[5] / values[0]);
    println!("C01: cone, least true {least:.1e}, false {false_one:.1e}");
    assert!(least > IcpConfig::default().observed_threshold());
    assert!(false_one < IcpConfig::default().observed_threshold());
}

#[test]
fn weak_axes_are_named() {
    let found = aligned(shapes::PLANE, &motion(2), 0.01);
    // Turning about the line of sight, sliding right and down.
    assert_eq!(found.solution.weak_axes(), 0b01_1100);
}

/// Sums of a corner seen at `scale` times its size from an eye moved by `offset` (in view axes), and its step.
fn scaled_step(scale: f64, offset: DVec3, centred: bool) -> (NormalEquations, [f64; 6]) {
    let camera = shapes::camera();
    let view = shapes::view(shapes::CORNER, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    let points = shapes::points(&shapes::depth(shapes::CORNER, &camera, &motion(4)), &camera);
    let packed = &points.levels()[0].points;
    let (center, radius) = packed.centroid().expect("points");
    let mut surfels = view.surfels.clone();
    for surfel in &mut surfels {
        surfel.position = surfel.position.map(|p| p * scale as f32);
    }
    let model = ModelPixels {
        surfels: &surfels,
        width: 160,
        height: 120,
        focal: [144.0; 2],
        center: [79.5, 59.5],
    };
    // An origin far from the data is a centre of rotation far from it.
    let center = if centred { center * scale } else { center * scale - offset };
    let step = IcpStep {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
        center: center.as_vec3().to_array(),
        largest_distance: 0.1 * scale as f32,
        robust_scale: 1e9,
    };
    let mut total = IcpSums::ZERO;
    for tile in 0..packed.tile_count() {
        let tile = packed.tile(tile);
        let scaled = |values: &[f32]| -> Vec<f32> {
            values.iter().map(|v| v * scale as f32).collect()
        };
        let (x, y, z) = (scaled(tile.x), scaled(tile.y), scaled(tile.z));
        let weight = vec![1e4; x.len()];
        let tile = fusion::kernels::icp::PointTile {
            x: &x,
            y: &y,
            z: &z,
            weight: &weight,
        };
        total.add(&sum_tile(Level::detect(), tile, model, &step));
    }
    let radius = if centred { radius * scale } else { 1.0 };
    let equations = NormalEquations::from_triangle(&total.hessian, &total.gradient, radius);
    (equations, equations.solve(1e-5).step)
}

fn condition(equations: &NormalEquations) -> f64 {
    let values = symmetric_eigen(&equations.hessian).values;
    values[0] / values[5]
}

#[test]
fn hc_c02_decisions_do_not_depend_on_the_unit() {
    let (reference, _) = scaled_step(1.0, DVec3::ZERO, true);
    let ratios = |equations: &NormalEquations| {
        let values = symmetric_eigen(&equations.hessian).values;
        values.map(|value| value / values[0])
    };
    let expected = ratios(&reference);
    let (mut worst, mut naive) = (0.0_f64, f64::INFINITY);
    for scale in [0.1, 10.0] {
        let (scaled, _) = scaled_step(scale, DVec3::ZERO, true);
        let (raw, _) = scaled_step(scale, DVec3::ZERO, false);
        for index in 0..6 {
            worst = worst.max((ratios(&scaled)[index] / expected[index] - 1.0).abs());
        }
        // In raw metres the least share moves with the square of the unit.
        naive = naive.min((ratios(&raw)[5] / expected[5] - 1.0).abs());
    }
    println!("C02: shares differ by {worst:.1e}, in raw metres by {naive:.1e}, tolerance 1e-5");
    assert!(naive > 0.5);
    assert!(worst < 1e-5);
}

#[test]
fn hc_c03_the_centre_of_rotation_is_that_of_the_data() {
    let (near, _) = scaled_step(1.0, DVec3::ZERO, true);
    let own = condition(&near);
    for (offset, least) in [(1.0, 10.0), (10.0, 1e3), (100.0, 1e5)] {
        let (far, _) = scaled_step(1.0, DVec3::splat(offset), false);
        let naive = condition(&far);
        println!("C03: condition {own:.0} centred, {naive:.1e} from {offset} m");
        assert!(naive > least * own);
    }
    // What tracking sees lies in camera axes, so a world far away changes nothing but the pose.
    let away = Pose::from_translation(DVec3::new(1e4, -1e4, 1e4));
    let live = motion(4);
    let here = aligned(shapes::CORNER, &live, 0.0);
    let there = away * (away.inverse() * here.view_from_live);
    let shift = (there.translation() - here.view_from_live.translation()).length();
    assert!(shift < 1e-9, "{shift}");
    assert!(own < 200.0);
}

#[test]
fn hc_c05_the_solve_holds_where_the_condition_is_squared() {
    // J with condition 1e4: H has 1e8, beyond f32.
    let scales = [1.0, 0.3, 0.05, 1e-2, 1e-3, 1e-4];
    let truth = [0.3, -0.2, 0.5, 1.0, -2.0, 0.7];
    let mut equations = NormalEquations::ZERO;
    for sample in 0..600_u32 {
        let row: [f64; 6] = std::array::from_fn(|axis| {
            let phase = f64::from(sample) * (1.0 + axis as f64) * 0.37 + axis as f64;
            scales[axis] * (phase.sin() + 0.5 * (phase * 1.7).cos())
        });
        let residual: f64 = -row.iter().zip(&truth).map(|(r, t)| r * t).sum::<f64>();
        for i in 0..6 {
            for j in 0..6 {
                equations.hessian[i][j] += row[i] * row[j];
            }
            equations.gradient[i] += row[i] * residual;
        }
    }
    let error = |step: &[f64; 6]| {
        step.iter()
            .zip(&truth)
            .map(|(s, t)| (s - t).abs())
            .fold(0.0, f64::max)
    };
    let held = error(&equations.solve(0.0).step);
    // The same sums in f32.
    let mut rounded = equations;
    for row in &mut rounded.hessian {
        *row = row.map(|h| f64::from(h as f32));
    }
    rounded.gradient = rounded.gradient.map(|g| f64::from(g as f32));
    let naive = error(&rounded.solve(0.0).step);
    println!("C05: error {held:.1e}, from f32 sums {naive:.1e}, tolerance 1e-6");
    assert!(naive > 1e-2);
    assert!(held < 1e-6);
}
