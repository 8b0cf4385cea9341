//! Normal equations of point-to-plane ICP between live points and a predicted model view.
//!
//! Each point is moved into the view, projected, paired with the surfel of its pixel and weighted by its
//! sensor noise, the square of the cosine it is seen under (hard-cases C13) and Geman-McClure (C08). The
//! unknown is (ω, t): a rotation about `center` in radians and a translation in metres; residual
//! r(ω, t) = n·(q + ω×(q − c) + t − s).
//!
//! Bound: per point 16 bytes of point and 32 of surfel, 48 bytes or 3 ns at 16 GB/s when nothing is cached;
//! a 320x240 view (2.4 MB) stays in L3. Arithmetic decides: about 40 operations to pair and 60 to accumulate
//! per point, 13 instructions a point with 8 lanes.
//!
//! Points are taken in tiles of [`TILE_POINTS`]; a tile is summed in f32 lanes of at most 128 terms
//! (vector) or in f64 (scalar), tiles are added in f64 in their order (C04): same bits for any number of
//! threads within one level, and within 1e-6 of the largest entry across levels.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use geometry::{DVec3, Pose};

use super::Level;
use crate::model_view::{ModelView, Surfel};

/// Points of one tile.
pub const TILE_POINTS: usize = 1024;
/// Least squared cosine between surface normal and ray: 80°, beyond it depth noise is amplified 6 times and
/// more (hard-cases C13).
const LEAST_COSINE_SQUARED: f32 = 0.03;
/// Standard deviations of the sensor within which a pair agrees.
pub const INLIER_SIGMAS: f32 = 3.0;
/// Nearest z of a moved point that is projected, metres (hard-cases A12).
const Z_NEAR: f32 = 0.01;

/// Points of one tile in live camera axes, metres.
#[derive(Clone, Copy)]
pub struct PointTile<'a> {
    /// To the right.
    pub x: &'a [f32],
    /// Down.
    pub y: &'a [f32],
    /// Forward.
    pub z: &'a [f32],
    /// 1/σ² of the depth, 1/m².
    pub weight: &'a [f32],
}

/// A predicted view to pair with.
#[derive(Clone, Copy)]
pub struct ModelPixels<'a> {
    /// Row-major, `width · height`.
    pub surfels: &'a [Surfel],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths, pixels.
    pub focal: [f32; 2],
    /// Principal point, pixels.
    pub center: [f32; 2],
}

impl<'a> ModelPixels<'a> {
    /// The pixels of a view.
    pub fn of(view: &'a ModelView) -> Self {
        Self {
            surfels: &view.surfels,
            width: view.width(),
            height: view.height(),
            focal: view.camera.focal().as_vec2().to_array(),
            center: view.camera.center().as_vec2().to_array(),
        }
    }
}

/// Where the points are, and how residuals are weighted.
#[derive(Clone, Copy, Debug)]
pub struct IcpStep {
    /// Rows of the rotation view from live.
    pub rotation: [[f32; 3]; 3],
    /// Translation view from live, metres.
    pub translation: [f32; 3],
    /// Centre of the unknown rotation, view axes, metres.
    pub center: [f32; 3],
    /// Largest distance of a pair, metres.
    pub largest_distance: f32,
    /// Scale of Geman-McClure in standard deviations.
    pub robust_scale: f32,
}

impl IcpStep {
    /// At a pose of the live camera, turning about `center` (view axes, metres).
    pub fn at(
        view_from_live: &Pose,
        center: DVec3,
        largest_distance: f32,
        robust_scale: f32,
    ) -> Self {
        let rows = view_from_live.matrix().transpose();
        Self {
            rotation: [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array()),
            translation: view_from_live.translation().as_vec3().to_array(),
            center: center.as_vec3().to_array(),
            largest_distance,
            robust_scale,
        }
    }
}

/// Sums over points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IcpSums {
    /// Upper triangle by rows of Σ w J Jᵀ with J = [(q − c) × n, n].
    pub hessian: [f64; 21],
    /// Σ w r J.
    pub gradient: [f64; 6],
    /// Σ of u²/(u² + scale²) over the pairs, u the residual in standard deviations: 0 to 1 each.
    pub cost: f64,
    /// Points that fell on a surfel, near or far.
    pub met_count: u32,
    /// Points that were paired.
    pub pair_count: u32,
    /// Pairs within [`INLIER_SIGMAS`] standard deviations.
    pub inlier_count: u32,
}

impl IcpSums {
    /// Nothing summed.
    pub const ZERO: Self = Self {
        hessian: [0.0; 21],
        gradient: [0.0; 6],
        cost: 0.0,
        met_count: 0,
        pair_count: 0,
        inlier_count: 0,
    };

    /// Adds another tile.
    pub fn add(&mut self, other: &Self) {
        for (sum, value) in self.hessian.iter_mut().zip(&other.hessian) {
            *sum += value;
        }
        for (sum, value) in self.gradient.iter_mut().zip(&other.gradient) {
            *sum += value;
        }
        self.cost += other.cost;
        self.met_count += other.met_count;
        self.pair_count += other.pair_count;
        self.inlier_count += other.inlier_count;
    }
}

/// Sums over one tile.
///
/// # Panics
/// When the slices of the tile differ in length or hold more than [`TILE_POINTS`], when the view has not
/// `width · height` surfels, or more than 2²⁴.
pub fn sum_tile(
    level: Level,
    points: PointTile<'_>,
    model: ModelPixels<'_>,
    step: &IcpStep,
) -> IcpSums {
    // The vector kernel's reads rest on these lines.
    let count = points.x.len();
    assert!(count <= TILE_POINTS);
    assert!(points.y.len() == count && points.z.len() == count && points.weight.len() == count);
    assert_eq!(model.surfels.len(), model.width * model.height);
    assert!(model.surfels.len() <= 1 << 24);
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::sum_tile(points, model, step),
        _ => scalar::sum_tile(points, model, step),
    }
}
