//! What the fused model looks like from a camera: the image that tracking compares a frame with.

use geometry::{Intrinsics, Pose};

/// One pixel of a [`ModelView`]: a piece of surface, or nothing where `weight` is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Surfel {
    /// Where the pixel's ray meets the surface, camera axes of the view, metres.
    pub position: [f32; 3],
    /// Linear luminance (Rec. 709), 1.0 = white level; 0 when unknown.
    pub grey: f32,
    /// Unit normal, camera axes of the view, facing the camera.
    pub normal: [f32; 3],
    /// Weight of the volume at the surface; 0 = no surface here, and the rest is 0 too.
    pub weight: f32,
}

impl Surfel {
    /// No surface.
    pub const NONE: Self = Self {
        position: [0.0; 3],
        grey: 0.0,
        normal: [0.0; 3],
        weight: 0.0,
    };

    /// Whether the pixel's ray meets a surface.
    #[inline]
    pub fn is_surface(&self) -> bool {
        self.weight > 0.0
    }
}

/// A model seen by an ideal pinhole, one [`Surfel`] per pixel. Its buffers are reused from frame to frame.
#[derive(Clone, Debug)]
pub struct ModelView {
    /// The pinhole; its distortion plays no part.
    pub camera: Intrinsics,
    /// Where the camera stands.
    pub world_from_camera: Pose,
    /// Rows one after the other, `width · height` surfels.
    pub surfels: Vec<Surfel>,
    /// Least weight of the eight voxels about a surface point; 0 asks only that all were observed. Kept by
    /// [`crate::Volume::predict`].
    pub min_weight: f32,
    /// Scratch of a prediction: where along the rays of each tile surface can be.
    pub(crate) ranges: Vec<DepthRange>,
}

/// Depths between which a tile's rays can meet surface, metres; empty when the first exceeds the second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DepthRange {
    pub(crate) nearest: f32,
    pub(crate) farthest: f32,
}

impl DepthRange {
    /// No surface.
    pub(crate) const EMPTY: Self = Self {
        nearest: f32::INFINITY,
        farthest: f32::NEG_INFINITY,
    };
}

impl ModelView {
    /// A view without any surface.
    pub fn new(camera: &Intrinsics, world_from_camera: &Pose) -> Self {
        let mut view = Self {
            camera: *camera,
            world_from_camera: *world_from_camera,
            surfels: Vec::new(),
            min_weight: 0.0,
            ranges: Vec::new(),
        };
        view.reset(camera, world_from_camera);
        view
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.camera.width() as usize
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.camera.height() as usize
    }

    /// The surfel of column `x`, row `y`.
    ///
    /// # Panics
    /// When the pixel lies outside the image.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> &Surfel {
        assert!(x < self.width(), "column {x} of {}", self.width());
        &self.surfels[y * self.width() + x]
    }

    /// Number of pixels with a surface.
    pub fn surface_count(&self) -> usize {
        self.surfels.iter().filter(|s| s.is_surface()).count()
    }

    /// Takes another camera and place; surfels keep what they held where the size stays.
    pub(crate) fn reset(&mut self, camera: &Intrinsics, world_from_camera: &Pose) {
        self.camera = *camera;
        self.world_from_camera = *world_from_camera;
        let count = self.width() * self.height();
        self.surfels.resize(count, Surfel::NONE);
    }
}
