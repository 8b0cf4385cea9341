//! Colours of what first bounces meet, as a blurred mirror shows them.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;
use raytrace::Hit;

use crate::effects::views::{SurveyPixel, SurveyViews, bilinear};
use crate::stages::observe::Surface;

/// Edges of the cells over which the colours of first bounces are averaged, 3 x 3 x 3 of them, metres: a survey pixel on
/// a curved mirror sees centimetres of what it mirrors, a wide lobe more, and an unsure normal misses it.
const BLUR_CELLS: [f32; 2] = [0.01, 0.04];
/// How a first bounce may be seen: sharp, and averaged over each size of cells.
pub(super) const BLUR_COUNT: usize = 1 + BLUR_CELLS.len();

/// Colour of a surface over the views.
#[derive(Clone, Copy)]
pub(super) struct BounceColor {
    pub(super) median: [f32; 3],
    /// Lower decile.
    pub(super) low: [f32; 3],
}

/// What a place shows on average and at least, summed over vertices.
#[derive(Clone, Copy, Default)]
struct ColorSum {
    median: [f64; 3],
    low: [f64; 3],
    count: f64,
}

/// Colours of the surface that first bounces meet.
pub(super) struct BounceColors {
    /// Median and lower decile of the vertices that some view sees.
    vertices: BTreeMap<u32, [[f64; 3]; 2]>,
    /// For each of [`BLUR_CELLS`].
    cells: [BTreeMap<[i64; 3], ColorSum>; BLUR_CELLS.len()],
}

impl BounceColors {
    fn key(position: Vec3, edge: f32) -> [i64; 3] {
        [position.x, position.y, position.z].map(|value| (value / edge).floor() as i64)
    }

    /// Median and lower decile over the views of every vertex that a first bounce meets, summed by cell.
    pub(super) fn new(
        views: &SurveyViews,
        surface: &Surface,
        picked: &[(usize, &SurveyPixel)],
    ) -> Self {
        let mut vertices: Vec<u32> = picked
            .iter()
            .filter_map(|(_, pixel)| pixel.bounce)
            .flat_map(|bounce| surface.triangles[bounce.triangle as usize])
            .collect();
        vertices.sort_unstable();
        vertices.dedup();
        let colors: Vec<Option<[[f64; 3]; 2]>> = vertices
            .par_iter()
            .map(|&vertex| quantiles(views, surface, vertex as usize))
            .collect();
        let mut cells: [BTreeMap<[i64; 3], ColorSum>; BLUR_CELLS.len()] = Default::default();
        let known: BTreeMap<u32, [[f64; 3]; 2]> = vertices
            .into_iter()
            .zip(colors)
            .filter_map(|(vertex, color)| Some((vertex, color?)))
            .collect();
        for (&vertex, [median, low]) in &known {
            let position = surface.positions[vertex as usize];
            for (cells, edge) in cells.iter_mut().zip(BLUR_CELLS) {
                let sum = cells.entry(Self::key(position, edge)).or_default();
                for c in 0..3 {
                    sum.median[c] += median[c];
                    sum.low[c] += low[c];
                }
                sum.count += 1.0;
            }
        }
        Self {
            vertices: known,
            cells,
        }
    }

    /// The colour at a hit: sharp, then averaged over ever larger cells.
    pub(super) fn at(&self, surface: &Surface, bounce: &Hit) -> [BounceColor; BLUR_COUNT] {
        std::array::from_fn(|blur| match blur.checked_sub(1) {
            None => self.sharp(surface, bounce),
            Some(size) => self.blurred(surface, bounce, size),
        })
    }

    /// The colour at a hit; that around it where no view sees its vertices.
    fn sharp(&self, surface: &Surface, bounce: &Hit) -> BounceColor {
        let weights = [1.0 - bounce.u - bounce.v, bounce.u, bounce.v].map(f64::from);
        let mut mixed = [[0.0; 3]; 2];
        for (vertex, weight) in surface.triangles[bounce.triangle as usize]
            .iter()
            .zip(weights)
        {
            let Some(colors) = self.vertices.get(vertex) else {
                return self.blurred(surface, bounce, 0);
            };
            for (mixed, color) in mixed.iter_mut().zip(colors) {
                for c in 0..3 {
                    mixed[c] += weight * color[c];
                }
            }
        }
        let [median, low] = mixed.map(|color| color.map(|value| value as f32));
        BounceColor { median, low }
    }

    /// The colour around a hit; black where no view sees anything there.
    fn blurred(&self, surface: &Surface, bounce: &Hit, size: usize) -> BounceColor {
        let position = surface.interpolate(&surface.positions, bounce);
        let middle = Self::key(position, BLUR_CELLS[size]);
        let mut whole = ColorSum::default();
        for step in 0..27 {
            let offset = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
            let key = std::array::from_fn(|axis| middle[axis] + offset[axis]);
            if let Some(cell) = self.cells[size].get(&key) {
                for c in 0..3 {
                    whole.median[c] += cell.median[c];
                    whole.low[c] += cell.low[c];
                }
                whole.count += cell.count;
            }
        }
        let count = whole.count.max(1.0);
        BounceColor {
            median: whole.median.map(|sum| (sum / count) as f32),
            low: whole.low.map(|sum| (sum / count) as f32),
        }
    }
}

/// Median and lower decile of a vertex's colour over the views that see it.
fn quantiles(views: &SurveyViews, surface: &Surface, vertex: usize) -> Option<[[f64; 3]; 2]> {
    let width = views.camera.width() as usize;
    let seen: Vec<[f32; 3]> = views
        .views
        .iter()
        .filter_map(|view| {
            let color_from_surface = view.surface_from_color.inverse();
            let at = views.place(view, &color_from_surface, surface, vertex)?;
            bilinear(&view.color, width, at, |color| color)
        })
        .collect();
    let quantile = |q: f64, c: usize| {
        let mut values: Vec<f64> = seen.iter().map(|color| f64::from(color[c])).collect();
        geometry::robust::quantile(&mut values, q).unwrap_or(0.0)
    };
    (!seen.is_empty())
        .then(|| [0.5, 0.1].map(|q| std::array::from_fn(|channel| quantile(q, channel))))
}
