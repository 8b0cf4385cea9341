//! Directions drawn in proportion to an environment's light.

use geometry::{DVec2, PanoramaSize};
use glam::Vec3;

/// Draws texels in proportion to luminance times solid angle. Sums are f64: one bright texel leaves the rest their
/// share; an environment without light is drawn from evenly (hard-cases I09). Its texels are coarser than the
/// environment's: a table of 32,768 stays in the cache, and the density of a draw is exact all the same.
#[derive(Clone, Debug)]
pub(crate) struct ImportanceTable {
    size: PanoramaSize,
    /// Cumulative weight at the end of each texel, row-major; the last is the total.
    cumulative: Vec<f64>,
}

impl ImportanceTable {
    /// For texel luminances, row-major.
    pub(crate) fn new(size: PanoramaSize, luminance: impl Fn(usize) -> f64) -> Self {
        let width = size.width() as usize;
        let solid_angles: Vec<f64> = (0..size.height())
            .map(|row| size.solid_angle(row))
            .collect();
        let sum = |weight: &dyn Fn(usize) -> f64| {
            let mut total = 0.0;
            let texels = 0..size.texel_count();
            texels
                .map(|index| {
                    total += weight(index) * solid_angles[index / width];
                    total
                })
                .collect::<Vec<f64>>()
        };
        let mut cumulative = sum(&luminance);
        if !(cumulative.last().copied().unwrap_or(0.0) > 0.0) {
            cumulative = sum(&|_| 1.0);
        }
        Self { size, cumulative }
    }

    fn total(&self) -> f64 {
        self.cumulative.last().copied().unwrap_or(0.0)
    }

    /// Weight of a texel.
    fn weight(&self, index: usize) -> f64 {
        let before = if index == 0 {
            0.0
        } else {
            self.cumulative[index - 1]
        };
        self.cumulative[index] - before
    }

    /// The texel at `u` in [0, 1) of the cumulative weight: never one without weight.
    fn texel(&self, u: f64) -> usize {
        let aim = u * self.total();
        let index = self.cumulative.partition_point(|&end| end <= aim);
        // `u` rounded up to 1: the last texel with weight.
        let last = self.cumulative.partition_point(|&end| end < self.total());
        index.min(last)
    }

    /// A direction, even within its texel, and its density in 1/steradian. `u` uniform: one to choose, two inside.
    pub(crate) fn sample(&self, choice: f64, within: [f32; 2]) -> (Vec3, f32) {
        let index = self.texel(choice);
        let width = self.size.width() as usize;
        let (row, column) = (index / width, index % width);
        // Even in solid angle: the sine of latitude is uniform between the texel's edges.
        let edge = |row: f64| self.size.direction_from_texel(DVec2::new(0.0, row)).y;
        let (top, bottom) = (edge(row as f64 - 0.5), edge(row as f64 + 0.5));
        let y = top + (bottom - top) * f64::from(within[1]);
        let flat = (1.0 - y * y).max(0.0).sqrt();
        // The equator's row has the longitude without the latitude.
        let middle = f64::from(self.size.height()) * 0.5 - 0.5;
        let x = column as f64 + f64::from(within[0]) - 0.5;
        let around = self.size.direction_from_texel(DVec2::new(x, middle));
        let direction = Vec3::new((around.x * flat) as f32, y as f32, (around.z * flat) as f32);
        (direction.normalize_or(Vec3::Z), self.density_of(index))
    }

    fn density_of(&self, index: usize) -> f32 {
        let row = (index / self.size.width() as usize) as u32;
        (self.weight(index) / (self.total() * self.size.solid_angle(row))) as f32
    }

    /// Density of a direction, 1/steradian.
    pub(crate) fn density(&self, direction: Vec3) -> f32 {
        self.density_of(self.size.index_from_direction(direction.as_dvec3()))
    }
}
