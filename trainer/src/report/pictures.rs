//! Pictures for the page: panoramas, shaded meshes and rows of pictures.

use geometry::{DVec3, Intrinsics, Pose, direction};
use glam::Vec3;
use imaging::{Image, LinearImage, Rgb8Image};

use crate::color::srgb8_from_linear;
use crate::eval::model::Model;

/// Grey of what is not known.
const UNKNOWN: [f32; 3] = [0.5; 3];
/// Colour behind a mesh.
const BACKGROUND: [u8; 3] = [244, 244, 242];

/// A panorama as a screen shows it, sRGB.
fn panorama(map: &LinearImage) -> Rgb8Image {
    map.map(|linear| linear.map(srgb8_from_linear))
}

/// A panorama faded to grey where its confidence is below `full`.
pub(super) fn claimed_panorama(map: &LinearImage, confidence: &Image<f32>, full: f32) -> Rgb8Image {
    let mut picture = panorama(map);
    for (pixel, &c) in picture.pixels_mut().iter_mut().zip(confidence.pixels()) {
        let keep = (c / full).clamp(0.0, 1.0);
        for (code, grey) in pixel.iter_mut().zip(UNKNOWN) {
            let faded = f32::from(*code) * keep + 255.0 * grey * (1.0 - keep);
            *code = faded.round().clamp(0.0, 255.0) as u8;
        }
    }
    picture
}

/// A confidence as grey values.
pub(super) fn confidence(confidence: &Image<f32>) -> Rgb8Image {
    confidence.map(|c| [(c.clamp(0.0, 1.0) * 255.0).round() as u8; 3])
}

/// What a mesh picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MeshPaint {
    /// Grey with a light at the camera: the shape.
    Shape,
    /// The solved diffuse colour.
    Diffuse,
    /// Segments in colours, shiny ones bright.
    Segments,
}

/// A camera that sees the object as the recording did, but sharper framed: it looks from the mean training
/// direction at the centre of the object.
pub(super) fn object_camera(model: &Model, eye: DVec3) -> Option<(Intrinsics, Pose)> {
    let surface = &model.surface;
    let chosen: Vec<DVec3> = surface
        .positions
        .iter()
        .zip(&surface.vertex_segment)
        .filter(|(_, segment)| **segment != 0)
        .map(|(position, _)| position.as_dvec3())
        .collect();
    let chosen = if chosen.is_empty() {
        surface.positions.iter().map(|p| p.as_dvec3()).collect()
    } else {
        chosen
    };
    let center = chosen.iter().sum::<DVec3>() / chosen.len().max(1) as f64;
    let mut distances: Vec<f64> = chosen.iter().map(|p| (*p - center).length()).collect();
    let radius = geometry::robust::quantile(&mut distances, 0.98)?;
    let forward = (center - eye).try_normalize()?;
    let rotation = direction::look_along(forward, DVec3::Y)?;
    let camera = Intrinsics::pinhole(640, 480, 640.0, 640.0, 319.5, 239.5).ok()?;
    let back = 3.0 * radius.max(0.02);
    Some((
        camera,
        Pose::from_matrix(rotation, center - forward * back).ok()?,
    ))
}

/// The mesh seen from a pose in surface axes.
pub(super) fn mesh(model: &Model, camera: &Intrinsics, pose: &Pose, paint: MeshPaint) -> Rgb8Image {
    let drawn = model.draw(camera, pose);
    let surface = &model.surface;
    let mut picture = Image::new(camera.width(), camera.height(), BACKGROUND);
    let eye = pose.translation().as_vec3();
    for (pixel, hit) in picture.pixels_mut().iter_mut().zip(&drawn.hits) {
        let Some(hit) = hit else { continue };
        let position = surface.interpolate(&surface.positions, hit);
        let normal = surface
            .interpolate(&surface.normals, hit)
            .normalize_or_zero();
        let shade = normal.dot((eye - position).normalize_or(Vec3::Z)).max(0.0);
        *pixel = match paint {
            MeshPaint::Shape => [srgb8_from_linear(0.05 + 0.7 * shade * shade); 3],
            MeshPaint::Diffuse => model.color_at(&model.diffuse, hit).map(srgb8_from_linear),
            MeshPaint::Segments => segment_color(model, surface.segment(hit.triangle))
                .map(|value| srgb8_from_linear(value * (0.2 + 0.8 * shade))),
        };
    }
    picture
}

fn segment_color(model: &Model, segment: u16) -> [f32; 3] {
    const COLORS: [[f32; 3]; 6] = [
        [0.9, 0.25, 0.1],
        [0.1, 0.45, 0.9],
        [0.15, 0.7, 0.25],
        [0.85, 0.65, 0.05],
        [0.6, 0.2, 0.8],
        [0.05, 0.65, 0.7],
    ];
    if segment == 0 {
        return [0.35; 3];
    }
    let color = COLORS[(usize::from(segment) - 1) % COLORS.len()];
    if model.specular_segments.contains(&segment) {
        color
    } else {
        color.map(|v| 0.25 * v + 0.3)
    }
}

/// Pictures of one height beside each other with a white line between.
pub(super) fn side_by_side(parts: &[Rgb8Image]) -> Rgb8Image {
    const GAP: u32 = 6;
    let height = parts.iter().map(Image::height).max().unwrap_or(1);
    let width = parts
        .iter()
        .map(|part| part.width() + GAP)
        .sum::<u32>()
        .saturating_sub(GAP)
        .max(1);
    let mut row = Image::new(width, height, [255; 3]);
    let mut left = 0;
    for part in parts {
        for y in 0..part.height() {
            for x in 0..part.width() {
                *row.at_mut(left + x, y) = part.at(x, y);
            }
        }
        left += part.width() + GAP;
    }
    row
}
