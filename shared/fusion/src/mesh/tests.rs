//! Hard cases D12, D13, D15: the table, exact zeros, flat gradients.

use std::collections::HashMap;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::cases::{CASES, EDGES, edge_start, face_corners, face_segments};
use super::*;
use crate::normals::face_normal_sums;
use crate::volume::{Volume, VolumeConfig};

/// Voxels from −REACH to REACH hold a test field; a layer of free space closes it.
const REACH: i32 = 6;

fn report(id: &str, worst: f64, tolerance: f64) {
    println!("{id}: worst error {worst:.3e}, tolerance {tolerance:.1e}");
    assert!(worst <= tolerance, "{id}: {worst:e} > {tolerance:e}");
}

/// Directed sides of a case's triangles that no other triangle of the case has the other way round, and
/// that lie on one face of the cell.
fn cuts_of_face(triangles: &[[u8; 3]], axis: usize, side: usize) -> Vec<(usize, usize)> {
    let sides: Vec<(usize, usize)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(from, to)| (usize::from(from), usize::from(to)))
        .collect();
    let lies_in_face = |edge: usize| {
        let (along, corner) = edge_start(edge);
        along != axis && corner >> axis & 1 == side
    };
    let mut cuts: Vec<(usize, usize)> = sides
        .iter()
        .copied()
        .filter(|&(from, to)| {
            !sides.contains(&(to, from)) && lies_in_face(from) && lies_in_face(to)
        })
        .collect();
    cuts.sort_unstable();
    cuts
}

/// The same cut seen by the neighbour above: its lower edges have the numbers of our upper ones less a bit,
/// and it goes round the other way.
fn seen_from_above(cuts: &[(usize, usize)], axis: usize) -> Vec<(usize, usize)> {
    let lowered = |edge: usize| {
        let (along, corner) = edge_start(edge);
        let target = (along, corner & !(1 << axis));
        (0..EDGES)
            .find(|&e| edge_start(e) == target)
            .expect("an edge of the lower face")
    };
    let mut cuts: Vec<_> = cuts
        .iter()
        .map(|&(from, to)| (lowered(to), lowered(from)))
        .collect();
    cuts.sort_unstable();
    cuts
}

/// All pairs of neighbouring cells: 12 corners, 3 axes. Counts pairs that cut their common face differently.
fn cracks(triangles_of: impl Fn(u8) -> Vec<[u8; 3]>) -> usize {
    let table: Vec<_> = (0..=255).map(triangles_of).collect();
    let mut cracks = 0;
    for axis in 0..3 {
        let [first, second] = [(axis + 1) % 3, (axis + 2) % 3];
        for signs in 0..1_u32 << 12 {
            // Corner (layer, n): layer 0 to 2 along the axis, n the place in the layer.
            let cell = |layer: u32| {
                let mut pattern = 0_u8;
                for n in 0..4_u32 {
                    let place = (n & 1) << first | (n >> 1) << second;
                    for upper in 0..2 {
                        let sign = (signs >> (4 * (layer + upper) + n) & 1) as u8;
                        pattern |= sign << (place | upper << axis);
                    }
                }
                usize::from(pattern)
            };
            let below = seen_from_above(&cuts_of_face(&table[cell(0)], axis, 1), axis);
            let above = cuts_of_face(&table[cell(1)], axis, 0);
            cracks += usize::from(below != above);
        }
    }
    cracks
}

#[test]
fn hc_d12_neighbours_cut_their_common_face_alike() {
    // Naive: 15 cases by complement; a cell with more negative corners is the mirror of its opposite.
    let naive = cracks(|signs| {
        if signs.count_ones() <= 4 {
            return CASES[usize::from(signs)].triangles.clone();
        }
        let opposite = &CASES[usize::from(!signs)].triangles;
        opposite.iter().map(|&[a, b, c]| [a, c, b]).collect()
    });
    println!("D12: naive error {naive}, tolerance 0");
    assert!(naive > 0, "mirrored ambiguous faces leave cracks");
    let shipped = cracks(|signs| CASES[usize::from(signs)].triangles.clone());
    report("D12", shipped as f64, 0.0);
}

#[test]
fn hc_d12_every_run_of_negative_corners_is_cut_off_once() {
    for signs in 0..=255_u8 {
        let segments: usize = (0..3)
            .flat_map(|axis| [false, true].map(|upper| face_corners(axis, upper)))
            .map(|corners| face_segments(signs, corners).len())
            .sum();
        let triangles = &CASES[usize::from(signs)].triangles;
        let cuts: usize = (0..3)
            .flat_map(|axis| [0, 1].map(|side| cuts_of_face(triangles, axis, side).len()))
            .sum();
        assert_eq!(segments, cuts, "pattern {signs:08b}");
    }
}

/// A field in free space at its border.
fn closed_volume(mut inner: impl FnMut([i32; 3]) -> f32) -> Volume {
    let config = VolumeConfig {
        voxel_size: 0.004,
        ..VolumeConfig::default()
    };
    Volume::from_field(config, REACH + 3, |voxel| {
        let is_inner = voxel.iter().all(|c| c.abs() <= REACH);
        (if is_inner { inner(voxel) } else { 1.0 }, 4.0)
    })
}

/// Panics unless every edge has exactly one triangle on either side; returns the Euler characteristic.
fn assert_closed(mesh: &Mesh, what: &str) -> i64 {
    let mut uses: HashMap<(u32, u32), (u32, u32)> = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (forth, back) = uses.entry((from.min(to), from.max(to))).or_default();
            *(if from < to { forth } else { back }) += 1;
        }
    }
    let torn = uses
        .values()
        .filter(|&&(forth, back)| (forth, back) != (1, 1))
        .count();
    assert_eq!(torn, 0, "{what}: {torn} edges without a partner");
    mesh.positions.len() as i64 - uses.len() as i64 + mesh.triangles.len() as i64
}

#[test]
fn hc_d12_random_volumes_have_closed_surfaces() {
    let mut rng = Pcg64::seed_from_u64(12);
    let mut triangles = 0;
    for round in 0..40 {
        let volume = closed_volume(|_| rng.random_range(-1.0..1.0));
        let mesh = extract_mesh(&volume, &MeshConfig::default());
        triangles += mesh.triangles.len();
        let characteristic = assert_closed(&mesh, &format!("round {round}"));
        assert_eq!(characteristic % 2, 0, "round {round}: χ = {characteristic}");
    }
    assert!(triangles > 10_000, "{triangles} triangles");
}

/// Twice the smallest area of a triangle, m².
fn smallest_double_area(mesh: &Mesh) -> f64 {
    let area = |&[a, b, c]: &[u32; 3]| {
        let [a, b, c] = [a, b, c].map(|v| mesh.positions[v as usize].as_dvec3());
        (b - a).cross(c - a).length()
    };
    mesh.triangles
        .iter()
        .map(area)
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn hc_d13_exact_zeros_leave_no_degenerate_triangle() {
    const SMALLEST_AREA: f64 = 1e-12;
    // Naive: linear interpolation as written; two zeros are 0/0, one zero gives three equal vertices.
    let naive = |d0: f32, d1: f32| d0 / (d0 - d1);
    assert!(naive(0.0, 0.0).is_nan());
    let at_corner = [naive(0.0, -1.0), naive(0.0, -0.5), naive(0.0, -0.25)];
    println!(
        "D13: naive area {:.1e}, least {SMALLEST_AREA:.1e}",
        at_corner[0]
    );
    assert_eq!(at_corner, [0.0; 3], "all vertices of the corner coincide");

    let mut rng = Pcg64::seed_from_u64(13);
    let mut smallest = f64::INFINITY;
    for round in 0..60 {
        let volume = closed_volume(|[x, y, z]| match round {
            // Planes through voxels, and a corner of three of them.
            0 => -(3 - x.abs()) as f32 / 6.0,
            1 => (x.abs().max(y.abs()).max(z.abs()) - 3) as f32 / 6.0,
            2 => (x.abs() + y.abs() + z.abs() - 4) as f32 / 6.0,
            // Signs and zeros at random; −0 counts as 0.
            _ => [-1.0, -0.5, -1e-30, -0.0, 0.0, 0.0, 1e-30, 0.5, 1.0][rng.random_range(0..9)],
        });
        let mesh = extract_mesh(&volume, &MeshConfig::default());
        assert!(!mesh.triangles.is_empty());
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
        assert_closed(&mesh, &format!("round {round}"));
        smallest = smallest.min(0.5 * smallest_double_area(&mesh));
    }
    println!("D13: smallest area {smallest:.2e} m², least {SMALLEST_AREA:.1e}");
    assert!(smallest >= SMALLEST_AREA);
}

#[test]
fn hc_d15_every_normal_is_finite_and_faces_with_its_triangles() {
    const UNIT: f64 = 1e-5;
    // Naive: the gradient of a field that alternates or is saturated, over its length.
    let flat = Vec3::ZERO;
    assert!(
        (flat / flat.length()).is_nan(),
        "D15: the naive normal is NaN"
    );

    let mut rng = Pcg64::seed_from_u64(15);
    let (mut worst, mut vertices) = (0.0_f64, 0);
    for round in 0..30 {
        let volume = closed_volume(|[x, y, z]| match round % 3 {
            // Alternating layers: every central difference is 0.
            0 => {
                if (x + round).rem_euclid(2) == 0 {
                    -1.0
                } else {
                    1.0
                }
            }
            // Saturated inside and out.
            1 => {
                if x * x + y * y + z * z < 20 + round {
                    -1.0
                } else {
                    1.0
                }
            }
            _ => *[-1.0, 1.0, 1.0, -1e-6]
                .get(rng.random_range(0..4))
                .unwrap_or(&1.0),
        });
        let mesh = extract_mesh(&volume, &MeshConfig::default());
        vertices += mesh.positions.len();
        for (normal, sum) in mesh.normals.iter().zip(face_normal_sums(&mesh)) {
            assert!(normal.is_finite());
            worst = worst.max((f64::from(normal.length()) - 1.0).abs());
            assert!(
                normal.dot(sum) >= 0.0,
                "a normal points away from its faces"
            );
        }
    }
    assert!(vertices > 1000);
    report("D15", worst, UNIT);
}

#[test]
fn an_empty_volume_has_an_empty_mesh() {
    let volume = Volume::new(VolumeConfig::default()).expect("a usable config");
    let mut mesh = extract_mesh(
        &volume,
        &MeshConfig {
            min_weight: f32::NAN,
        },
    );
    assert_eq!(mesh, Mesh::default());
    assert!(components(&mesh).is_empty());
    assert_eq!(remove_small_components(&mut mesh, 10), 0);
}

#[test]
fn small_parts_go_and_large_ones_stay() {
    let ball = |[x, y, z]: [i32; 3], at: i32, radius: f32| {
        (((x - at).pow(2) + y * y + z * z) as f32).sqrt() - radius
    };
    let volume = closed_volume(|v| (ball(v, 2, 3.2).min(ball(v, -5, 0.7)) / 6.0).min(1.0));
    let mut mesh = extract_mesh(&volume, &MeshConfig::default());
    assert_eq!(components(&mesh).into_iter().max(), Some(1), "two parts");
    let before = mesh.triangles.len();
    let removed = remove_small_components(&mut mesh, 20);
    assert!(removed > 0 && removed < 20);
    assert_eq!(mesh.triangles.len(), before - removed);
    assert_eq!(components(&mesh).into_iter().max(), Some(0));
    assert_eq!(assert_closed(&mesh, "the large part"), 2, "a sphere");
}

#[test]
fn triangles_are_counter_clockwise_from_free_space() {
    let volume =
        closed_volume(|[x, y, z]| ((((x * x + y * y + z * z) as f32).sqrt() - 4.3) / 6.0).min(1.0));
    let mesh = extract_mesh(&volume, &MeshConfig::default());
    assert!(!mesh.triangles.is_empty());
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
        assert!(
            (b - a).cross(c - a).dot(a + b + c) > 0.0,
            "a triangle faces inwards"
        );
    }
    let outward = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .all(|(p, n)| p.dot(*n) > 0.0);
    assert!(outward, "a normal faces inwards");
}
