//! Least squares of a map's luminance on a square wave of known phase.

use geometry::{DQuat, DVec3, PanoramaSize};
use glam::{DMat4, DVec4};
use imaging::{Image, LinearImage};

use super::file::BarGroup;
use crate::eval::environment::score::luminance;

/// Samples for each bar's width.
const SAMPLES_A_BAR: f64 = 10.0;
/// Offsets at which a plain panel is judged.
const OFFSET_COUNT: usize = 32;
/// Least confidence of a sample that counts.
const LEAST_CONFIDENCE: f64 = 0.5;
/// A determinant of the scaled normal equations below this has no solution.
const SMALLEST_DETERMINANT: f64 = 1e-9;

/// A map to be judged, in its own axes.
pub(in crate::eval::environment) struct MapView<'a> {
    /// Linear radiance.
    pub(in crate::eval::environment) map: &'a LinearImage,
    /// Confidence in [0, 1], of the same size.
    pub(in crate::eval::environment) confidence: &'a Image<f32>,
    /// The turn from the map's axes to those of the truth.
    pub(in crate::eval::environment) truth_from_map: DQuat,
    /// The scale that fits the map to the truth.
    pub(in crate::eval::environment) scale: f64,
}

/// A sample on a group, in widths and lengths from its centre.
#[derive(Clone, Copy)]
struct Sample {
    t: f64,
    s: f64,
    value: f64,
}

/// The samples of one panel that the map claims.
pub(super) struct Panel {
    samples: Vec<Sample>,
    /// Share of the panel's samples that the map claims.
    pub(super) coverage: f64,
}

impl MapView<'_> {
    /// Luminance along a direction of the truth, bilinear; `None` where the map does not claim it.
    fn luminance(&self, size: PanoramaSize, direction: DVec3) -> Option<f64> {
        let taps = size.taps(self.truth_from_map.conjugate() * direction);
        let (mut color, mut confidence) = ([0.0; 3], 0.0);
        for (&texel, weight) in taps.texels.iter().zip(taps.weights) {
            let value = self.map.pixels()[texel as usize];
            for c in 0..3 {
                color[c] += f64::from(weight) * f64::from(value[c]);
            }
            confidence += f64::from(weight) * f64::from(self.confidence.pixels()[texel as usize]);
        }
        let value = luminance(color);
        (confidence >= LEAST_CONFIDENCE && value.is_finite()).then_some(value)
    }

    /// Samples `window`, a rectangle of the group's size, at pitch width/10 on the panel of `on`; its axes are
    /// exchanged where the panel's bars would run the other way. Cut where the panel ends.
    pub(super) fn sample(&self, size: PanoramaSize, window: &BarGroup, on: &BarGroup) -> Panel {
        let width = window.width_deg.to_radians();
        let length = window.length_deg.to_radians();
        let crossed = window.is_crossed_by(on);
        let ends = on.half_extent();
        let across = 5 * SAMPLES_A_BAR as usize;
        let along = (SAMPLES_A_BAR * length / width).ceil() as usize;
        let (mut samples, mut count) = (Vec::new(), 0_usize);
        for i in 0..across {
            let t = (i as f64 + 0.5) / SAMPLES_A_BAR - 2.5;
            for j in 0..along {
                let s = (j as f64 + 0.5) / along as f64 - 0.5;
                let place = if crossed {
                    [s * length, t * width]
                } else {
                    [t * width, s * length]
                };
                if place[0].abs() > ends[0] || place[1].abs() > ends[1] {
                    continue;
                }
                count += 1;
                let value = self.luminance(size, on.direction(place[0], place[1]));
                samples.extend(value.map(|value| Sample { t, s, value }));
            }
        }
        Panel {
            coverage: samples.len() as f64 / f64::max(count as f64, 1.0),
            samples,
        }
    }
}

/// The square wave: bars 0, 2, 4 from t = −2.5 on are +1, the others −1; `offset` in widths.
fn wave(t: f64, offset: f64) -> f64 {
    let bar = (t - offset + 2.5).floor();
    if bar.rem_euclid(2.0) < 1.0 { 1.0 } else { -1.0 }
}

impl Panel {
    /// The coefficient of the wave in a least-squares fit of 1, t, s and the wave; `None` when too few samples
    /// decide it.
    pub(super) fn coefficient(&self, offset: f64) -> Option<f64> {
        let mut normal = DMat4::ZERO;
        let mut right = DVec4::ZERO;
        for sample in &self.samples {
            let row = DVec4::new(1.0, sample.t, sample.s, wave(sample.t, offset));
            for k in 0..4 {
                *normal.col_mut(k) += row * row[k];
            }
            right += row * sample.value;
        }
        let count = self.samples.len() as f64;
        if count < 8.0 || (normal * (1.0 / count)).determinant() < SMALLEST_DETERMINANT {
            return None;
        }
        let coefficient = (normal.inverse() * right).w;
        coefficient.is_finite().then_some(coefficient)
    }

    /// Root mean square of the coefficients that a panel without bars gives, the wave shifted over its period but
    /// never by a multiple of half a bar.
    pub(super) fn null_deviation(&self) -> Option<f64> {
        let coefficients: Option<Vec<f64>> = (0..OFFSET_COUNT)
            .map(|k| self.coefficient(2.0 * (k as f64 + 0.5) / OFFSET_COUNT as f64))
            .collect();
        let squares: f64 = coefficients?.iter().map(|a| a * a).sum();
        Some((squares / OFFSET_COUNT as f64).sqrt())
    }
}
