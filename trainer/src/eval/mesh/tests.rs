//! Surfaces whose distances are known; hard case L11.

use geometry::{DVec3, Intrinsics, Pose, rotation};
use glam::Vec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use sequence::DepthCamera;

use super::*;

fn uniform(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

fn unit_vector(rng: &mut Pcg64) -> DVec3 {
    loop {
        let v = DVec3::from_array([(); 3].map(|()| uniform(rng, -1.0, 1.0)));
        if (1e-4..=1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

fn random_pose(rng: &mut Pcg64) -> Pose {
    let turn = rotation::exp(unit_vector(rng) * uniform(rng, 0.0, 3.0));
    Pose::new(turn, unit_vector(rng) * uniform(rng, 0.0, 5.0)).unwrap()
}

/// A plane of 0.4 x 0.3 m at height `z`, as `columns` x `rows` cells whose inner corners are pushed about.
fn plane(rng: &mut Pcg64, columns: u32, rows: u32, z: f64, pose: &Pose) -> SurfaceMesh {
    let mut points = Vec::new();
    for row in 0..=rows {
        for column in 0..=columns {
            let mut push = |index: u32, count: u32| {
                let inside = index > 0 && index < count;
                f64::from(index) + if inside { uniform(rng, -0.3, 0.3) } else { 0.0 }
            };
            let x = 0.4 * push(column, columns) / f64::from(columns);
            let y = 0.3 * push(row, rows) / f64::from(rows);
            points.push(pose.transform_point(DVec3::new(x, y, z)));
        }
    }
    let at = |column: u32, row: u32| row * (columns + 1) + column;
    let mut triangles = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [at(column, row), at(column + 1, row)];
            let [c, d] = [at(column, row + 1), at(column + 1, row + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    SurfaceMesh {
        positions: points.iter().map(|p| p.as_vec3()).collect(),
        triangles,
        origin: DVec3::ZERO,
    }
}

/// Mean distance from each vertex to the nearest vertex.
fn naive_distance(estimate: &SurfaceMesh, reference: &SurfaceMesh) -> f64 {
    let nearest = |p: &Vec3| {
        let distances = reference
            .positions
            .iter()
            .map(|q| f64::from(p.distance(*q)));
        distances.fold(f64::INFINITY, f64::min)
    };
    estimate.positions.iter().map(nearest).sum::<f64>() / estimate.positions.len() as f64
}

fn judged(
    estimate: &SurfaceMesh,
    reference: &SurfaceMesh,
    pose: &Pose,
    sightings: Option<&Sightings<'_>>,
    count: usize,
) -> MeshMetrics {
    compare(
        estimate,
        reference,
        pose,
        "a test",
        sightings,
        count,
        &|_, _| {},
    )
    .unwrap()
}

/// Relative error of a distance: the samples are on the surface, so that only f32 rounds.
const SHIFT_TOLERANCE: f64 = 0.01;

#[test]
fn hc_l11_the_distance_of_shifted_planes_is_the_shift() {
    let mut rng = Pcg64::seed_from_u64(11);
    // Bite: 2 mm apart, cells of 10 mm that do not meet.
    let shift = 0.002;
    let reference = plane(&mut rng, 40, 30, 0.0, &Pose::IDENTITY);
    let estimate = plane(&mut rng, 31, 23, shift, &Pose::IDENTITY);
    let naive_error = (naive_distance(&estimate, &reference) / shift - 1.0).abs();
    println!("hc_l11: naive error {naive_error:.3e}, tolerance {SHIFT_TOLERANCE:.1e}");
    assert!(naive_error > SHIFT_TOLERANCE);

    let mut worst = 0.0_f64;
    for round in 0..1001 {
        let (shift, cells) = match round {
            0 => (shift, [40, 30, 31, 23]),
            _ => (
                uniform(&mut rng, 5e-4, 0.02),
                [(); 4].map(|()| rng.random_range(1..12)),
            ),
        };
        let pose = random_pose(&mut rng);
        let reference = plane(&mut rng, cells[0], cells[1], 0.0, &pose);
        let estimate = plane(&mut rng, cells[2], cells[3], shift, &pose);
        let found = judged(&estimate, &reference, &Pose::IDENTITY, None, 500);
        for distances in [found.accuracy, found.completeness] {
            for value in [distances.mean, distances.median, distances.q90] {
                worst = worst.max((value / shift - 1.0).abs());
            }
        }
        assert!(found.normal_error_deg < 0.1 && found.opposed_fraction == 0.0);
    }
    println!("hc_l11: worst error {worst:.3e}, tolerance {SHIFT_TOLERANCE:.1e}");
    assert!(worst <= SHIFT_TOLERANCE);
}

/// A box around the origin of half sizes `half`, its front face first.
fn closed_box(half: Vec3) -> SurfaceMesh {
    let signs = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mut positions = Vec::new();
    for z in [-1.0, 1.0] {
        positions.extend(signs.map(|(x, y)| half * Vec3::new(x, y, z)));
    }
    let quads = [
        [0, 1, 2, 3],
        [4, 7, 6, 5],
        [0, 4, 5, 1],
        [1, 5, 6, 2],
        [2, 6, 7, 3],
        [3, 7, 4, 0],
    ];
    SurfaceMesh {
        positions,
        triangles: quads
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
            .collect(),
        origin: DVec3::ZERO,
    }
}

/// Share of the seen surface that may pass for missing: points at the rim of the face round to a pixel beside it.
const UNSEEN_TOLERANCE: f64 = 0.01;

#[test]
fn hc_l11_what_nobody_saw_is_not_missing() {
    let mut rng = Pcg64::seed_from_u64(12);
    let camera = DepthCamera {
        intrinsics: Intrinsics::pinhole(32, 24, 30.0, 30.0, 15.5, 11.5).unwrap(),
        depth_scale: 0.001,
        depth_range: 0.3..=3.0,
        samples: sequence::DepthSamples::Values,
        shift: None,
        is_registered: false,
    };
    let mut worst = 0.0_f64;
    for round in 0..1001 {
        let half = match round {
            0 => Vec3::new(0.15, 0.1, 0.1),
            _ => Vec3::from_array([(); 3].map(|()| uniform(&mut rng, 0.08, 0.2) as f32)),
        };
        let reference = closed_box(half);
        // What a camera in front reconstructs: the front face.
        let estimate = SurfaceMesh {
            triangles: reference.triangles[..2].to_vec(),
            ..reference.clone()
        };
        let all = judged(&estimate, &reference, &Pose::IDENTITY, None, 600);
        let naive_error = 1.0 - all.completeness.share_5mm;
        if round == 0 {
            println!("hc_l11: naive error {naive_error:.3e}, tolerance {UNSEEN_TOLERANCE:.1e}");
        }
        assert!(naive_error > UNSEEN_TOLERANCE);
        // Straight ahead, so that the sides are hidden behind the front.
        let toward = |x: f64| Pose::from_translation(DVec3::new(0.01 * x, 0.0, -0.8));
        let sightings = Sightings {
            camera: &camera,
            world_from_depth: [-1.0, 0.0, 1.0].map(toward).to_vec(),
        };
        let seen = judged(
            &estimate,
            &reference,
            &Pose::IDENTITY,
            Some(&sightings),
            600,
        );
        worst = worst.max(1.0 - seen.completeness.share_5mm);
        let front = 1.0 / (2.0 * (1.0 + half.z / half.x + half.z / half.y));
        assert!((seen.seen_fraction - f64::from(front)).abs() < 0.05);
    }
    println!("hc_l11: worst error {worst:.3e}, tolerance {UNSEEN_TOLERANCE:.1e}");
    assert!(worst <= UNSEEN_TOLERANCE);
}

#[test]
fn the_alignment_of_the_path_moves_the_mesh() {
    let mut rng = Pcg64::seed_from_u64(13);
    let pose = random_pose(&mut rng);
    let reference = plane(&mut rng, 5, 4, 0.0, &pose);
    let mut estimate = plane(&mut rng, 7, 3, 0.0, &Pose::IDENTITY);
    // The same surface counted from elsewhere.
    estimate.origin = DVec3::new(-7.0, 11.0, 1000.0);
    let origin = Pose::from_translation(-estimate.origin);
    let found = judged(&estimate, &reference, &(pose * origin), None, 2000);
    assert!(found.accuracy.q90 < 1e-5 && found.fscore_5mm == 1.0);
    let unmoved = judged(&estimate, &reference, &Pose::IDENTITY, None, 2000);
    assert!(unmoved.fscore_5mm == 0.0);
}

#[test]
fn specks_beside_the_surface_are_told() {
    let mut rng = Pcg64::seed_from_u64(14);
    let reference = plane(&mut rng, 4, 4, 0.0, &Pose::IDENTITY);
    let mut estimate = reference.clone();
    let first = estimate.positions.len() as u32;
    // 0.0005 m² beside 0.12 m².
    estimate
        .positions
        .extend([[0.0, 0.0], [0.1, 0.0], [0.0, 0.01]].map(|[x, y]| Vec3::new(x, y, 0.5)));
    estimate.triangles.push([first, first + 1, first + 2]);
    let found = judged(&estimate, &reference, &Pose::IDENTITY, None, 5000);
    assert!((found.floating_fraction - 0.0005 / 0.1205).abs() < 1e-6);
    let flipped = SurfaceMesh {
        triangles: reference
            .triangles
            .iter()
            .map(|[a, b, c]| [*a, *c, *b])
            .collect(),
        ..reference.clone()
    };
    let found = judged(&flipped, &reference, &Pose::IDENTITY, None, 5000);
    assert_eq!((found.normal_error_deg, found.opposed_fraction), (0.0, 1.0));
}

#[test]
fn a_reference_that_no_frame_sees_is_refused() {
    let mut rng = Pcg64::seed_from_u64(15);
    let mesh = plane(&mut rng, 2, 2, 0.0, &Pose::IDENTITY);
    let camera = DepthCamera {
        intrinsics: Intrinsics::pinhole(32, 24, 30.0, 30.0, 15.5, 11.5).unwrap(),
        depth_scale: 0.001,
        depth_range: 0.3..=3.0,
        samples: sequence::DepthSamples::Values,
        shift: None,
        is_registered: false,
    };
    let sightings = Sightings {
        camera: &camera,
        world_from_depth: vec![Pose::from_translation(DVec3::Z); 5],
    };
    let refused = compare(
        &mesh,
        &mesh,
        &Pose::IDENTITY,
        "a test",
        Some(&sightings),
        100,
        &|_, _| {},
    );
    assert!(refused.unwrap_err().to_string().contains("no frame sees"));
}
