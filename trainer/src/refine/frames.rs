//! The frames of a recording as refinement takes them: pinhole depth, its points, its colour, luminance.

use anyhow::Context as _;
use fusion::tracking::points::half_camera;
use fusion::tracking::{DepthNoise, GreyFrame, PointPyramid};
use geometry::{Intrinsics, Pose};
use glam::DVec2;
use imaging::develop::Developer;
use imaging::{DepthImage, Image, LinearPixel, Registration};
use rayon::prelude::*;
use sequence::{ColorEncoding, Recording};

use crate::stages::geometry::depth_of;
use crate::stages::observe::ColorView;

/// Sizes below the full image.
const LEVEL_COUNT: usize = 3;
/// Frames that are held at a time: 6 MB each at VGA.
const BATCH: usize = 12;

/// One frame.
pub(super) struct LoadedFrame {
    /// Metres along z in the pinhole of [`FrameLoader::depth_camera`].
    pub(super) depth: DepthImage,
    /// Half size and smaller.
    pub(super) points: PointPyramid,
    /// Colour of every depth pixel and luminance of the photograph; `None` where the photograph repeats the one before,
    /// so that it is older than its time.
    pub(super) photograph: Option<Photograph>,
}

/// The photograph of a frame.
pub(super) struct Photograph {
    /// One pixel per depth pixel.
    pub(super) registered: Vec<LinearPixel>,
    /// Luminance in the pinhole of [`FrameLoader::half_color_camera`] and smaller.
    pub(super) grey: GreyFrame,
}

/// Reads frames of a recording.
pub(super) struct FrameLoader<'a> {
    recording: &'a Recording,
    view: ColorView,
    /// Pinhole of the depth images.
    pub(super) depth_camera: Intrinsics,
    /// Pinhole of half-size photographs.
    pub(super) half_color_camera: Intrinsics,
    noise: DepthNoise,
    /// Where the pixels of the pinhole lie in the stored depth image; `None` where that is a pinhole's.
    depth_places: Option<Vec<Option<(u32, u32)>>>,
    /// The same for half-size luminance, fractions of pixels.
    grey_places: Option<Vec<Option<DVec2>>>,
}

/// What one thread works with.
struct Scratch {
    developer: Developer,
    registration: Registration,
    pixels: Vec<LinearPixel>,
}

impl<'a> FrameLoader<'a> {
    /// For the cameras of a recording.
    pub(super) fn new(recording: &'a Recording) -> anyhow::Result<Self> {
        let view = ColorView::new(recording);
        let stored = recording.depth_camera().intrinsics;
        let depth_camera = pinhole(&stored)?;
        let half_color_camera =
            half_camera(&view.camera).context("the photographs are too small to refine poses")?;
        half_camera(&depth_camera).context("the depth images are too small to refine poses")?;
        Ok(Self {
            recording,
            depth_camera,
            noise: DepthNoise::default(),
            depth_places: (!stored.distortion().is_none()).then(|| {
                places(&depth_camera, &stored)
                    .map(|place| place.and_then(|pixel| stored.contains(pixel)))
                    .collect()
            }),
            grey_places: (!view.camera.distortion().is_none()).then(|| {
                // Pixel (x, y) of the half size is the middle of a block of the full one.
                places(&half_color_camera, &view.camera)
                    .map(|place| place.map(|pixel| (pixel + 0.5) / 2.0 - 0.5))
                    .collect()
            }),
            half_color_camera,
            view,
        })
    }

    /// Colour camera from depth camera.
    pub(super) fn color_from_depth(&self) -> Pose {
        self.view.color_from_depth
    }

    /// Whether the depth of a frame repeats the one before.
    pub(super) fn depth_is_repeat(&self, index: usize) -> bool {
        self.recording.depth_is_repeat(index)
    }

    /// Calls `take(position, frame)` for the frames `indices` in their order; they are read by all threads,
    /// some ahead.
    pub(super) fn for_each(
        &self,
        indices: &[usize],
        mut take: impl FnMut(usize, LoadedFrame) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let mut position = 0;
        for batch in indices.chunks(BATCH) {
            crate::interrupt::check()?;
            for frame in self.load_all(batch)? {
                take(position, frame)?;
                position += 1;
            }
        }
        Ok(())
    }

    /// Applies `work(position, frame)` to the frames `indices` by all threads; results in their order.
    pub(super) fn map<T: Send>(
        &self,
        indices: &[usize],
        work: impl Fn(usize, &LoadedFrame) -> anyhow::Result<T> + Sync,
    ) -> anyhow::Result<Vec<T>> {
        let results: Vec<anyhow::Result<T>> = indices
            .par_iter()
            .enumerate()
            .map_init(
                || self.scratch(),
                |scratch, (position, &index)| {
                    crate::interrupt::check()?;
                    let scratch = usable(scratch)?;
                    work(position, &self.load(index, scratch)?)
                },
            )
            .collect();
        // The first error in order, whatever thread met another.
        results.into_iter().collect()
    }

    /// The frames `indices`, in their order.
    pub(super) fn load_all(&self, indices: &[usize]) -> anyhow::Result<Vec<LoadedFrame>> {
        let loaded: Vec<anyhow::Result<LoadedFrame>> = indices
            .par_iter()
            .map_init(
                || self.scratch(),
                |scratch, &index| self.load(index, usable(scratch)?),
            )
            .collect();
        loaded.into_iter().collect()
    }

    fn scratch(&self) -> anyhow::Result<Scratch> {
        let layout = self.recording.color_camera().layout()?;
        let count = self.view.camera.width() as usize * self.view.camera.height() as usize;
        Ok(Scratch {
            developer: Developer::new(&self.view.corrector, layout)?,
            registration: Registration::new(
                &self.depth_camera,
                &self.view.camera,
                &self.view.color_from_depth,
            )?,
            pixels: vec![LinearPixel::INVALID; count],
        })
    }

    fn load(&self, index: usize, scratch: &mut Scratch) -> anyhow::Result<LoadedFrame> {
        let stored = depth_of(self.recording, index)?;
        let depth = match &self.depth_places {
            None => stored,
            Some(places) => Image::from_vec(
                stored.width(),
                stored.height(),
                places
                    .iter()
                    .map(|place| place.map_or(imaging::NO_DEPTH, |(x, y)| stored.at(x, y)))
                    .collect(),
            )?,
        };
        let mut points = PointPyramid::new(&self.depth_camera, LEVEL_COUNT, self.noise);
        points.load(&depth);
        let photograph = if self.recording.color_is_repeat(index) {
            None
        } else {
            Some(self.photograph(index, &depth, scratch)?)
        };
        Ok(LoadedFrame {
            depth,
            points,
            photograph,
        })
    }

    fn photograph(
        &self,
        index: usize,
        depth: &DepthImage,
        scratch: &mut Scratch,
    ) -> anyhow::Result<Photograph> {
        let mut grey = GreyFrame::new(
            &self.half_color_camera,
            self.view.color_from_depth,
            LEVEL_COUNT,
        );
        let out = grey.finest_mut();
        match self.recording.color_camera().encoding {
            ColorEncoding::Jpeg | ColorEncoding::Rgb8 => {
                let codes = self.recording.color(index)?;
                let is_subsampled = self.recording.color_is_subsampled(index)?;
                scratch.developer.develop(
                    codes.pixels().as_flattened(),
                    is_subsampled,
                    &mut scratch.pixels,
                    out.pixels_mut(),
                )?;
            }
            // Of infrared there is no developer.
            ColorEncoding::BayerGrbg
            | ColorEncoding::Uyvy
            | ColorEncoding::Yuyv
            | ColorEncoding::Infrared10 => {
                let frame = self.recording.color_raw(index)?;
                scratch
                    .developer
                    .develop(&frame, false, &mut scratch.pixels, out.pixels_mut())?;
            }
        }
        if let Some(places) = &self.grey_places {
            let seen = out.clone();
            for (pixel, place) in out.pixels_mut().iter_mut().zip(places) {
                *pixel = place.and_then(|place| between(&seen, place)).unwrap_or(0.0);
            }
        }
        grey.finish();
        let mut registered = vec![LinearPixel::INVALID; depth.pixels().len()];
        scratch
            .registration
            .register(depth.pixels(), &scratch.pixels, &mut registered)?;
        Ok(Photograph { registered, grey })
    }
}

/// What a thread works with, or why there is none.
fn usable(scratch: &mut anyhow::Result<Scratch>) -> anyhow::Result<&mut Scratch> {
    scratch
        .as_mut()
        .map_err(|error| anyhow::anyhow!("{error:#}"))
}

/// The camera without its distortion.
fn pinhole(camera: &Intrinsics) -> anyhow::Result<Intrinsics> {
    let (focal, center) = (camera.focal(), camera.center());
    Ok(Intrinsics::pinhole(
        camera.width(),
        camera.height(),
        focal.x,
        focal.y,
        center.x,
        center.y,
    )?)
}

/// Where the pixels of `to`, in scan order, lie in the images of `from`, a camera at the same place.
fn places<'a>(
    to: &'a Intrinsics,
    from: &'a Intrinsics,
) -> impl Iterator<Item = Option<DVec2>> + 'a {
    (0..to.height()).flat_map(move |y| {
        (0..to.width()).map(move |x| {
            let ray = to.camera_from_pixel(DVec2::new(x.into(), y.into()))?;
            from.pixel_from_camera(ray)
        })
    })
}

/// Bilinear value where all four pixels are known (above 0).
pub(super) fn between(image: &Image<f32>, place: DVec2) -> Option<f32> {
    let inside = place.x >= 0.0
        && place.y >= 0.0
        && place.x < f64::from(image.width()) - 1.0
        && place.y < f64::from(image.height()) - 1.0;
    if !inside {
        return None;
    }
    let (x, y) = (place.x as u32, place.y as u32);
    let (fx, fy) = (
        (place.x - f64::from(x)) as f32,
        (place.y - f64::from(y)) as f32,
    );
    let [a, b, c, d] = [
        image.at(x, y),
        image.at(x + 1, y),
        image.at(x, y + 1),
        image.at(x + 1, y + 1),
    ];
    if !(a > 0.0 && b > 0.0 && c > 0.0 && d > 0.0) {
        return None;
    }
    let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
    Some(top + (bottom - top) * fy)
}
