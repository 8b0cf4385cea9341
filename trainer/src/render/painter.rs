//! One picture: a size, samples of a pixel, and what is drawn.

use anyhow::Context as _;
use clap::ValueEnum;
use geometry::{Intrinsics, Pose};
use imaging::{Image, LinearImage, Mask};
use rayon::prelude::*;
use raytrace::{Hit, visibility_buffer};
use sequence::Recording;

use super::RenderOptions;
use crate::eval::model::Model;
use crate::eval::views::{Photograph, TrainingViews};
use crate::stages::observe::{ColorView, hit_at};

/// What is drawn of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DrawnModel {
    /// D and what the surface mirrors.
    Composition,
    /// The median texture alone.
    Diffuse,
    /// The training photograph from the nearest direction, reprojected through the mesh; what it did not see is
    /// diffuse.
    Nearest,
}

/// Size of a picture over that of the photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Scale {
    /// As large.
    #[value(name = "1")]
    Whole,
    /// Half in width and height.
    #[value(name = "1/2")]
    Half,
    /// A quarter.
    #[value(name = "1/4")]
    Quarter,
}

impl Scale {
    /// Photograph's pixels along the edge of a picture's.
    pub fn divisor(self) -> u32 {
        match self {
            Self::Whole => 1,
            Self::Half => 2,
            Self::Quarter => 4,
        }
    }

    /// The pixel of a photograph of `size` pixels that holds the middle of pixel `x` of the picture, or the one
    /// behind it where that lies on an edge.
    pub(super) fn pixel_of_photograph(self, x: u32, size: u32) -> u32 {
        let divisor = self.divisor();
        (x * divisor + divisor / 2).min(size - 1)
    }
}

/// A drawn picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Linear radiance; black where there is no surface. Pixels at its edge are the mean of the samples that have one.
    pub linear: LinearImage,
    /// Whether any sample of a pixel has a surface.
    pub has_surface: Mask,
}

/// Draws pictures of one run.
pub struct Painter<'a> {
    model: &'a Model,
    drawn: DrawnModel,
    /// Camera of the samples.
    fine: Intrinsics,
    /// Samples along the edge of a pixel.
    side: u32,
    training: Option<TrainingViews<'a>>,
}

impl<'a> Painter<'a> {
    /// `poses` are those of the training: where photographs were taken from.
    ///
    /// # Errors
    /// When the photographs are too small for the scale, or samples are neither 1 nor 4.
    pub fn new(
        recording: &'a Recording,
        view: &'a ColorView,
        model: &'a Model,
        poses: &[Option<Pose>],
        options: &RenderOptions,
    ) -> anyhow::Result<Self> {
        let side = match options.samples {
            1 => 1,
            4 => 2,
            other => anyhow::bail!("{other} samples of a pixel: give 1 or 4"),
        };
        let divisor = options.scale.divisor();
        let fine = resized(&view.camera, divisor, side)
            .with_context(|| format!("the photographs cannot be drawn at 1/{divisor}"))?;
        let training = (options.model == DrawnModel::Nearest)
            .then(|| TrainingViews::new(recording, view, model, poses));
        Ok(Self {
            model,
            drawn: options.model,
            fine,
            side,
            training,
        })
    }

    /// The picture from `surface_from_color`.
    ///
    /// # Errors
    /// When a photograph that is to be reprojected cannot be read.
    pub fn draw(&self, surface_from_color: &Pose) -> anyhow::Result<Picture> {
        let surface = &self.model.surface;
        let photograph = match &self.training {
            Some(training) => Some(training.nearest(surface_from_color)?.photograph()?),
            None => None,
        };
        let buffer = visibility_buffer(
            &surface.scene,
            &surface.positions,
            &surface.triangles,
            &self.fine,
            surface_from_color,
        );
        let eye = surface_from_color.translation().as_vec3();
        let side = self.side;
        let (width, height) = (self.fine.width() / side, self.fine.height() / side);
        let pixels: Vec<Option<[f32; 3]>> = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| {
                let (mut sum, mut count) = ([0.0; 3], 0.0);
                for sample in 0..side * side {
                    let (fine_x, fine_y) = (x * side + sample % side, y * side + sample / side);
                    let index = (fine_y * self.fine.width() + fine_x) as usize;
                    if let Some(hit) = hit_at(&buffer, index) {
                        let color = self.color(&hit, eye, photograph.as_ref());
                        sum = [0, 1, 2].map(|c| sum[c] + color[c]);
                        count += 1.0;
                    }
                }
                (count > 0.0).then(|| sum.map(|value| value / count))
            })
            .collect();
        let mask = pixels.iter().map(Option::is_some).collect();
        let linear = pixels.iter().map(|pixel| pixel.unwrap_or_default());
        Ok(Picture {
            linear: Image::from_vec(width, height, linear.collect())?,
            has_surface: Image::from_vec(width, height, mask)?,
        })
    }

    fn color(&self, hit: &Hit, eye: glam::Vec3, photograph: Option<&Photograph<'_>>) -> [f32; 3] {
        let diffuse = || self.model.color_at(&self.model.median, hit);
        match self.drawn {
            DrawnModel::Composition => self.model.shade(hit, eye),
            DrawnModel::Diffuse => diffuse(),
            DrawnModel::Nearest => photograph
                .and_then(|photograph| photograph.seen(hit))
                .unwrap_or_else(diffuse),
        }
    }
}

/// The camera with `side / divisor` times as many pixels along each edge, seeing the same; what is left of an edge
/// that does not divide is cut off.
fn resized(camera: &Intrinsics, divisor: u32, side: u32) -> anyhow::Result<Intrinsics> {
    if divisor == side {
        return Ok(*camera);
    }
    let factor = f64::from(side) / f64::from(divisor);
    let (focal, center) = (factor * camera.focal(), camera.center());
    // The corner of the image, half a pixel before the centre of the first, stays where it is.
    let moved = |center: f64| (center + 0.5) * factor - 0.5;
    Ok(Intrinsics::new(
        camera.width() / divisor * side,
        camera.height() / divisor * side,
        focal.x,
        focal.y,
        moved(center.x).max(0.0),
        moved(center.y).max(0.0),
        camera.distortion(),
    )?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::DVec3;

    #[test]
    fn a_smaller_and_a_finer_camera_see_the_same_at_the_same_place() {
        let camera = Intrinsics::pinhole(640, 480, 570.0, 571.0, 318.5, 241.0).unwrap();
        let point = DVec3::new(0.21, -0.13, 1.1);
        let pixel = camera.pixel_from_camera(point).unwrap();
        for (divisor, side, factor) in [(2, 1, 0.5), (4, 1, 0.25), (1, 2, 2.0), (4, 2, 0.5)] {
            let other = resized(&camera, divisor, side).unwrap();
            assert_eq!(f64::from(other.width()), 640.0 * factor);
            let found = other.pixel_from_camera(point).unwrap();
            // From the image's corner, not from the first pixel's centre.
            let expected = (pixel + 0.5) * factor - 0.5;
            assert!((found - expected).length() < 1e-9, "{divisor} {side}");
        }
    }

    #[test]
    fn the_middle_of_a_small_pixel_lies_in_the_photographs() {
        assert_eq!(Scale::Whole.pixel_of_photograph(7, 10), 7);
        assert_eq!(Scale::Half.pixel_of_photograph(3, 10), 7);
        assert_eq!(Scale::Quarter.pixel_of_photograph(2, 10), 9);
    }
}
