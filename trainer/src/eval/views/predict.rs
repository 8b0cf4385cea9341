//! The three predictions of a held-out photograph, as 8-bit pictures like itself.

use geometry::Pose;
use imaging::{Image, LinearImage, Mask, Radiance, Rgb8Image};
use raytrace::{Hit, VisibilityBuffer, visibility_buffer};
use sequence::Recording;

use crate::eval::model::Model;
use crate::stages::geometry::depth_tolerance;
use crate::stages::observe::{ColorView, Surface};
use crate::stages::poses::PosedFrame;

/// Predictions of one held-out frame. What sees no surface is black and predicted by none.
pub(super) struct Predictions {
    pub(super) composition: Rgb8Image,
    pub(super) diffuse_only: Rgb8Image,
    pub(super) nearest_view: Rgb8Image,
    pub(super) has_surface: Mask,
    pub(super) is_shiny: Mask,
    /// Where the nearest photograph saw nothing and diffuse stands in.
    pub(super) is_hole: Mask,
}

impl Predictions {
    /// Composition, diffuse alone, nearest view.
    pub(super) fn pictures(&self) -> [&Rgb8Image; 3] {
        [&self.composition, &self.diffuse_only, &self.nearest_view]
    }
}

/// A training photograph with what it sees.
pub(super) struct Photograph {
    index: usize,
    surface_from_color: Pose,
    radiance: Radiance,
    buffer: VisibilityBuffer,
}

/// Reads a training photograph and finds what it sees.
pub(super) fn photograph(
    recording: &Recording,
    view: &ColorView,
    model: &Model,
    frame: PosedFrame,
) -> anyhow::Result<Photograph> {
    let surface_from_color = view.surface_from_color(&model.surface, &frame.world_from_camera);
    let surface = &model.surface;
    Ok(Photograph {
        index: frame.index,
        radiance: view.radiance(recording, frame.index)?,
        buffer: visibility_buffer(
            &surface.scene,
            &surface.positions,
            &surface.triangles,
            &view.camera,
            &surface_from_color,
        ),
        surface_from_color,
    })
}

/// Draws the view at `pose` (surface from colour camera) and reprojects `photograph` into it.
pub(super) fn predict(
    view: &ColorView,
    model: &Model,
    pose: &Pose,
    photograph: &Photograph,
) -> Predictions {
    debug_assert!(
        photograph.radiance.linear.width() == view.camera.width(),
        "frame {}",
        photograph.index
    );
    let drawn = model.draw(&view.camera, pose);
    let (width, height) = (view.camera.width(), view.camera.height());
    let mut predictions = Predictions {
        composition: Image::new(width, height, [0; 3]),
        diffuse_only: Image::new(width, height, [0; 3]),
        nearest_view: Image::new(width, height, [0; 3]),
        has_surface: Image::new(width, height, false),
        is_shiny: Image::new(width, height, false),
        is_hole: Image::new(width, height, false),
    };
    for y in 0..height {
        for x in 0..width {
            let index = (y * width + x) as usize;
            let Some(hit) = &drawn.hits[index] else {
                continue;
            };
            let diffuse = drawn.diffuse_only.at(x, y);
            let seen = reprojected(view, &model.surface, photograph, hit);
            // The photograph is 8 bit: so is the prediction.
            let encode = |linear: [f32; 3]| rounded(view.corrector.encode(x, y, linear));
            *predictions.composition.at_mut(x, y) = encode(drawn.composition.at(x, y));
            *predictions.diffuse_only.at_mut(x, y) = encode(diffuse);
            *predictions.nearest_view.at_mut(x, y) = encode(seen.unwrap_or(diffuse));
            *predictions.has_surface.at_mut(x, y) = true;
            *predictions.is_shiny.at_mut(x, y) = drawn.is_specular[index];
            *predictions.is_hole.at_mut(x, y) = seen.is_none();
        }
    }
    predictions
}

fn rounded(code: [f32; 3]) -> [u8; 3] {
    code.map(|value| value.round().clamp(0.0, 255.0) as u8)
}

/// What the photograph shows of the surface point at `hit`, bilinear, or `None` where it is hidden there.
fn reprojected(
    view: &ColorView,
    surface: &Surface,
    photograph: &Photograph,
    hit: &Hit,
) -> Option<[f32; 3]> {
    let point = surface.interpolate(&surface.positions, hit).as_dvec3();
    let in_camera = photograph
        .surface_from_color
        .inverse()
        .transform_point(point);
    let pixel = view.camera.pixel_from_camera(in_camera)?;
    let (x, y) = view.camera.contains(pixel)?;
    let index = (y * view.camera.width() + x) as usize;
    let depth = photograph.buffer.depth[index];
    if !(depth > 0.0) || (depth - in_camera.z as f32).abs() > 2.0 * depth_tolerance(depth) {
        return None;
    }
    bilinear(&photograph.radiance.linear, pixel.x, pixel.y)
}

fn bilinear(image: &LinearImage, x: f64, y: f64) -> Option<[f32; 3]> {
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
    let (x0, y0) = (x0 as i64, y0 as i64);
    let mut value = [0.0; 3];
    for (dx, dy, weight) in [
        (0, 0, (1.0 - fx) * (1.0 - fy)),
        (1, 0, fx * (1.0 - fy)),
        (0, 1, (1.0 - fx) * fy),
        (1, 1, fx * fy),
    ] {
        if weight > 0.0 {
            let color = image.get(x0 + dx, y0 + dy)?;
            for c in 0..3 {
                value[c] += weight * color[c];
            }
        }
    }
    Some(value)
}
