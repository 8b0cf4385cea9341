//! A small solve of the survey's pixels with any set of effects, for paired comparisons.
//!
//! D is one colour a cell of the surface instead of one a vertex, the map is small, and rows are thinned: what is
//! compared is the same rows with and without one effect, so that all of this cancels.

use std::collections::BTreeMap;

use effects::survey::CODES;
use effects::{BlockPlan, Comparison, Effect, EffectSet, ErrorPair};
use geometry::PanoramaSize;
use rayon::prelude::*;
use raytrace::Hit;
use srm::rows::luminance;
use srm::{DiffuseTreatment, JointSettings, Problem, Row, Rows};

use super::fresnel::{FresnelFit, LARGEST_KAPPA, rise};
use super::views::{SurveyPixel, SurveyViews, bilinear};
use crate::stages::observe::Surface;

/// Rows of a trial at most.
const MOST_ROWS: usize = 36_000;
/// Rows of its map: texels of 2.8 degrees.
const MAP_HEIGHT: u32 = 64;
/// Edge of a cell of D in survey pixels at the median depth.
const CELL_PIXELS: f64 = 1.5;
/// Pull of D to zero at ten rows a cell, as in training.
const DIFFUSE_WEIGHT: f64 = 0.2;
/// Every other block is held out, in two turns: two fits judge all blocks.
const TURNS: usize = 2;
/// κ from which the search for each segment starts: the best of these for all.
const START_KAPPAS: [f64; 4] = [0.0, 2.0, 8.0, 24.0];
/// Steps of the search.
const KAPPA_STEPS: usize = 4;
/// S answers each step, so that a plain Newton step is too short.
const KAPPA_RELAXATION: f64 = 1.5;
/// Steps of the search for gains of first bounces.
const BOUNCE_STEPS: usize = 3;
/// A segment reflects at most this many times what the common gain says.
const LARGEST_BOUNCE_GAIN: f64 = 3.0;
/// Gain of the trial's map; the map takes up any other.
const GAIN: f32 = 0.3;

/// A survey pixel with all terms that any effect could give it.
#[derive(Clone, Copy)]
struct TrialRow {
    base: Row,
    cosine: f32,
    /// Colour of the first bounce: on average, and without what it mirrors.
    bounce: Option<BounceColor>,
    /// Texels and weights of the second mirrored direction.
    second: Option<([u32; 4], [f32; 4])>,
}

/// Colour of a surface over the views.
#[derive(Clone, Copy)]
struct BounceColor {
    median: [f32; 3],
    /// Lower decile.
    low: [f32; 3],
}

/// The small problem.
pub(super) struct Trial {
    rows: Vec<TrialRow>,
    cell_count: usize,
    panorama: PanoramaSize,
    /// Found when Fresnel is tried.
    fresnel: Option<BTreeMap<u16, FresnelFit>>,
    /// What segments reflect of their first bounces over the common gain; found when first bounces are tried.
    bounce_gains: Option<BTreeMap<u16, f64>>,
    blocks: Option<BlockPlan>,
    /// Errors by set, so that none is solved twice: of fitted frames, and of blocks.
    fitted: BTreeMap<String, f64>,
    held: BTreeMap<String, Vec<f64>>,
}

impl Trial {
    /// From the survey; `None` without pixels of the object.
    pub(super) fn new(views: &SurveyViews, surface: &Surface) -> Option<Self> {
        let panorama = PanoramaSize::from_height(MAP_HEIGHT)?;
        let count: usize = views.views.iter().map(|view| view.pixels.len()).sum();
        let step = count.div_ceil(MOST_ROWS).max(1);
        let picked: Vec<(usize, &SurveyPixel)> = views
            .views
            .iter()
            .enumerate()
            .flat_map(|(view, of)| of.pixels.iter().map(move |pixel| (view, pixel)))
            .step_by(step)
            .collect();
        let mut depths: Vec<f64> = picked.iter().map(|(_, p)| f64::from(p.hit.t)).collect();
        let depth = geometry::robust::median(&mut depths)?;
        let cell = CELL_PIXELS * depth / views.camera.focal().x;
        let mut cells = BTreeMap::new();
        let colors = bounce_colors(views, surface, &picked);
        let rows = picked
            .into_iter()
            .map(|(view, pixel)| {
                let own = &views.views[view];
                let taps = panorama.taps(pixel.reflected.as_dvec3());
                let corners = surface.triangles[pixel.hit.triangle as usize].map(|vertex| {
                    let at = surface.positions[vertex as usize].as_dvec3() / cell;
                    let key = (
                        pixel.segment,
                        [at.x, at.y, at.z].map(|value| value.floor() as i64),
                    );
                    let next = cells.len() as u32;
                    *cells.entry(key).or_insert(next)
                });
                TrialRow {
                    base: Row {
                        vertices: corners,
                        barycentric: [1.0 - pixel.hit.u - pixel.hit.v, pixel.hit.u, pixel.hit.v],
                        texels: taps.texels,
                        taps: taps.weights.map(|weight| weight * GAIN),
                        observed: own.color[pixel.place],
                        known: [0.0; 3],
                        weight: 1.0,
                        clipped: if pixel.is_saturated { 0b111 } else { 0 },
                        frame: own.position as u32,
                        segment: pixel.segment,
                    },
                    cosine: pixel.cosine,
                    bounce: pixel
                        .bounce
                        .and_then(|bounce| bounce_color(&colors, surface, &bounce)),
                    second: pixel.second.map(|direction| {
                        let taps = panorama.taps(direction.as_dvec3());
                        (taps.texels, taps.weights)
                    }),
                }
            })
            .collect();
        Some(Self {
            rows,
            cell_count: cells.len(),
            panorama,
            fresnel: None,
            bounce_gains: None,
            blocks: None,
            fitted: BTreeMap::new(),
            held: BTreeMap::new(),
        })
    }

    /// Sets the blocks that are held out; `None` for comparisons on fitted frames.
    pub(super) fn hold_out(&mut self, blocks: Option<BlockPlan>) {
        self.blocks = blocks;
        self.held.clear();
    }

    /// The rise of every segment's reflectance, found when it was tried.
    pub(super) fn fresnel(&self) -> Option<&BTreeMap<u16, FresnelFit>> {
        self.fresnel.as_ref()
    }

    /// What segments reflect of their first bounces, found when that was tried.
    pub(super) fn bounce_gains(&self) -> Option<&BTreeMap<u16, f64>> {
        self.bounce_gains.as_ref()
    }

    /// Mean absolute error of every view in codes, fitted with `set`, in the order of the views.
    pub(super) fn error_by_view(&self, set: EffectSet) -> anyhow::Result<Vec<f64>> {
        let residuals = self.residuals(set, &|_| true, &|_| true)?;
        let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        for (row, residual) in residuals {
            let sum = sums.entry(self.rows[row].base.frame).or_default();
            sum.0 += residual;
            sum.1 += 1.0;
        }
        Ok(sums
            .into_values()
            .map(|(sum, count)| CODES * sum / count)
            .collect())
    }

    /// Errors of `base` without and with `effect`.
    pub(super) fn compare(
        &mut self,
        base: EffectSet,
        effect: Effect,
    ) -> anyhow::Result<Comparison> {
        self.fit(base, effect)?;
        let with = base.with(effect);
        if self.blocks.is_some() {
            let off = self.held_errors(base)?;
            let on = self.held_errors(with)?;
            let pairs = off
                .iter()
                .zip(&on)
                .map(|(&l1_off, &l1_on)| ErrorPair { l1_off, l1_on })
                .filter(|pair| pair.l1_off.is_finite() && pair.l1_on.is_finite());
            return Ok(Comparison::Blocks(pairs.collect()));
        }
        Ok(Comparison::Fitted(ErrorPair {
            l1_off: self.fitted_error(base)?,
            l1_on: self.fitted_error(with)?,
        }))
    }

    /// Finds the parameters of `effect` beside those of `base`, where they are not known yet.
    pub(super) fn fit(&mut self, base: EffectSet, effect: Effect) -> anyhow::Result<()> {
        match effect {
            Effect::Fresnel if self.fresnel.is_none() => self.fit_fresnel(base),
            Effect::FirstBounce if self.bounce_gains.is_none() => {
                self.fit_bounce_gains(base.with(effect))
            }
            Effect::Visibility
            | Effect::FirstBounce
            | Effect::FirstBounceSpecular
            | Effect::Fresnel
            | Effect::Vignetting
            | Effect::Response
            | Effect::Saturation
            | Effect::Noise
            | Effect::PoseRefinement => Ok(()),
        }
    }

    fn fitted_error(&mut self, set: EffectSet) -> anyhow::Result<f64> {
        if let Some(&known) = self.fitted.get(&set.to_string()) {
            return Ok(known);
        }
        let residuals = self.residuals(set, &|_| true, &|_| true)?;
        let sum: f64 = residuals.iter().map(|(_, residual)| residual).sum();
        let error = CODES * sum / residuals.len().max(1) as f64;
        self.fitted.insert(set.to_string(), error);
        Ok(error)
    }

    /// Error of every block while it is held out; NaN where none of its rows can be judged.
    fn held_errors(&mut self, set: EffectSet) -> anyhow::Result<Vec<f64>> {
        if let Some(known) = self.held.get(&set.to_string()) {
            return Ok(known.clone());
        }
        let Some(plan) = self.blocks.clone() else {
            return Ok(Vec::new());
        };
        let mut sums = vec![(0.0, 0.0); plan.blocks.len()];
        for turn in 0..TURNS {
            let is_held = |block: usize| block % TURNS == turn;
            let fits = |frame: u32| plan.is_fitted(frame as usize, is_held);
            let judges = |frame: u32| plan.block_of(frame as usize).is_some_and(is_held);
            for (row, residual) in self.residuals(set, &fits, &judges)? {
                let frame = self.rows[row].base.frame as usize;
                if let Some(block) = plan.block_of(frame) {
                    sums[block].0 += residual;
                    sums[block].1 += 1.0;
                }
            }
        }
        let errors: Vec<f64> = sums
            .into_iter()
            .map(|(sum, count)| CODES * sum / count)
            .collect();
        self.held.insert(set.to_string(), errors.clone());
        Ok(errors)
    }

    /// Solves the rows whose frame `fits` and gives |residual| (luminance) of those whose frame `judges`, by row, where
    /// the fit knows their part of the surface.
    fn residuals(
        &self,
        set: EffectSet,
        fits: &dyn Fn(u32) -> bool,
        judges: &dyn Fn(u32) -> bool,
    ) -> anyhow::Result<Vec<(usize, f64)>> {
        let fit: Rows = self
            .rows
            .iter()
            .filter(|row| fits(row.base.frame))
            .map(|row| self.composed(row, set, self.fresnel.as_ref()))
            .collect();
        if fit.is_empty() {
            return Ok(Vec::new());
        }
        let problem = Problem::new(fit, self.cell_count, self.panorama)?;
        let solution = problem.solve(&self.settings(problem.rows().len()));
        let known = srm::selection::known_vertices(&problem);
        Ok(self
            .rows
            .iter()
            .enumerate()
            .filter(|(_, row)| judges(row.base.frame) && row.base.clipped == 0)
            .filter(|(_, row)| row.base.vertices.iter().all(|&v| known[v as usize]))
            .map(|(index, row)| {
                let row = self.composed(row, set, self.fresnel.as_ref());
                (index, residual(&problem, &row, &solution.unknowns).abs())
            })
            .collect())
    }

    fn settings(&self, row_count: usize) -> JointSettings {
        let rows_per_cell = row_count as f64 / self.cell_count.max(1) as f64;
        let mut settings = JointSettings {
            diffuse: DiffuseTreatment::PulledToZero {
                weight: DIFFUSE_WEIGHT * rows_per_cell / 10.0,
            },
            rounds: 2,
            ..JointSettings::default()
        };
        settings.solver.steps = 24;
        settings.solver.passes = 1;
        settings
    }

    /// The row with the terms of `set`.
    fn composed(
        &self,
        row: &TrialRow,
        set: EffectSet,
        fresnel: Option<&BTreeMap<u16, FresnelFit>>,
    ) -> Row {
        let mut composed = row.base;
        let factor = fresnel
            .filter(|_| set.contains(Effect::Fresnel))
            .and_then(|fits| fits.get(&row.base.segment))
            .map_or(1.0, |fit| fit.factor(row.cosine));
        if set.contains(Effect::Visibility)
            && let Some(color) = row.bounce
        {
            composed.taps = [0.0; 4];
            let mut shown = color.median;
            if set.contains(Effect::FirstBounceSpecular)
                && let Some((texels, weights)) = row.second
            {
                composed.texels = texels;
                composed.taps = weights.map(|weight| weight * GAIN * GAIN);
                shown = color.low;
            }
            if set.contains(Effect::FirstBounce) {
                let gains = self.bounce_gains.as_ref();
                let share = gains.and_then(|gains| gains.get(&row.base.segment));
                let gain = GAIN * factor * share.map_or(1.0, |share| *share as f32);
                composed.known = shown.map(|value| value * gain);
            }
        }
        composed.taps = composed.taps.map(|tap| tap * factor);
        composed
    }

    /// Finds κ of every segment: the best start for all, then steps along the slope of the residual on what the rise
    /// adds, each followed by a new solve.
    fn fit_fresnel(&mut self, base: EffectSet) -> anyhow::Result<()> {
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
            return Ok(());
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
        self.fresnel = Some(fits(&chosen));
        Ok(())
    }

    /// Finds what each segment reflects of its first bounces: steps along the slope of the residual on them.
    fn fit_bounce_gains(&mut self, set: EffectSet) -> anyhow::Result<()> {
        let mut gains: BTreeMap<u16, f64> = self
            .rows
            .iter()
            .map(|row| (row.base.segment, 1.0))
            .collect();
        for _ in 0..BOUNCE_STEPS {
            self.bounce_gains = Some(gains.clone());
            for (segment, slope) in self.bounce_slopes(set)? {
                let gain = gains.entry(segment).or_insert(1.0);
                *gain = (*gain + slope).clamp(0.0, LARGEST_BOUNCE_GAIN);
            }
        }
        self.bounce_gains = Some(gains);
        Ok(())
    }

    /// Slope of the residual of each segment on what its first bounces show, over blocked rows.
    fn bounce_slopes(&self, set: EffectSet) -> anyhow::Result<BTreeMap<u16, f64>> {
        let rows: Rows = self
            .rows
            .iter()
            .map(|row| self.composed(row, set, self.fresnel.as_ref()))
            .collect();
        anyhow::ensure!(rows.len() == self.rows.len(), "a survey row is not finite");
        let problem = Problem::new(rows, self.cell_count, self.panorama)?;
        let solution = problem.solve(&self.settings(problem.rows().len()));
        let mut slopes = Slopes::default();
        for (row, composed) in self.rows.iter().zip(problem.rows().iter()) {
            if let Some(color) = row.bounce.filter(|_| composed.clipped == 0) {
                let r = residual(&problem, composed, &solution.unknowns);
                let x = f64::from(GAIN) * luminance(color.median.map(f64::from));
                slopes.add(composed, x, r);
            }
        }
        Ok(slopes.by_segment())
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

/// Observed minus predicted, luminance.
fn residual(problem: &Problem, row: &Row, unknowns: &[[f64; 3]]) -> f64 {
    let predicted = problem.predict(row, unknowns);
    luminance(std::array::from_fn(|c| {
        f64::from(row.observed[c]) - predicted[c]
    }))
}

/// What a row reflects, luminance.
fn reflected(problem: &Problem, row: &Row, unknowns: &[[f64; 3]]) -> f64 {
    let mut sum = row.known.map(f64::from);
    for (&texel, &tap) in row.texels.iter().zip(&row.taps) {
        let value = unknowns[problem.vertex_count() + texel as usize];
        for (sum, value) in sum.iter_mut().zip(value) {
            *sum += f64::from(tap) * value;
        }
    }
    luminance(sum)
}

/// Colours of the vertices that first bounces meet.
fn bounce_colors(
    views: &SurveyViews,
    surface: &Surface,
    picked: &[(usize, &SurveyPixel)],
) -> BTreeMap<u32, BounceColor> {
    let width = views.camera.width() as usize;
    let mut vertices: Vec<u32> = picked
        .iter()
        .filter_map(|(_, pixel)| pixel.bounce)
        .flat_map(|bounce| surface.triangles[bounce.triangle as usize])
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    let colors: Vec<BounceColor> = vertices
        .par_iter()
        .map(|&vertex| {
            let seen: Vec<[f32; 3]> = views
                .views
                .iter()
                .filter_map(|view| {
                    let at = views.place(view, surface, vertex as usize)?;
                    bilinear(&view.color, width, at, |color| color)
                })
                .collect();
            let quantile = |q: f64| {
                [0, 1, 2].map(|c| {
                    let mut values: Vec<f64> =
                        seen.iter().map(|color| f64::from(color[c])).collect();
                    geometry::robust::quantile(&mut values, q).unwrap_or(0.0) as f32
                })
            };
            BounceColor {
                median: quantile(0.5),
                low: quantile(0.1),
            }
        })
        .collect();
    vertices.into_iter().zip(colors).collect()
}

/// The colour of a first bounce between its vertices.
fn bounce_color(
    colors: &BTreeMap<u32, BounceColor>,
    surface: &Surface,
    bounce: &Hit,
) -> Option<BounceColor> {
    let [a, b, c] = surface.triangles[bounce.triangle as usize];
    let (a, b, c) = (colors.get(&a)?, colors.get(&b)?, colors.get(&c)?);
    let mix = |a: [f32; 3], b: [f32; 3], c: [f32; 3]| {
        [0, 1, 2].map(|i| a[i] * (1.0 - bounce.u - bounce.v) + b[i] * bounce.u + c[i] * bounce.v)
    };
    Some(BounceColor {
        median: mix(a.median, b.median, c.median),
        low: mix(a.low, b.low, c.low),
    })
}
