//! What was computed for effects: proof that an effect that is off costs nothing.

use std::collections::BTreeMap;
use std::ops::AddAssign;

use serde::{Deserialize, Serialize};

use crate::effect::Effect;

/// Work done for effects. Each task counts for itself, sums are added up at the end of the stage: counting costs an
/// addition, and the sums do not depend on the number of threads.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counters {
    /// Rays that only ask whether something is in the way.
    pub rays_occlusion: u64,
    /// Rays that ask what they meet first.
    pub rays_closest: u64,
    /// Coefficients of each specular map.
    pub taps_srm: Vec<u64>,
    /// Look-ups of the surface's colour for first bounces.
    pub taps_texture: u64,
    /// Pixels with a first bounce in their model.
    pub first_bounce_pixels: u64,
    /// Fresnel factors evaluated.
    pub fresnel_evals: u64,
    /// Pixels whose weight follows their noise.
    pub noise_weights: u64,
    /// Bytes of buffers that exist for one effect alone.
    pub bytes_effect: BTreeMap<Effect, u64>,
}

impl Counters {
    /// Counts `taps` coefficients of map `map`.
    pub fn add_taps(&mut self, map: usize, taps: u64) {
        if self.taps_srm.len() <= map {
            self.taps_srm.resize(map + 1, 0);
        }
        self.taps_srm[map] += taps;
    }

    /// Counts bytes of a buffer that exists for `effect` alone.
    pub fn add_bytes(&mut self, effect: Effect, bytes: usize) {
        if bytes > 0 {
            *self.bytes_effect.entry(effect).or_default() += bytes as u64;
        }
    }

    /// What was counted for an effect that has counters of its own: 0 is the proof that it was not computed. The
    /// rays of a first bounce answer visibility too.
    pub fn of(&self, effect: Effect) -> u64 {
        let work = match effect {
            Effect::Visibility => self.rays_occlusion + self.rays_closest,
            Effect::FirstBounce => self.first_bounce_pixels + self.taps_texture + self.rays_closest,
            Effect::Fresnel => self.fresnel_evals,
            Effect::Noise => self.noise_weights,
            Effect::FirstBounceSpecular
            | Effect::Vignetting
            | Effect::Response
            | Effect::Saturation
            | Effect::PoseRefinement => 0,
        };
        work + self.bytes_effect.get(&effect).copied().unwrap_or(0)
    }
}

impl AddAssign<&Self> for Counters {
    fn add_assign(&mut self, other: &Self) {
        self.rays_occlusion += other.rays_occlusion;
        self.rays_closest += other.rays_closest;
        for (map, taps) in other.taps_srm.iter().enumerate() {
            self.add_taps(map, *taps);
        }
        self.taps_texture += other.taps_texture;
        self.first_bounce_pixels += other.first_bounce_pixels;
        self.fresnel_evals += other.fresnel_evals;
        self.noise_weights += other.noise_weights;
        for (effect, bytes) in &other.bytes_effect {
            *self.bytes_effect.entry(*effect).or_default() += bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_do_not_depend_on_the_grouping() {
        let part = |n: u64| {
            let mut counters = Counters {
                rays_closest: n,
                fresnel_evals: 2 * n,
                ..Counters::default()
            };
            counters.add_taps((n % 2) as usize, n);
            counters.add_bytes(Effect::FirstBounceSpecular, n as usize);
            counters
        };
        let mut one_by_one = Counters::default();
        for n in 0..6 {
            one_by_one += &part(n);
        }
        let (mut low, mut high) = (Counters::default(), Counters::default());
        for n in 0..3 {
            low += &part(n);
            high += &part(n + 3);
        }
        high += &low;
        assert_eq!(one_by_one, high);
        assert_eq!(one_by_one.taps_srm, [6, 9]);
        assert_eq!(one_by_one.of(Effect::FirstBounceSpecular), 15);
    }

    #[test]
    fn nothing_done_is_zero_for_every_effect() {
        let nothing = Counters::default();
        assert!(Effect::ALL.iter().all(|&effect| nothing.of(effect) == 0));
    }
}
