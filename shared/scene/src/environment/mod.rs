//! The light around a scene: a panorama, at infinity or on the walls of a box.

mod bars;
mod importance;
mod room;

use geometry::{DVec2, PanoramaSize};
use glam::Vec3;
use imaging::{Image, LinearImage};
use rayon::prelude::*;

pub use bars::{BAR_WIDTHS, BarGroup, BarKind, Bars};
pub use room::Room;

use crate::error::SceneError;
use importance::ImportanceTable;

/// A box around the scene whose walls carry the panorama as it is seen from the middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enclosure {
    /// The middle, metres.
    pub center: Vec3,
    /// Half of each edge, metres.
    pub half: Vec3,
}

impl Enclosure {
    /// The direction from the middle to what a ray from inside meets.
    fn seen_from_center(&self, origin: Vec3, direction: Vec3) -> Vec3 {
        let local = origin - self.center;
        let exit = |position: f32, half: f32, direction: f32| {
            if direction.abs() < 1e-12 {
                f32::INFINITY
            } else {
                ((half.copysign(direction) - position) / direction).max(0.0)
            }
        };
        let t = exit(local.x, self.half.x, direction.x)
            .min(exit(local.y, self.half.y, direction.y))
            .min(exit(local.z, self.half.z, direction.z));
        (local + direction * t).normalize_or(direction)
    }
}

/// Light from all directions, linear radiance, 1.0 = white level.
#[derive(Clone, Debug)]
pub struct Environment {
    size: PanoramaSize,
    texels: Vec<[f32; 3]>,
    importance: ImportanceTable,
    enclosure: Option<Enclosure>,
}

/// Rec. 709 luminance of linear radiance.
pub(crate) fn luminance([r, g, b]: [f32; 3]) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}

/// Most rows of the table that directions are drawn from.
const IMPORTANCE_ROWS: u32 = 128;

/// Shares of the texel before, of a texel and of the texel behind in the bilinear light over it.
const BILINEAR_SHARES: [f64; 3] = [0.125, 0.75, 0.125];

/// The table of a panorama, averaged to fewer rows. Light is bilinear between texels, so that a dark texel has the
/// skirts of bright ones around it: drawn by its own value alone, they would be seen seldom and then be far too bright.
fn importance_of(size: PanoramaSize, texels: &[[f32; 3]]) -> ImportanceTable {
    let factor = (size.height() / IMPORTANCE_ROWS).max(1);
    let coarse = PanoramaSize::from_height(size.height() / factor).unwrap_or(size);
    let width = coarse.width() as usize;
    let light = |column: usize, row: usize| -> f64 {
        let at = |dx: usize, dy: usize| {
            let texel = size.wrap((column + dx) as i64 - 1, (row + dy) as i64 - 1);
            BILINEAR_SHARES[dx] * BILINEAR_SHARES[dy] * luminance(texels[texel as usize])
        };
        (0..3)
            .map(|dy| (0..3).map(|dx| at(dx, dy)).sum::<f64>())
            .sum()
    };
    let mut means = vec![0.0_f64; coarse.texel_count()];
    for (index, mean) in means.iter_mut().enumerate() {
        let (x0, y0) = (
            (index % width) * factor as usize,
            (index / width) * factor as usize,
        );
        for y in y0..y0 + factor as usize {
            *mean += (x0..x0 + factor as usize).map(|x| light(x, y)).sum::<f64>();
        }
        *mean /= f64::from(factor * factor);
    }
    ImportanceTable::new(coarse, |index| means[index])
}

impl Environment {
    /// From a panorama in the world's axes.
    ///
    /// # Errors
    /// What is no panorama, and values that are no radiance.
    pub fn from_panorama(map: &LinearImage) -> Result<Self, SceneError> {
        let size = PanoramaSize::from_height(map.height())
            .filter(|size| size.width() == map.width() && size.height() <= 8192)
            .ok_or(SceneError::NoPanorama {
                width: map.width(),
                height: map.height(),
            })?;
        for (index, texel) in map.pixels().iter().enumerate() {
            if let Some(&value) = texel.iter().find(|value| !(0.0..=1e6).contains(*value)) {
                let index = index as u32;
                return Err(SceneError::Radiance {
                    x: index % size.width(),
                    y: index / size.width(),
                    value,
                });
            }
        }
        Ok(Self::new(size, map.pixels().to_vec()))
    }

    /// From a function of direction, each texel the mean of `fineness`² samples.
    pub fn from_function(
        size: PanoramaSize,
        fineness: u32,
        radiance: impl Fn(Vec3) -> [f32; 3] + Sync,
    ) -> Self {
        let texels = (0..size.texel_count())
            .into_par_iter()
            .map(|index| {
                let (column, row) = (index as u32 % size.width(), index as u32 / size.width());
                let mut sum = [0.0_f64; 3];
                for sample in 0..fineness * fineness {
                    let inside = |part: u32| (f64::from(part) + 0.5) / f64::from(fineness) - 0.5;
                    let texel = DVec2::new(
                        f64::from(column) + inside(sample % fineness),
                        f64::from(row) + inside(sample / fineness),
                    );
                    let value = radiance(size.direction_from_texel(texel).as_vec3());
                    for c in 0..3 {
                        sum[c] += f64::from(value[c]);
                    }
                }
                sum.map(|s| (s / f64::from(fineness * fineness)) as f32)
            })
            .collect();
        Self::new(size, texels)
    }

    fn new(size: PanoramaSize, texels: Vec<[f32; 3]>) -> Self {
        let importance = importance_of(size, &texels);
        Self {
            size,
            texels,
            importance,
            enclosure: None,
        }
    }

    /// The same light on the walls of a box.
    #[must_use]
    pub fn enclosed(self, enclosure: Enclosure) -> Self {
        Self {
            enclosure: Some(enclosure),
            ..self
        }
    }

    /// Whether the light comes from walls at a finite distance.
    pub fn enclosure(&self) -> Option<Enclosure> {
        self.enclosure
    }

    /// The panorama.
    pub fn panorama(&self) -> LinearImage {
        Image::from_vec(self.size.width(), self.size.height(), self.texels.clone())
            .expect("one value a texel")
    }

    /// The panorama averaged to `height` rows, which divide its own.
    pub fn averaged(&self, height: u32) -> LinearImage {
        let factor = (self.size.height() / height.max(1)).max(1);
        let map = self.panorama();
        Image::from_fn(map.width() / factor, map.height() / factor, |x, y| {
            let mut sum = [0.0_f64; 3];
            for index in 0..factor * factor {
                let texel = map.at(x * factor + index % factor, y * factor + index / factor);
                for c in 0..3 {
                    sum[c] += f64::from(texel[c]);
                }
            }
            sum.map(|s| (s / f64::from(factor * factor)) as f32)
        })
    }

    /// Radiance that arrives at `origin` from `direction` (unit), bilinear.
    pub fn radiance(&self, origin: Vec3, direction: Vec3) -> [f32; 3] {
        let direction = match &self.enclosure {
            Some(enclosure) => enclosure.seen_from_center(origin, direction),
            None => direction,
        };
        let taps = self.size.taps(direction.as_dvec3());
        let mut sum = [0.0; 3];
        for (&texel, weight) in taps.texels.iter().zip(taps.weights) {
            let value = self.texels[texel as usize];
            for c in 0..3 {
                sum[c] += weight * value[c];
            }
        }
        sum
    }

    /// A direction in proportion to the light, and its density, 1/steradian. `choice` and `within` uniform in [0, 1).
    pub fn sample(&self, choice: f64, within: [f32; 2]) -> (Vec3, f32) {
        self.importance.sample(choice, within)
    }

    /// Density with which [`Environment::sample`] draws `direction`.
    pub fn density(&self, direction: Vec3) -> f32 {
        self.importance.density(direction)
    }
}
