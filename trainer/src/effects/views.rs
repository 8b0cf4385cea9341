//! The survey's views: few frames, small, with what each pixel sees and what its mirrored ray meets.

use geometry::{DVec2, Intrinsics, Pose};
use glam::Vec3;
use imaging::Radiance;
use rayon::prelude::*;
use raytrace::{Hit, NO_TRIANGLE, VisibilityBuffer, visibility_buffer};
use sequence::Recording;
use srm::rows::luminance;

use super::noise::{NoiseSample, noise_samples};
use crate::stages::observe::{ColorView, Surface, hit_at};
use crate::stages::poses::{PosedFrame, without_repeats};

/// Frames of a survey.
pub(super) const SURVEY_FRAMES: usize = 40;
/// Width of its pictures, pixels.
const SURVEY_WIDTH: u32 = 160;
/// Smallest cosine between normal and outgoing direction, as in training.
const LEAST_COSINE: f32 = 0.2;
/// Jump of depth to a neighbour that is an edge, as a share of the depth.
const EDGE_SHARE: f32 = 0.05;

/// A pixel of the object in a survey picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurveyPixel {
    /// Index in the picture.
    pub place: usize,
    /// What it sees.
    pub hit: Hit,
    /// Cosine between normal and outgoing direction.
    pub cosine: f32,
    /// Unit mirrored direction.
    pub reflected: Vec3,
    /// What the mirrored ray meets.
    pub bounce: Option<Hit>,
    /// Where that is on the object and mirrors freely into the room: the second mirrored direction.
    pub second: Option<Vec3>,
    /// Segment.
    pub segment: u16,
    /// Share of its photograph's pixels that are clipped.
    pub clipped_share: f32,
}

/// One picture of the survey.
pub(super) struct SurveyView {
    /// Position among the training frames whose colour is their own.
    pub position: usize,
    /// Surface from colour camera.
    pub surface_from_color: Pose,
    /// Mean linear radiance of the photograph's pixels; NaN where one is invalid.
    pub color: Vec<[f32; 3]>,
    /// Luminance of that, with the gain of the view taken out once it is known.
    pub grey: Vec<f32>,
    /// What each pixel sees.
    pub buffer: VisibilityBuffer,
    /// Pixels of the object away from edges.
    pub pixels: Vec<SurveyPixel>,
    /// Second differences of the photograph, for its noise.
    pub noise: Vec<NoiseSample>,
}

/// All pictures.
pub(super) struct SurveyViews {
    /// In the order of the recording.
    pub views: Vec<SurveyView>,
    /// The small camera.
    pub camera: Intrinsics,
    /// Training frames whose colour is their own.
    pub frame_count: usize,
}

/// Frames evenly spread along the path in turn and way, ends included, in order: positions in `frames`.
pub(super) fn spread(frames: &[PosedFrame], count: usize) -> Vec<usize> {
    let mut way = vec![0.0];
    for pair in frames.windows(2) {
        let (a, b) = (pair[0].world_from_camera, pair[1].world_from_camera);
        let turn = geometry::direction::angle_between(
            a.rotation() * geometry::DVec3::Z,
            b.rotation() * geometry::DVec3::Z,
        );
        // Frames of a still camera count a little: the survey then takes some of them, spread evenly.
        let step = turn + (a.translation() - b.translation()).length() + 1e-4;
        way.push(way.last().copied().unwrap_or(0.0) + step);
    }
    let whole = way.last().copied().unwrap_or(0.0);
    let mut chosen: Vec<usize> = (0..count)
        .map(|i| whole * (i as f64 + 0.5) / count as f64)
        .map(|goal| way.partition_point(|&w| w < goal).min(frames.len() - 1))
        .collect();
    chosen.dedup();
    chosen
}

/// The camera whose pixel is the mean of `block` x `block` pixels of `camera`; `None` where it has lens distortion
/// that this cannot keep.
fn smaller(camera: &Intrinsics, block: u32) -> Option<Intrinsics> {
    let scale = f64::from(block);
    let center = (camera.center() + DVec2::splat(0.5)) / scale - DVec2::splat(0.5);
    let focal = camera.focal() / scale;
    Intrinsics::new(
        camera.width() / block,
        camera.height() / block,
        focal.x,
        focal.y,
        center.x,
        center.y,
        camera.distortion(),
    )
    .ok()
}

/// Looks at the chosen frames; `wants_rays` is false where no mirrored ray is to be followed.
///
/// # Errors
/// When a frame cannot be read.
pub(super) fn look(
    recording: &Recording,
    view: &ColorView,
    surface: &Surface,
    frames: &[PosedFrame],
    wants_rays: bool,
) -> anyhow::Result<Option<SurveyViews>> {
    let (frames, _) = without_repeats(frames, |index| recording.color_is_repeat(index));
    let block = (view.camera.width() / SURVEY_WIDTH).max(1);
    let Some(camera) = smaller(&view.camera, block).filter(|_| !frames.is_empty()) else {
        return Ok(None);
    };
    let views: anyhow::Result<Vec<SurveyView>> = spread(&frames, SURVEY_FRAMES)
        .into_par_iter()
        .map(|position| {
            let frame = &frames[position];
            let radiance = view.radiance(recording, frame.index)?;
            let pose = view.surface_from_color(surface, &frame.world_from_camera);
            Ok(one_view(
                surface, &camera, block, &radiance, pose, position, wants_rays,
            ))
        })
        .collect();
    Ok(Some(SurveyViews {
        views: views?,
        camera,
        frame_count: frames.len(),
    }))
}

fn one_view(
    surface: &Surface,
    camera: &Intrinsics,
    block: u32,
    radiance: &Radiance,
    pose: Pose,
    position: usize,
    wants_rays: bool,
) -> SurveyView {
    let buffer = visibility_buffer(
        &surface.scene,
        &surface.positions,
        &surface.triangles,
        camera,
        &pose,
    );
    let (width, height) = (camera.width(), camera.height());
    let mut color = Vec::with_capacity((width * height) as usize);
    let mut saturated = Vec::with_capacity(color.capacity());
    for y in 0..height {
        for x in 0..width {
            let (mean, clipped) = block_mean(radiance, x * block, y * block, block);
            color.push(mean);
            saturated.push(clipped);
        }
    }
    let eye = pose.translation().as_vec3();
    // Without an object the whole surface is looked at: its camera has effects all the same.
    let has_object = surface.vertex_segment.iter().any(|&segment| segment != 0);
    let mut pixels = Vec::new();
    for index in 0..color.len() {
        if !color[index][0].is_finite() || !is_inside(&buffer, surface, index) {
            continue;
        }
        let segment = surface.segment(buffer.triangle[index]);
        let Some(hit) = hit_at(&buffer, index).filter(|_| segment != 0 || !has_object) else {
            continue;
        };
        let Some(mirrored) = surface.mirror_ray(&hit, eye, LEAST_COSINE) else {
            continue;
        };
        let bounce = wants_rays
            .then(|| surface.scene.closest(&mirrored.ray))
            .flatten();
        let second = bounce
            .filter(|bounce| surface.segment(bounce.triangle) != 0)
            .and_then(|bounce| surface.second_mirror(&bounce, mirrored.ray.origin));
        pixels.push(SurveyPixel {
            place: index,
            hit,
            cosine: mirrored.cosine,
            reflected: mirrored.ray.direction,
            bounce,
            second,
            segment,
            clipped_share: saturated[index],
        });
    }
    SurveyView {
        position,
        surface_from_color: pose,
        grey: color
            .iter()
            .map(|rgb| luminance(rgb.map(f64::from)) as f32)
            .collect(),
        color,
        buffer,
        pixels,
        noise: noise_samples(radiance),
    }
}

/// Mean radiance of a block of pixels (NaN where one is invalid) and the share that is clipped.
fn block_mean(radiance: &Radiance, left: u32, top: u32, block: u32) -> ([f32; 3], f32) {
    let mut sum = [0.0_f64; 3];
    let mut clipped = 0.0;
    for y in top..top + block {
        for x in left..left + block {
            if radiance.invalid.at(x, y) {
                return ([f32::NAN; 3], 0.0);
            }
            clipped += f64::from(u8::from(radiance.saturated.at(x, y)));
            for (sum, value) in sum.iter_mut().zip(radiance.linear.at(x, y)) {
                *sum += f64::from(value);
            }
        }
    }
    let count = f64::from(block * block);
    (
        sum.map(|value| (value / count) as f32),
        (clipped / count) as f32,
    )
}

/// Whether the four neighbours see the same segment without a jump in depth.
fn is_inside(buffer: &VisibilityBuffer, surface: &Surface, index: usize) -> bool {
    let width = buffer.width as usize;
    let (x, y) = (index % width, index / width);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= buffer.height as usize {
        return false;
    }
    if buffer.triangle[index] == NO_TRIANGLE {
        return false;
    }
    let (segment, depth) = (surface.segment(buffer.triangle[index]), buffer.depth[index]);
    [index - 1, index + 1, index - width, index + width]
        .into_iter()
        .all(|other| {
            let triangle = buffer.triangle[other];
            triangle != NO_TRIANGLE
                && surface.segment(triangle) == segment
                && (buffer.depth[other] - depth).abs() <= EDGE_SHARE * depth
        })
}

impl SurveyViews {
    /// Where a vertex is seen in a view, pixels; `None` where something is in front of it or it looks away.
    pub(super) fn place(
        &self,
        view: &SurveyView,
        color_from_surface: &Pose,
        surface: &Surface,
        vertex: usize,
    ) -> Option<DVec2> {
        let position = surface.positions[vertex];
        let eye = view.surface_from_color.translation().as_vec3();
        let outgoing = (eye - position).try_normalize()?;
        if surface.normals[vertex].dot(outgoing) < LEAST_COSINE {
            return None;
        }
        let in_camera = color_from_surface.transform_point(position.as_dvec3());
        let pixel = self.camera.pixel_from_camera(in_camera)?;
        let (x, y) = self.camera.contains(pixel)?;
        let index = (y * self.camera.width() + x) as usize;
        let depth = view.buffer.depth[index];
        let is_seen = view.buffer.triangle[index] != NO_TRIANGLE
            && (f64::from(depth) - in_camera.z).abs() <= 0.5 * f64::from(EDGE_SHARE * depth);
        is_seen.then_some(pixel)
    }
}

/// The pixels of the object (Ω) in one frame that bounds are about.
#[derive(Clone, Debug)]
pub struct ObjectPixels {
    /// Index of the frame in the recording.
    pub frame: usize,
    /// Pixels of the photograph on each side of a survey pixel.
    pub block: u32,
    /// Column and row of each survey pixel: it is the mean of `block` x `block` pixels of the photograph, the first of
    /// which is `block` times this.
    pub places: Vec<[u32; 2]>,
}

/// The pixels that a survey of `frames` looks at, in the order of the recording; none where there is nothing to survey.
///
/// # Errors
/// When a frame cannot be read.
pub fn object_pixels(
    recording: &Recording,
    surface: &Surface,
    frames: &[PosedFrame],
) -> anyhow::Result<Vec<ObjectPixels>> {
    let view = ColorView::new(recording);
    let (own, _) = without_repeats(frames, |index| recording.color_is_repeat(index));
    let Some(views) = look(recording, &view, surface, frames, false)? else {
        return Ok(Vec::new());
    };
    let width = views.camera.width();
    let place = |pixel: &SurveyPixel| [pixel.place as u32 % width, pixel.place as u32 / width];
    let pixels = |seen: &SurveyView| ObjectPixels {
        frame: own[seen.position].index,
        block: view.camera.width() / width,
        places: seen.pixels.iter().map(place).collect(),
    };
    Ok(views.views.iter().map(pixels).collect())
}

/// Value of a picture between pixels; `None` where a pixel beside is missing.
pub(super) fn bilinear<T: Copy, const N: usize>(
    picture: &[T],
    width: usize,
    at: DVec2,
    channels: impl Fn(T) -> [f32; N],
) -> Option<[f32; N]> {
    let height = picture.len() / width;
    let (left, top) = (at.x.floor(), at.y.floor());
    if !(left >= 0.0 && top >= 0.0) {
        return None;
    }
    // Checked above and below: within the picture.
    let (x, y) = (left as usize, top as usize);
    if x + 1 >= width || y + 1 >= height {
        return None;
    }
    let (u, v) = ((at.x - left) as f32, (at.y - top) as f32);
    let index = y * width + x;
    let corners = [
        (index, (1.0 - u) * (1.0 - v)),
        (index + 1, u * (1.0 - v)),
        (index + width, (1.0 - u) * v),
        (index + width + 1, u * v),
    ];
    let mut sum = [0.0; N];
    for (corner, weight) in corners {
        for (sum, value) in sum.iter_mut().zip(channels(picture[corner])) {
            *sum += weight * value;
        }
    }
    sum.iter().all(|value| value.is_finite()).then_some(sum)
}
