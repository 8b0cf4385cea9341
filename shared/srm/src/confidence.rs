//! What a texel is worth: confidence from the normal equations and from the held-out residual.

use crate::joint::Solution;
use crate::problem::{Problem, Rgb};
use crate::rows::LUMINANCE;

/// Standard deviation of a texel, in white levels, at which the confidence is one half.
pub const SIGMA_AT_HALF: f64 = 0.1;

/// Smallest residual noise that a confidence is computed with, linear radiance.
pub const SMALLEST_NOISE: f64 = 0.03;

/// Facts about a texel, as bits of one number in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TexelFlags(pub u32);

impl TexelFlags {
    /// No row reaches the texel.
    pub const UNCOVERED: u32 = 1;
    /// Most of what reaches it is clipped: the value is a lower bound (H10).
    pub const SATURATED: u32 = 2;
    /// The offset between D and S is not observed for this map (H02).
    pub const OFFSET_UNOBSERVED: u32 = 4;

    /// Whether a bit is set.
    pub fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }
}

/// Confidence of every texel, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Confidence {
    /// c = I/(I + (noise/0.1)²) with I the information of rows and smoothness, 0 to 1; 0.5 and more counts
    /// as claimed.
    pub confidence: Vec<f32>,
    /// Standard deviation a channel, linear radiance; infinite where no row reaches.
    pub sigma: Vec<[f32; 3]>,
    /// Weight of the rows that reach the texel (sum of squared tap shares).
    pub sample_count: Vec<f32>,
    /// Facts.
    pub flags: Vec<TexelFlags>,
    /// The noise that was assumed: the held-out residual, at least [`SMALLEST_NOISE`].
    pub noise: f64,
}

impl Confidence {
    /// The confidence of a map that claims nothing.
    pub fn nothing(texel_count: usize) -> Self {
        Self {
            confidence: vec![0.0; texel_count],
            sigma: vec![[f32::INFINITY; 3]; texel_count],
            sample_count: vec![0.0; texel_count],
            flags: vec![
                TexelFlags(TexelFlags::UNCOVERED | TexelFlags::OFFSET_UNOBSERVED);
                texel_count
            ],
            noise: SMALLEST_NOISE,
        }
    }
}

impl Problem {
    /// Information of every texel from the normal equations of S, unit noise: what its own rows say, and
    /// what those of its four neighbours say through the smoothness that ties them,
    /// Iₜ + Σ λIₙ/(λ + Iₙ). That is the exact inverse variance where only these five texels are tied, and
    /// too small, never too large, where more are.
    fn texel_information(&self, solution: &Solution, smoothness: f64) -> Vec<Rgb> {
        let own = &self.information(&solution.weights)[self.vertex_count()..];
        let mut information = own.to_vec();
        for texel in 0..own.len() {
            for (other, weight) in self
                .edges(texel, &solution.weights.edges)
                .into_iter()
                .flatten()
            {
                let tie = smoothness * weight;
                for (to, from) in [(texel, other), (other, texel)] {
                    for c in 0..3 {
                        if own[from][c] > 0.0 {
                            information[to][c] += tie * own[from][c] / (tie + own[from][c]);
                        }
                    }
                }
            }
        }
        information
    }

    /// The confidence of a solution that was smoothed with `smoothness`, given the robust residual of rows
    /// that it never saw.
    pub fn confidence(
        &self,
        solution: &Solution,
        smoothness: f64,
        held_out_sigma: f64,
        offset_observed: bool,
    ) -> Confidence {
        let noise = held_out_sigma.max(SMALLEST_NOISE);
        let information = self.texel_information(solution, smoothness);
        let ratio = (noise / SIGMA_AT_HALF).powi(2);
        let texel_count = self.panorama().texel_count();
        let mut reached = vec![0.0_f64; texel_count];
        let mut clipped = vec![0.0_f64; texel_count];
        for row in self.rows().iter() {
            for (&texel, &tap) in row.texels.iter().zip(&row.taps) {
                let share = f64::from(tap) * f64::from(tap);
                reached[texel as usize] += share;
                if row.clipped != 0 {
                    clipped[texel as usize] += share;
                }
            }
        }
        let strongest = self
            .rows()
            .iter()
            .map(|row| row.taps.iter().sum::<f32>())
            .fold(f32::MIN_POSITIVE, f32::max);
        let strongest = f64::from(strongest).powi(2);
        let mut result = Confidence {
            confidence: Vec::with_capacity(texel_count),
            sigma: Vec::with_capacity(texel_count),
            sample_count: Vec::with_capacity(texel_count),
            flags: Vec::with_capacity(texel_count),
            noise,
        };
        for texel in 0..texel_count {
            let info = information[texel];
            // A met lower bound has no weight in its channel and yet says something: the channels are
            // judged together by luminance, and the flag tells.
            let luminance_info: f64 = info.iter().zip(LUMINANCE).map(|(i, l)| i * l).sum();
            let mut flags = 0;
            if !self.covered()[texel] {
                flags |= TexelFlags::UNCOVERED;
            }
            if clipped[texel] > 0.5 * reached[texel] && reached[texel] > 0.0 {
                flags |= TexelFlags::SATURATED;
            }
            if !offset_observed {
                flags |= TexelFlags::OFFSET_UNOBSERVED;
            }
            result
                .confidence
                .push((luminance_info / (luminance_info + ratio)) as f32);
            result.sigma.push(info.map(|i| {
                if i > 0.0 {
                    (noise / i.sqrt()) as f32
                } else {
                    f32::INFINITY
                }
            }));
            result
                .sample_count
                .push((reached[texel] / strongest) as f32);
            result.flags.push(TexelFlags(flags));
        }
        result
    }

    /// S with texels that no row reaches filled from their neighbours, for looking at (their confidence
    /// stays 0): repeated averaging outward from the covered ones.
    pub fn filled(&self, specular: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let size = self.panorama();
        let (width, height) = (i64::from(size.width()), i64::from(size.height()));
        let mut values = specular.to_vec();
        let mut known = self.covered().to_vec();
        while known.iter().any(|k| !k) && known.iter().any(|&k| k) {
            let mut next = known.clone();
            for row in 0..height {
                for column in 0..width {
                    let index = (row * width + column) as usize;
                    if known[index] {
                        continue;
                    }
                    let mut sum = [0.0_f32; 3];
                    let mut count = 0.0;
                    for (dx, dy) in [
                        (-1, 0),
                        (1, 0),
                        (0, -1),
                        (0, 1),
                        (-1, -1),
                        (1, 1),
                        (-1, 1),
                        (1, -1),
                    ] {
                        let neighbour = size.wrap(column + dx, row + dy) as usize;
                        if known[neighbour] {
                            for c in 0..3 {
                                sum[c] += values[neighbour][c];
                            }
                            count += 1.0;
                        }
                    }
                    if count > 0.0 {
                        values[index] = sum.map(|s| s / count);
                        next[index] = true;
                    }
                }
            }
            known = next;
        }
        values
    }
}
