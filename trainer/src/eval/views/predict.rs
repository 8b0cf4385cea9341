//! The three predictions of a held-out photograph, as 8-bit pictures like itself.

use geometry::Pose;
use imaging::{Image, Mask, Rgb8Image};

use super::training::Photograph;
use crate::eval::model::{DrawnView, Model};
use crate::stages::observe::ColorView;

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

/// What is known of a view without a prediction of its light.
pub(super) struct Outline {
    pub(super) has_surface: Mask,
    pub(super) is_shiny: Mask,
    pub(super) diffuse_only: Rgb8Image,
}

/// The outline of the view at `pose` (surface from colour camera).
pub(super) fn outline(view: &ColorView, model: &Model, pose: &Pose) -> Outline {
    outline_of(view, &model.draw(&view.camera, pose))
}

fn outline_of(view: &ColorView, drawn: &DrawnView) -> Outline {
    let (width, height) = (view.camera.width(), view.camera.height());
    let index = |x: u32, y: u32| (y * width + x) as usize;
    let has_surface = Image::from_fn(width, height, |x, y| drawn.hits[index(x, y)].is_some());
    Outline {
        is_shiny: Image::from_fn(width, height, |x, y| drawn.is_specular[index(x, y)]),
        diffuse_only: Image::from_fn(width, height, |x, y| {
            if has_surface.at(x, y) {
                rounded(view.corrector.encode(x, y, drawn.diffuse_only.at(x, y)))
            } else {
                [0; 3]
            }
        }),
        has_surface,
    }
}

/// Draws the view at `pose` (surface from colour camera) and reprojects `photograph` into it.
pub(super) fn predict(
    view: &ColorView,
    model: &Model,
    pose: &Pose,
    photograph: &Photograph<'_>,
) -> Predictions {
    let drawn = model.draw(&view.camera, pose);
    let (width, height) = (view.camera.width(), view.camera.height());
    let Outline {
        has_surface,
        is_shiny,
        diffuse_only,
    } = outline_of(view, &drawn);
    let mut predictions = Predictions {
        composition: Image::new(width, height, [0; 3]),
        nearest_view: Image::new(width, height, [0; 3]),
        is_hole: Image::new(width, height, false),
        diffuse_only,
        has_surface,
        is_shiny,
    };
    for y in 0..height {
        for x in 0..width {
            let index = (y * width + x) as usize;
            let Some(hit) = &drawn.hits[index] else {
                continue;
            };
            let seen = photograph.seen(hit);
            // The photograph is 8 bit: so is the prediction.
            let encode = |linear: [f32; 3]| rounded(view.corrector.encode(x, y, linear));
            *predictions.composition.at_mut(x, y) = encode(drawn.composition.at(x, y));
            *predictions.nearest_view.at_mut(x, y) =
                encode(seen.unwrap_or_else(|| drawn.diffuse_only.at(x, y)));
            *predictions.is_hole.at_mut(x, y) = seen.is_none();
        }
    }
    predictions
}

fn rounded(code: [f32; 3]) -> [u8; 3] {
    code.map(|value| value.round().clamp(0.0, 255.0) as u8)
}
