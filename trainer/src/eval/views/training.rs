//! The training photograph nearest to a view, and what it shows of the surface.

use anyhow::Context as _;
use geometry::Pose;
use glam::DVec3;
use imaging::{LinearImage, Radiance};
use raytrace::{Hit, VisibilityBuffer, visibility_buffer};
use sequence::Recording;

use super::nearest;
use crate::eval::model::Model;
use crate::stages::geometry::depth_tolerance;
use crate::stages::observe::ColorView;
use crate::stages::poses::{PosedFrame, training_frames_at};

/// The photographs that a run was trained from.
pub struct TrainingViews<'a> {
    recording: &'a Recording,
    view: &'a ColorView,
    model: &'a Model,
    frames: Vec<PosedFrame>,
    /// Centres of their cameras, surface axes.
    centers: Vec<DVec3>,
    object: DVec3,
}

/// A photograph by its place, not yet read.
pub struct NearestFrame<'a> {
    views: &'a TrainingViews<'a>,
    frame: PosedFrame,
    /// Angle at the object between its camera and the asked one, radians.
    pub angle: f64,
}

/// A training photograph with what it sees.
pub struct Photograph<'a> {
    view: &'a ColorView,
    model: &'a Model,
    surface_from_color: Pose,
    radiance: Radiance,
    buffer: VisibilityBuffer,
}

impl<'a> TrainingViews<'a> {
    /// Those of `recording` with their `poses` (world from depth camera, one a frame).
    pub fn new(
        recording: &'a Recording,
        view: &'a ColorView,
        model: &'a Model,
        poses: &[Option<Pose>],
    ) -> Self {
        let frames = training_frames_at(recording, poses);
        let centers = frames
            .iter()
            .map(|frame| view.surface_from_color(&model.surface, &frame.world_from_camera))
            .map(|pose| pose.translation())
            .collect();
        Self {
            recording,
            view,
            model,
            frames,
            centers,
            object: nearest::object_center(model),
        }
    }

    /// The frame whose camera is nearest in angle, as the object sees it, to the one at `surface_from_color`.
    ///
    /// # Errors
    /// When no training frame has a pose.
    pub fn nearest(&self, surface_from_color: &Pose) -> anyhow::Result<NearestFrame<'_>> {
        let centers = self.centers.iter().copied();
        let camera = surface_from_color.translation();
        let (nearest, angle) = nearest::nearest_camera(self.object, camera, centers)
            .context("no training frame has a pose: there is no nearest view")?;
        Ok(NearestFrame {
            views: self,
            frame: self.frames[nearest],
            angle,
        })
    }
}

impl<'a> NearestFrame<'a> {
    /// Index in the recording.
    pub fn index(&self) -> usize {
        self.frame.index
    }

    /// Reads it and finds what it sees.
    ///
    /// # Errors
    /// When the frame cannot be read.
    pub fn photograph(&self) -> anyhow::Result<Photograph<'a>> {
        let TrainingViews {
            recording,
            view,
            model,
            ..
        } = *self.views;
        let surface = &model.surface;
        let surface_from_color = view.surface_from_color(surface, &self.frame.world_from_camera);
        Ok(Photograph {
            view,
            model,
            radiance: view.radiance(recording, self.frame.index)?,
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
}

impl Photograph<'_> {
    /// What it shows of the surface point at `hit`, linear radiance, bilinear; `None` where that is hidden there.
    pub fn seen(&self, hit: &Hit) -> Option<[f32; 3]> {
        let surface = &self.model.surface;
        let camera = &self.view.camera;
        let point = surface.interpolate(&surface.positions, hit).as_dvec3();
        let in_camera = self.surface_from_color.inverse().transform_point(point);
        let pixel = camera.pixel_from_camera(in_camera)?;
        let (x, y) = camera.contains(pixel)?;
        let index = (y * camera.width() + x) as usize;
        let depth = self.buffer.depth[index];
        if !(depth > 0.0) || (depth - in_camera.z as f32).abs() > 2.0 * depth_tolerance(depth) {
            return None;
        }
        bilinear(&self.radiance.linear, pixel.x, pixel.y)
    }
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
