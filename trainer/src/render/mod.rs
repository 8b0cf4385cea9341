//! `glint render`: pictures from any path of views.
//!
//! Map: [`path`] the views · [`painter`] one picture at a size, with samples, of a model.

pub mod painter;
pub mod path;

use std::path::Path;

use anyhow::{Context as _, bail};
use geometry::Pose;
use imaging::{Image, Rgb8Image, encode_png_rgb8};
use sequence::Recording;
use serde::Serialize;

use self::painter::{DrawnModel, Painter, Picture, Scale};
pub use self::path::{ViewPath, read_tum};
use crate::clock::Stopwatch;
use crate::color::srgb8_from_linear;
use crate::eval::model::Model;
use crate::progress::Progress;
use crate::run_folder::{RunFolder, write_atomically};
use crate::stages::observe::ColorView;
use crate::stages::poses::poses_of_run;
use crate::tradeoff::machine::rss_peak_mb;
use crate::train::TrainConfig;

/// How pictures are drawn.
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Size over that of the photographs.
    pub scale: Scale,
    /// Samples of a pixel: 1 or 4.
    pub samples: u32,
    /// What is drawn.
    pub model: DrawnModel,
    /// As the camera would have coded it, with vignetting and response, instead of plain sRGB.
    pub camera: bool,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            scale: Scale::Whole,
            samples: 1,
            model: DrawnModel::Composition,
            camera: false,
        }
    }
}

/// What was drawn, and its cost.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RenderSummary {
    /// Pictures.
    pub pictures: usize,
    /// Core-milliseconds of drawing a picture, coding it as PNG and writing it left out.
    pub draw_core_ms: f64,
    /// Core-seconds until the first picture could be drawn: recording, mesh, map.
    pub prep_core_s: f64,
    /// Core-seconds of the pictures' coding and writing.
    pub write_core_s: f64,
    /// Largest resident memory, mebibytes.
    pub rss_peak_mb: f64,
}

/// Draws every view of `path` into `output` as `NNNNNN.png`; numbers are those of the frames, or lines of the file.
///
/// # Errors
/// When run, recording or path cannot be read, nothing is on the path, or the folder cannot be written.
pub fn render(
    folder: &RunFolder,
    path: &ViewPath,
    output: &Path,
    options: &RenderOptions,
    progress: &Progress,
) -> anyhow::Result<RenderSummary> {
    let preparing = Stopwatch::start();
    let config: TrainConfig =
        toml::from_str(&std::fs::read_to_string(folder.path("config.toml"))?)?;
    let recording = Recording::open(&config.recording)?;
    let view = ColorView::new(&recording);
    let model = Model::load(folder)?;
    let views = match path {
        ViewPath::File(file) => read_tum(file)?.into_iter().enumerate().collect(),
        ViewPath::Recorded | ViewPath::Test => {
            let poses = poses_of_run(folder, &recording, &config.poses)?;
            of_frames(&recording, &view, &poses, path)
        }
    };
    if views.is_empty() {
        bail!("the path holds no view: the recording has no held-out frame with a pose");
    }
    let poses = poses_of_run(folder, &recording, &config.poses)?;
    let painter = Painter::new(&recording, &view, &model, &poses, options)?;
    std::fs::create_dir_all(output).with_context(|| format!("cannot make {}", output.display()))?;
    progress.stage("render");
    let prep_core_s = preparing.cost().core_s;
    let (mut draw_core_s, mut write_core_s) = (0.0, 0.0);
    for (done, (index, world_from_color)) in views.iter().enumerate() {
        crate::interrupt::check()?;
        let drawing = Stopwatch::start();
        let surface_from_color = Pose::from_translation(-model.surface.origin) * *world_from_color;
        let picture = painter.draw(&surface_from_color)?;
        let picture = coded(&picture, &view, options);
        draw_core_s += drawing.cost().core_s;
        let writing = Stopwatch::start();
        let file = output.join(format!("{index:06}.png"));
        write_atomically(&file, &encode_png_rgb8(&picture)?)?;
        write_core_s += writing.cost().core_s;
        progress.step(done + 1, views.len());
    }
    Ok(RenderSummary {
        pictures: views.len(),
        draw_core_ms: 1e3 * draw_core_s / views.len() as f64,
        prep_core_s,
        write_core_s,
        rss_peak_mb: rss_peak_mb(),
    })
}

/// Frames of the recording with their poses (world from colour camera): all, or those held out.
fn of_frames(
    recording: &Recording,
    view: &ColorView,
    poses: &[Option<Pose>],
    path: &ViewPath,
) -> Vec<(usize, Pose)> {
    let all = poses.iter().enumerate();
    let test = &recording.split().test;
    let wanted = |index: usize| match path {
        ViewPath::Test => test.iter().any(|&frame| frame as usize == index),
        ViewPath::Recorded | ViewPath::File(_) => true,
    };
    all.filter(|(index, _)| wanted(*index))
        .filter_map(|(index, pose)| Some((index, (*pose)? * view.color_from_depth.inverse())))
        .collect()
}

/// The picture in 8 bits.
fn coded(picture: &Picture, view: &ColorView, options: &RenderOptions) -> Rgb8Image {
    if !options.camera {
        return picture.linear.map(|linear| linear.map(srgb8_from_linear));
    }
    let (width, height) = (view.camera.width(), view.camera.height());
    Image::from_fn(picture.linear.width(), picture.linear.height(), |x, y| {
        if !picture.has_surface.at(x, y) {
            return [0; 3];
        }
        let x_of_camera = options.scale.pixel_of_photograph(x, width);
        let y_of_camera = options.scale.pixel_of_photograph(y, height);
        let linear = picture.linear.at(x, y);
        let code = view.corrector.encode(x_of_camera, y_of_camera, linear);
        code.map(|value| value.round().clamp(0.0, 255.0) as u8)
    })
}
