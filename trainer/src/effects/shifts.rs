//! How far the views are off: shifts of tiles of each view against what the surface shows from all sides, and the part
//! of them that a motion of the camera explains.

use geometry::robust;
use rayon::prelude::*;
use raytrace::NO_TRIANGLE;

use super::texture::{Texture, drawn, gradient};
use super::views::{SurveyView, SurveyViews};
use crate::stages::observe::Surface;

/// Edge of a tile, survey pixels.
const TILE: usize = 16;
/// Distance of tiles.
const SPACING: usize = 12;
/// Least share of a tile's pixels that must say something.
const LEAST_SHARE: f64 = 0.6;
/// Largest standard deviation of a shift, survey pixels.
const LARGEST_SIGMA: f64 = 0.15;
/// Longest shift that one linear step can find, survey pixels.
const LONGEST: f64 = 3.0;
/// Fewest tiles of a view that a motion is fitted to: twice its six unknowns.
const FEWEST_TILES: usize = 6;
/// Residual at which a tile begins to lose weight in the fit of a motion, survey pixels.
const RESIDUAL_SCALE: f64 = 0.1;
/// Rounds of reweighting.
const ROUNDS: usize = 3;
/// What exact poses show: the texture is read at vertices of a fused mesh, whose depth is off by what the sensor rounds
/// to (0.03 to 0.05 survey pixels on simulated recordings).
const RIGID_FLOOR: f64 = 0.05;
/// Unknowns of a rigid motion.
const DEGREES: usize = 6;

/// Misregistration of a survey, survey pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Misregistration {
    /// Median length of a tile's shift.
    pub delta_px: f64,
    /// Root mean square of the part that six degrees of freedom a view explain, chance taken out.
    pub rigid_px: f64,
}

/// Shift of one tile.
struct Shift {
    /// Centre in normalised image coordinates.
    at: [f64; 2],
    /// Metres.
    depth: f64,
    /// Survey pixels.
    shift: [f64; 2],
}

/// Measures all views.
pub(super) fn misregistration(
    views: &SurveyViews,
    surface: &Surface,
    texture: &Texture,
) -> Misregistration {
    let by_view: Vec<Vec<Shift>> = views
        .views
        .par_iter()
        .map(|view| shifts(views, view, surface, texture))
        .collect();
    let mut lengths: Vec<f64> = by_view
        .iter()
        .flatten()
        .map(|tile| tile.shift[0].hypot(tile.shift[1]))
        .collect();
    let focal = 0.5 * (views.camera.focal().x + views.camera.focal().y);
    let explained: Vec<f64> = by_view
        .iter()
        .filter_map(|tiles| explained_square(tiles, focal))
        .collect();
    let mean = explained.iter().sum::<f64>() / explained.len().max(1) as f64;
    Misregistration {
        delta_px: robust::median(&mut lengths).unwrap_or(0.0),
        rigid_px: (mean - RIGID_FLOOR * RIGID_FLOOR).max(0.0).sqrt(),
    }
}

fn shifts(
    views: &SurveyViews,
    view: &SurveyView,
    surface: &Surface,
    texture: &Texture,
) -> Vec<Shift> {
    let width = views.camera.width() as usize;
    let expected = drawn(view, surface, &texture.median);
    let slopes = gradient(&expected, width);
    let height = expected.len() / width;
    let (focal, center) = (views.camera.focal(), views.camera.center());
    let mut found = Vec::new();
    for top in (0..height.saturating_sub(TILE - 1)).step_by(SPACING) {
        for left in (0..width.saturating_sub(TILE - 1)).step_by(SPACING) {
            let places: Vec<usize> = (top..top + TILE)
                .flat_map(|y| y * width + left..y * width + left + TILE)
                .collect();
            let Some(shift) = tile_shift(view, &expected, &slopes, &places) else {
                continue;
            };
            let middle = (top + TILE / 2) * width + left + TILE / 2;
            if view.buffer.triangle[middle] == NO_TRIANGLE {
                continue;
            }
            let half = 0.5 * (TILE - 1) as f64;
            found.push(Shift {
                at: [
                    (left as f64 + half - center.x) / focal.x,
                    (top as f64 + half - center.y) / focal.y,
                ],
                depth: f64::from(view.buffer.depth[middle]),
                shift,
            });
        }
    }
    found
}

/// Shift of one tile by one linear step, with an offset of its own; `None` where it has too little texture.
fn tile_shift(
    view: &SurveyView,
    expected: &[f32],
    slopes: &[[f32; 2]],
    places: &[usize],
) -> Option<[f64; 2]> {
    let mut known: Vec<[f64; 3]> = Vec::with_capacity(places.len());
    for &place in places {
        let [gx, gy] = slopes[place].map(f64::from);
        let residual = f64::from(view.grey[place] - expected[place]);
        if gx.is_finite() && gy.is_finite() && residual.is_finite() {
            known.push([gx, gy, residual]);
        }
    }
    if (known.len() as f64) < LEAST_SHARE * places.len() as f64 {
        return None;
    }
    let count = known.len() as f64;
    let mean: [f64; 3] =
        std::array::from_fn(|i| known.iter().map(|value| value[i]).sum::<f64>() / count);
    let (mut xx, mut xy, mut yy, mut xr, mut yr, mut rr) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for value in &known {
        let [gx, gy, r] = std::array::from_fn(|i| value[i] - mean[i]);
        xx += gx * gx;
        xy += gx * gy;
        yy += gy * gy;
        xr += gx * r;
        yr += gy * r;
        rr += r * r;
    }
    let determinant = xx * yy - xy * xy;
    if !(determinant > 1e-12 * (xx + yy) * (xx + yy)) {
        return None;
    }
    // What the view shows at u is what is expected at u − shift.
    let shift = [
        -(yy * xr - xy * yr) / determinant,
        -(xx * yr - xy * xr) / determinant,
    ];
    let left = (rr + shift[0] * xr + shift[1] * yr).max(0.0) / (count - 3.0);
    let least = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
    let sigma = (left / least.max(f64::MIN_POSITIVE)).sqrt();
    let is_sure = sigma <= LARGEST_SIGMA && shift[0].hypot(shift[1]) <= LONGEST;
    is_sure.then_some(shift)
}

/// How the image of a point moves with the camera, pixels; translations in units of the point's own distance scale.
fn motion_rows(tile: &Shift, focal: f64, scale: f64) -> [[f64; DEGREES]; 2] {
    let [x, y] = tile.at;
    let near = scale / tile.depth.max(1e-3);
    [
        [-near, 0.0, x * near, x * y, -(1.0 + x * x), y].map(|v| v * focal),
        [0.0, -near, y * near, 1.0 + y * y, -x * y, -x].map(|v| v * focal),
    ]
}

/// Mean square of the shifts that the best rigid motion predicts, less what it would explain of pure chance.
fn explained_square(tiles: &[Shift], focal: f64) -> Option<f64> {
    if tiles.len() < FEWEST_TILES {
        return None;
    }
    let mut depths: Vec<f64> = tiles.iter().map(|tile| tile.depth).collect();
    let scale = robust::median(&mut depths)?;
    let rows: Vec<[[f64; DEGREES]; 2]> = tiles
        .iter()
        .map(|tile| motion_rows(tile, focal, scale))
        .collect();
    let mut motion = [0.0; DEGREES];
    let predicted = |motion: &[f64; DEGREES], rows: &[[f64; DEGREES]; 2]| {
        rows.map(|row| row.iter().zip(motion).map(|(a, m)| a * m).sum::<f64>())
    };
    for round in 0..ROUNDS {
        let mut matrix = [[0.0; DEGREES]; DEGREES];
        let mut right = [0.0; DEGREES];
        for (tile, rows) in tiles.iter().zip(&rows) {
            let [u, v] = predicted(&motion, rows);
            let residual = (tile.shift[0] - u).hypot(tile.shift[1] - v);
            let weight = if round == 0 {
                1.0
            } else {
                1.0 / (1.0 + (residual / RESIDUAL_SCALE).powi(2))
            };
            for (row, shift) in rows.iter().zip(tile.shift) {
                for i in 0..DEGREES {
                    right[i] += weight * row[i] * shift;
                    for j in 0..DEGREES {
                        matrix[i][j] += weight * row[i] * row[j];
                    }
                }
            }
        }
        motion = solved(matrix, right)?;
    }
    let (mut explained, mut left) = (0.0, 0.0);
    for (tile, rows) in tiles.iter().zip(&rows) {
        let [u, v] = predicted(&motion, rows);
        explained += u * u + v * v;
        left += (tile.shift[0] - u).powi(2) + (tile.shift[1] - v).powi(2);
    }
    let (count, degrees) = (tiles.len() as f64, DEGREES as f64);
    let variance = left / (2.0 * count - degrees);
    Some((explained - degrees * variance) / count)
}

/// Solves a symmetric positive system by Cholesky, with a ridge for motions that the tiles cannot tell apart.
fn solved(mut matrix: [[f64; DEGREES]; DEGREES], right: [f64; DEGREES]) -> Option<[f64; DEGREES]> {
    let trace: f64 = (0..DEGREES).map(|i| matrix[i][i]).sum();
    for (i, row) in matrix.iter_mut().enumerate() {
        row[i] += 1e-6 * trace;
    }
    let mut lower = [[0.0; DEGREES]; DEGREES];
    for i in 0..DEGREES {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let value = matrix[i][j] - sum;
            if i == j {
                if !(value > 0.0) {
                    return None;
                }
                lower[i][i] = value.sqrt();
            } else {
                lower[i][j] = value / lower[j][j];
            }
        }
    }
    let mut half = [0.0; DEGREES];
    for i in 0..DEGREES {
        let sum: f64 = (0..i).map(|k| lower[i][k] * half[k]).sum();
        half[i] = (right[i] - sum) / lower[i][i];
    }
    let mut solution = [0.0; DEGREES];
    for i in (0..DEGREES).rev() {
        let sum: f64 = (i + 1..DEGREES).map(|k| lower[k][i] * solution[k]).sum();
        solution[i] = (half[i] - sum) / lower[i][i];
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tiles(shift: impl Fn(usize, f64, f64, f64) -> [f64; 2]) -> Vec<Shift> {
        (0..40)
            .map(|i| {
                let (x, y) = (
                    (f64::from(i % 8) - 3.5) * 0.12,
                    (f64::from(i / 8) - 2.0) * 0.15,
                );
                let depth = 0.6 + 0.3 * f64::from(i * 7 % 5);
                Shift {
                    at: [x, y],
                    depth,
                    shift: shift(i as usize, x, y, depth),
                }
            })
            .collect()
    }

    #[test]
    fn a_motion_of_the_camera_is_explained_and_chance_is_not() {
        let focal = 130.0;
        // The camera stands 1 mm further right and is turned by a milliradian about its axis.
        let moved =
            tiles(|_, x, y, depth| [focal * (-1e-3 / depth + 1e-3 * y), focal * (-1e-3 * x)]);
        let expected = moved
            .iter()
            .map(|tile| tile.shift[0].powi(2) + tile.shift[1].powi(2))
            .sum::<f64>()
            / moved.len() as f64;
        let found = explained_square(&moved, focal).unwrap();
        assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");

        let mut state = 9_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / (1_u64 << 30) as f64 - 1.0
        };
        let mean = (0..200)
            .map(|_| {
                let noise: Vec<[f64; 2]> = (0..40).map(|_| [uniform(), uniform()]).collect();
                explained_square(&tiles(|i, _, _, _| noise[i].map(|v| 0.1 * v)), focal).unwrap()
            })
            .sum::<f64>()
            / 200.0;
        // Of a mean square of 0.0067 a naive fit would call 0.001 explained.
        assert!(mean.abs() < 3e-4, "{mean}");
    }

    #[test]
    fn too_few_tiles_say_nothing() {
        let few: Vec<Shift> = tiles(|_, _, _, _| [0.1, 0.0]).into_iter().take(5).collect();
        assert!(explained_square(&few, 130.0).is_none());
    }
}
