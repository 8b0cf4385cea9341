//! Small scenes for the hard cases: points with one texel a view, truth known.

use geometry::PanoramaSize;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use srm::{DiffuseTreatment, JointSettings, Problem, Row, Rows};

/// Gain of every row.
pub(crate) const GAIN: f32 = 0.3;

/// A scene of `vertex_count` points that each see random texels.
pub(crate) struct TestScene {
    pub(crate) rows: Rows,
    pub(crate) panorama: PanoramaSize,
    pub(crate) diffuse: Vec<f64>,
    pub(crate) specular: Vec<f64>,
}

pub(crate) fn generator(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// A row with one tap.
pub(crate) fn row(vertex: u32, texel: u32, tap: f32, observed: f64) -> Row {
    Row {
        vertices: [vertex; 3],
        barycentric: [1.0, 0.0, 0.0],
        texels: [texel; 4],
        taps: [tap, 0.0, 0.0, 0.0],
        observed: [observed as f32; 3],
        known: [0.0; 3],
        weight: 1.0,
        clipped: 0,
        frame: 0,
        segment: 1,
    }
}

/// Every point sees `views` random texels below `texel_limit`; frames count the views.
pub(crate) fn scene(
    seed: u64,
    height: u32,
    vertex_count: usize,
    views: usize,
    texel_limit: usize,
    noise: f64,
) -> TestScene {
    let mut rng = generator(seed);
    let panorama = PanoramaSize::from_height(height).unwrap();
    // Some prints are black: they are what fixes the offset.
    let diffuse: Vec<f64> = (0..vertex_count)
        .map(|_| (rng.random::<f64>() * 0.6 - 0.2).max(0.0))
        .collect();
    let specular: Vec<f64> = (0..panorama.texel_count())
        .map(|_| 0.2 + 0.8 * rng.random::<f64>())
        .collect();
    let mut rows = Rows::default();
    for view in 0..views {
        for (vertex, &d) in diffuse.iter().enumerate() {
            let texel = rng.random_range(0..texel_limit);
            let jitter =
                (rng.random::<f64>() + rng.random::<f64>() + rng.random::<f64>() - 1.5) * 2.0;
            let observed = d + f64::from(GAIN) * specular[texel] + noise * jitter;
            let mut row = row(vertex as u32, texel as u32, GAIN, observed);
            row.frame = view as u32;
            rows.push(row);
        }
    }
    TestScene {
        rows,
        panorama,
        diffuse,
        specular,
    }
}

/// Prints the line that every hard case prints.
pub(crate) fn report(id: &str, worst: f64, tolerance: f64) {
    println!("{id}, worst error {worst:.3e}, tolerance {tolerance:.3e}");
}

/// Settings that solve to the end, with D pulled to zero by `weight`.
pub(crate) fn tight(weight: f64) -> JointSettings {
    let mut settings = JointSettings {
        diffuse: DiffuseTreatment::PulledToZero { weight },
        ..JointSettings::default()
    };
    settings.solver.steps = 400;
    settings.solver.passes = 12;
    settings.solver.tolerance = 1e-9;
    settings
}

/// The problem of `rows`.
pub(crate) fn problem(rows: Rows, vertex_count: usize, panorama: PanoramaSize) -> Problem {
    Problem::new(rows, vertex_count, panorama).unwrap()
}
