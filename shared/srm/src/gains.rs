//! How strongly each segment reflects the map that all of them made.
//!
//! S is solved with one gain for everything: freeing the gain there trades light between D and S
//! (srm-feasibility section 4.4). For drawing, S is known, and a segment's share of it can be read off.

use std::collections::BTreeMap;

use crate::joint::Solution;
use crate::problem::Problem;
use crate::rows::{Row, Rows, luminance};

/// A segment reflects at most this many times what the common gain says.
const LARGEST_GAIN: f64 = 3.0;

/// Weighted moments of what rows reflect (x) and what they show (y).
#[derive(Clone, Copy, Default)]
struct Moments {
    weight: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
}

impl Moments {
    /// Covariance of x and y and variance of x, both times the weight.
    fn centred(&self) -> (f64, f64) {
        if self.weight <= 0.0 {
            return (0.0, 0.0);
        }
        (
            self.xy - self.x * self.y / self.weight,
            self.xx - self.x * self.x / self.weight,
        )
    }
}

impl Problem {
    /// Relative gain of every segment: the slope of what its rows show against what they reflect, luminance,
    /// within vertices (each vertex has a D of its own, so means say nothing), pooled over the segment. 1
    /// where nothing varies. Noise in S draws the slope towards 0, which is what predicts best.
    pub fn segment_gains(&self, solution: &Solution) -> BTreeMap<u16, f64> {
        let mut moments: BTreeMap<(u16, u32), Moments> = BTreeMap::new();
        for (row, weight) in self.rows().iter().zip(&solution.weights.rows) {
            if row.clipped != 0 {
                continue;
            }
            let nearest = (0..3).max_by(|&a, &b| row.barycentric[a].total_cmp(&row.barycentric[b]));
            let vertex = row.vertices[nearest.unwrap_or(0)];
            let (w, x) = (f64::from(weight[1]), self.reflected(row, solution));
            let y = luminance(row.observed.map(f64::from));
            let sums = moments.entry((row.segment, vertex)).or_default();
            sums.weight += w;
            sums.x += w * x;
            sums.y += w * y;
            sums.xx += w * x * x;
            sums.xy += w * x * y;
        }
        let mut slopes: BTreeMap<u16, (f64, f64)> = BTreeMap::new();
        for ((segment, _), sums) in moments {
            let (covariance, variance) = sums.centred();
            let pooled = slopes.entry(segment).or_default();
            pooled.0 += covariance;
            pooled.1 += variance;
        }
        slopes
            .into_iter()
            .map(|(segment, (covariance, variance))| {
                let slope = if variance > 1e-9 {
                    covariance / variance
                } else {
                    1.0
                };
                (segment, slope.clamp(0.0, LARGEST_GAIN))
            })
            .collect()
    }

    /// Luminance that a row reflects at the common gain: map and first bounce.
    fn reflected(&self, row: &Row, solution: &Solution) -> f64 {
        let mut sum = row.known.map(f64::from);
        for (&texel, &tap) in row.texels.iter().zip(&row.taps) {
            for (total, s) in sum
                .iter_mut()
                .zip(solution.unknowns[self.vertex_count() + texel as usize])
            {
                *total += f64::from(tap) * s;
            }
        }
        luminance(sum)
    }

    /// The same problem with what rows reflect scaled by the gain of their segment.
    #[must_use]
    pub fn with_segment_gains(&self, gains: &BTreeMap<u16, f64>) -> Self {
        let rows: Rows = self
            .rows()
            .iter()
            .map(|row| {
                let gain = gains.get(&row.segment).copied().unwrap_or(1.0) as f32;
                Row {
                    taps: row.taps.map(|t| t * gain),
                    known: row.known.map(|k| k * gain),
                    ..*row
                }
            })
            .collect();
        self.with_rows(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::JointSettings;
    use geometry::PanoramaSize;

    #[test]
    fn a_weaker_segment_is_found_by_its_slope() {
        const TOLERANCE: f64 = 1e-4;
        let panorama = PanoramaSize::from_height(4).unwrap();
        let truth = |texel: u32| 0.2 + 0.02 * f64::from(texel);
        let rows: Rows = (0..320_u32)
            .map(|i| {
                let (vertex, texel) = (i % 10, i % 32);
                let segment = 1 + (vertex % 2) as u16;
                let gain = [0.3, 0.12][usize::from(segment) - 1];
                let observed = 0.05 * f64::from(vertex) + gain * truth(texel);
                Row {
                    vertices: [vertex; 3],
                    barycentric: [1.0, 0.0, 0.0],
                    texels: [texel; 4],
                    taps: [0.3, 0.0, 0.0, 0.0],
                    observed: [observed as f32; 3],
                    known: [0.0; 3],
                    weight: 1.0,
                    clipped: 0,
                    frame: i,
                    segment,
                }
            })
            .collect();
        let problem = Problem::new(rows, 10, panorama).unwrap();
        let mut solution = problem.solve(&JointSettings {
            rounds: 1,
            ..JointSettings::default()
        });
        for texel in 0..32 {
            solution.unknowns[10 + texel as usize] = [truth(texel); 3];
        }
        let gains = problem.segment_gains(&solution);
        assert!((gains[&1] - 1.0).abs() < TOLERANCE, "{}", gains[&1]);
        assert!((gains[&2] - 0.4).abs() < TOLERANCE, "{}", gains[&2]);
        let scaled = problem.with_segment_gains(&gains);
        assert!((scaled.rows().as_slice()[1].taps[0] - 0.12).abs() < 1e-4);
    }
}
