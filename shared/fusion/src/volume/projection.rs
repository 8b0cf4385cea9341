//! A camera relative to a volume, in f64 until it is near.

use geometry::{DMat3, DVec2, DVec3, Intrinsics, Pose};

use super::allocate::BlockRays;
use super::config::VolumeConfig;
use super::key::BLOCK_EDGE;
use crate::kernels::integrate::BlockView;

/// Longest way between two samples of a ray's band, in block edges: no layer of blocks is stepped over.
const LONGEST_SAMPLE_STEP: f32 = 0.75;

/// An ideal pinhole relative to the origin of a volume.
pub(super) struct Projection {
    camera_from_volume: DMat3,
    /// Camera centre relative to the volume origin, metres.
    eye: DVec3,
    focal: DVec2,
    center: DVec2,
    /// Columns and rows.
    size: DVec2,
    voxel_size: f64,
    /// Steps of the homogeneous pixel per voxel along x, y, z: the same in every block.
    step: [[f32; 3]; 3],
}

impl Projection {
    pub(super) fn new(
        camera: &Intrinsics,
        world_from_camera: &Pose,
        config: &VolumeConfig,
    ) -> Self {
        let mut projection = Self {
            camera_from_volume: world_from_camera.matrix().transpose(),
            eye: world_from_camera.translation() - config.origin,
            focal: camera.focal(),
            center: camera.center(),
            size: DVec2::new(f64::from(camera.width()), f64::from(camera.height())),
            voxel_size: f64::from(config.voxel_size),
            step: [[0.0; 3]; 3],
        };
        projection.step = [0, 1, 2].map(|axis| {
            let along = projection.camera_from_volume.col(axis);
            projection.homogeneous(along * projection.voxel_size)
        });
        projection
    }

    /// Homogeneous pixel (u·z, v·z, z) of a vector in camera axes.
    fn homogeneous(&self, v: DVec3) -> [f32; 3] {
        let u = self.focal.x * v.x + self.center.x * v.z;
        let w = self.focal.y * v.y + self.center.y * v.z;
        [u as f32, w as f32, v.z as f32]
    }

    /// The view of a block, without depth bounds.
    pub(super) fn block_view(&self, block: [i32; 3]) -> BlockView {
        let first_voxel =
            DVec3::from_array(block.map(|c| f64::from(c) * BLOCK_EDGE as f64)) * self.voxel_size;
        let from_eye = first_voxel - self.eye;
        let middle = from_eye + DVec3::splat(3.5 * self.voxel_size);
        let to_camera = (-middle).normalize_or_zero();
        BlockView {
            start: self.homogeneous(self.camera_from_volume * from_eye),
            step: self.step,
            to_camera: to_camera.as_vec3().to_array(),
            farthest: f32::INFINITY,
            nearest: f32::NEG_INFINITY,
            is_inside: false,
        }
    }

    /// The pixel rays in block units.
    pub(super) fn block_rays(&self, config: &VolumeConfig) -> BlockRays {
        let block_size = self.voxel_size * BLOCK_EDGE as f64;
        let eye = self.eye / block_size;
        let anchor = eye.floor();
        let volume_from_camera = self.camera_from_volume.transpose();
        let ray = |x: f64, y: f64, z: f64| {
            (volume_from_camera * DVec3::new(x / self.focal.x, y / self.focal.y, z) / block_size)
                .as_vec3a()
        };
        let corners = [0, 1, 2, 3].map(|n| {
            let (x, y) = (f64::from(n & 1), f64::from(n >> 1));
            ray(
                x * self.size.x - self.center.x,
                y * self.size.y - self.center.y,
                1.0,
            )
        });
        let longest_ray = corners
            .into_iter()
            .fold(0.0, |longest: f32, ray| longest.max(ray.length()));
        let half_samples =
            (config.truncation() * longest_ray / LONGEST_SAMPLE_STEP).ceil() as usize;
        BlockRays {
            // A cast saturates: a camera beyond every block stays there and its requests are refused.
            anchor: anchor.to_array().map(|c| c as i32),
            eye: (eye - anchor).as_vec3a(),
            forward: ray(-self.center.x, -self.center.y, 1.0),
            right: ray(1.0, 0.0, 0.0),
            down: ray(0.0, 1.0, 0.0),
            truncation: config.truncation(),
            truncation_in_blocks: config.truncation_voxels / BLOCK_EDGE as f32,
            half_samples,
            sample_step: config.truncation() / half_samples as f32,
            depth_step: config.depth_step,
        }
    }
}
