//! What the stages leave in the run folder.

use glam::DMat3;
use imaging::{ConfidenceMap, Image, PanoramaAttributes, write_confidence_exr, write_rgb_exr};

use super::{
    CONFIDENCE_FILE, LINEAR_DIFFUSE_FILE, MEDIAN_FILE, MESH_FILE, ObjectSummary, SRM_FILE,
};
use crate::ply::{self, PlyMesh};
use crate::run_folder::RunFolder;
use crate::stages::diffuse::VertexColors;
use crate::stages::geometry::Geometry;
use crate::stages::linear::{GAIN, Linear};
use crate::stages::object::ObjectParts;
use crate::stages::observe::Surface;

pub(super) fn write_geometry(
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

pub(super) fn write_colors(
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

pub(super) fn write_linear(
    folder: &RunFolder,
    surface: &Surface,
    linear: &Linear,
) -> anyhow::Result<()> {
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
