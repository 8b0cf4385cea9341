//! Hard case D16, and what a prediction must not show.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;
use crate::volume::VolumeConfig;

const VOXEL: f64 = 0.005;
const RADIUS_VOXELS: f64 = 20.0;
/// Voxels from −REACH to REACH hold a field.
const REACH: i32 = 32;

fn config() -> VolumeConfig {
    VolumeConfig {
        voxel_size: VOXEL as f32,
        min_depth: 0.0,
        ..VolumeConfig::default()
    }
}

/// The distance field of a ball about the origin, observed everywhere.
fn ball() -> Volume {
    let truncation = f64::from(config().truncation_voxels);
    Volume::from_field(config(), REACH, |voxel| {
        let from_center = DVec3::from_array(voxel.map(f64::from)).length();
        let distance = (from_center - RADIUS_VOXELS) / truncation;
        (distance.clamp(-1.0, 1.0) as f32, 1.0)
    })
}

fn camera(width: u32) -> Intrinsics {
    let (w, height) = (f64::from(width), width * 3 / 4);
    Intrinsics::pinhole(width, height, w, w, 0.5 * w, 0.5 * f64::from(height)).expect("usable")
}

fn look_at(eye: DVec3, target: DVec3) -> Pose {
    let forward = (target - eye).normalize();
    let right = forward.any_orthonormal_vector();
    let rotation = geometry::DMat3::from_cols(right, forward.cross(right), forward);
    Pose::from_matrix(rotation, eye).expect("a rotation")
}

fn unit_vector(rng: &mut Pcg64) -> DVec3 {
    loop {
        let v = DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        if (1e-4..=1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

/// Depth at which a ray `eye + z · slope` meets the ball, metres.
fn true_depth(eye: DVec3, slope: DVec3) -> Option<f64> {
    let radius = RADIUS_VOXELS * VOXEL;
    let (a, b) = (slope.length_squared(), eye.dot(slope));
    let root = b * b - a * (eye.length_squared() - radius * radius);
    (root > 0.0).then(|| (-b - root.sqrt()) / a)
}

/// Depth of the first negative voxel at steps of the truncation: no smaller step, no refinement.
fn naive_depth(volume: &Volume, eye: DVec3, slope: DVec3) -> Option<f64> {
    let step = f64::from(volume.config().truncation());
    (0..200).map(|n| f64::from(n) * step).find(|&z| {
        let voxel = ((eye + z * slope) / VOXEL).round().to_array();
        let voxel = volume.voxel(voxel.map(|c| c as i32));
        voxel.is_some_and(|voxel| voxel.tsdf < 0.0)
    })
}

#[test]
fn hc_d16_a_ray_stops_at_the_surface() {
    /// Voxels.
    const MEAN_TOLERANCE: f64 = 0.05;
    let volume = ball();
    let camera = camera(64);
    let mut rng = Pcg64::seed_from_u64(16);
    let (mut naive, mut shipped, mut worst_normal) = ((0.0, 0.0), (0.0, 0.0), 0.0_f64);
    for _ in 0..12 {
        let eye = rng.random_range(0.2..0.6) * unit_vector(&mut rng);
        let pose = look_at(eye, 0.02 * unit_vector(&mut rng));
        let mut view = ModelView::new(&camera, &pose);
        volume.predict(&camera, &pose, &mut view);
        for y in 0..view.height() {
            for x in 0..view.width() {
                let pixel = DVec2::new(x as f64, y as f64);
                let slope = ((pixel - camera.center()) / camera.focal()).extend(1.0);
                let slope = pose.transform_vector(slope);
                let surfel = view.at(x, y);
                let Some(depth) = true_depth(eye, slope) else {
                    continue;
                };
                let normal = (eye + depth * slope).normalize();
                let cosine = -normal.dot(slope.normalize());
                // At the rim a voxel of depth is nothing across.
                if cosine < 0.2 {
                    continue;
                }
                assert!(surfel.is_surface(), "pixel ({x}, {y}) misses the ball");
                let error = (f64::from(surfel.position[2]) - depth).abs() / VOXEL;
                shipped = (shipped.0 + error, shipped.1 + 1.0);
                let seen = pose.transform_vector(DVec3::from_array(surfel.normal.map(f64::from)));
                worst_normal = worst_normal.max(geometry::direction::angle_between(seen, normal));
                let missed = naive_depth(&volume, eye, slope).map_or(0.1, |z| (z - depth).abs());
                naive = (naive.0 + missed / VOXEL, naive.1 + 1.0);
            }
        }
    }
    assert!(shipped.1 > 1000.0);
    let (naive, shipped) = (naive.0 / naive.1, shipped.0 / shipped.1);
    println!("D16: naive error {naive:.2} voxels, tolerance {MEAN_TOLERANCE}");
    println!("D16: worst error {shipped:.4} voxels (mean), tolerance {MEAN_TOLERANCE}");
    println!("D16: worst normal {:.2} degrees", worst_normal.to_degrees());
    assert!(naive > MEAN_TOLERANCE, "the naive march passes");
    assert!(shipped <= MEAN_TOLERANCE);
    assert!(worst_normal.to_degrees() < 1.0);
}

#[test]
fn hc_d16_backs_of_surfaces_show_nothing() {
    let volume = ball();
    let camera = camera(64);
    let mut view = ModelView::new(&camera, &Pose::IDENTITY);
    // Inside the ball every crossing goes from behind the surface to free space.
    volume.predict(&camera, &Pose::IDENTITY, &mut view);
    assert_eq!(view.surface_count(), 0);
}

#[test]
fn unobserved_voxels_end_no_ray() {
    // Half of the ball was never seen.
    let truncation = config().truncation_voxels;
    let volume = Volume::from_field(config(), REACH, |voxel| {
        let from_center = DVec3::from_array(voxel.map(f64::from)).length() as f32;
        let distance = (from_center - RADIUS_VOXELS as f32) / truncation;
        if voxel[2] < 0 && distance > -1.0 {
            (distance.min(1.0), 1.0)
        } else {
            (1.0, 0.0)
        }
    });
    let camera = camera(64);
    let mut view = ModelView::new(&camera, &Pose::IDENTITY);
    for eye in [[0.0, 0.0, 0.4], [0.4, 0.0, 0.01], [0.0, -0.3, 0.3]] {
        let pose = look_at(DVec3::from_array(eye), DVec3::ZERO);
        volume.predict(&camera, &pose, &mut view);
        let wrong = view.surfels.iter().filter(|surfel| {
            let point = pose.transform_point(DVec3::from_array(surfel.position.map(f64::from)));
            let off = (point.length() / VOXEL - RADIUS_VOXELS).abs();
            surfel.is_surface() && (point.z > 0.0 || off > 0.5)
        });
        assert_eq!(wrong.count(), 0, "from {eye:?}");
    }
    view.min_weight = 1.5;
    let pose = look_at(DVec3::new(0.0, 0.0, -0.4), DVec3::ZERO);
    volume.predict(&camera, &pose, &mut view);
    assert_eq!(view.surface_count(), 0, "too little weight");
    view.min_weight = 1.0;
    volume.predict(&camera, &pose, &mut view);
    assert!(view.surface_count() > 500);
}

#[test]
fn a_prediction_has_the_same_bits_for_any_number_of_threads() {
    let volume = ball();
    let camera = camera(128);
    let pose = look_at(DVec3::new(0.1, 0.2, -0.3), DVec3::ZERO);
    let surfels = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool").install(|| {
            let mut view = ModelView::new(&camera, &pose);
            volume.predict(&camera, &pose, &mut view);
            view.surfels
        })
    });
    assert!(surfels[0].iter().any(Surfel::is_surface));
    assert!(surfels.iter().all(|other| *other == surfels[0]));
}

#[test]
fn an_empty_volume_and_a_far_camera_show_nothing() {
    let camera = camera(32);
    for far in [0.0, 1e4, -1e9, 1e30] {
        for volume in [ball(), Volume::new(config()).expect("usable")] {
            let pose = Pose::from_translation(DVec3::new(far, far, -far));
            let mut view = ModelView::new(&camera, &pose);
            volume.predict(&camera, &pose, &mut view);
            assert_eq!(view.surface_count(), 0, "at {far} m");
        }
    }
}

/// Depth of the ball as a sensor sees it: up to `noise` metres off, a tenth of the pixels missing.
fn measured_depth(camera: &Intrinsics, pose: &Pose, noise: f64, rng: &mut Pcg64) -> Vec<f32> {
    let size = camera.width() * camera.height();
    (0..size)
        .map(|n| {
            let pixel = DVec2::new(f64::from(n % camera.width()), f64::from(n / camera.width()));
            let slope = ((pixel - camera.center()) / camera.focal()).extend(1.0);
            let depth = true_depth(pose.translation(), pose.transform_vector(slope));
            let is_hole = rng.random_range(0.0..1.0) < 0.1;
            depth.filter(|_| !is_hole).map_or(0.0, |depth| {
                (depth + noise * rng.random_range(-1.0..1.0)) as f32
            })
        })
        .collect()
}

#[test]
fn measured_depth_leads_to_the_same_surface_as_the_march() {
    /// Voxels.
    const TOLERANCE: f32 = 0.1;
    let volume = ball();
    let camera = camera(64);
    let mut rng = Pcg64::seed_from_u64(17);
    let (mut both, mut missed, mut measured, mut worst) = (0, 0, 0, 0.0_f32);
    for round in 0..12 {
        let eye = rng.random_range(0.2..0.6) * unit_vector(&mut rng);
        let pose = look_at(eye, 0.02 * unit_vector(&mut rng));
        let [mut march, mut near] = [(); 2].map(|()| ModelView::new(&camera, &pose));
        volume.predict(&camera, &pose, &mut march);
        // Within the band, and in every other round mostly beyond it.
        let noise = if round % 2 == 0 { 0.005 } else { 0.08 };
        let depth = measured_depth(&camera, &pose, noise, &mut rng);
        volume.predict_near(&camera, &pose, &depth, &mut near);
        for ((&depth, march), near) in depth.iter().zip(&march.surfels).zip(&near.surfels) {
            if depth == 0.0 {
                assert!(!near.is_surface(), "no surfel without a measurement");
                continue;
            }
            measured += 1;
            match (march.is_surface(), near.is_surface()) {
                (true, true) => {
                    both += 1;
                    let off = (march.position[2] - near.position[2]).abs() / VOXEL as f32;
                    // Along a ray at the rim a tenth of a voxel across the surface is more.
                    let normal = Vec3A::from_array(near.normal);
                    let ray = Vec3A::from_array(near.position).normalize();
                    worst = worst.max(off * normal.dot(ray).abs());
                }
                (true, false) => missed += 1,
                // At the rim a march may pass by.
                (false, true) => {
                    let point = DVec3::from_array(near.position.map(f64::from));
                    let from_center = pose.transform_point(point).length() / VOXEL;
                    assert!((from_center - RADIUS_VOXELS).abs() < 0.5);
                }
                (false, false) => {}
            }
        }
    }
    println!("{both} surfels of {measured}, {missed} missed, worst {worst:.3} voxels");
    assert!(
        both > 5000 && missed * 500 < both,
        "{missed} of {both} missed"
    );
    assert!(worst < TOLERANCE, "{worst} voxels");
}

#[test]
fn of_two_walls_on_a_ray_the_measured_one_is_shown() {
    // Walls at z = −20 and 20 voxels, as seen from below z: both are entered from free space.
    let truncation = config().truncation_voxels;
    let volume = Volume::from_field(config(), REACH, |[_, _, z]| {
        let wall = if z < 0 { -20 } else { 20 };
        let distance = (wall - z) as f32 / truncation;
        if distance > -1.0 {
            (distance.min(1.0), 1.0)
        } else {
            (1.0, 0.0)
        }
    });
    let camera = camera(32);
    let pose = Pose::from_translation(DVec3::new(0.0, 0.0, -0.4));
    let mut view = ModelView::new(&camera, &pose);
    for (measured, shown) in [(0.3, 0.3), (0.5, 0.5), (0.503, 0.5), (1.5, 0.3)] {
        volume.predict_near(&camera, &pose, &vec![measured; 32 * 24], &mut view);
        let at = view.at(16, 12).position[2];
        assert!((at - shown).abs() < 1e-3, "measured {measured}, shown {at}");
    }
}

#[test]
fn a_prediction_by_measured_depth_has_the_same_bits_for_any_number_of_threads() {
    let volume = ball();
    let camera = camera(128);
    let pose = look_at(DVec3::new(0.1, 0.2, -0.3), DVec3::ZERO);
    let depth = measured_depth(&camera, &pose, 0.02, &mut Pcg64::seed_from_u64(18));
    let surfels = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool").install(|| {
            let mut view = ModelView::new(&camera, &pose);
            volume.predict_near(&camera, &pose, &depth, &mut view);
            view.surfels
        })
    });
    assert!(surfels[0].iter().any(Surfel::is_surface));
    assert!(surfels.iter().all(|other| *other == surfels[0]));
}
