//! The gate: whether anything on the object looks different from different sides.

use crate::survey::{CODES, L1_OF_SIGMA};

/// E_skew up to this is that of a matte surface, codes.
pub const MATTE_SKEW: f64 = 0.15;
/// E_tile up to this is that of a matte surface, codes.
pub const MATTE_TILE: f64 = 0.25;
/// Edge of a tile, pixels.
pub const TILE: usize = 8;
/// Share of the tiles, those with the smallest gradients, that E_tile is taken over.
const CALM_SHARE: f64 = 0.3;
/// Part of gradient times misregistration that a tile's mean can show.
const TILE_MISREGISTRATION: f64 = 0.5;

/// One view of the object: what it shows beyond the median of all views, row-major.
#[derive(Clone, Copy, Debug)]
pub struct ViewResidual<'a> {
    /// Pixels a row.
    pub width: usize,
    /// G − D_med, linear luminance; not finite where the view says nothing.
    pub residual: &'a [f32],
    /// ‖∇D‖, linear luminance a pixel.
    pub gradient: &'a [f32],
}

/// View dependence over all views so far.
#[derive(Clone, Debug, Default)]
pub struct ViewDependence {
    sum: f64,
    count: usize,
    /// Mean residual and mean gradient of every whole tile.
    tiles: Vec<(f64, f64)>,
}

/// What the gate looks at, codes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gate {
    /// ⟨G − D_med⟩: highlights only add light, noise and misregistration are symmetric.
    pub eskew_codes: f64,
    /// Spread of tile means beyond noise and misregistration: broad, smooth lobes.
    pub etile_codes: f64,
}

impl Gate {
    /// Whether the specular group stays in. Not both small; a number that is not finite is not small.
    pub fn is_specular(&self) -> bool {
        !(self.eskew_codes <= MATTE_SKEW && self.etile_codes <= MATTE_TILE)
    }
}

impl ViewDependence {
    /// Adds a view. A tile counts when at least half of its pixels say something.
    pub fn add(&mut self, view: &ViewResidual<'_>) {
        let known = view.residual.iter().filter(|value| value.is_finite());
        for &value in known {
            self.sum += f64::from(value);
            self.count += 1;
        }
        let height = view.residual.len() / view.width.max(1);
        for tile_y in 0..height / TILE {
            for tile_x in 0..view.width / TILE {
                self.add_tile(view, tile_x * TILE, tile_y * TILE);
            }
        }
    }

    fn add_tile(&mut self, view: &ViewResidual<'_>, left: usize, top: usize) {
        let (mut residual, mut gradient, mut count) = (0.0, 0.0, 0_usize);
        for y in top..top + TILE {
            for index in y * view.width + left..y * view.width + left + TILE {
                if view.residual[index].is_finite() {
                    residual += f64::from(view.residual[index]);
                    gradient += f64::from(view.gradient[index]);
                    count += 1;
                }
            }
        }
        if 2 * count >= TILE * TILE {
            self.tiles
                .push((residual / count as f64, gradient / count as f64));
        }
    }

    /// Pixels that said something.
    pub fn pixel_count(&self) -> usize {
        self.count
    }

    /// The gate's numbers; 0 where there is nothing. `sigma` is the noise of a pixel (linear luminance),
    /// `delta_px` the misregistration.
    pub fn gate(mut self, sigma: f64, delta_px: f64) -> Gate {
        let eskew = self.sum / self.count.max(1) as f64;
        self.tiles.sort_by(|a, b| a.1.total_cmp(&b.1));
        let kept = (self.tiles.len() as f64 * CALM_SHARE).ceil() as usize;
        self.tiles.truncate(kept);
        let count = self.tiles.len().max(1) as f64;
        let gradient = self.tiles.iter().map(|tile| tile.1).sum::<f64>() / count;
        self.tiles.sort_by(|a, b| a.0.total_cmp(&b.0));
        let median = self.tiles.get(self.tiles.len() / 2).map_or(0.0, |t| t.0);
        let spread = self.tiles.iter().map(|t| (t.0 - median).abs()).sum::<f64>() / count;
        let etile =
            spread - L1_OF_SIGMA * sigma / TILE as f64 - TILE_MISREGISTRATION * gradient * delta_px;
        Gate {
            eskew_codes: CODES * eskew,
            etile_codes: if self.tiles.is_empty() {
                0.0
            } else {
                CODES * etile
            },
        }
    }
}

#[cfg(test)]
mod tests;
