//! The model against held-out photographs, beside diffuse alone and the nearest training photograph.

use std::path::Path;

use geometry::{Pose, direction::angle_between};
use glam::DVec3;
use imaging::{Image, LinearImage, Mask, Radiance, Rgb8Image, decode_png_mask, measures};
use raytrace::{Hit, VisibilityBuffer, visibility_buffer};
use sequence::Recording;
use serde::{Deserialize, Serialize};

use super::model::Model;
use crate::stages::geometry::depth_tolerance;
use crate::stages::observe::{ColorView, Surface};
use crate::stages::poses::{PosedFrame, training_frames_at};

/// Error of one way to predict a photograph, codes as [0, 1], over the mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewError {
    /// Mean absolute difference over pixels and channels.
    pub l1: f64,
    /// 10 log₁₀(1/MSE), MSE pooled over frames, at most 100.
    pub psnr: f64,
}

/// Figures over all held-out frames.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CompositionMetrics {
    /// Where the mask came from.
    pub mask: String,
    /// Masked pixels.
    pub pixel_count: usize,
    /// Held-out frames.
    pub frame_count: usize,
    /// D + gain · (V · SRM + (1 − V) · first bounce).
    pub composition: ViewError,
    /// The median texture alone.
    pub diffuse_only: ViewError,
    /// The nearest training photograph, reprojected through the mesh, holes filled by diffuse.
    pub nearest_view: ViewError,
    /// Share of masked pixels that the nearest photograph did not see.
    pub nearest_hole_fraction: f64,
    /// One row a frame.
    pub frames: Vec<FrameError>,
}

/// One held-out frame.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct FrameError {
    /// Index in the recording.
    pub frame: usize,
    /// Nearest training frame.
    pub nearest: usize,
    /// Angle at the object between the two cameras, degrees.
    pub angle_deg: f64,
    /// Masked L1 of the composition.
    pub l1: f64,
    /// Masked L1 of diffuse alone.
    pub l1_diffuse: f64,
    /// Masked L1 of the nearest view.
    pub l1_nearest: f64,
}

/// Pictures of one held-out frame for the report.
pub struct Strip {
    /// Index in the recording.
    pub frame: usize,
    /// The photograph.
    pub photograph: Rgb8Image,
    /// The composition.
    pub composition: Rgb8Image,
    /// Diffuse alone.
    pub diffuse_only: Rgb8Image,
    /// The nearest view.
    pub nearest_view: Rgb8Image,
    /// The mask.
    pub mask: Mask,
}

/// Predictions of one held-out frame, codes 0 to 255 as floats.
struct Predictions {
    composition: Image<[f32; 3]>,
    diffuse_only: Image<[f32; 3]>,
    nearest_view: Image<[f32; 3]>,
    has_surface: Mask,
    is_shiny: Mask,
    is_hole: Mask,
}

/// A training photograph with what it sees.
struct Photograph {
    index: usize,
    surface_from_color: Pose,
    radiance: Radiance,
    buffer: VisibilityBuffer,
}

/// Judges all test frames; `None` when the recording has none. `masks` is a folder of 1-bit PNGs named by
/// frame; without it the shiny segments of the mesh are the mask.
pub fn evaluate(
    recording: &Recording,
    model: &Model,
    pose_set: &str,
    masks: Option<&Path>,
    progress: &dyn Fn(usize, usize),
) -> anyhow::Result<Option<(CompositionMetrics, Vec<Strip>)>> {
    let Some(poses) = recording.poses(pose_set) else {
        return Ok(None);
    };
    evaluate_at(recording, model, poses, masks, progress)
}

/// As [`evaluate`], with `poses` (world from depth camera, one a frame of the recording) instead of a set: a run may
/// have poses of its own.
pub fn evaluate_at(
    recording: &Recording,
    model: &Model,
    poses: &[Option<Pose>],
    masks: Option<&Path>,
    progress: &dyn Fn(usize, usize),
) -> anyhow::Result<Option<(CompositionMetrics, Vec<Strip>)>> {
    let view = ColorView::new(recording);
    let training = training_frames_at(recording, poses);
    let tests: Vec<PosedFrame> = recording
        .split()
        .test
        .iter()
        .filter_map(|&index| {
            let index = index as usize;
            Some(PosedFrame {
                index,
                world_from_camera: poses.get(index).copied().flatten()?,
            })
        })
        .collect();
    let center = object_center(model);
    let mut pool = [Pooled::default(); 3];
    let mut frames = Vec::new();
    let mut strips = Vec::new();
    let mut holes = 0.0;
    for (done, test) in tests.iter().enumerate() {
        let pose = view.surface_from_color(&model.surface, &test.world_from_camera);
        let (nearest, angle) = nearest_frame(&view, model, &training, &pose, center);
        let photograph = photograph(recording, &view, model, nearest)?;
        let predicted = predict(&view, model, &pose, &photograph);
        let truth = recording.color(test.index)?;
        let mask = mask_of(masks, test.index, &predicted)?;
        let mut errors = [0.0; 3];
        for ((error, pooled), image) in errors.iter_mut().zip(&mut pool).zip(predicted.images()) {
            let this = Pooled::of(&truth, image, &mask);
            *error = this.l1();
            pooled.add(&this);
        }
        holes += count_both(&mask, &predicted.is_hole);
        frames.push(FrameError {
            frame: test.index,
            nearest: nearest.index,
            angle_deg: angle.to_degrees(),
            l1: errors[0],
            l1_diffuse: errors[1],
            l1_nearest: errors[2],
        });
        strips.push(Strip {
            frame: test.index,
            photograph: truth,
            composition: predicted.composition.map(rounded),
            diffuse_only: predicted.diffuse_only.map(rounded),
            nearest_view: predicted.nearest_view.map(rounded),
            mask,
        });
        progress(done + 1, tests.len());
    }
    if pool[0].count == 0.0 {
        return Ok(None);
    }
    let [composition, diffuse_only, nearest_view] = pool.map(|pooled| pooled.error());
    let metrics = CompositionMetrics {
        mask: if masks.is_some() {
            "given masks, eroded by 1 pixel".into()
        } else {
            "shiny segments of the mesh".into()
        },
        pixel_count: (pool[0].count / 3.0) as usize,
        frame_count: tests.len(),
        composition,
        diffuse_only,
        nearest_view,
        nearest_hole_fraction: holes * 3.0 / pool[0].count,
        frames,
    };
    Ok(Some((metrics, strips)))
}

fn rounded(code: [f32; 3]) -> [u8; 3] {
    code.map(|value| value.round().clamp(0.0, 255.0) as u8)
}

impl Predictions {
    fn images(&self) -> [&Image<[f32; 3]>; 3] {
        [&self.composition, &self.diffuse_only, &self.nearest_view]
    }
}

/// Sums of differences of codes as [0, 1].
#[derive(Clone, Copy, Debug, Default)]
struct Pooled {
    absolute: f64,
    square: f64,
    count: f64,
}

impl Pooled {
    fn of(truth: &Rgb8Image, predicted: &Image<[f32; 3]>, mask: &Mask) -> Self {
        let mut sums = Self::default();
        for ((truth, predicted), &inside) in truth
            .pixels()
            .iter()
            .zip(predicted.pixels())
            .zip(mask.pixels())
        {
            if !inside {
                continue;
            }
            for c in 0..3 {
                // The photograph is 8 bit: so is the prediction.
                let difference = f64::from(predicted[c].round() - f32::from(truth[c])) / 255.0;
                sums.absolute += difference.abs();
                sums.square += difference * difference;
                sums.count += 1.0;
            }
        }
        sums
    }

    fn add(&mut self, other: &Self) {
        self.absolute += other.absolute;
        self.square += other.square;
        self.count += other.count;
    }

    fn l1(&self) -> f64 {
        self.absolute / self.count.max(1.0)
    }

    fn error(&self) -> ViewError {
        ViewError {
            l1: self.l1(),
            psnr: measures::psnr_from_mse(self.square / self.count.max(1.0)),
        }
    }
}

fn count_both(a: &Mask, b: &Mask) -> f64 {
    a.pixels()
        .iter()
        .zip(b.pixels())
        .filter(|(a, b)| **a && **b)
        .count() as f64
}

/// Centre of the shiny segments, surface axes.
fn object_center(model: &Model) -> DVec3 {
    let surface = &model.surface;
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for (position, segment) in surface.positions.iter().zip(&surface.vertex_segment) {
        if model.specular_segments.is_empty() || model.specular_segments.contains(segment) {
            sum += position.as_dvec3();
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// The training frame whose camera is nearest in angle at the object.
fn nearest_frame(
    view: &ColorView,
    model: &Model,
    training: &[PosedFrame],
    pose: &Pose,
    center: DVec3,
) -> (PosedFrame, f64) {
    let angle = |frame: &PosedFrame| {
        let other = view.surface_from_color(&model.surface, &frame.world_from_camera);
        angle_between(pose.translation() - center, other.translation() - center)
    };
    training
        .iter()
        .map(|frame| (*frame, angle(frame)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .expect("training_frames refuses an empty list")
}

fn photograph(
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

fn predict(view: &ColorView, model: &Model, pose: &Pose, photograph: &Photograph) -> Predictions {
    debug_assert!(
        photograph.radiance.linear.width() == view.camera.width(),
        "frame {}",
        photograph.index
    );
    let drawn = model.draw(&view.camera, pose);
    let (width, height) = (view.camera.width(), view.camera.height());
    let mut predictions = Predictions {
        composition: Image::new(width, height, [0.0; 3]),
        diffuse_only: Image::new(width, height, [0.0; 3]),
        nearest_view: Image::new(width, height, [0.0; 3]),
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
            let encode = |linear: [f32; 3]| view.corrector.encode(x, y, linear);
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

/// The scored pixels of a test frame: the given mask eroded by a pixel, or the shiny segments, and always
/// with geometry.
fn mask_of(masks: Option<&Path>, index: usize, predicted: &Predictions) -> anyhow::Result<Mask> {
    let Some(folder) = masks else {
        return Ok(predicted.is_shiny.clone());
    };
    let valid = &predicted.has_surface;
    let path = folder.join(format!("{index:06}.png"));
    let bytes = std::fs::read(&path)
        .map_err(|error| anyhow::anyhow!("cannot read the mask {}: {error}", path.display()))?;
    let given = decode_png_mask(&bytes)?;
    anyhow::ensure!(
        (given.width(), given.height()) == (valid.width(), valid.height()),
        "the mask {} has another size than the photographs",
        path.display()
    );
    let mut mask = valid.clone();
    for y in 0..mask.height() {
        for x in 0..mask.width() {
            let (x64, y64) = (i64::from(x), i64::from(y));
            let inside = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
                .iter()
                .all(|(dx, dy)| given.get(x64 + dx, y64 + dy).unwrap_or(false));
            *mask.at_mut(x, y) = inside && valid.at(x, y);
        }
    }
    Ok(mask)
}
