//! A depth image as packed points, coarse to fine.

use geometry::{DVec3, Intrinsics};
use imaging::{DepthImage, DepthTolerance, Image};
use rayon::prelude::*;

use super::noise::DepthNoise;
use crate::kernels::icp::{PointTile, TILE_POINTS};

/// Fewest columns of a level.
const LEAST_COLUMNS: u32 = 40;

/// The measured pixels of one level, in scan order.
#[derive(Debug, Default)]
pub struct PackedPoints {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    weight: Vec<f32>,
}

impl PackedPoints {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether nothing was measured.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Tiles of [`TILE_POINTS`], the last one shorter.
    pub fn tile(&self, index: usize) -> PointTile<'_> {
        let range = index * TILE_POINTS..((index + 1) * TILE_POINTS).min(self.len());
        PointTile {
            x: &self.x[range.clone()],
            y: &self.y[range.clone()],
            z: &self.z[range.clone()],
            weight: &self.weight[range],
        }
    }

    /// Number of tiles.
    pub fn tile_count(&self) -> usize {
        self.len().div_ceil(TILE_POINTS)
    }

    /// Mean and root mean square distance from it, metres; `None` without points.
    pub fn centroid(&self) -> Option<(DVec3, f64)> {
        if self.is_empty() {
            return None;
        }
        let mean = |values: &[f32]| {
            values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
        };
        let center = DVec3::new(mean(&self.x), mean(&self.y), mean(&self.z));
        let spread = |values: &[f32], at: f64| {
            let square = |&v: &f32| (f64::from(v) - at) * (f64::from(v) - at);
            values.iter().map(square).sum::<f64>() / values.len() as f64
        };
        let square = spread(&self.x, center.x) + spread(&self.y, center.y) + spread(&self.z, center.z);
        Some((center, square.sqrt()))
    }

    /// Packs the measured pixels of `depth` (metres, pinhole `camera`).
    fn pack(&mut self, depth: &DepthImage, camera: &Intrinsics, noise: &DepthNoise) {
        for column in [&mut self.x, &mut self.y, &mut self.z, &mut self.weight] {
            column.clear();
        }
        let (focal, center) = (camera.focal().as_vec2(), camera.center().as_vec2());
        for line in 0..depth.height() {
            let slope_y = (line as f32 - center.y) / focal.y;
            for (column, &z) in depth.row(line).iter().enumerate() {
                if imaging::is_measured(z) {
                    self.x.push((column as f32 - center.x) / focal.x * z);
                    self.y.push(slope_y * z);
                    self.z.push(z);
                    self.weight.push(noise.weight(z));
                }
            }
        }
    }

    fn reserve(&mut self, count: usize) {
        for column in [&mut self.x, &mut self.y, &mut self.z, &mut self.weight] {
            column.reserve(count.saturating_sub(column.len()));
        }
    }
}

/// One size of a depth image.
#[derive(Debug)]
pub struct PointLevel {
    /// Pinhole camera of this size.
    pub camera: Intrinsics,
    /// Metres, 0 = no measurement.
    pub depth: DepthImage,
    /// Its measured pixels.
    pub points: PackedPoints,
}

/// Half, quarter and eighth size of a depth image, with points. Buffers are kept from frame to frame.
#[derive(Debug)]
pub struct PointPyramid {
    levels: Vec<PointLevel>,
    tolerance: DepthTolerance,
    noise: DepthNoise,
}

impl PointPyramid {
    /// For depth images of `camera`, a pinhole; `level_count` sizes below the full one, fewer where images would
    /// become narrower than 40 pixels, but at least one.
    pub fn new(camera: &Intrinsics, level_count: usize, noise: DepthNoise) -> Self {
        let mut levels = Vec::new();
        let mut finer = *camera;
        while let Some(half) = half_camera(&finer) {
            if levels.len() >= level_count.max(1)
                || (!levels.is_empty() && half.width() < LEAST_COLUMNS)
            {
                break;
            }
            let mut points = PackedPoints::default();
            points.reserve(half.width() as usize * half.height() as usize);
            levels.push(PointLevel {
                camera: half,
                depth: Image::new(half.width(), half.height(), 0.0),
                points,
            });
            finer = half;
        }
        Self {
            levels,
            tolerance: DepthTolerance::default(),
            noise,
        }
    }

    /// Half size first.
    pub fn levels(&self) -> &[PointLevel] {
        &self.levels
    }

    /// Takes a full-size depth image, metres along z, without distortion.
    pub fn load(&mut self, depth: &DepthImage) {
        for index in 0..self.levels.len() {
            let (finer, rest) = self.levels.split_at_mut(index);
            let source = finer.last().map_or(depth, |level| &level.depth);
            half_rows(source, &mut rest[0].depth, self.tolerance);
        }
        let noise = self.noise;
        self.levels
            .par_iter_mut()
            .for_each(|level| level.points.pack(&level.depth, &level.camera, &noise));
    }
}

/// The camera of a half-size image (see [`imaging::pyramid`]); `None` when a side would vanish or the rest is
/// no camera.
pub fn half_camera(camera: &Intrinsics) -> Option<Intrinsics> {
    let (focal, center) = (camera.focal() / 2.0, (camera.center() + 0.5) / 2.0 - 0.5);
    let (width, height) = (camera.width() / 2, camera.height() / 2);
    Intrinsics::pinhole(width, height, focal.x, focal.y, center.x, center.y).ok()
}

fn half_rows(depth: &DepthImage, half: &mut DepthImage, tolerance: DepthTolerance) {
    let width = half.width() as usize;
    half.pixels_mut()
        .par_chunks_mut(width * 16)
        .enumerate()
        .for_each(|(band, rows)| {
            for (row, out) in rows.chunks_mut(width).enumerate() {
                let line = 2 * (band * 16 + row) as u32;
                imaging::pyramid::half_depth_row(depth.row(line), depth.row(line + 1), tolerance, out);
            }
        });
}
