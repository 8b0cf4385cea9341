//! `glint train`: the stages one after the other, each with its outputs, cost and event.

use std::path::PathBuf;

use anyhow::Context as _;
use glam::DMat3;
use imaging::{ConfidenceMap, Image, PanoramaAttributes, write_confidence_exr, write_rgb_exr};
use raytrace::{MirrorQuery, Scene};
use sequence::Recording;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::clock::{Cost, Stopwatch};
use crate::ply::{self, PlyMesh};
use crate::progress::Progress;
use crate::run_folder::{Manifest, RunFolder};
use crate::stages::diffuse::{VertexColors, vertex_colors};
use crate::stages::geometry::{self, Geometry};
use crate::stages::linear::{self, DiffuseOrder, GAIN, Linear, SRM_HEIGHT};
use crate::stages::object::{DominantPlane, ObjectParts, Segment, WorldBox, find_object};
use crate::stages::observe::{ColorView, Observations, PixelRules, Surface, observe};
use crate::stages::poses;
use crate::tradeoff::machine::rss_peak_mb;

/// Every key of a training run, `config.toml`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// The recording.
    pub recording: PathBuf,
    /// Profile.
    pub profile: String,
    /// Pose set.
    pub poses: String,
    /// Voxel edge of the mesh, millimetres.
    pub voxel_mm: f64,
    /// Every how many pixels in x and y give a row.
    pub pixel_stride: u32,
    /// Rows of the specular map, which is twice as wide.
    #[serde(default = "usual_map_height")]
    pub map_height: u32,
    /// Every how many training frames one is used.
    #[serde(default = "every_frame")]
    pub frame_stride: u32,
    /// Treatment of D.
    pub diffuse: DiffuseOrder,
    /// Box that holds the object, world metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_box: Option<WorldBox>,
    /// Seed of the random plane search.
    pub seed: u64,
    /// Worker threads.
    pub threads: usize,
}

fn usual_map_height() -> u32 {
    SRM_HEIGHT
}

fn every_frame() -> u32 {
    1
}

/// What was left out and what remained, `geometry/object.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ObjectSummary {
    /// Planes that were left out.
    pub planes: Vec<DominantPlane>,
    /// Segments of the object.
    pub segments: Vec<Segment>,
}

/// The end of a training run.
#[derive(Clone, Debug, Serialize)]
pub struct TrainSummary {
    /// Sentence about what was found.
    pub sentence: String,
    /// Whether anything shiny was found.
    pub found_specular: bool,
    /// Training frames used.
    pub frames: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Rows of the linear stage.
    pub rows: usize,
    /// Share of texels claimed.
    pub claimed_fraction: f64,
    /// Cost of the whole run.
    pub cost: Cost,
    /// Largest resident memory, mebibytes.
    pub rss_peak_mb: f64,
}

/// Name of the mesh inside a run folder: world positions, smoothed normals, segments.
pub const MESH_FILE: &str = "geometry/mesh.ply";
/// Name of D's mesh of the linear stage.
pub const LINEAR_DIFFUSE_FILE: &str = "linear/diffuse.ply";
/// Name of the median colours: what diffuse alone says, and the radiance of a first bounce.
pub const MEDIAN_FILE: &str = "diffuse/median.ply";
/// Name of the specular map.
pub const SRM_FILE: &str = "linear/srm0.exr";
/// Name of its confidence.
pub const CONFIDENCE_FILE: &str = "linear/confidence.exr";

struct Stages<'a> {
    folder: &'a RunFolder,
    progress: &'a Progress,
    costs: std::collections::BTreeMap<String, Cost>,
}

impl Stages<'_> {
    fn run<T>(
        &mut self,
        name: &str,
        work: impl FnOnce(&Progress) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        crate::interrupt::check()?;
        let watch = Stopwatch::start();
        self.progress.stage(name);
        let result = work(self.progress).with_context(|| format!("stage {name}"))?;
        let cost = watch.cost();
        self.folder
            .log(&json!({"event": "stage", "stage": name, "cost": cost}))?;
        tracing::info!(
            "{name}: {:.1} s wall, {:.1} core-seconds",
            cost.wall_s,
            cost.core_s
        );
        self.costs.insert(name.to_owned(), cost);
        Ok(result)
    }
}

/// Trains in profile `draft` into `folder`. Reads training frames only.
pub fn train(
    config: &TrainConfig,
    folder: &RunFolder,
    progress: &Progress,
) -> anyhow::Result<TrainSummary> {
    let whole = Stopwatch::start();
    let recording = Recording::open(&config.recording)?;
    folder.write("config.toml", toml::to_string(config)?.as_bytes())?;
    let mut stages = Stages {
        folder,
        progress,
        costs: std::collections::BTreeMap::new(),
    };

    let frames = stages.run("poses", |progress| {
        poses::run(&recording, &config.poses, folder, progress)
    })?;
    let frames = poses::every_nth(frames, config.frame_stride)?;

    let (geometry, parts) = stages.run("geometry", |progress| {
        let voxel_size = (config.voxel_mm * 1e-3) as f32;
        let geometry = geometry::build(&recording, &frames, voxel_size, &mut |done, of| {
            progress.step(done, of);
        })?;
        let parts = find_object(&geometry.mesh, config.object_box.as_ref(), config.seed);
        write_geometry(folder, &geometry, &parts)?;
        note_repeats("depth", geometry.summary.repeated_frame_count);
        Ok((geometry, parts))
    })?;
    let Geometry {
        mesh,
        normal_sigma,
        summary: geometry_summary,
    } = geometry;

    let voxel_size = (config.voxel_mm * 1e-3) as f32;
    let (surface, observations, colors) = stages.run("diffuse", |progress| {
        let surface = Surface {
            scene: Scene::new(&mesh.positions, &mesh.triangles)?,
            mirror: MirrorQuery::for_fused(voxel_size),
            positions: mesh.positions,
            normals: mesh.normals,
            triangles: mesh.triangles,
            vertex_segment: parts.vertex_segment,
            origin: mesh.origin,
        };
        let view = ColorView::new(&recording);
        let rules = PixelRules {
            stride: config.pixel_stride,
            ..PixelRules::default()
        };
        let Observations {
            frames: observations,
            repeated_frame_count,
        } = observe(
            &recording,
            &view,
            &surface,
            &normal_sigma,
            &frames,
            &rules,
            &|done, of| progress.step(done, of),
        )?;
        let colors = vertex_colors(&surface, &observations);
        write_colors(folder, &surface, &colors)?;
        note_repeats("colour", repeated_frame_count);
        folder.write_json(
            "diffuse/summary.json",
            &json!({
                "frame_count": observations.len(),
                "repeated_frame_count": repeated_frame_count,
            }),
        )?;
        Ok((surface, observations, colors))
    })?;

    let linear = stages.run("linear", |_| {
        let linear = linear::solve(
            &surface,
            &observations,
            &colors,
            config.diffuse,
            config.map_height,
        )?;
        write_linear(folder, &surface, &linear)?;
        Ok(linear)
    })?;

    let cost = whole.cost();
    folder.write_json(
        "manifest.json",
        &Manifest {
            glint_version: env!("CARGO_PKG_VERSION").to_owned(),
            recording: config.recording.clone(),
            recording_hash: recording.content_hash().to_string(),
            profile: config.profile.clone(),
            newest_stage: "linear".to_owned(),
            stages: stages.costs,
            threads: config.threads,
        },
    )?;
    Ok(TrainSummary {
        sentence: linear.summary.sentence.clone(),
        found_specular: linear.summary.found_specular,
        frames: frames.len(),
        triangles: geometry_summary.triangle_count,
        rows: linear.summary.row_count,
        claimed_fraction: linear.summary.claimed_fraction,
        cost,
        rss_peak_mb: rss_peak_mb(),
    })
}

/// Says how many frames were left out as repeats.
fn note_repeats(stream: &str, count: usize) {
    if count > 0 {
        tracing::info!("{count} frames left out: their {stream} repeats the frame before");
    }
}

fn write_geometry(
    folder: &RunFolder,
    geometry: &Geometry,
    parts: &ObjectParts,
) -> anyhow::Result<()> {
    let mesh = PlyMesh {
        positions: geometry.mesh.positions.clone(),
        normals: geometry.mesh.normals.clone(),
        linear: Vec::new(),
        segments: parts.vertex_segment.clone(),
        triangles: geometry.mesh.triangles.clone(),
        origin: geometry.mesh.origin,
    };
    folder.write(MESH_FILE, &ply::to_bytes(&mesh))?;
    folder.write_json("geometry/summary.json", &geometry.summary)?;
    folder.write_json(
        "geometry/object.json",
        &ObjectSummary {
            planes: parts.planes.clone(),
            segments: parts.segments.clone(),
        },
    )
}

fn colored(surface: &Surface, linear: Vec<[f32; 3]>) -> PlyMesh {
    PlyMesh {
        positions: surface.positions.clone(),
        normals: surface.normals.clone(),
        linear,
        segments: surface.vertex_segment.clone(),
        triangles: surface.triangles.clone(),
        origin: surface.origin,
    }
}

fn write_colors(
    folder: &RunFolder,
    surface: &Surface,
    colors: &VertexColors,
) -> anyhow::Result<()> {
    folder.write(
        "diffuse/robust-minimum.ply",
        &ply::to_bytes(&colored(surface, colors.robust_minimum.clone())),
    )?;
    folder.write(
        MEDIAN_FILE,
        &ply::to_bytes(&colored(surface, colors.median.clone())),
    )
}

fn write_linear(folder: &RunFolder, surface: &Surface, linear: &Linear) -> anyhow::Result<()> {
    let (width, height) = (linear.panorama.width(), linear.panorama.height());
    std::fs::create_dir_all(folder.path("linear"))?;
    let attributes = PanoramaAttributes {
        world_from_panorama: DMat3::IDENTITY,
        origin: surface.origin,
        radius: f64::INFINITY,
        gain: f64::from(GAIN),
    };
    let map = Image::from_vec(width, height, linear.specular_map.clone())?;
    write_rgb_exr(&folder.path(SRM_FILE), &map, &attributes)?;
    let confidence = &linear.confidence;
    let map = ConfidenceMap {
        confidence: Image::from_vec(width, height, confidence.confidence.clone())?,
        sigma: Image::from_vec(width, height, confidence.sigma.clone())?,
        sample_count: Image::from_vec(width, height, confidence.sample_count.clone())?,
        flags: Image::from_vec(
            width,
            height,
            confidence.flags.iter().map(|f| f.0).collect(),
        )?,
    };
    write_confidence_exr(&folder.path(CONFIDENCE_FILE), &map)?;
    folder.write(
        LINEAR_DIFFUSE_FILE,
        &ply::to_bytes(&colored(surface, linear.diffuse.clone())),
    )?;
    folder.write_json("linear/summary.json", &linear.summary)
}
