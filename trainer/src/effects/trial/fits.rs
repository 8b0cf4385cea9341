//! Parameters that a trial finds for its effects: the rise of the reflectance, and shares of first bounces.

use std::collections::BTreeMap;

use effects::{Effect, EffectSet};
use srm::{JointSettings, Problem, Row, Rows};

use super::bounce::BLUR_COUNT;
use super::{Trial, reflected, residual};
use crate::effects::fresnel::{FresnelFit, LARGEST_KAPPA, rise};

/// κ from which the search for each segment starts: the best of these for all.
const START_KAPPAS: [f64; 4] = [0.0, 2.0, 8.0, 24.0];
/// Steps of the search.
const KAPPA_STEPS: usize = 4;
/// S answers each step, so that a plain Newton step is too short.
const KAPPA_RELAXATION: f64 = 1.5;
/// Shares of the common gain at which segments may reflect their first bounces.
const BOUNCE_GAINS: [f32; 4] = [0.3, 0.6, 1.2, 3.0];
/// Segments whose share is refined.
const MOST_BOUNCE_SEGMENTS: usize = 4;

impl Trial {
    /// Finds κ of every segment: the best start for all, then steps along the slope of the residual on what the rise
    /// adds, each followed by a new solve.
    pub(super) fn fresnel_fits(
        &self,
        base: EffectSet,
    ) -> anyhow::Result<BTreeMap<u16, FresnelFit>> {
        let set = base.with(Effect::Fresnel);
        let means = self.mean_rises();
        let fits = |kappas: &BTreeMap<u16, f64>| -> BTreeMap<u16, FresnelFit> {
            let fit = |(&segment, &kappa): (&u16, &f64)| {
                let mean = 1.0 + kappa * means.get(&segment).copied().unwrap_or(0.0);
                (segment, FresnelFit { kappa, mean })
            };
            kappas.iter().map(fit).collect()
        };
        let mut best: Option<(f64, BTreeMap<u16, f64>)> = None;
        for start in START_KAPPAS {
            let kappas: BTreeMap<u16, f64> = means.keys().map(|&s| (s, start)).collect();
            let (error, _) = self.step(set, &fits(&kappas))?;
            if best.as_ref().is_none_or(|(least, _)| error < *least) {
                best = Some((error, kappas));
            }
        }
        let Some((mut least, mut chosen)) = best else {
            return Ok(BTreeMap::new());
        };
        let mut kappas = chosen.clone();
        for _ in 0..KAPPA_STEPS {
            let (error, slopes) = self.step(set, &fits(&kappas))?;
            if error < least {
                (least, chosen) = (error, kappas.clone());
            }
            for (segment, kappa) in &mut kappas {
                let slope = slopes.get(segment).copied().unwrap_or(0.0);
                *kappa = (*kappa + KAPPA_RELAXATION * slope).clamp(0.0, LARGEST_KAPPA);
            }
        }
        let (error, _) = self.step(set, &fits(&kappas))?;
        if error < least {
            chosen = kappas;
        }
        Ok(fits(&chosen))
    }

    /// Finds what each segment reflects of its first bounces, and how blurred: the best of a few shares
    /// for all, then for each of the segments half and double of that.
    pub(super) fn fit_bounce_gains(&mut self, set: EffectSet) -> anyhow::Result<()> {
        let mut count: BTreeMap<u16, usize> = BTreeMap::new();
        for row in self.rows.iter().filter(|row| row.bounce.is_some()) {
            *count.entry(row.base.segment).or_default() += 1;
        }
        let mut best = (f64::INFINITY, BTreeMap::new());
        let mut best_blur = 0;
        for blur in 0..BLUR_COUNT {
            self.blur = blur;
            for share in BOUNCE_GAINS {
                let before = best.0;
                let gains = count.keys().map(|&segment| (segment, share)).collect();
                self.try_bounce_gains(set, gains, &mut best)?;
                if best.0 < before {
                    best_blur = blur;
                }
            }
        }
        self.blur = best_blur;
        let mut largest: Vec<u16> = count.keys().copied().collect();
        largest.sort_by_key(|segment| (std::cmp::Reverse(count[segment]), *segment));
        if largest.len() > 1 {
            for segment in largest.into_iter().take(MOST_BOUNCE_SEGMENTS) {
                for factor in [0.5, 2.0] {
                    let mut gains: BTreeMap<u16, f32> = best.1.clone();
                    if let Some(gain) = gains.get_mut(&segment) {
                        *gain *= factor;
                    }
                    self.try_bounce_gains(set, gains, &mut best)?;
                }
            }
        }
        self.bounce_gains = best.1;
        Ok(())
    }

    fn try_bounce_gains(
        &mut self,
        set: EffectSet,
        gains: BTreeMap<u16, f32>,
        best: &mut (f64, BTreeMap<u16, f32>),
    ) -> anyhow::Result<()> {
        self.bounce_gains.clone_from(&gains);
        let residuals = self.residuals(set, &|_| true, &|_| true)?;
        let error: f64 = residuals.iter().map(|(_, residual)| residual).sum();
        if error < best.0 {
            *best = (error, gains);
        }
        Ok(())
    }

    /// Mean of (1 − cos α)⁵ of every segment.
    fn mean_rises(&self) -> BTreeMap<u16, f64> {
        let mut sums: BTreeMap<u16, (f64, f64)> = BTreeMap::new();
        for row in &self.rows {
            let sum = sums.entry(row.base.segment).or_default();
            sum.0 += rise(f64::from(row.cosine));
            sum.1 += 1.0;
        }
        sums.into_iter()
            .map(|(segment, (sum, count))| (segment, sum / count))
            .collect()
    }

    /// Solves with these rises: mean absolute error, and the step of κ that the residuals of each segment ask for.
    fn step(
        &self,
        set: EffectSet,
        fits: &BTreeMap<u16, FresnelFit>,
    ) -> anyhow::Result<(f64, BTreeMap<u16, f64>)> {
        let rows: Rows = self
            .rows
            .iter()
            .map(|row| self.composed(row, set, Some(fits)))
            .collect();
        anyhow::ensure!(rows.len() == self.rows.len(), "a survey row is not finite");
        let problem = Problem::new(rows, self.cell_count, self.panorama)?;
        let solution = problem.solve(&self.settings(problem.rows().len()));
        let mut error = 0.0;
        let mut count = 0.0;
        let mut slopes = Slopes::default();
        for (row, composed) in self.rows.iter().zip(problem.rows().iter()) {
            if composed.clipped != 0 {
                continue;
            }
            let r = residual(&problem, composed, &solution.unknowns);
            error += r.abs();
            count += 1.0;
            let Some(fit) = fits.get(&composed.segment) else {
                continue;
            };
            let without_rise = reflected(&problem, composed, &solution.unknowns)
                / f64::from(fit.factor(row.cosine))
                / fit.mean;
            let x = without_rise * rise(f64::from(row.cosine));
            slopes.add(composed, x, r);
        }
        Ok((error / f64::max(count, 1.0), slopes.by_segment()))
    }
}

/// Slopes of residuals on something, a segment; within cells, each of which has a D of its own that takes up the mean.
#[derive(Default)]
struct Slopes {
    /// Weight, x, r, x², xr.
    moments: BTreeMap<(u16, u32), [f64; 5]>,
}

impl Slopes {
    fn add(&mut self, row: &Row, x: f64, r: f64) {
        let scale = JointSettings::default().residual_scale;
        let weight = 1.0 / (1.0 + (r / scale).powi(2)).sqrt();
        let sums = self
            .moments
            .entry((row.segment, row.vertices[0]))
            .or_default();
        for (sum, value) in sums.iter_mut().zip([1.0, x, r, x * x, x * r]) {
            *sum += weight * value;
        }
    }

    fn by_segment(self) -> BTreeMap<u16, f64> {
        let mut pooled: BTreeMap<u16, (f64, f64)> = BTreeMap::new();
        for ((segment, _), [weight, x, r, xx, xr]) in self.moments {
            let sums = pooled.entry(segment).or_default();
            sums.0 += xr - x * r / weight;
            sums.1 += xx - x * x / weight;
        }
        let known = pooled
            .into_iter()
            .filter(|(_, (_, variance))| *variance > 1e-9);
        known
            .map(|(segment, (covariance, variance))| (segment, covariance / variance))
            .collect()
    }
}
