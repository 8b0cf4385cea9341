//! A depth image as points, coarse to fine.
//!
//! A point of the half size is the mean of those of its four points that are one surface: a mean of points of
//! a plane lies in the plane, whichever of them it is made of, where a mean depth at the middle of the pixel does not
//! (off by centimetres on a slanted wall in an eighth of the size). Coarser sizes take every second and fourth of
//! these points: alignment averages anyway, and what is not averaged cannot be biased.

use geometry::{DVec3, Intrinsics};
use imaging::pyramid::agreeing;
use imaging::{DepthImage, DepthTolerance, Image};
use rayon::prelude::*;

use super::noise::DepthNoise;
use crate::kernels::icp::{PointTile, TILE_POINTS};

/// Fewest columns of a coarser size.
const LEAST_COLUMNS: u32 = 40;
/// Half-size rows of one parallel task.
const BAND_ROWS: usize = 15;

/// Points of one size, one place per pixel in scan order; z is NaN where nothing was measured.
#[derive(Debug, Default)]
pub struct PointGrid {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    weight: Vec<f32>,
    measured_count: usize,
}

impl PointGrid {
    fn new(count: usize) -> Self {
        Self {
            x: vec![0.0; count],
            y: vec![0.0; count],
            z: vec![f32::NAN; count],
            weight: vec![0.0; count],
            measured_count: 0,
        }
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.z.len()
    }

    /// Whether there are no places.
    pub fn is_empty(&self) -> bool {
        self.z.is_empty()
    }

    /// Number of measured points.
    pub fn measured_count(&self) -> usize {
        self.measured_count
    }

    /// Depth of each place, metres; NaN where nothing was measured.
    pub fn depth(&self) -> &[f32] {
        &self.z
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

    fn measured(&self) -> impl Iterator<Item = DVec3> {
        self.x
            .iter()
            .zip(&self.y)
            .zip(&self.z)
            .filter(|(_, z)| z.is_finite())
            .map(|((&x, &y), &z)| DVec3::new(x.into(), y.into(), z.into()))
    }
}

/// One size of a frame.
#[derive(Debug)]
pub struct PointLevel {
    /// Pinhole camera of this size.
    pub camera: Intrinsics,
    /// Its points.
    pub points: PointGrid,
}

/// Where the points of a frame lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Mean, live camera axes, metres.
    pub center: DVec3,
    /// Root mean square distance from it, metres.
    pub radius: f64,
}

/// Half, quarter and eighth size of a frame. Buffers are kept from frame to frame.
#[derive(Debug)]
pub struct PointPyramid {
    full: Intrinsics,
    levels: Vec<PointLevel>,
    depth: DepthImage,
    extent: Option<Extent>,
    tolerance: DepthTolerance,
    noise: DepthNoise,
}

impl PointPyramid {
    /// For depth images of `camera`, a pinhole; `level_count` sizes below the full one, fewer where images would
    /// become narrower than 40 pixels, but at least one.
    pub fn new(camera: &Intrinsics, level_count: usize, noise: DepthNoise) -> Self {
        let mut levels: Vec<PointLevel> = Vec::new();
        let mut finer = *camera;
        while let Some(half) = half_camera(&finer) {
            if levels.len() >= level_count.max(1)
                || (!levels.is_empty() && half.width() < LEAST_COLUMNS)
            {
                break;
            }
            levels.push(PointLevel {
                camera: half,
                points: PointGrid::new(half.width() as usize * half.height() as usize),
            });
            finer = half;
        }
        let (width, height) = levels.first().map_or((0, 0), |level| {
            (level.camera.width(), level.camera.height())
        });
        Self {
            full: *camera,
            levels,
            depth: Image::new(width, height, imaging::NO_DEPTH),
            extent: None,
            tolerance: DepthTolerance::default(),
            noise,
        }
    }

    /// Half size first.
    pub fn levels(&self) -> &[PointLevel] {
        &self.levels
    }

    /// Half-size depth, metres, 0 = no measurement.
    pub fn depth(&self) -> &DepthImage {
        &self.depth
    }

    /// Where the points lie; `None` without any.
    pub fn extent(&self) -> Option<Extent> {
        self.extent
    }

    /// Takes a full-size depth image, metres along z, without distortion; its size must be that of the camera.
    pub fn load(&mut self, depth: &DepthImage) {
        assert!(
            depth.width() == self.full.width() && depth.height() == self.full.height(),
            "a depth image of the camera's size"
        );
        let Some((finest, coarser)) = self.levels.split_first_mut() else {
            return;
        };
        let rules = BlockRules {
            focal: self.full.focal().as_vec2().to_array(),
            center: self.full.center().as_vec2().to_array(),
            tolerance: self.tolerance,
            noise: self.noise,
        };
        load_finest(depth, &rules, finest, &mut self.depth);
        let width = finest.camera.width() as usize;
        for (index, level) in coarser.iter_mut().enumerate() {
            take_every(&finest.points, width, 2 << index, level);
        }
        self.extent = extent(&self.levels[self.levels.len().min(2) - 1].points);
    }
}

/// The camera of a half-size image (see [`imaging::pyramid`]); `None` when a side would vanish or the rest is
/// no camera.
pub fn half_camera(camera: &Intrinsics) -> Option<Intrinsics> {
    let (focal, center) = (camera.focal() / 2.0, (camera.center() + 0.5) / 2.0 - 0.5);
    let (width, height) = (camera.width() / 2, camera.height() / 2);
    Intrinsics::pinhole(width, height, focal.x, focal.y, center.x, center.y).ok()
}

fn extent(points: &PointGrid) -> Option<Extent> {
    let count = points.measured_count as f64;
    if points.measured_count == 0 {
        return None;
    }
    let center = points.measured().sum::<DVec3>() / count;
    let square: f64 = points
        .measured()
        .map(|point| (point - center).length_squared())
        .sum();
    Some(Extent {
        center,
        radius: (square / count).sqrt(),
    })
}

struct BlockRules {
    focal: [f32; 2],
    center: [f32; 2],
    tolerance: DepthTolerance,
    noise: DepthNoise,
}

/// A row of one size, to be written.
struct RowOut<'a> {
    x: &'a mut [f32],
    y: &'a mut [f32],
    z: &'a mut [f32],
    weight: &'a mut [f32],
    depth: &'a mut [f32],
}

fn load_finest(
    depth: &DepthImage,
    rules: &BlockRules,
    level: &mut PointLevel,
    half: &mut DepthImage,
) {
    let width = level.camera.width() as usize;
    let band = width * BAND_ROWS;
    let points = &mut level.points;
    let measured: usize = points
        .x
        .par_chunks_mut(band)
        .zip(points.y.par_chunks_mut(band))
        .zip(points.z.par_chunks_mut(band))
        .zip(points.weight.par_chunks_mut(band))
        .zip(half.pixels_mut().par_chunks_mut(band))
        .enumerate()
        .map(|(index, ((((x, y), z), weight), depth_out))| {
            let rows = x
                .chunks_mut(width)
                .zip(y.chunks_mut(width))
                .zip(z.chunks_mut(width))
                .zip(weight.chunks_mut(width))
                .zip(depth_out.chunks_mut(width));
            rows.enumerate()
                .map(|(row, ((((x, y), z), weight), out))| {
                    let line = (2 * (index * BAND_ROWS + row)) as u32;
                    let out = RowOut {
                        x,
                        y,
                        z,
                        weight,
                        depth: out,
                    };
                    load_row(depth.row(line), depth.row(line + 1), line, rules, out)
                })
                .sum::<usize>()
        })
        .sum();
    points.measured_count = measured;
}

/// Means of the blocks of two rows, `line` and the one below; the number of measured ones.
fn load_row(top: &[f32], bottom: &[f32], line: u32, rules: &BlockRules, out: RowOut<'_>) -> usize {
    let mut measured = 0;
    let v = line as f32 - rules.center[1];
    for column in 0..out.z.len() {
        let u = 2.0 * column as f32 - rules.center[0];
        let block = [
            top[2 * column],
            top[2 * column + 1],
            bottom[2 * column],
            bottom[2 * column + 1],
        ];
        let low = block
            .iter()
            .fold(f32::INFINITY, |low, &d| if d < low { d } else { low });
        let high = block
            .iter()
            .fold(0.0, |high, &d| if d > high { d } else { high });
        // NaN fails the second test, where low and high do not show it.
        let sum = block[0] + block[1] + block[2] + block[3];
        let (right, down, z, count) =
            if low > 0.0 && sum.is_finite() && high - low <= rules.tolerance.at(low) {
                (block[1] + block[3], block[2] + block[3], sum, 4.0)
            } else {
                part_of(block, rules.tolerance)
            };
        if count == 0.0 {
            out.z[column] = f32::NAN;
            out.weight[column] = 0.0;
            out.depth[column] = imaging::NO_DEPTH;
            continue;
        }
        let share = 1.0 / count;
        let mean = z * share;
        out.x[column] = (u * z + right) * share / rules.focal[0];
        out.y[column] = (v * z + down) * share / rules.focal[1];
        out.z[column] = mean;
        out.weight[column] = rules.noise.weight(mean);
        out.depth[column] = mean;
        measured += 1;
    }
    measured
}

/// Sums over the samples of one surface: of depths in the right column, in the lower row, of all, and their number.
fn part_of(block: [f32; 4], tolerance: DepthTolerance) -> (f32, f32, f32, f32) {
    let agrees = agreeing(block, tolerance);
    let part: [f32; 4] = std::array::from_fn(|i| if agrees[i] { block[i] } else { 0.0 });
    let count = agrees.iter().filter(|&&agrees| agrees).count();
    (
        part[1] + part[3],
        part[2] + part[3],
        part.iter().sum(),
        count as f32,
    )
}

/// Every `stride`-th point of the finest size in both directions.
fn take_every(finest: &PointGrid, width: usize, stride: usize, level: &mut PointLevel) {
    let (columns, rows) = (
        level.camera.width() as usize,
        level.camera.height() as usize,
    );
    let points = &mut level.points;
    points.measured_count = 0;
    for row in 0..rows {
        for column in 0..columns {
            // From the middle of the pixels that are left out.
            let from = (row * stride + stride / 2) * width + column * stride + stride / 2;
            let to = row * columns + column;
            points.x[to] = finest.x[from];
            points.y[to] = finest.y[from];
            points.z[to] = finest.z[from];
            points.weight[to] = finest.weight[from];
            points.measured_count += usize::from(finest.z[from].is_finite());
        }
    }
}
