//! Stage `geometry`: the training depth fused at fine voxels, meshed, with normals fit to aim reflections.

use anyhow::Context as _;
use fusion::{Mesh, MeshConfig, Volume, VolumeConfig};
use geometry::{DVec3, robust};
use imaging::{DepthImage, metres_from_raw};
use raytrace::{NO_TRIANGLE, VisibilityBuffer, rasterise};
use sequence::Recording;
use serde::{Deserialize, Serialize};

use super::Refusal;
use super::poses::{PosedFrame, without_repeats};

/// What the stage found out, `geometry/summary.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GeometrySummary {
    /// Voxel edge, millimetres.
    pub voxel_mm: f64,
    /// Frames fused.
    pub frame_count: usize,
    /// Frames left out because their depth repeats the frame before.
    #[serde(default)]
    pub repeated_frame_count: usize,
    /// Vertices of the mesh.
    pub vertex_count: usize,
    /// Triangles of the mesh.
    pub triangle_count: usize,
    /// Blocks of 8x8x8 voxels in the volume.
    pub block_count: usize,
    /// Blocks refused because the limit was reached.
    pub refused_block_count: usize,
    /// Share of measured depth pixels that lie on the fused surface.
    pub depth_fit_fraction: f64,
    /// Median distance of measured depth from the fused surface, millimetres.
    pub depth_residual_mm: f64,
    /// Median standard deviation of the normals, degrees.
    pub normal_noise_deg: f64,
    /// Rounds of normal smoothing.
    pub normal_rounds: usize,
    /// Blur of a reflection that the normals imply: twice their noise, degrees.
    pub reflection_blur_deg: f64,
}

/// Geometry in memory.
pub struct Geometry {
    /// The mesh.
    pub mesh: Mesh,
    /// Standard deviation of the normal at every vertex, radians.
    pub normal_sigma: Vec<f32>,
    /// Figures.
    pub summary: GeometrySummary,
}

/// Bytes that a volume may hold: about 1.4 million blocks of 8³ voxels.
const MEMORY_LIMIT_BYTES: usize = 6 << 30;
/// Least share of measured depth that must lie on the fused surface.
const LEAST_FIT: f64 = 0.6;
/// Frames that judge the fit.
const JUDGE_COUNT: usize = 24;

/// Depth of one frame in metres.
pub fn depth_of(recording: &Recording, index: usize) -> anyhow::Result<DepthImage> {
    let raw = recording.depth_raw(index)?;
    let camera = recording.depth_camera();
    let range = camera.depth_range.clone();
    Ok(match camera.shift_table_mm()? {
        None => metres_from_raw(&raw, camera.depth_scale, range).0,
        Some(table) => {
            let millimetres = raw.map(|shift| table.get(usize::from(shift)).copied().unwrap_or(0));
            metres_from_raw(&millimetres, 1e-3, range).0
        }
    })
}

/// How far apart two depths of one surface may be at `depth` metres: four steps of an 1/8 pixel disparity
/// sensor (2.9e-3 z² a step, hard-cases B02), at least 6 mm.
pub fn depth_tolerance(depth: f32) -> f32 {
    (4.0 * 2.9e-3 * depth * depth).max(0.006)
}

/// Fuses, meshes and judges; depth that repeats the frame before is left out. `progress(done, of)` is called
/// after every frame.
pub fn build(
    recording: &Recording,
    frames: &[PosedFrame],
    voxel_size: f32,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<Geometry> {
    let (frames, repeated_frame_count) =
        without_repeats(frames, |index| recording.depth_is_repeat(index));
    if frames.is_empty() {
        return Err(Refusal::NoSurface(0).into());
    }
    let camera = &recording.depth_camera().intrinsics;
    let range = recording.depth_camera().depth_range.clone();
    let origin = frames
        .iter()
        .map(|f| f.world_from_camera.translation())
        .sum::<DVec3>()
        / frames.len() as f64;
    let config = VolumeConfig {
        voxel_size,
        min_depth: *range.start(),
        max_depth: *range.end(),
        memory_limit_bytes: MEMORY_LIMIT_BYTES,
        origin,
        ..VolumeConfig::default()
    };
    let mut volume = Volume::new(config).context("the volume cannot be made")?;
    let mut refused_block_count = 0;
    for (done, frame) in frames.iter().enumerate() {
        let depth = depth_of(recording, frame.index)?;
        let stats = volume.integrate(depth.pixels(), camera, &frame.world_from_camera)?;
        refused_block_count += stats.blocks_refused;
        progress(done + 1, frames.len());
    }
    let block_count = volume.block_count();
    let mut mesh = fusion::extract_mesh(&volume, &MeshConfig::default());
    drop(volume);
    fusion::remove_small_components(&mut mesh, 60);
    if mesh.triangles.is_empty() {
        return Err(Refusal::NoSurface(frames.len()).into());
    }
    let raw_normals = mesh.normals.clone();
    let normal_rounds = fusion::rounds_for_voxel(voxel_size);
    fusion::smooth_normals(&mut mesh, normal_rounds);
    let noise = fusion::normal_noise(&mesh, &raw_normals);
    let fit = judge_fit(recording, &frames, &mesh)?;
    if fit.fraction < LEAST_FIT {
        return Err(Refusal::PosesDoNotFit {
            percent: 100.0 * fit.fraction,
            least: 100.0 * LEAST_FIT,
        }
        .into());
    }
    let normal_noise_deg = f64::from(noise.median).to_degrees();
    let summary = GeometrySummary {
        voxel_mm: f64::from(voxel_size) * 1e3,
        frame_count: frames.len(),
        repeated_frame_count,
        vertex_count: mesh.positions.len(),
        triangle_count: mesh.triangles.len(),
        block_count,
        refused_block_count,
        depth_fit_fraction: fit.fraction,
        depth_residual_mm: fit.residual * 1e3,
        normal_noise_deg,
        normal_rounds,
        reflection_blur_deg: 2.0 * normal_noise_deg,
    };
    Ok(Geometry {
        normal_sigma: noise.sigma,
        mesh,
        summary,
    })
}

struct Fit {
    fraction: f64,
    residual: f64,
}

/// Share of measured depth near the mesh as each judged frame sees it, median over frames.
fn judge_fit(recording: &Recording, frames: &[PosedFrame], mesh: &Mesh) -> anyhow::Result<Fit> {
    let step = frames.len().div_ceil(JUDGE_COUNT).max(1);
    let mut fractions = Vec::new();
    let mut residuals = Vec::new();
    for frame in frames.iter().step_by(step) {
        let depth = depth_of(recording, frame.index)?;
        let seen = depth_view(recording, mesh, frame);
        let (mut near, mut measured) = (0.0, 0.0);
        for (index, &z) in depth.pixels().iter().enumerate() {
            if !imaging::is_measured(z) {
                continue;
            }
            measured += 1.0;
            if seen.triangle[index] != NO_TRIANGLE {
                let difference = (seen.depth[index] - z).abs();
                if difference <= depth_tolerance(z) {
                    near += 1.0;
                }
                if index % 97 == 0 {
                    residuals.push(f64::from(difference));
                }
            }
        }
        if measured > 0.0 {
            fractions.push(near / measured);
        }
    }
    Ok(Fit {
        fraction: robust::median(&mut fractions).unwrap_or(0.0),
        residual: robust::median(&mut residuals).unwrap_or(f64::INFINITY),
    })
}

fn depth_view(recording: &Recording, mesh: &Mesh, frame: &PosedFrame) -> VisibilityBuffer {
    let mut pose = frame.world_from_camera;
    pose = geometry::Pose::from_translation(-mesh.origin) * pose;
    rasterise(
        &mesh.positions,
        &mesh.triangles,
        &recording.depth_camera().intrinsics,
        &pose,
    )
}
