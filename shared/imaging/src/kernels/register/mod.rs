//! Depth pixels into a colour camera: where they fall, what hides them, what colour they have.
//!
//! Bound: a pixel reads its depth twice and four colour samples and writes 8 bytes, 14 MB a VGA frame or 0.5 ms at
//! 28 GB/s of one core. Arithmetic decides: a projection with one division, done twice because storing it costs
//! more, and a bilinear sample of four lanes. The vector level projects eight columns at once and samples all lanes
//! of two columns at once; both levels do the same IEEE operations in the same order, so they agree bit for bit.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod scalar;
#[cfg(test)]
mod tests;

use geometry::{Intrinsics, Pose};

use super::Level;
use crate::linear_pixel::LinearPixel;

/// A depth camera without distortion seen from a colour camera, in f32: coordinates stay within 1e-3 pixels for
/// images up to 4096 pixels wide.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection {
    /// Direction of depth pixel (0, 0) at z = 1, and its step per column and row, colour camera axes.
    start: [f32; 3],
    step: [[f32; 2]; 3],
    /// The depth camera's centre, colour camera axes, metres.
    center_of_depth: [f32; 3],
    focal: [f32; 2],
    center: [f32; 2],
    /// k1, k2, p1, p2, k3.
    distortion: [f32; 5],
    is_distorted: bool,
    /// Square of the normalised radius at which the distortion folds.
    fold_square: f32,
    /// Largest coordinates that still belong to a colour pixel (exclusive).
    end: [f32; 2],
}

impl Projection {
    /// Of pixels of `depth`, whose distortion is not looked at, into `color`.
    pub(crate) fn new(depth: &Intrinsics, color: &Intrinsics, color_from_depth: &Pose) -> Self {
        let rotation = color_from_depth.matrix();
        let (focal, center) = (depth.focal(), depth.center());
        let ray = |u: f64, v: f64| {
            let direction = [(u - center.x) / focal.x, (v - center.y) / focal.y, 1.0];
            rotation * geometry::DVec3::from_array(direction)
        };
        let (start, column, row) = (ray(0.0, 0.0), ray(1.0, 0.0), ray(0.0, 1.0));
        let geometry::Distortion { k1, k2, p1, p2, k3 } = color.distortion();
        let fold = color.distortion().fold_radius();
        Self {
            start: start.to_array().map(|v| v as f32),
            step: std::array::from_fn(|axis| {
                [column, row].map(|ray| (ray[axis] - start[axis]) as f32)
            }),
            center_of_depth: color_from_depth.translation().to_array().map(|v| v as f32),
            focal: color.focal().to_array().map(|v| v as f32),
            center: color.center().to_array().map(|v| v as f32),
            distortion: [k1, k2, p1, p2, k3].map(|v| v as f32),
            is_distorted: !color.distortion().is_none(),
            fold_square: (fold * fold) as f32,
            end: [color.width() as f32 - 0.5, color.height() as f32 - 0.5],
        }
    }
}

/// Where the pixels of a depth row fall in the colour image.
#[derive(Clone, Debug, Default)]
pub(crate) struct ProjectedRow {
    /// Column, pixels, in [−0.5, width − 0.5).
    x: Vec<f32>,
    /// Row, likewise.
    y: Vec<f32>,
    /// 1 / z in the colour camera, 1/metres; 0 where there is no measurement or the camera does not see it.
    inverse_depth: Vec<f32>,
}

impl ProjectedRow {
    pub(crate) fn new(width: usize) -> Self {
        Self {
            x: vec![0.0; width],
            y: vec![0.0; width],
            inverse_depth: vec![0.0; width],
        }
    }
}

/// Projects row `v` of a depth image, metres.
///
/// # Panics
/// When `depth` is not as long as `projected`.
pub(crate) fn project_row(
    level: Level,
    projection: &Projection,
    v: usize,
    depth: &[f32],
    projected: &mut ProjectedRow,
) {
    assert!(depth.len() == projected.x.len());
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::project_row(projection, v, depth, projected),
        _ => scalar::project_row(projection, v, depth, projected),
    }
}

/// What is nearest in each cell of the colour image: inverse depth, 0 where nothing is.
#[derive(Clone, Debug, Default)]
pub(crate) struct NearestCells {
    columns: usize,
    /// 1 / side of a cell, 1/pixels.
    per_pixel: f32,
    inverse_depth: Vec<f32>,
}

impl NearestCells {
    /// For an image of `width` x `height` pixels in cells of `side` pixels.
    pub(crate) fn new(width: u32, height: u32, side: u32) -> Self {
        let (columns, rows) = (
            width.div_ceil(side) as usize,
            height.div_ceil(side) as usize,
        );
        Self {
            columns,
            per_pixel: 1.0 / side as f32,
            inverse_depth: vec![0.0; columns * rows],
        }
    }

    pub(crate) fn clear(&mut self) {
        self.inverse_depth.fill(0.0);
    }

    /// Enters a projected row.
    pub(crate) fn enter(&mut self, level: Level, row: &ProjectedRow) {
        match level {
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => avx2::enter_row(self, row),
            _ => scalar::enter_row(self, row),
        }
    }

    /// Keeps the nearer of both in each cell; `other` has the same cells.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (nearest, &other) in self.inverse_depth.iter_mut().zip(&other.inverse_depth) {
            *nearest = nearest.max(other);
        }
    }

    #[inline(always)]
    fn index(&self, x: f32, y: f32) -> usize {
        // Coordinates of seen points are at least −0.5: truncation is the cell.
        let cell = |at: f32| ((at + 0.5) * self.per_pixel) as i32 as usize;
        cell(y) * self.columns + cell(x)
    }
}

/// A colour image and what may hide parts of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen<'a> {
    /// Colour, rows of `width` pixels, `height` of them.
    pub(crate) color: &'a [LinearPixel],
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Nearest things, and by how much of inverse depth they must be nearer to hide a point: 1/metres, and as a
    /// share of the point's own.
    pub(crate) hiding: Option<(&'a NearestCells, [f32; 2])>,
}

impl Seen<'_> {
    #[inline(always)]
    fn is_hidden(&self, x: f32, y: f32, inverse_depth: f32) -> bool {
        let Some((cells, [absolute, share])) = self.hiding else {
            return false;
        };
        let nearest = cells.inverse_depth.get(cells.index(x, y)).copied();
        nearest.unwrap_or(0.0) - inverse_depth > absolute.max(share * inverse_depth)
    }
}

/// The colours of a projected row.
///
/// # Panics
/// When `pixels` is not as long as `row`, or the image is not `width · height` long.
pub(crate) fn sample_row(
    level: Level,
    seen: &Seen,
    row: &ProjectedRow,
    pixels: &mut [LinearPixel],
) {
    // The vector kernel's reads rest on these lines.
    assert!(seen.color.len() == seen.width * seen.height);
    assert!(pixels.len() == row.x.len());
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => avx2::sample_row(seen, row, pixels),
        _ => scalar::sample_row(seen, row, pixels),
    }
}
