//! The folder beside a simulated recording: everything that is true of it.

use std::path::Path;

use effects::Effect;
use geometry::Pose;
use imaging::{
    Image, Layer, Mask, PanoramaAttributes, encode_png_gray16, encode_png_mask, write_layers_exr,
    write_rgb_exr,
};
use scene::material::Finish;
use scene::{Film, FrameTruth};
use sequence::Split;
use serde_json::json;

use super::SimulateOptions;
use super::reach::reach;
use crate::export::poses::tum_line;
use crate::export::target_folder::TargetFolder;
use crate::ply::{self, PlyMesh};

/// Rows of the stored environment.
const ENVIRONMENT_ROWS: u32 = 256;
/// Paths of a pixel of stored mirrored light.
const TRUTH_PATHS: u32 = 16;

/// Begins the folder; one that is there goes first where it may.
pub(super) fn begin(options: &SimulateOptions, folder: &Path) -> anyhow::Result<TargetFolder> {
    if options.may_replace && folder.exists() {
        anyhow::ensure!(
            folder.join("manifest.json").exists(),
            "{} is no truth of a simulation: it is not replaced",
            folder.display()
        );
        std::fs::remove_dir_all(folder)?;
    }
    TargetFolder::begin(folder)
}

/// Writes all and gives the folder its name.
pub(super) fn write(
    film: &Film,
    options: &SimulateOptions,
    split: &Split,
    folder: TargetFolder,
) -> anyhow::Result<()> {
    let environment = &film.world().environment;
    let attributes = PanoramaAttributes {
        world_from_panorama: glam::DMat3::IDENTITY,
        origin: environment
            .enclosure()
            .map_or(glam::DVec3::ZERO, |walls| walls.center.as_dvec3()),
        radius: environment
            .enclosure()
            .map_or(f64::INFINITY, |walls| f64::from(walls.half.min_element())),
        gain: 1.0,
    };
    let map = environment.averaged(ENVIRONMENT_ROWS);
    write_rgb_exr(&folder.path("environment.exr"), &map, &attributes)?;
    let known = reach(film, &split.train);
    write_layers_exr(&folder.path("reach.exr"), &[Layer::Scalar("Y", &known)])?;
    if let Some(bars) = film.bars() {
        folder.write("bars.json", &serde_json::to_vec_pretty(bars)?)?;
    }
    folder.write("mesh.ply", &ply::to_bytes(&mesh(film)))?;
    folder.write("poses.txt", poses(film, Film::pose).as_bytes())?;
    folder.write("split.json", &serde_json::to_vec(split)?)?;
    for name in ["masks", "objects", "materials", "depth", "components"] {
        folder.make(name)?;
    }
    for number in 0..film.frame_count() {
        crate::interrupt::check()?;
        let is_shown = number % options.truth_every == 0;
        let is_masked = split.test.binary_search(&number).is_ok();
        if is_shown || is_masked {
            let paths = if is_shown { TRUTH_PATHS } else { 0 };
            write_frame(&folder, number, &film.truth(number, paths), is_shown)?;
        }
    }
    folder.write(
        "manifest.json",
        &serde_json::to_vec_pretty(&manifest(film, options, split))?,
    )?;
    folder.finish()
}

/// The mask of a frame and, where it is shown, everything else.
fn write_frame(
    folder: &TargetFolder,
    number: u32,
    truth: &FrameTruth,
    is_shown: bool,
) -> anyhow::Result<()> {
    let mask: &Mask = &truth.mask;
    folder.write(&format!("masks/{number:06}.png"), &encode_png_mask(mask)?)?;
    if !is_shown {
        return Ok(());
    }
    let wide = |image: &Image<u8>| image.map(u16::from);
    for (name, image) in [
        ("objects", wide(&truth.object)),
        ("materials", wide(&truth.material)),
        // Tenths of a millimetre.
        ("depth", truth.depth.map(|z| (z * 10_000.0).round() as u16)),
    ] {
        folder.write(
            &format!("{name}/{number:06}.png"),
            &encode_png_gray16(&image)?,
        )?;
    }
    let visible = truth.visible.map(|v| f32::from(u8::from(v)));
    write_layers_exr(
        &folder.path(&format!("components/{number:06}.exr")),
        &[
            Layer::Rgb("D", &truth.diffuse),
            Layer::Rgb("S", &truth.specular),
            Layer::Rgb("FBI", &truth.first_bounce),
            Layer::Rgb("N", &truth.normal),
            Layer::Rgb("R", &truth.mirrored),
            Layer::Scalar("V", &visible),
        ],
    )?;
    Ok(())
}

fn mesh(film: &Film) -> PlyMesh {
    let world = film.world();
    let mesh = world.mesh();
    // Vertices belong to one object each: shapes share none.
    let mut segments = vec![0_u16; mesh.positions.len()];
    for (triangle, object) in mesh.triangles.iter().zip(world.object_of_triangle()) {
        for &vertex in triangle {
            segments[vertex as usize] = object + 1;
        }
    }
    let mut linear = vec![[0.0; 3]; mesh.positions.len()];
    for (vertex, color) in linear.iter_mut().enumerate() {
        let Some(object) = segments[vertex].checked_sub(1) else {
            continue;
        };
        let object = &world.objects[usize::from(object)];
        let albedo = object
            .material
            .texture
            .at(mesh.positions[vertex] - object.anchor);
        let light = world.vertex_light()[vertex];
        *color = std::array::from_fn(|c| albedo[c] * light[c]);
    }
    PlyMesh {
        positions: mesh.positions.clone(),
        normals: mesh.normals.clone(),
        linear,
        segments,
        triangles: mesh.triangles.clone(),
        origin: glam::DVec3::ZERO,
    }
}

/// World from depth camera of all frames, TUM.
fn poses(film: &Film, of: impl Fn(&Film, u32) -> Pose) -> String {
    (0..film.frame_count())
        .map(|number| tum_line(i64::from(number) * 100_000_000, Some(of(film, number))))
        .collect()
}

fn manifest(film: &Film, options: &SimulateOptions, split: &Split) -> serde_json::Value {
    let design = film.design();
    let objects: Vec<serde_json::Value> = film
        .world()
        .objects
        .iter()
        .enumerate()
        .map(|(index, object)| {
            let gloss = |gloss: &scene::material::Gloss| {
                json!({"alpha": gloss.alpha, "r0": gloss.r0, "fresnel": gloss.has_fresnel})
            };
            let finish = match &object.material.finish {
                Finish::Matte => json!([]),
                Finish::Even(even) => json!([gloss(even)]),
                Finish::Patches(a, b, _) => json!([gloss(a), gloss(b)]),
            };
            json!({"id": index + 1, "name": object.name, "target": object.is_target, "gloss": finish})
        })
        .collect();
    let effects: Vec<&str> = film.effects().iter().map(Effect::id).collect();
    json!({
        "version": 1,
        "glint_version": env!("CARGO_PKG_VERSION"),
        "scene": design.name,
        "about": design.about,
        "seed": options.seed,
        "width": options.width,
        "frames": film.frame_count(),
        "train": split.train.len(),
        "unused": split.unused.len(),
        "test": split.test.len(),
        "effects": effects,
        "objects": objects,
        "operator": design.has_operator,
        "readout_s": design.shutter.readout,
        "exposure_s": design.shutter.exposure,
        "pose_noise_m": design.errors.pose_translation,
        "pose_noise_rad": design.errors.pose_rotation,
        "mesh_noise_m": design.errors.mesh_noise,
        "mesh_scale": design.errors.mesh_scale,
        "walls_m": design.enclosure.map(|walls| walls.half.to_array()),
    })
}
