//! A scene that other renderers can draw, with what this simulator makes of it, for tests/peers/radiance_mitsuba.py:
//! `cargo run --release -p scene --example common_scene -- FOLDER`.
//!
//! Writes `scene.json` (camera, objects, materials), a Wavefront OBJ an object, `environment.exr` and `radiance.exr`
//! (layers D: matte light alone, L: all light, O.Y: object, from 1).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use effects::{Effect, EffectSet};
use glam::Vec3;
use imaging::{Layer, PanoramaAttributes, write_layers_exr, write_rgb_exr};
use scene::design::{Design, ball, prop};
use scene::material::{Gloss, Material};
use scene::shape::Shape;
use scene::texture::Texture;
use scene::world::LightQuality;
use scene::{Film, FilmOptions};

fn film(color: [f32; 3], r0: f32, alpha: f32) -> Material {
    let gloss = Gloss {
        alpha,
        r0: [r0; 3],
        has_fresnel: false,
    };
    Material::glossy(Texture::Plain(color), gloss)
}

fn design() -> Design {
    let plate = Shape::rectangle(
        Vec3::new(-0.4, 0.0, -0.4),
        Vec3::X * 0.8,
        Vec3::Z * 0.8,
        0.01,
    );
    let mut box_of_card = Shape::cuboid(
        Vec3::new(0.0, -0.04, 0.14),
        Vec3::new(0.1, 0.04, 0.04),
        0.01,
    );
    box_of_card = box_of_card.moved(Vec3::X * 0.02);
    Design::new(
        "common",
        "balls and a box on a plate",
        vec![
            prop(
                "plate",
                Material::matte(Texture::Plain([0.22, 0.18, 0.14])),
                plate,
            ),
            prop(
                "box",
                Material::matte(Texture::Plain([0.1, 0.2, 0.25])),
                box_of_card,
            ),
            ball(
                "sharp",
                film([0.05, 0.05, 0.06], 0.45, 0.02),
                Vec3::new(-0.11, 0.0, 0.0),
                0.08,
            ),
            ball(
                "satin",
                film([0.2, 0.05, 0.05], 0.3, 0.15),
                Vec3::new(0.1, 0.0, -0.03),
                0.07,
            ),
            ball(
                "rough",
                film([0.05, 0.1, 0.05], 0.4, 0.5),
                Vec3::new(0.0, 0.0, -0.16),
                0.05,
            ),
        ],
    )
}

/// Positions, normals and triangles of one object, Wavefront OBJ.
fn obj(shape: &Shape) -> String {
    let mut text = String::new();
    for p in &shape.positions {
        let _ = writeln!(text, "v {} {} {}", p.x, p.y, p.z);
    }
    for n in &shape.normals {
        let _ = writeln!(text, "vn {} {} {}", n.x, n.y, n.z);
    }
    for t in &shape.triangles {
        let [a, b, c] = t.map(|v| v + 1);
        let _ = writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}");
    }
    text
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("give a folder to write")?);
    std::fs::create_dir_all(&folder)?;
    let design = design();
    let mut objects = Vec::new();
    for (index, (object, shape)) in design.things.iter().enumerate() {
        std::fs::write(folder.join(format!("{index}.obj")), obj(shape))?;
        let Texture::Plain(albedo) = object.material.texture else {
            continue;
        };
        let gloss = object.material.gloss(Vec3::ZERO).map(|(_, gloss)| gloss);
        objects.push(format!(
            r#"{{"obj":"{index}.obj","albedo":{albedo:?},"r0":{},"alpha":{}}}"#,
            gloss.map_or(0.0, |g| g.r0[0]),
            gloss.map_or(0.0, |g| g.alpha)
        ));
    }
    // Lamps of ordinary brightness: both renderers then need few samples.
    let effects = EffectSet::all()
        .without(Effect::PoseRefinement)
        .without(Effect::Saturation);
    let film = Film::of(
        design,
        FilmOptions {
            width: 320,
            frame_count: Some(12),
            effects: Some(effects),
            samples: 16,
            paths: 16,
            quality: LightQuality {
                light_count: 2048,
                bounce_count: 256,
            },
            ..FilmOptions::default()
        },
    )?;
    write_scene(&folder, &film, &objects)
}

fn write_scene(
    folder: &Path,
    film: &Film,
    objects: &[String],
) -> Result<(), Box<dyn std::error::Error>> {
    const FRAME: u32 = 6;
    let world_from_color = film.pose(FRAME) * film.color_from_depth().inverse();
    let (r, t) = (world_from_color.matrix(), world_from_color.translation());
    let camera = film.color().intrinsics;
    let text = format!(
        r#"{{"width":{},"height":{},"focal":{},"rotation":{:?},"translation":{:?},"objects":[{}]}}"#,
        camera.width(),
        camera.height(),
        camera.focal().x,
        r.transpose().to_cols_array_2d(),
        t.to_array(),
        objects.join(",")
    );
    std::fs::write(folder.join("scene.json"), text)?;
    let environment = film.world().environment.panorama();
    let attributes = PanoramaAttributes {
        world_from_panorama: glam::DMat3::IDENTITY,
        origin: glam::DVec3::ZERO,
        radius: f64::INFINITY,
        gain: 1.0,
    };
    write_rgb_exr(&folder.join("environment.exr"), &environment, &attributes)?;
    let (light, _) = film.light(FRAME);
    let truth = film.truth(FRAME, 0);
    let object = truth.object.map(f32::from);
    write_layers_exr(
        &folder.join("radiance.exr"),
        &[
            Layer::Rgb("L", &light),
            Layer::Rgb("D", &truth.diffuse),
            Layer::Scalar("O", &object),
        ],
    )?;
    Ok(())
}
