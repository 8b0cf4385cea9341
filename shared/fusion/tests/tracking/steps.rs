//! Motion and convergence (hard-cases C11, C12, C14).

use fusion::live::{Effort, LiveConfig, LiveFusion, LiveRig};
use fusion::tracking::{Icp, IcpConfig, IcpInput, IcpPass, Photometric, TrackState};
use fusion::{VolumeConfig, kernels::Level};
use geometry::{DVec3, Intrinsics, Pose};
use imaging::DepthImage;
use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use crate::shapes::{self, Distance};

/// A corner of a room with a ball and a box: every direction is observed.
pub(crate) const ROOM: Distance = |p| {
    let ball = (p - DVec3::new(0.15, 0.1, 0.9)).length() - 0.15;
    let b = (p - DVec3::new(-0.25, 0.1, 1.0)).abs() - DVec3::new(0.1, 0.25, 0.08);
    let outside = b.max(DVec3::ZERO).length() + b.max_element().min(0.0);
    ball.min(outside)
        .min(shapes::CORNER(p - DVec3::new(0.0, 0.0, 0.4)))
};

/// Live fusion that holds one frame, seen from the identity.
pub(crate) fn started(depth: &DepthImage) -> LiveFusion {
    let rig = LiveRig {
        depth_camera: shapes::camera(),
        color_camera: None,
        color_from_depth: Pose::IDENTITY,
    };
    let config = LiveConfig {
        volume: VolumeConfig {
            voxel_size: 0.01,
            ..VolumeConfig::default()
        },
        ..LiveConfig::default()
    };
    let mut live = LiveFusion::new(config, rig, Pose::IDENTITY).expect("settings");
    live.load(depth, false);
    live
}

fn jump(random: &mut Pcg64Mcg, distance: f64, angle: f64) -> Pose {
    let mut direction = || DVec3::from_array(std::array::from_fn(|_| shapes::normal(random)));
    let (axis, way) = (direction().normalize(), direction().normalize());
    Pose::new(geometry::rotation::exp(axis * angle), way * distance).expect("a pose")
}

#[test]
fn hc_c11_a_jump_is_recovered_or_lost_but_never_wrong() {
    let camera = shapes::camera();
    let first = shapes::depth(ROOM, &camera, &Pose::IDENTITY);
    let mut random = Pcg64Mcg::seed_from_u64(21);
    let (mut recovered, mut lost) = (0, 0);
    for trial in 0..40 {
        let is_far = trial % 2 == 1;
        let (distance, angle) = if is_far { (0.5, 0.5) } else { (0.05, 0.087) };
        let truth = jump(&mut random, distance, angle);
        let depth = shapes::depth(ROOM, &camera, &truth);
        let mut live = started(&first);
        live.track(0, Effort::default());
        for _ in 0..3 {
            live.fuse(&first, None).expect("a frame");
        }
        live.load(&depth, false);
        let tracked = live.track(33_000_000, Effort::default());
        let error = truth.inverse() * tracked.world_from_camera;
        let is_right = error.translation().length() < 0.01
            && geometry::rotation::log(error.rotation()).length() < 0.02;
        if tracked.state == TrackState::Ok {
            assert!(is_right, "jump {trial} accepted at {error:?}");
        }
        recovered += u32::from(!is_far && is_right && tracked.state == TrackState::Ok);
        lost += u32::from(is_far && tracked.state == TrackState::Lost);
    }
    println!(
        "C11: {recovered} of 20 jumps of 5 cm and 5 degrees recovered, {lost} of 20 of 50 cm lost"
    );
    assert!(recovered >= 19 && lost == 20);
}

#[test]
fn hc_c12_a_thousand_repeats_do_not_walk() {
    let camera = shapes::camera();
    let mut random = Pcg64Mcg::seed_from_u64(4);
    let noisy = |pose: &Pose, random: &mut Pcg64Mcg| {
        let exact = shapes::depth(ROOM, &camera, pose);
        exact.map(|z| {
            let noise = (0.002 * shapes::normal(random)) as f32;
            if z > 0.0 { z + noise } else { 0.0 }
        })
    };
    let first = noisy(&Pose::IDENTITY, &mut random);
    let mut live = started(&first);
    live.track(0, Effort::default());
    live.fuse(&first, None).expect("a frame");
    let moved = Pose::from_translation(DVec3::new(0.004, -0.003, 0.002));
    let repeated = noisy(&moved, &mut random);
    let mut known = None;
    let mut worst = 0.0_f64;
    for repeat in 0..1_012 {
        live.load(&repeated, false);
        let pose = live
            .track(33_000_000 * (repeat + 1), Effort::default())
            .world_from_camera;
        // A dozen frames to come to rest.
        if repeat == 12 {
            known = Some(pose);
        }
        if let Some(known) = known {
            worst = worst.max((pose.translation() - known.translation()).length());
        }
    }
    println!("C12: walked {worst:.1e} m in 1000 repeats, tolerance 1e-7");
    assert!(worst <= 1e-7);
}

#[test]
fn hc_c14_no_pass_ends_above_its_start() {
    let camera = Intrinsics::pinhole(80, 60, 72.0, 72.0, 39.5, 29.5).expect("a camera");
    let view = shapes::view(ROOM, &camera, &Pose::IDENTITY, 0.0, |_| 0.0);
    let points = shapes::points(&shapes::depth(ROOM, &camera, &Pose::IDENTITY), &camera);
    let input = IcpInput {
        points: &points,
        view: &view,
        grey: None,
    };
    let pass = |iterations| IcpConfig {
        passes: vec![IcpPass {
            level: 0,
            iterations,
            largest_distance: 0.3,
            robust_scale: 6.0,
            photometric: false,
        }],
        ..IcpConfig::default()
    };
    let mut random = Pcg64Mcg::seed_from_u64(9);
    let mut photometric = Photometric::default();
    let [mut once, mut more] = [1, 4].map(|n| Icp::with_level(pass(n), Level::detect()));
    let (mut above, mut naive_above) = (0, 0);
    for _ in 0..10_000 {
        let start = jump(&mut random, 0.2, 0.3);
        let mut cost_at =
            |icp: &mut Icp, pose: Pose| icp.align(input, &mut photometric, pose, 0..1);
        let Some(first) = cost_at(&mut once, start) else {
            continue;
        };
        let last = cost_at(&mut more, start).expect("the same points");
        above += u32::from(last.cost > first.cost);
        // Plain Gauss-Newton takes every step.
        let mut pose = start;
        for _ in 0..3 {
            let Some(found) = cost_at(&mut once, pose) else {
                break;
            };
            let step = found.solution.step;
            let turn = DVec3::new(step[0], step[1], step[2]) / found.radius;
            let shift = DVec3::new(step[3], step[4], step[5]);
            let turned = geometry::rotation::exp(turn);
            let to = found.center - turned * found.center + shift;
            pose = Pose::new(turned, to).expect("finite") * pose;
        }
        if let Some(end) = cost_at(&mut once, pose) {
            naive_above += u32::from(end.cost > first.cost);
        }
    }
    println!("C14: {above} of 10000 end above their start, plain steps {naive_above}");
    assert!(naive_above > 0);
    assert_eq!(above, 0);
}
