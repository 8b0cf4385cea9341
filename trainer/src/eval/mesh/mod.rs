//! `glint eval --mesh`: a surface against a reference surface (effects-and-tradeoffs C4).
//!
//! Points are spread by area on one surface and measured to the triangles of the other, so that tessellation
//! does not matter (hard-cases L11). Map: `read` PLY files · `samples` points of a surface · `seen` which of
//! them the camera saw.

mod read;
mod samples;
mod seen;
#[cfg(test)]
mod tests;

use anyhow::{Context as _, ensure};
use geometry::{DVec3, Pose, robust};
use glam::Vec3;
use rayon::prelude::*;
use raytrace::{Nearest, Scene};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

pub use self::read::{SurfaceMesh, read_mesh};
pub use self::samples::SurfacePoint;
pub use self::seen::Sightings;

use self::samples::{area_samples, area_vector, corners};
use self::seen::seen_points;

/// Distance that counts as right, metres.
const CLOSE_METRES: f64 = 0.005;
/// Distance beyond which a normal is left out of the second figure, metres.
const OUTLIER_METRES: f64 = 0.02;
/// Share of the area below which a connected part floats.
const SMALL_PART: f64 = 0.01;
/// Points on each surface.
pub const SAMPLE_COUNT: usize = 1_000_000;
/// Seed of the points.
const SEED: u64 = 1;

/// Distances of points of one surface to another, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceDistances {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Quantile 0.9.
    pub q90: f64,
    /// Share below 5 mm.
    pub share_5mm: f64,
    /// Points.
    pub count: usize,
}

/// Everything `--mesh` measures, for `metrics.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MeshMetrics {
    /// Estimate to reference.
    pub accuracy: SurfaceDistances,
    /// Reference to estimate.
    pub completeness: SurfaceDistances,
    /// Which part of the reference completeness is about.
    pub completeness_domain: String,
    /// Share of the reference's points in that part.
    pub seen_fraction: f64,
    /// Harmonic mean of the two shares below 5 mm.
    pub fscore_5mm: f64,
    /// Median angle between the normals of a point of the estimate and of the nearest point of the reference,
    /// either way round, degrees.
    pub normal_error_deg: f64,
    /// The same without points further than 20 mm.
    pub normal_error_near_deg: f64,
    /// Share of points whose normals look opposite ways: nearly 0 or nearly 1, else walls are doubled.
    pub opposed_fraction: f64,
    /// Area of connected parts of the estimate below 1 % of all, as a share.
    pub floating_fraction: f64,
    /// What the alignment was taken from.
    pub alignment: String,
    /// Triangles of the estimate and of the reference.
    pub triangle_counts: [usize; 2],
}

/// Compares `estimate`, moved by `reference_from_estimate` (world to world, said by `alignment`), with
/// `reference`. Completeness is about what `sightings` see, where they are given.
///
/// # Errors
/// When a mesh has no area, or the camera saw nothing of the reference.
pub fn compare(
    estimate: &SurfaceMesh,
    reference: &SurfaceMesh,
    reference_from_estimate: &Pose,
    alignment: &str,
    sightings: Option<&Sightings<'_>>,
    sample_count: usize,
    progress: &dyn Fn(usize, usize),
) -> anyhow::Result<MeshMetrics> {
    let moved: Vec<Vec3> = estimate
        .positions
        .iter()
        .map(|position| {
            let world = estimate.origin + position.as_dvec3();
            (reference_from_estimate.transform_point(world) - reference.origin).as_vec3()
        })
        .collect();
    let estimate_scene = Scene::new(&moved, &estimate.triangles)?;
    let reference_scene = Scene::new(&reference.positions, &reference.triangles)?;
    let on_estimate = area_samples(&moved, &estimate.triangles, sample_count, SEED);
    let on_reference = area_samples(
        &reference.positions,
        &reference.triangles,
        sample_count,
        SEED,
    );
    ensure!(!on_estimate.is_empty(), "the estimated mesh has no area");
    ensure!(!on_reference.is_empty(), "the reference mesh has no area");
    let to_reference = nearest_of(&reference_scene, &on_estimate);
    let reference_count = on_reference.len();
    let (wanted, completeness_domain) = match sightings {
        Some(sightings) => (
            seen_points(
                reference,
                &reference_scene,
                on_reference,
                sightings,
                progress,
            ),
            format!(
                "reference surface that at least 3 of {} training frames see within range",
                sightings.world_from_depth.len()
            ),
        ),
        None => (
            on_reference,
            "all of the reference surface: no poses say what was seen".to_owned(),
        ),
    };
    ensure!(
        !wanted.is_empty(),
        "no frame sees the reference mesh: is it in the world of the reference poses?"
    );
    let seen_fraction = wanted.len() as f64 / reference_count as f64;
    let accuracy = distances(&to_reference)?;
    let completeness = distances(&nearest_of(&estimate_scene, &wanted))?;
    let both = accuracy.share_5mm + completeness.share_5mm;
    let normals = NormalErrors::of(&moved, estimate, reference, &on_estimate, &to_reference);
    Ok(MeshMetrics {
        fscore_5mm: if both > 0.0 {
            2.0 * accuracy.share_5mm * completeness.share_5mm / both
        } else {
            0.0
        },
        accuracy,
        completeness,
        completeness_domain,
        seen_fraction,
        normal_error_deg: normals.median_deg(f64::INFINITY),
        normal_error_near_deg: normals.median_deg(OUTLIER_METRES),
        opposed_fraction: normals.opposed_fraction(),
        floating_fraction: floating_fraction(&moved, &estimate.triangles),
        alignment: alignment.to_owned(),
        triangle_counts: [estimate.triangles.len(), reference.triangles.len()],
    })
}

/// The nearest point of `scene` to every point, in their order.
fn nearest_of(scene: &Scene, points: &[SurfacePoint]) -> Vec<Option<Nearest>> {
    let nearest = |sample: &SurfacePoint| scene.nearest(sample.point, f64::INFINITY);
    points.par_iter().with_min_len(1024).map(nearest).collect()
}

fn distances(nearest: &[Option<Nearest>]) -> anyhow::Result<SurfaceDistances> {
    let mut found: Vec<f64> = nearest.iter().flatten().map(|n| n.distance).collect();
    let count = found.len();
    let mean = found.iter().sum::<f64>() / count as f64;
    let close_count = found.iter().filter(|d| **d < CLOSE_METRES).count();
    Ok(SurfaceDistances {
        mean,
        median: robust::median(&mut found).context("no distance was found")?,
        q90: robust::quantile(&mut found, 0.9).context("no distance was found")?,
        share_5mm: close_count as f64 / count as f64,
        count,
    })
}

/// Angle of the normals, signed, and distance, point by point.
struct NormalErrors(Vec<(f64, f64)>);

impl NormalErrors {
    fn of(
        moved: &[Vec3],
        estimate: &SurfaceMesh,
        reference: &SurfaceMesh,
        points: &[SurfacePoint],
        nearest: &[Option<Nearest>],
    ) -> Self {
        let normal = |positions: &[Vec3], triangle: [u32; 3]| -> DVec3 {
            area_vector(corners(positions, triangle))
        };
        let pairs = points.iter().zip(nearest);
        let errors = pairs.filter_map(|(sample, nearest)| {
            let nearest = nearest.as_ref()?;
            let own = normal(moved, estimate.triangles[sample.triangle as usize]);
            let other = reference.triangles[nearest.triangle as usize];
            let other = normal(&reference.positions, other);
            let angle = geometry::direction::angle_between(own, other).to_degrees();
            Some((angle, nearest.distance))
        });
        Self(errors.collect())
    }

    fn median_deg(&self, farthest: f64) -> f64 {
        let near = self.0.iter().filter(|(_, distance)| *distance <= farthest);
        let mut angles: Vec<f64> = near.map(|(angle, _)| angle.min(180.0 - angle)).collect();
        robust::median(&mut angles).unwrap_or(90.0)
    }

    fn opposed_fraction(&self) -> f64 {
        let opposed = self.0.iter().filter(|(angle, _)| *angle > 90.0).count();
        opposed as f64 / self.0.len().max(1) as f64
    }
}

/// Share of the area in connected parts that are below 1 % of all.
fn floating_fraction(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let mesh = fusion::Mesh {
        positions: positions.to_vec(),
        triangles: triangles.to_vec(),
        ..fusion::Mesh::default()
    };
    let labels = fusion::components(&mesh);
    let part_count = labels.iter().max().map_or(0, |&last| last as usize + 1);
    let mut areas = vec![0.0; part_count];
    for triangle in triangles {
        let area = area_vector(corners(positions, *triangle)).length();
        areas[labels[triangle[0] as usize] as usize] += area;
    }
    let total: f64 = areas.iter().sum();
    let small = areas.iter().filter(|area| **area < SMALL_PART * total);
    small.sum::<f64>() / total
}

/// The figures in words for a terminal.
pub fn text(metrics: &MeshMetrics) -> String {
    let line = |name: &str, d: &SurfaceDistances| {
        format!(
            "  {name}: mean {:.2} mm, median {:.2}, 90 % below {:.2}; {:.1} % below 5 mm",
            1e3 * d.mean,
            1e3 * d.median,
            1e3 * d.q90,
            100.0 * d.share_5mm
        )
    };
    format!(
        "mesh of {} triangles against one of {}, aligned by {}\n{}\n{}\n  ({}; {:.1} % of it)\n  F-score at 5 mm {:.3}; normals off by {:.2} degrees (median; {:.2} within 20 mm), {:.1} % look the other way; {:.2} % of the area floats",
        metrics.triangle_counts[0],
        metrics.triangle_counts[1],
        metrics.alignment,
        line("accuracy", &metrics.accuracy),
        line("completeness", &metrics.completeness),
        metrics.completeness_domain,
        100.0 * metrics.seen_fraction,
        metrics.fscore_5mm,
        metrics.normal_error_deg,
        metrics.normal_error_near_deg,
        100.0 * metrics.opposed_fraction,
        100.0 * metrics.floating_fraction,
    )
}

/// The keys of the summary event.
pub fn summary(metrics: &MeshMetrics) -> Map<String, Value> {
    let value = json!({
        "mesh_accuracy_m": metrics.accuracy.mean,
        "mesh_accuracy_median_m": metrics.accuracy.median,
        "mesh_accuracy_q90_m": metrics.accuracy.q90,
        "mesh_accuracy_5mm": metrics.accuracy.share_5mm,
        "mesh_completeness_m": metrics.completeness.mean,
        "mesh_completeness_median_m": metrics.completeness.median,
        "mesh_completeness_q90_m": metrics.completeness.q90,
        "mesh_completeness_5mm": metrics.completeness.share_5mm,
        "mesh_seen_fraction": metrics.seen_fraction,
        "fscore_5mm": metrics.fscore_5mm,
        "normal_error_deg": metrics.normal_error_deg,
        "mesh_floating_fraction": metrics.floating_fraction,
    });
    match value {
        Value::Object(keys) => keys,
        _ => Map::new(),
    }
}
