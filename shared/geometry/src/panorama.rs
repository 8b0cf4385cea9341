//! Directions and lat-long panorama texels: the only place where one becomes the other.
//!
//! Texel (i, j) has its centre at lon = 2π(i+½)/W − π, lat = π/2 − π(j+½)/H and looks along
//! (cos lat sin lon, −sin lat, cos lat cos lon). The middle looks along +z, right of it is +x, the top is −y.

use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// The size of a lat-long panorama: `width = 2 height`, both at least 2 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PanoramaSize {
    height: u32,
}

/// Four bilinear taps: texel indices (row-major) and weights that sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps {
    /// Row-major texel indices, each below `width · height`.
    pub texels: [u32; 4],
    /// Weights in [0, 1], same order.
    pub weights: [f32; 4],
}

impl PanoramaSize {
    /// A panorama of `height` rows and `2 height` columns; `None` for 0 or more than 32768 rows.
    pub fn from_height(height: u32) -> Option<Self> {
        (1..=32_768).contains(&height).then_some(Self { height })
    }

    /// Columns.
    pub fn width(self) -> u32 {
        self.height * 2
    }

    /// Rows.
    pub fn height(self) -> u32 {
        self.height
    }

    /// Number of texels.
    pub fn texel_count(self) -> usize {
        self.width() as usize * self.height as usize
    }

    /// The unit direction of continuous texel coordinates (0 = centre of the first texel).
    pub fn direction_from_texel(self, texel: DVec2) -> DVec3 {
        let lon = 2.0 * PI * (texel.x + 0.5) / f64::from(self.width()) - PI;
        let lat = PI / 2.0 - PI * (texel.y + 0.5) / f64::from(self.height);
        DVec3::new(lat.cos() * lon.sin(), -lat.sin(), lat.cos() * lon.cos())
    }

    /// Continuous texel coordinates of a direction of any nonzero length:
    /// x in [−½, W − ½), y in [−½, H − ½] (hard-cases F01, F02).
    pub fn texel_from_direction(self, direction: DVec3) -> DVec2 {
        let lon = direction.x.atan2(direction.z);
        let lat = (-direction.y).atan2(direction.x.hypot(direction.z));
        let width = f64::from(self.width());
        let mut x = (lon + PI) / (2.0 * PI) * width - 0.5;
        if x >= width - 0.5 {
            x -= width;
        }
        let y = (PI / 2.0 - lat) / PI * f64::from(self.height) - 0.5;
        DVec2::new(x, y)
    }

    /// The row-major index of the texel that holds a direction of any nonzero length.
    ///
    /// The direction must be finite: there is no index to say otherwise (checked in debug builds).
    pub fn index_from_direction(self, direction: DVec3) -> usize {
        debug_assert!(direction.is_finite(), "a direction is finite");
        let texel = self.texel_from_direction(direction);
        let (width, height) = (i64::from(self.width()), i64::from(self.height));
        let column = ((texel.x + 0.5).floor() as i64).rem_euclid(width);
        let row = ((texel.y + 0.5).floor() as i64).clamp(0, height - 1);
        (row * width + column) as usize
    }

    /// The four bilinear taps of a direction of any nonzero length. Columns wrap; a tap beyond a pole is
    /// the same row half a turn on; exactly at a pole the value is shared by opposite columns (hard-cases
    /// F03, F04). For a direction that is not finite the weights are NaN.
    pub fn taps(self, direction: DVec3) -> Taps {
        let texel = self.texel_from_direction(direction);
        let (x0, y0) = (texel.x.floor(), texel.y.floor());
        let (fx, fy) = ((texel.x - x0) as f32, (texel.y - y0) as f32);
        let (x0, y0) = (x0 as i64, y0 as i64);
        let weights = [
            (1.0 - fx) * (1.0 - fy),
            fx * (1.0 - fy),
            (1.0 - fx) * fy,
            fx * fy,
        ];
        let texels = [
            self.wrap(x0, y0),
            self.wrap(x0 + 1, y0),
            self.wrap(x0, y0 + 1),
            self.wrap(x0 + 1, y0 + 1),
        ];
        Taps { texels, weights }
    }

    /// The row-major index of integer texel coordinates up to one row beyond a pole.
    pub fn wrap(self, column: i64, row: i64) -> u32 {
        let (width, height) = (i64::from(self.width()), i64::from(self.height));
        let (column, row) = if row < 0 {
            (column + width / 2, -1 - row)
        } else if row >= height {
            (column + width / 2, 2 * height - 1 - row)
        } else {
            (column, row)
        };
        let index = row.clamp(0, height - 1) * width + column.rem_euclid(width);
        index as u32
    }

    /// The solid angle of a texel of row `row`, below `height`, steradians; all texels sum to 4π (hard-cases F05).
    ///
    /// In the product form, because the difference of cosines cancels at the poles.
    pub fn solid_angle(self, row: u32) -> f64 {
        let step = PI / f64::from(self.height);
        let colatitude = step * (f64::from(row) + 0.5);
        2.0 * colatitude.sin() * (step * 0.5).sin() * 2.0 * PI / f64::from(self.width())
    }

    /// Latitude of the centre of `row`, radians, positive towards −y (up).
    pub fn latitude(self, row: u32) -> f64 {
        PI / 2.0 - PI * (f64::from(row) + 0.5) / f64::from(self.height)
    }
}
