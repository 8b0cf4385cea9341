//! Points that lie (hard-cases C04, C06 to C08, C13).

use fusion::Level;
use fusion::ModelView;
use fusion::kernels::icp::{IcpStep, IcpSums, ModelPixels, PointTile, TILE_POINTS, sum_tile};
use fusion::live::{Effort, LiveConfig, LiveFusion, LiveRig};
use fusion::tracking::equations::NormalEquations;
use fusion::tracking::{Icp, IcpConfig, IcpInput, Photometric, TrackState};
use geometry::{DVec2, DVec3, Pose, symmetric_eigen};
use imaging::DepthImage;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use crate::shapes;

/// Pairs of one pixel each: live point, surfel, normal.
type Pairs = Vec<(DVec3, DVec3, DVec3)>;

fn pairs(depth: &DepthImage, view: &ModelView) -> Pairs {
    let camera = view.camera;
    let mut pairs = Pairs::new();
    for y in 0..camera.height() {
        for x in 0..camera.width() {
            let surfel = view.at(x as usize, y as usize);
            let z = f64::from(depth.at(x, y));
            if z > 0.0 && surfel.is_surface() {
                let ray = camera.camera_from_pixel(DVec2::new(x.into(), y.into()));
                let [s, n] = [surfel.position, surfel.normal].map(|v| v.map(f64::from));
                pairs.push((
                    ray.expect("no distortion") * z,
                    DVec3::from_array(s),
                    DVec3::from_array(n),
                ));
            }
        }
    }
    pairs
}

/// Plain iterated least squares over fixed pairs; `weigh` turns residuals into weights. The translation found.
fn naive_translation(pairs: &Pairs, weigh: impl Fn(usize, &[f64]) -> Vec<f64>) -> DVec3 {
    let mut pose = Pose::IDENTITY;
    for iteration in 0..20 {
        let moved: Vec<DVec3> = pairs
            .iter()
            .map(|(q, ..)| pose.transform_point(*q))
            .collect();
        let residuals: Vec<f64> = pairs
            .iter()
            .zip(&moved)
            .map(|((_, s, n), q)| n.dot(*q - *s))
            .collect();
        let mut triangle = [0.0; 21];
        let mut gradient = [0.0; 6];
        for (((q, (_, _, n)), r), w) in moved
            .iter()
            .zip(pairs)
            .zip(&residuals)
            .zip(weigh(iteration, &residuals))
        {
            let turn = q.cross(*n);
            let row = [turn.x, turn.y, turn.z, n.x, n.y, n.z];
            let mut place = 0;
            for i in 0..6 {
                for j in i..6 {
                    triangle[place] += w * row[i] * row[j];
                    place += 1;
                }
                gradient[i] += w * row[i] * r;
            }
        }
        let step = NormalEquations::from_triangle(&triangle, &gradient, 1.0)
            .solve(1e-9)
            .step;
        let turn = DVec3::new(step[0], step[1], step[2]);
        let shift = DVec3::new(step[3], step[4], step[5]);
        pose = geometry::rotation::exp_twist(turn, shift) * pose;
    }
    pose.translation()
}

fn shipped_translation(depth: &DepthImage, view: &ModelView) -> DVec3 {
    let points = shapes::points(depth, &view.camera);
    let input = IcpInput {
        points: &points,
        view,
        grey: None,
    };
    Icp::new(IcpConfig::default())
        .align(input, &mut Photometric::default(), Pose::IDENTITY, 0..3)
        .expect("there are points")
        .view_from_live
        .translation()
}

fn median(mut values: Vec<f64>) -> f64 {
    geometry::robust::median(&mut values).expect("values")
}

#[test]
fn hc_c04_sums_of_a_whole_frame_keep_their_digits() {
    let camera = shapes::camera();
    let view = shapes::view(shapes::CORNER, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    let depth = shapes::depth(shapes::CORNER, &camera, &Pose::IDENTITY);
    let own = pairs(&depth, &view);
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let columns: Vec<DVec3> = (0..307_200)
        .map(|index| own[index % own.len()].0 + DVec3::splat(random.random_range(-1e-4..1e-4)))
        .collect();
    let take =
        |pick: fn(&DVec3) -> f64| -> Vec<f32> { columns.iter().map(|p| pick(p) as f32).collect() };
    let (x, y, z) = (take(|p| p.x), take(|p| p.y), take(|p| p.z));
    let weight = vec![1e4; columns.len()];
    let model = ModelPixels {
        surfels: &view.surfels,
        width: 160,
        height: 120,
        focal: [144.0; 2],
        center: [79.5, 59.5],
    };
    let sums = |level: Level, center: [f32; 3]| {
        let step = IcpStep {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            center,
            largest_distance: 0.1,
            robust_scale: 1e9,
        };
        let mut total = IcpSums::ZERO;
        for first in (0..columns.len()).step_by(TILE_POINTS) {
            let range = first..(first + TILE_POINTS).min(columns.len());
            let tile = PointTile {
                x: &x[range.clone()],
                y: &y[range.clone()],
                z: &z[range.clone()],
                weight: &weight[range],
            };
            total.add(&sum_tile(level, tile, model, &step));
        }
        total
    };
    let difference = |one: &[f64; 21], other: &[f64; 21]| {
        let largest = one.iter().fold(0.0_f64, |l, v| l.max(v.abs()));
        let worst = one
            .iter()
            .zip(other)
            .fold(0.0_f64, |w, (a, b)| w.max((a - b).abs()));
        worst / largest
    };
    let center = [0.0, 0.0, 1.0];
    let reference = sums(Level::Scalar, center);
    let shipped = sums(Level::detect(), center);
    // One f32 for each sum, about an origin 100 m away.
    let naive = naive_f32(&own, columns.len());
    let held = difference(&reference.hessian, &shipped.hessian);
    let least = |hessian: &[f64; 21]| {
        symmetric_eigen(&NormalEquations::from_triangle(hessian, &[0.0; 6], 1.0).hessian).values[5]
    };
    let (exact, rounded) = (naive.0, naive.1);
    let error = difference(&exact, &rounded);
    println!("C04: sums differ by {held:.1e}, in one f32 by {error:.1e}, tolerance 1e-7");
    assert!(error > 1e-5);
    assert!(held <= 1e-7 && least(&shipped.hessian) > 0.0);
}

/// The Hessian about a far origin, in f64 and with one f32 a sum.
fn naive_f32(own: &Pairs, count: usize) -> ([f64; 21], [f64; 21]) {
    let (mut exact, mut rounded) = ([0.0_f64; 21], [0.0_f32; 21]);
    for index in 0..count {
        let (q, _, n) = own[index % own.len()];
        let turn = (q + DVec3::splat(100.0)).cross(n);
        let row = [turn.x, turn.y, turn.z, n.x, n.y, n.z];
        let mut place = 0;
        for i in 0..6 {
            for j in i..6 {
                exact[place] += row[i] * row[j];
                rounded[place] += row[i] as f32 * row[j] as f32;
                place += 1;
            }
        }
    }
    (exact, rounded.map(f64::from))
}

#[test]
fn hc_c06_a_handful_of_points_is_no_pose() {
    let camera = shapes::camera();
    let depth = shapes::depth(shapes::CORNER, &camera, &Pose::IDENTITY);
    let measured: Vec<usize> = (0..depth.pixels().len())
        .filter(|&i| depth.pixels()[i] > 0.0)
        .collect();
    for count in [0, 1, 5, 6, 100] {
        let mut live = crate::steps::started(&depth);
        let known = live.track(0, Effort::default()).world_from_camera;
        live.fuse(&depth, None).expect("a frame");
        let mut few = DepthImage::new(camera.width(), camera.height(), 0.0);
        for &place in measured
            .iter()
            .step_by(measured.len() / count.max(1))
            .take(count)
        {
            few.pixels_mut()[place] = depth.pixels()[place];
        }
        live.load(&few, false);
        let tracked = live.track(33_000_000, Effort::default());
        assert_eq!(tracked.state, TrackState::Lost, "{count} points");
        assert_eq!(tracked.world_from_camera, known);
        assert!(live.fuse(&few, None).expect("a frame").is_none());
    }
}

#[test]
fn hc_c06_a_camera_that_has_seen_nothing_has_not_begun() {
    let camera = shapes::camera();
    let rig = LiveRig {
        depth_camera: camera,
        color_camera: None,
        color_from_depth: Pose::IDENTITY,
    };
    let mut live = LiveFusion::new(LiveConfig::default(), rig, Pose::IDENTITY).expect("settings");
    live.load(&DepthImage::new(160, 120, 0.0), false);
    assert_eq!(live.track(0, Effort::default()).state, TrackState::Lost);
    live.load(
        &shapes::depth(shapes::CORNER, &camera, &Pose::IDENTITY),
        false,
    );
    assert_eq!(live.track(1, Effort::default()).state, TrackState::Ok);
}

#[test]
fn hc_c07_exact_data_has_a_scale() {
    let camera = shapes::camera();
    let view = shapes::view(shapes::PLANE, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    let depth = shapes::depth(shapes::PLANE, &camera, &Pose::IDENTITY);
    // The naive scale is the median of the residuals, which is 0, and so is the residual.
    let residuals: Vec<f64> = pairs(&depth, &view)
        .iter()
        .map(|(_, s, n)| n.dot(*s - *s))
        .collect();
    let scale = 1.4826 * median(residuals.iter().map(|r| r.abs()).collect());
    assert!((residuals[0] / scale).is_nan());

    let points = shapes::points(&depth, &camera);
    let input = IcpInput {
        points: &points,
        view: &view,
        grey: None,
    };
    let found = Icp::new(IcpConfig::default())
        .align(input, &mut Photometric::default(), Pose::IDENTITY, 0..3)
        .expect("there are points");
    println!(
        "C07: cost {:.1e}, {} of {} pairs agree",
        found.cost, found.sums.inlier_count, found.sums.pair_count
    );
    assert_eq!(found.sums.inlier_count, found.sums.pair_count);
    assert!(found.cost < 1e-6 && found.sums.hessian.iter().all(|h| h.is_finite()));
}

#[test]
fn hc_c08_a_hand_that_covers_two_fifths_does_not_pull() {
    let camera = shapes::camera();
    let view = shapes::view(shapes::CORNER, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    let exact = shapes::depth(shapes::CORNER, &camera, &Pose::IDENTITY);
    let mut worst = 0.0_f64;
    let mut naive = (f64::INFINITY, f64::INFINITY);
    for seed in 0..20 {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        // Fragments of 8 x 8 pixels, so that the hand is no better a plane than the walls.
        let covered: Vec<bool> = (0..20 * 15).map(|_| random.random_bool(0.4)).collect();
        let depth = DepthImage::from_fn(camera.width(), camera.height(), |x, y| {
            let z = f64::from(exact.at(x, y));
            if z == 0.0 {
                return 0.0;
            }
            let hand = if covered[(y / 8 * 20 + x / 8) as usize] {
                0.05
            } else {
                0.0
            };
            (z + 0.002 * shapes::normal(&mut random) - hand) as f32
        });
        worst = worst.max(shipped_translation(&depth, &view).length());
        let pairs = pairs(&depth, &view);
        naive.0 = naive
            .0
            .min(naive_translation(&pairs, |_, r| vec![1.0; r.len()]).length());
        // The textbook: Huber first, then Tukey, both with the scale of the residuals.
        let tukey = |iteration: usize, residuals: &[f64]| -> Vec<f64> {
            let scale = 1.4826 * median(residuals.iter().map(|r| r.abs()).collect());
            let weight = |r: &f64| {
                let u = r / (4.685 * scale);
                match iteration {
                    0..10 => (1.345 * scale / r.abs()).min(1.0),
                    _ if u.abs() < 1.0 => (1.0 - u * u).powi(2),
                    _ => 0.0,
                }
            };
            residuals.iter().map(weight).collect()
        };
        naive.1 = naive.1.min(naive_translation(&pairs, tukey).length());
    }
    println!(
        "C08: pulled {:.2} mm, least squares {:.0} mm, scale from residuals {:.0} mm, tolerance 1 mm",
        1e3 * worst,
        1e3 * naive.0,
        1e3 * naive.1
    );
    assert!(naive.0 > 0.015 && naive.1 > 0.010);
    assert!(worst < 1e-3);
}

#[test]
fn hc_c13_grazing_points_do_not_bend_the_pose() {
    let camera = shapes::camera();
    let view = shapes::view(shapes::CYLINDER, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    let exact = shapes::depth(shapes::CYLINDER, &camera, &Pose::IDENTITY);
    let depth = DepthImage::from_fn(camera.width(), camera.height(), |x, y| {
        let surfel = view.at(x as usize, y as usize);
        if !surfel.is_surface() {
            return 0.0;
        }
        let (p, n) = (surfel.position.map(f64::from), surfel.normal.map(f64::from));
        let (p, n) = (DVec3::from_array(p), DVec3::from_array(n));
        let cosine = -p.normalize().dot(n);
        // The beam is a few pixels wide: what it meets on the slant is read too far.
        let error = 0.001 * (1.0 / cosine - 1.0);
        exact.at(x, y) + error as f32
    });
    let held = shipped_translation(&depth, &view).z.abs();
    let naive = naive_translation(&pairs(&depth, &view), |_, r| vec![1.0; r.len()])
        .z
        .abs();
    println!(
        "C13: off by {:.2} mm, unweighted {:.2} mm, tolerance 0.2 mm",
        1e3 * held,
        1e3 * naive
    );
    assert!(naive > 2e-4);
    assert!(held <= 2e-4);
}
