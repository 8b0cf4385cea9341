//! The photometric term: what the model looks like against the live photograph.
//!
//! Surfels with a known luminance are moved into the live colour camera, wherever it sits, so the two images
//! need not be registered. Residual: r = I(π(x)) − (a m + b), with the gain a and offset b of the frame
//! estimated along (hard-cases C09). A highlight that wandered is brighter than the model, never darker:
//! positive residuals lose weight by Geman-McClure, negative ones by Huber.

use geometry::{DVec3, Intrinsics, Pose};
use imaging::Image;
use rayon::prelude::*;

use super::equations::NormalEquations;
use crate::model_view::{ModelView, Surfel};

/// Rows of the view in one parallel task, and in one f32 sum. Fixed, so that sums do not depend on threads.
const BAND_ROWS: usize = 8;
/// Unknowns: six of motion, gain, offset.
const UNKNOWNS: usize = 8;
/// Gradient of a half-size photograph, radiance per pixel, below which a pixel says nothing: three standard
/// deviations of its noise (hard-cases C09).
const LEAST_GRADIENT: f32 = 3.0 * 0.002;
/// Gain and offset are kept near 1 and 0 with these standard deviations.
const GAIN_SIGMA: f64 = 0.3;
const OFFSET_SIGMA: f64 = 0.1;
/// Fewest pixels for a term.
const LEAST_COUNT: usize = 200;
/// Bounds of the spread of residuals, radiance.
const SIGMA_RANGE: std::ops::RangeInclusive<f32> = 0.004..=0.1;
/// Share of a photometric equation that is information of its own: residuals of neighbours are alike.
const INDEPENDENT_SHARE: f64 = 0.3;

/// A photograph as luminance, half size and smaller.
#[derive(Debug)]
pub struct GreyFrame {
    /// Pinhole or distorted camera of each size and its luminance; 0 or less = unknown or saturated.
    pub levels: Vec<(Intrinsics, Image<f32>)>,
    /// Colour camera from depth camera.
    pub color_from_depth: Pose,
}

impl GreyFrame {
    /// For photographs whose half size is `camera`, with up to `level_count` sizes.
    pub fn new(camera: &Intrinsics, color_from_depth: Pose, level_count: usize) -> Self {
        let mut levels = Vec::new();
        let mut size = Some(*camera);
        while let Some(camera) = size.filter(|_| levels.len() < level_count.max(1)) {
            levels.push((camera, Image::new(camera.width(), camera.height(), 0.0)));
            size = super::points::half_camera(&camera);
        }
        Self {
            levels,
            color_from_depth,
        }
    }

    /// The half-size luminance, to be filled before [`GreyFrame::finish`].
    pub fn finest_mut(&mut self) -> &mut Image<f32> {
        &mut self.levels[0].1
    }

    /// Makes the smaller sizes.
    pub fn finish(&mut self) {
        for index in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(index);
            half_grey(&finer[index - 1].1, &mut coarser[0].1);
        }
    }
}

/// Mean of the known of four.
fn half_grey(finer: &Image<f32>, half: &mut Image<f32>) {
    for y in 0..half.height() {
        let (top, bottom) = (finer.row(2 * y), finer.row(2 * y + 1));
        for (x, out) in half.row_mut(y).iter_mut().enumerate() {
            let block = [top[2 * x], top[2 * x + 1], bottom[2 * x], bottom[2 * x + 1]];
            let known = block.iter().filter(|&&v| v > 0.0);
            let (sum, count) = known.fold((0.0, 0.0), |(s, n), &v| (s + v, n + 1.0));
            *out = if count > 0.0 { sum / count } else { 0.0 };
        }
    }
}

/// The term at one pose.
#[derive(Clone, Copy, Debug)]
pub struct PhotometricTerm {
    /// Equations of motion with gain and offset eliminated, over the variance of the residuals.
    pub equations: NormalEquations,
    /// Root mean square residual, radiance.
    pub rms: f64,
    /// Pixels that count.
    pub count: usize,
}

/// What is carried from frame to frame: gain, offset, spread of residuals.
#[derive(Clone, Debug)]
pub struct Photometric {
    gain: f64,
    offset: f64,
    sigma: f32,
    bands: Vec<Sums<f32>>,
}

impl Default for Photometric {
    fn default() -> Self {
        Self {
            gain: 1.0,
            offset: 0.0,
            sigma: 0.05,
            bands: Vec::new(),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Sums<T> {
    hessian: [[T; UNKNOWNS]; UNKNOWNS],
    gradient: [T; UNKNOWNS],
    square: T,
    absolute: T,
    count: usize,
}

impl Sums<f32> {
    const ZERO: Self = Self {
        hessian: [[0.0; UNKNOWNS]; UNKNOWNS],
        gradient: [0.0; UNKNOWNS],
        square: 0.0,
        absolute: 0.0,
        count: 0,
    };
}

impl Sums<f64> {
    const ZERO: Self = Self {
        hessian: [[0.0; UNKNOWNS]; UNKNOWNS],
        gradient: [0.0; UNKNOWNS],
        square: 0.0,
        absolute: 0.0,
        count: 0,
    };

    fn add(&mut self, other: &Sums<f32>) {
        for (row, values) in self.hessian.iter_mut().zip(&other.hessian) {
            for (sum, value) in row.iter_mut().zip(values) {
                *sum += f64::from(*value);
            }
        }
        for (sum, value) in self.gradient.iter_mut().zip(&other.gradient) {
            *sum += f64::from(*value);
        }
        self.square += f64::from(other.square);
        self.absolute += f64::from(other.absolute);
        self.count += other.count;
    }
}

/// Poses and camera of one evaluation, in f32.
struct Geometry<'a> {
    /// Rows of the rotation colour from view.
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    center: [f32; 3],
    radius: f32,
    focal: [f32; 2],
    principal: [f32; 2],
    image: &'a Image<f32>,
    gain: f32,
    offset: f32,
    sigma: f32,
}

impl Photometric {
    /// The term for the live camera at `view_from_live`; unknown (ω R, t) about `center` (view axes, metres)
    /// with radius R `radius`. `level` picks the size of the photograph. `None` where too little is seen.
    pub fn equations(
        &mut self,
        view: &ModelView,
        grey: &GreyFrame,
        view_from_live: &Pose,
        center: DVec3,
        radius: f64,
        level: usize,
    ) -> Option<PhotometricTerm> {
        let level = level.min(grey.levels.len().checked_sub(1)?);
        let (camera, image) = &grey.levels[level];
        let color_from_view = grey.color_from_depth * view_from_live.inverse();
        let rows = color_from_view.matrix().transpose();
        let geometry = Geometry {
            rotation: [rows.x_axis, rows.y_axis, rows.z_axis].map(|r| r.as_vec3().to_array()),
            translation: color_from_view.translation().as_vec3().to_array(),
            center: center.as_vec3().to_array(),
            radius: radius as f32,
            focal: camera.focal().as_vec2().to_array(),
            principal: camera.center().as_vec2().to_array(),
            image,
            gain: self.gain as f32,
            offset: self.offset as f32,
            sigma: self.sigma,
        };
        let width = view.camera.width() as usize;
        // Fewer in smaller sizes of the photograph: neighbours say the same.
        let stride = 1 << level;
        let height = view.camera.height() as usize;
        self.bands
            .resize(height.div_ceil(BAND_ROWS), Sums::<f32>::ZERO);
        self.bands
            .par_iter_mut()
            .enumerate()
            .for_each(|(band, sums)| {
                *sums = Sums::<f32>::ZERO;
                for line in band * BAND_ROWS..((band + 1) * BAND_ROWS).min(height) {
                    if line % stride == 0 {
                        let row = &view.surfels[line * width..(line + 1) * width];
                        for surfel in row.iter().step_by(stride) {
                            sum_surfel(surfel, &geometry, sums);
                        }
                    }
                }
            });
        let mut total = Sums::<f64>::ZERO;
        for band in &self.bands {
            total.add(band);
        }
        self.finish(&mut total, level)
    }

    /// Eliminates gain and offset, and takes their step and the new spread.
    fn finish(&mut self, total: &mut Sums<f64>, level: usize) -> Option<PhotometricTerm> {
        if total.count < LEAST_COUNT {
            return None;
        }
        let mean_absolute = total.absolute / total.count as f64;
        let rms = (total.square / total.count as f64).sqrt();
        let variance = f64::from(self.sigma) * f64::from(self.sigma);
        total.hessian[6][6] += variance / (GAIN_SIGMA * GAIN_SIGMA);
        total.gradient[6] += variance * (self.gain - 1.0) / (GAIN_SIGMA * GAIN_SIGMA);
        total.hessian[7][7] += variance / (OFFSET_SIGMA * OFFSET_SIGMA);
        total.gradient[7] += variance * self.offset / (OFFSET_SIGMA * OFFSET_SIGMA);
        let [[aa, ab], [_, bb]] = [
            [total.hessian[6][6], total.hessian[6][7]],
            [0.0, total.hessian[7][7]],
        ];
        let determinant = aa * bb - ab * ab;
        if !(determinant > 1e-12 * aa * bb) {
            return None;
        }
        let inverse = [
            [bb / determinant, -ab / determinant],
            [-ab / determinant, aa / determinant],
        ];
        let mut equations = NormalEquations::ZERO;
        let scale = INDEPENDENT_SHARE * f64::from(1 << (2 * level)) / variance;
        for row in 0..6 {
            let coupling = [total.hessian[row][6], total.hessian[row][7]];
            let reduced: [f64; 2] =
                std::array::from_fn(|k| coupling[0] * inverse[0][k] + coupling[1] * inverse[1][k]);
            for column in 0..6 {
                let other = [total.hessian[column][6], total.hessian[column][7]];
                equations.hessian[row][column] = scale
                    * (total.hessian[row][column] - reduced[0] * other[0] - reduced[1] * other[1]);
            }
            equations.gradient[row] = scale
                * (total.gradient[row]
                    - reduced[0] * total.gradient[6]
                    - reduced[1] * total.gradient[7]);
        }
        let step: [f64; 2] = std::array::from_fn(|k| {
            -(inverse[k][0] * total.gradient[6] + inverse[k][1] * total.gradient[7])
        });
        self.gain = (self.gain + step[0]).clamp(0.2, 5.0);
        self.offset = (self.offset + step[1]).clamp(-0.5, 0.5);
        // Mean absolute of a normal distribution is 0.8 σ.
        self.sigma = ((mean_absolute / 0.8) as f32).clamp(*SIGMA_RANGE.start(), *SIGMA_RANGE.end());
        Some(PhotometricTerm {
            equations,
            rms,
            count: total.count,
        })
    }
}

fn sum_surfel(surfel: &Surfel, geometry: &Geometry<'_>, sums: &mut Sums<f32>) {
    if !(surfel.weight > 0.0 && surfel.grey > 0.0) {
        return;
    }
    let x = surfel.position;
    let c: [f32; 3] =
        std::array::from_fn(|r| dot(geometry.rotation[r], x) + geometry.translation[r]);
    if !(c[2] > 0.01) {
        return;
    }
    let inverse_z = 1.0 / c[2];
    let u = geometry.focal[0] * c[0] * inverse_z + geometry.principal[0];
    let v = geometry.focal[1] * c[1] * inverse_z + geometry.principal[1];
    let Some((value, [du, dv])) = sampled(geometry.image, u, v) else {
        return;
    };
    if du * du + dv * dv < LEAST_GRADIENT * LEAST_GRADIENT {
        return;
    }
    let residual = value - (geometry.gain * surfel.grey + geometry.offset);
    let u_residual = residual / geometry.sigma;
    let weight = if u_residual > 0.0 {
        let share = 4.0 / (4.0 + u_residual * u_residual);
        share * share
    } else {
        (1.345 / (-u_residual).max(1.345)).min(1.0)
    };
    // Derivative of the value by the point in colour axes, then in view axes.
    let (gu, gv) = (
        du * geometry.focal[0] * inverse_z,
        dv * geometry.focal[1] * inverse_z,
    );
    let in_color = [gu, gv, -(gu * c[0] + gv * c[1]) * inverse_z];
    let g: [f32; 3] = std::array::from_fn(|axis| {
        (0..3)
            .map(|r| geometry.rotation[r][axis] * in_color[r])
            .sum()
    });
    // The live camera moves by the step, so a point of the view moves the other way in it.
    let arm: [f32; 3] = std::array::from_fn(|axis| x[axis] - geometry.center[axis]);
    let turn = [
        arm[1] * g[2] - arm[2] * g[1],
        arm[2] * g[0] - arm[0] * g[2],
        arm[0] * g[1] - arm[1] * g[0],
    ];
    let r = geometry.radius;
    let row = [
        -turn[0] / r,
        -turn[1] / r,
        -turn[2] / r,
        -g[0],
        -g[1],
        -g[2],
        -surfel.grey,
        -1.0,
    ];
    // The whole square, lower triangle too: rows of eight are registers.
    for (sum, left) in sums.hessian.iter_mut().zip(row) {
        let weighted = weight * left;
        for (sum, right) in sum.iter_mut().zip(row) {
            *sum += weighted * right;
        }
    }
    let weighted = weight * residual;
    for (sum, value) in sums.gradient.iter_mut().zip(row) {
        *sum += weighted * value;
    }
    sums.square += weighted * residual;
    sums.absolute += residual.abs().min(3.0 * geometry.sigma);
    sums.count += 1;
}

/// Bilinear value and gradient per pixel, where all four pixels are known.
#[inline]
fn sampled(image: &Image<f32>, u: f32, v: f32) -> Option<(f32, [f32; 2])> {
    let inside =
        u >= 0.0 && v >= 0.0 && u < image.width() as f32 - 1.0 && v < image.height() as f32 - 1.0;
    if !inside {
        return None;
    }
    let (x, y) = (u as u32, v as u32);
    let (fx, fy) = (u - x as f32, v - y as f32);
    let (top, bottom) = (image.row(y), image.row(y + 1));
    let x = x as usize;
    let [a, b, c, d] = [top[x], top[x + 1], bottom[x], bottom[x + 1]];
    if !(a > 0.0 && b > 0.0 && c > 0.0 && d > 0.0) {
        return None;
    }
    let (left, right) = (a + (c - a) * fy, b + (d - b) * fy);
    let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
    Some((left + (right - left) * fx, [right - left, lower - upper]))
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
