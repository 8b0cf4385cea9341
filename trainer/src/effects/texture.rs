//! What the surface shows from all sides: median and low quantile of every vertex over the views, and what each view
//! shows beyond.

use effects::{Gate, ViewDependence, ViewResidual};
use geometry::robust;
use rayon::prelude::*;
use raytrace::{Hit, NO_TRIANGLE};

use super::views::{SurveyView, SurveyViews, bilinear};
use crate::stages::observe::Surface;

/// Fewest views of a vertex whose median means something.
const FEWEST_VIEWS: usize = 5;
/// Vertices that one task reduces.
const VERTICES_A_TASK: usize = 4096;
/// Least luminance at which a view's gain is read.
const LEAST_GREY: f32 = 0.02;

/// Luminance of every vertex over the views; NaN where too few views see it.
pub(super) struct Texture {
    /// Median.
    pub median: Vec<f32>,
    /// Lower decile: what the vertex shows without highlights.
    pub low: Vec<f32>,
}

/// Luminance of every vertex in a view; NaN where it is not seen.
fn seen(views: &SurveyViews, view: &SurveyView, surface: &Surface) -> Vec<f32> {
    let width = views.camera.width() as usize;
    let color_from_surface = view.surface_from_color.inverse();
    (0..surface.positions.len())
        .map(|vertex| {
            views
                .place(view, &color_from_surface, surface, vertex)
                .and_then(|at| bilinear(&view.grey, width, at, |value| [value]))
                .map_or(f32::NAN, |[value]| value)
        })
        .collect()
}

impl Texture {
    /// Reads the vertices of all views.
    pub(super) fn of(views: &SurveyViews, surface: &Surface) -> Self {
        let by_view: Vec<Vec<f32>> = views
            .views
            .par_iter()
            .map(|view| seen(views, view, surface))
            .collect();
        let mut median = vec![f32::NAN; surface.positions.len()];
        let mut low = median.clone();
        median
            .par_chunks_mut(VERTICES_A_TASK)
            .zip(low.par_chunks_mut(VERTICES_A_TASK))
            .enumerate()
            .for_each(|(chunk, (median, low))| {
                let mut values: Vec<f32> = Vec::with_capacity(by_view.len());
                for (offset, (median, low)) in median.iter_mut().zip(low).enumerate() {
                    let vertex = chunk * VERTICES_A_TASK + offset;
                    values.clear();
                    values.extend(by_view.iter().map(|view| view[vertex]));
                    values.retain(|value| value.is_finite());
                    if values.len() >= FEWEST_VIEWS {
                        values.sort_unstable_by(f32::total_cmp);
                        let middle = values.len() / 2;
                        *median = 0.5 * (values[middle] + values[(values.len() - 1) / 2]);
                        *low = values[values.len() / 10];
                    }
                }
            });
        Self { median, low }
    }
}

/// A per-vertex value at a hit.
pub(super) fn at_hit(surface: &Surface, values: &[f32], hit: &Hit) -> f32 {
    let [a, b, c] = surface.triangles[hit.triangle as usize].map(|v| values[v as usize]);
    a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
}

/// A per-vertex value as a view sees it; NaN where there is none.
pub(super) fn drawn(view: &SurveyView, surface: &Surface, values: &[f32]) -> Vec<f32> {
    let buffer = &view.buffer;
    (0..buffer.triangle.len())
        .map(|index| {
            if buffer.triangle[index] == NO_TRIANGLE {
                return f32::NAN;
            }
            let hit = Hit {
                triangle: buffer.triangle[index],
                t: buffer.depth[index],
                u: buffer.u[index],
                v: buffer.v[index],
            };
            at_hit(surface, values, &hit)
        })
        .collect()
}

/// Central differences of a picture; NaN at its border and where a neighbour is missing.
pub(super) fn gradient(picture: &[f32], width: usize) -> Vec<[f32; 2]> {
    let height = picture.len() / width;
    (0..picture.len())
        .map(|index| {
            let (x, y) = (index % width, index / width);
            if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height {
                return [f32::NAN; 2];
            }
            [
                0.5 * (picture[index + 1] - picture[index - 1]),
                0.5 * (picture[index + width] - picture[index - width]),
            ]
        })
        .collect()
}

/// Takes the gain of every view out of its grey picture: the median of what it shows over what the surface shows from
/// all sides. Both auto exposure and a residue of the lens look like a broad lobe. Returns the largest change.
pub(super) fn level_gains(views: &mut SurveyViews, surface: &Surface, texture: &Texture) -> f64 {
    let changes: Vec<f64> = views
        .views
        .par_iter_mut()
        .map(|view| {
            let expected = drawn(view, surface, &texture.median);
            let mut ratios: Vec<f64> = view
                .grey
                .iter()
                .zip(&expected)
                .filter(|(seen, expected)| **expected > LEAST_GREY && seen.is_finite())
                .map(|(seen, expected)| f64::from(seen / expected))
                .collect();
            let gain = robust::median(&mut ratios).unwrap_or(1.0);
            if gain > 0.0 {
                for value in &mut view.grey {
                    *value /= gain as f32;
                }
            }
            (gain - 1.0).abs()
        })
        .collect();
    changes.into_iter().fold(0.0, f64::max)
}

/// The gate over the object's pixels. `sigma`: noise of a survey pixel; `delta_px`: misregistration.
pub(super) fn gate(
    views: &SurveyViews,
    surface: &Surface,
    texture: &Texture,
    sigma: f64,
    delta_px: f64,
) -> Gate {
    let width = views.camera.width() as usize;
    let residuals: Vec<(Vec<f32>, Vec<f32>)> = views
        .views
        .par_iter()
        .map(|view| {
            let expected = drawn(view, surface, &texture.median);
            let slopes = gradient(&expected, width);
            let mut residual = vec![f32::NAN; expected.len()];
            let mut slope = residual.clone();
            for pixel in &view.pixels {
                let [x, y] = slopes[pixel.place];
                // A clipped pixel is at least this bright, so that it counts; an edge of the object does not.
                if x.is_finite() && y.is_finite() {
                    residual[pixel.place] = view.grey[pixel.place] - expected[pixel.place];
                    slope[pixel.place] = x.hypot(y);
                }
            }
            (residual, slope)
        })
        .collect();
    let mut dependence = ViewDependence::default();
    for (residual, gradient) in &residuals {
        dependence.add(&ViewResidual {
            width,
            residual,
            gradient,
        });
    }
    dependence.gate(sigma, delta_px)
}
