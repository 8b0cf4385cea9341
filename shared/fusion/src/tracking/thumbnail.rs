//! Small blurred copies of a frame: for fast rotation, and to recognise a place.

use geometry::{DMat3, DVec3, Intrinsics, rotation};
use imaging::{DepthImage, Image};

/// Columns and rows of a thumbnail of luminance.
pub const GREY_SIZE: [u32; 2] = [80, 60];
/// Columns and rows of a thumbnail of depth.
pub const DEPTH_SIZE: [u32; 2] = [40, 30];
/// Most steps of the rotation.
const STEPS: usize = 12;
/// Step that ends the search, radians.
const LEAST_STEP: f64 = 1e-4;
/// Least share of pixels that both thumbnails must know.
const LEAST_OVERLAP: f64 = 0.4;

/// A frame at the size of a stamp.
#[derive(Clone, Debug)]
pub struct Thumbnail {
    /// Blurred luminance with mean 0 and standard deviation 1; NaN = unknown. Empty without a photograph.
    pub grey: Vec<f32>,
    /// Median-like inverse depth, 1/metres; 0 = unknown.
    pub inverse_depth: Vec<f32>,
}

impl Default for Thumbnail {
    fn default() -> Self {
        let [columns, rows] = DEPTH_SIZE;
        Self {
            grey: Vec::with_capacity((GREY_SIZE[0] * GREY_SIZE[1]) as usize),
            inverse_depth: vec![0.0; (columns * rows) as usize],
        }
    }
}

impl Thumbnail {
    /// Takes the smallest size of a frame. `grey`: luminance, 0 = unknown; `depth`: metres.
    pub fn load(&mut self, depth: &DepthImage, grey: Option<&Image<f32>>) {
        let [columns, rows] = DEPTH_SIZE;
        for (place, out) in self.inverse_depth.iter_mut().enumerate() {
            let (column, row) = (place as u32 % columns, place as u32 / columns);
            let mut sum = 0.0_f32;
            let mut count = 0.0_f32;
            for_block(depth, [column, row], DEPTH_SIZE, |z| {
                if imaging::is_measured(z) {
                    sum += 1.0 / z;
                    count += 1.0;
                }
            });
            *out = if count > 0.0 { sum / count } else { 0.0 };
        }
        debug_assert_eq!(self.inverse_depth.len(), (columns * rows) as usize);
        self.grey.clear();
        if let Some(grey) = grey {
            let [columns, rows] = GREY_SIZE;
            for row in 0..rows {
                for column in 0..columns {
                    let (mut sum, mut count) = (0.0_f32, 0.0_f32);
                    for_block(grey, [column, row], GREY_SIZE, |value| {
                        if value > 0.0 {
                            sum += value;
                            count += 1.0;
                        }
                    });
                    self.grey.push(if count > 0.0 {
                        (sum / count).sqrt()
                    } else {
                        f32::NAN
                    });
                }
            }
            blur(&mut self.grey, columns as usize);
            standardise(&mut self.grey);
        }
    }

    /// How unlike two thumbnails are: mean absolute difference of what both know, 0 = alike; infinite where they
    /// share too little.
    pub fn difference(&self, other: &Self) -> f64 {
        let (mut sum, mut count) = (0.0_f64, 0_u32);
        for (&one, &two) in self.inverse_depth.iter().zip(&other.inverse_depth) {
            if one > 0.0 && two > 0.0 {
                sum += f64::from((one - two).abs().min(0.5));
                count += 1;
            }
        }
        if f64::from(count) < LEAST_OVERLAP * self.inverse_depth.len() as f64 {
            return f64::INFINITY;
        }
        let depth = sum / f64::from(count);
        let (mut sum, mut count) = (0.0_f64, 0_u32);
        for (&one, &two) in self.grey.iter().zip(&other.grey) {
            let difference = f64::from((one - two).abs());
            if difference.is_finite() {
                sum += difference.min(2.0);
                count += 1;
            }
        }
        // 0.1/m of inverse depth is as telling as half a standard deviation of luminance.
        let grey = if count > 0 {
            sum / f64::from(count)
        } else {
            0.0
        };
        depth + 0.2 * grey
    }
}

/// The rotation `now_from_before` of a turning camera, from two thumbnails of its photographs.
///
/// Gauss-Newton on SO(3) from `start`; `camera` is any size of the photographs' camera, its distortion is
/// ignored. Residuals are clipped, so that things that moved do not steer. `None` without overlap, or
/// where the result explains the picture no better than the start.
pub fn rotation_between(
    before: &Thumbnail,
    now: &Thumbnail,
    camera: &Intrinsics,
    start: geometry::DQuat,
) -> Option<geometry::DQuat> {
    let [columns, rows] = GREY_SIZE;
    if before.grey.is_empty() || now.grey.is_empty() {
        return None;
    }
    let shrink = f64::from(camera.width()) / f64::from(columns);
    let focal = camera.focal() / shrink;
    let center = (camera.center() + 0.5) / shrink - 0.5;
    let mut turn = start;
    let mut best: Option<(f64, geometry::DQuat)> = None;
    let mut first_cost = f64::INFINITY;
    for step in 0..STEPS {
        let m = DMat3::from_quat(turn);
        let mut hessian = DMat3::ZERO;
        let mut gradient = DVec3::ZERO;
        let (mut cost, mut count) = (0.0, 0_u32);
        for row in 1..rows - 1 {
            for column in 1..columns - 1 {
                let ray = DVec3::new(
                    (f64::from(column) - center.x) / focal.x,
                    (f64::from(row) - center.y) / focal.y,
                    1.0,
                );
                let q = m * ray;
                if q.z < 0.1 {
                    continue;
                }
                let u = focal.x * q.x / q.z + center.x;
                let v = focal.y * q.y / q.z + center.y;
                let Some((value, du, dv)) = sampled(&now.grey, u, v) else {
                    continue;
                };
                let residual = value - f64::from(before.grey[(row * columns + column) as usize]);
                if !residual.is_finite() {
                    continue;
                }
                let weight = (0.5 / residual.abs().max(0.5)).min(1.0);
                let (gu, gv) = (du * focal.x / q.z, dv * focal.y / q.z);
                let g = DVec3::new(gu, gv, -(gu * q.x + gv * q.y) / q.z);
                let j = q.cross(g);
                hessian += outer(j) * weight;
                gradient += j * (residual * weight);
                cost += residual.abs().min(1.0);
                count += 1;
            }
        }
        if f64::from(count) < LEAST_OVERLAP * f64::from(columns * rows) {
            break;
        }
        cost /= f64::from(count);
        if step == 0 {
            first_cost = cost;
        }
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, turn));
        } else {
            break;
        }
        let damped = hessian + DMat3::from_diagonal(DVec3::splat(1e-6 * trace(hessian) + 1e-12));
        let change = -(damped.inverse() * gradient);
        if !change.is_finite() || change.length() > 0.3 {
            break;
        }
        turn = (rotation::exp(change) * turn).normalize();
        if change.length() < LEAST_STEP {
            break;
        }
    }
    best.filter(|(cost, _)| *cost < 0.98 * first_cost)
        .map(|(_, turn)| turn)
}

fn trace(m: DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

fn sampled(grey: &[f32], u: f64, v: f64) -> Option<(f64, f64, f64)> {
    let [columns, rows] = GREY_SIZE.map(f64::from);
    let inside = u >= 0.0 && v >= 0.0 && u < columns - 1.0 && v < rows - 1.0;
    if !inside {
        return None;
    }
    let (x, y) = (u as usize, v as usize);
    let (fx, fy) = (u - x as f64, v - y as f64);
    let stride = GREY_SIZE[0] as usize;
    let at = |x: usize, y: usize| f64::from(grey[y * stride + x]);
    let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
    let (left, right) = (a + (c - a) * fy, b + (d - b) * fy);
    let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
    let value = left + (right - left) * fx;
    value
        .is_finite()
        .then_some((value, right - left, lower - upper))
}

/// Calls `take` for the pixels of an image that a pixel of a `size` thumbnail covers.
fn for_block(image: &Image<f32>, place: [u32; 2], size: [u32; 2], mut take: impl FnMut(f32)) {
    let edges = |at: u32, size: u32, full: u32| {
        let first = (u64::from(at) * u64::from(full) / u64::from(size)) as u32;
        let end = (u64::from(at + 1) * u64::from(full) / u64::from(size)) as u32;
        first..end.max(first + 1).min(full)
    };
    for y in edges(place[1], size[1], image.height()) {
        let row = image.row(y);
        for x in edges(place[0], size[0], image.width()) {
            take(row[x as usize]);
        }
    }
}

/// A binomial blur of width 3, along rows and then columns, twice; what is unknown stays unknown.
fn blur(values: &mut [f32], columns: usize) {
    for _ in 0..2 {
        for row in values.chunks_mut(columns) {
            smooth(row, 1);
        }
        for column in 0..columns {
            smooth(&mut values[column..], columns);
        }
    }
}

fn smooth(values: &mut [f32], stride: usize) {
    let mut before = values[0];
    let mut place = stride;
    while place + stride < values.len() {
        let (here, after) = (values[place], values[place + stride]);
        let mean = 0.25 * before + 0.5 * here + 0.25 * after;
        before = here;
        if mean.is_finite() {
            values[place] = mean;
        }
        place += stride;
    }
}

fn standardise(values: &mut [f32]) {
    let known = || {
        values
            .iter()
            .filter(|v| v.is_finite())
            .map(|&v| f64::from(v))
    };
    let count = known().count();
    if count == 0 {
        return;
    }
    let mean = known().sum::<f64>() / count as f64;
    let variance = known().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count as f64;
    let scale = 1.0 / variance.sqrt().max(1e-3);
    for value in values.iter_mut() {
        *value = ((f64::from(*value) - mean) * scale) as f32;
    }
}
