//! Which directions are observed (hard-cases C01 to C03, C05).

use fusion::kernels::icp::{IcpStep, IcpSums, ModelPixels, sum_tile};
use fusion::tracking::equations::NormalEquations;
use fusion::tracking::{Alignment, Icp, IcpConfig, IcpInput, Photometric};
use fusion::{Level, ModelView};
use geometry::{DVec3, Pose, symmetric_eigen};
use rand::{RngExt as _, SeedableRng as _};

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
    let view = shapes::view(
        surface,
        &shapes::camera(),
        &Pose::IDENTITY,
        normal_sigma,
        |_| 0.0,
    );
    aligned_with(&view, surface, live)
}

fn aligned_with(view: &ModelView, surface: Distance, live: &Pose) -> Alignment {
    let camera = shapes::camera();
    let points = shapes::points(&shapes::depth(surface, &camera, live), &camera);
    let input = IcpInput {
        points: &points,
        view,
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
        let view = shapes::view(surface, &shapes::camera(), &Pose::IDENTITY, 0.01, |_| 0.0);
        for frame in 0..30 {
            let found = aligned_with(&view, surface, &motion(frame));
            let rank = found.solution.rank;
            // From one side less can be seen than of the whole surface.
            assert!(rank <= 6 - null, "{name}, frame {frame}: {rank}");
            let along = |step: &[f64; 6], vector: &[f64; 6]| -> f64 {
                vector.iter().zip(step).map(|(v, s)| v * s).sum()
            };
            // A plain solve fills what slides from the noise of the normals.
            let naive = found.equations.solve(0.0);
            for vector in &found.solution.eigen.vectors[rank..] {
                worst = worst.max(along(&found.solution.step, vector).abs());
                naive_worst = naive_worst.max(along(&naive.step, vector).abs());
            }
        }
    }
    println!(
        "C01: worst slide {worst:.1e} m, plain solve {naive_worst:.1e} m, tolerance {tolerance:.0e}"
    );
    assert!(naive_worst > 100.0 * tolerance);
    assert!(worst <= tolerance);
}

#[test]
fn hc_c01_a_camera_in_front_of_a_plane_does_not_slide() {
    // 30 frames one after the other; the prediction says rest, and nothing says otherwise.
    let mut pose = Pose::IDENTITY;
    let camera = shapes::camera();
    let view = shapes::view(shapes::PLANE, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    for frame in 0..30 {
        let live = Pose::from_translation(DVec3::new(0.0, 0.0, 0.002 * f64::from(frame % 3)));
        let points = shapes::points(&shapes::depth(shapes::PLANE, &camera, &live), &camera);
        let input = IcpInput {
            points: &points,
            view: &view,
            grey: None,
        };
        pose = Icp::new(IcpConfig::default())
            .align(input, &mut Photometric::default(), pose, 0..3)
            .expect("there are points")
            .view_from_live;
        assert!((pose.translation().z - live.translation().z).abs() < 1e-5);
    }
    let slide = pose.translation().truncate().length();
    assert!(slide < 1e-6, "{slide}");
}

/// Equations of 30 000 samples all over a surface, normals off by `sigma` radians per axis.
fn all_over(sample: impl Fn(f64, f64) -> (DVec3, DVec3), sigma: f64) -> NormalEquations {
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let samples: Vec<(DVec3, DVec3)> = (0..30_000)
        .map(|_| {
            let (at, normal) = sample(random.random_range(0.0..1.0), random.random_range(0.0..1.0));
            let noise = DVec3::from_array(std::array::from_fn(|_| shapes::normal(&mut random)));
            (at, (normal.normalize() + noise * sigma).normalize())
        })
        .collect();
    let count = samples.len() as f64;
    let center = samples.iter().map(|(at, _)| *at).sum::<DVec3>() / count;
    let square = samples
        .iter()
        .map(|(at, _)| (*at - center).length_squared());
    let radius = (square.sum::<f64>() / count).sqrt();
    let mut triangle = [0.0; 21];
    for (at, normal) in &samples {
        let turn = (*at - center).cross(*normal);
        let row = [turn.x, turn.y, turn.z, normal.x, normal.y, normal.z];
        let mut place = 0;
        for i in 0..6 {
            for j in i..6 {
                triangle[place] += row[i] * row[j];
                place += 1;
            }
        }
    }
    NormalEquations::from_triangle(&triangle, &[0.0; 6], radius)
}

#[test]
fn hc_c01_the_table_of_surfaces_has_its_ranks() {
    use std::f64::consts::TAU;
    let around = |u: f64| DVec3::new((TAU * u).cos(), 0.0, (TAU * u).sin());
    type Sample = Box<dyn Fn(f64, f64) -> (DVec3, DVec3)>;
    let table: [(&str, Sample, usize); 5] = [
        (
            "plane",
            Box::new(|u, v| (DVec3::new(u, 0.8 * v, 0.0), DVec3::Z)),
            3,
        ),
        (
            "sphere",
            Box::new(move |u, v| {
                let height = 2.0 * v - 1.0;
                let normal = around(u) * (1.0 - height * height).sqrt() + DVec3::Y * height;
                (normal * 0.1, normal)
            }),
            3,
        ),
        (
            "cylinder",
            Box::new(move |u, v| (around(u) * 0.04 + DVec3::Y * (0.2 * v), around(u))),
            2,
        ),
        (
            "cone",
            Box::new(move |u, v| {
                let height = 0.2 * v.sqrt();
                (
                    around(u) * (0.3 * height) + DVec3::Y * height,
                    around(u) - DVec3::Y * 0.3,
                )
            }),
            1,
        ),
        (
            "torus",
            Box::new(move |u, v| {
                let normal = around(u) * (TAU * v).cos() + DVec3::Y * (TAU * v).sin();
                (around(u) * 0.1 + normal * 0.04, normal)
            }),
            1,
        ),
    ];
    let threshold = IcpConfig::default().observed_threshold();
    for (name, sample, null) in &table {
        let exact = all_over(sample, 0.0).solve(threshold);
        let noisy = all_over(sample, 0.01).solve(threshold);
        let share = |index: usize| noisy.eigen.values[index] / noisy.eigen.values[0];
        println!(
            "C01: {name}: least true {:.1e}, largest false {:.1e}, threshold {threshold:.0e}",
            share(5 - null),
            share(6 - null)
        );
        assert_eq!((exact.rank, noisy.rank), (6 - null, 6 - null), "{name}");
        // A solve with a threshold for rounding alone takes the false ones for true.
        assert_eq!(all_over(sample, 0.01).solve(1e-6).rank, 6, "{name}");
    }
}

#[test]
fn hc_c01_what_a_surface_shows_is_found() {
    for (surface, null) in [(shapes::PLANE, 3), (shapes::SPHERE, 3), (shapes::CORNER, 0)] {
        let live = motion(3);
        let found = aligned(surface, &live, 0.0);
        let error = live.inverse() * found.view_from_live;
        assert!(
            null != 0 || error.translation().length() < 2e-4,
            "{error:?}"
        );
        // Along the axis of the camera each of them is observed.
        let depth_error = (found.view_from_live.translation() - live.translation()).z;
        assert!(depth_error.abs() < 1e-3, "{depth_error}");
    }
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
    let extent = points.extent().expect("points");
    let (center, radius) = (extent.center, extent.radius);
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
    let center = if centred {
        center * scale
    } else {
        center * scale - offset
    };
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
        let scaled =
            |values: &[f32]| -> Vec<f32> { values.iter().map(|v| v * scale as f32).collect() };
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
    // Powers of two leave every rounding as it is, so nothing may differ.
    for scale in [0.125, 8.0] {
        let (scaled, _) = scaled_step(scale, DVec3::ZERO, true);
        let (raw, _) = scaled_step(scale, DVec3::ZERO, false);
        for (ratio, expected) in ratios(&scaled).iter().zip(&expected) {
            worst = worst.max((ratio / expected - 1.0).abs());
        }
        // In raw metres the least share moves with the square of the unit.
        naive = naive.min((ratios(&raw)[5] / expected[5] - 1.0).abs());
    }
    println!("C02: shares differ by {worst:.1e}, in raw metres by {naive:.1e}, tolerance 1e-12");
    assert!(naive > 0.5);
    assert!(worst < 1e-12);
    for scale in [0.1, 10.0] {
        let (scaled, _) = scaled_step(scale, DVec3::ZERO, true);
        for (ratio, expected) in ratios(&scaled).iter().zip(&expected) {
            // A few points on the border of a pixel are paired otherwise.
            assert!((ratio / expected - 1.0).abs() < 1e-2);
        }
    }
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
    // Powers of one variable, like the columns of a Hilbert matrix: cond(J) is about 1e4.
    let truth = [0.3, -0.2, 0.5, 1.0, -2.0, 0.7];
    let mut equations = NormalEquations::ZERO;
    for sample in 0..600_i32 {
        let t = f64::from(sample) / 599.0;
        let row: [f64; 6] = std::array::from_fn(|axis| t.powi(axis as i32));
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
