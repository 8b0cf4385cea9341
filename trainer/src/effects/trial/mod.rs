//! A small solve of the survey's pixels with any set of effects, for paired comparisons.
//!
//! D is one colour a cell of the surface instead of one a vertex, the map is small, and rows are thinned: what is
//! compared is the same rows with and without one effect, so that all of this cancels.

mod bounce;
mod fits;

use std::collections::BTreeMap;
use std::rc::Rc;

use effects::survey::CODES;
use effects::{BlockPlan, Comparison, Effect, EffectSet, ErrorPair};
use geometry::PanoramaSize;
use srm::rows::luminance;
use srm::{DiffuseTreatment, JointSettings, Problem, Row, Rows};

use self::bounce::{BLUR_COUNT, BounceColor, BounceColors};
use super::fresnel::FresnelFit;
use super::views::{SurveyPixel, SurveyViews};
use crate::stages::observe::Surface;

/// Rows of a trial at most.
const MOST_ROWS: usize = 36_000;
/// Rows of its map: texels of 2.8 degrees.
const MAP_HEIGHT: u32 = 64;
/// Edge of a cell of D in survey pixels at the median depth.
const CELL_PIXELS: f64 = 1.5;
/// Pull of D to zero at ten rows a cell: that of the darkest split that training tries. With less, D takes up most of
/// what a first bounce adds, and the offset of the map pays for it unseen.
const DIFFUSE_WEIGHT: f64 = 0.8;
/// Every other block is held out, in two turns: two fits judge all blocks.
const TURNS: usize = 2;
/// Gain of the trial's map; the map takes up any other.
const GAIN: f32 = 0.3;

/// A survey pixel with all terms that any effect could give it.
#[derive(Clone, Copy)]
struct TrialRow {
    base: Row,
    cosine: f32,
    /// Colour of the first bounce, sharp and as ever more blurred mirrors show it.
    bounce: Option<[BounceColor; BLUR_COUNT]>,
    /// Texels and weights of the second mirrored direction.
    second: Option<([u32; 4], [f32; 4])>,
}

/// |residual| of rows, each with the row's number.
type RowErrors = Vec<(usize, f64)>;

/// The small problem.
pub(super) struct Trial {
    rows: Vec<TrialRow>,
    cell_count: usize,
    panorama: PanoramaSize,
    /// Found when Fresnel is tried, beside the effects that were on then.
    fresnel: Option<(EffectSet, BTreeMap<u16, FresnelFit>)>,
    /// What segments reflect of their first bounces over the common gain, found when first bounces are tried.
    bounce_gains: BTreeMap<u16, f32>,
    /// How blurred a mirror first bounces are seen in, found with their shares.
    blur: usize,
    /// What is held out; `None` until that is known.
    blocks: Option<BlockPlan>,
    /// Whether the blocks are long enough for an interval.
    is_honest: bool,
    /// Residuals by set and whether their blocks were held out, so that none is solved twice.
    judged: BTreeMap<(EffectSet, bool), Rc<RowErrors>>,
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
        let colors = BounceColors::new(views, surface, &picked);
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
                        clipped: if pixel.clipped_share > 0.0 { 0b111 } else { 0 },
                        frame: own.position as u32,
                        segment: pixel.segment,
                    },
                    cosine: pixel.cosine,
                    bounce: pixel.bounce.map(|bounce| colors.at(surface, &bounce)),
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
            bounce_gains: BTreeMap::new(),
            blur: 0,
            blocks: None,
            is_honest: false,
            judged: BTreeMap::new(),
        })
    }

    /// Sets the blocks that are held out. `honest`: blocks that say independent things; `None` where the recording is too
    /// short for them. Then dependent ones are held out where a map that nothing blocks is compared: on fitted frames it
    /// wins by painting what it cannot foresee. All other effects add a term with at most a parameter a part to the same
    /// map, and fitted frames judge them more sharply than far ones.
    pub(super) fn hold_out(&mut self, honest: Option<BlockPlan>, frame_count: usize) {
        self.is_honest = honest.is_some();
        self.blocks = honest.or_else(|| Some(BlockPlan::dependent(frame_count)));
        self.judged.clear();
    }

    /// The rise of every segment's reflectance, found when it was tried.
    pub(super) fn fresnel(&self) -> Option<&BTreeMap<u16, FresnelFit>> {
        self.fresnel.as_ref().map(|(_, fits)| fits)
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

    /// What segments reflect of their first bounces over the common gain, found when that was tried.
    pub(super) fn bounce_gains(&self) -> &BTreeMap<u16, f32> {
        &self.bounce_gains
    }

    /// Errors of `base` without and with `added`.
    pub(super) fn compare(
        &mut self,
        base: EffectSet,
        added: EffectSet,
    ) -> anyhow::Result<Comparison> {
        let with = added.iter().fold(base, EffectSet::with);
        if added.contains(Effect::Fresnel) {
            self.fit(base)?;
        }
        if added.contains(Effect::FirstBounce) && self.bounce_gains.is_empty() {
            self.fit_bounce_gains(with)?;
        }
        let holds_out = self.is_honest || added.contains(Effect::Visibility);
        let (off, on) = (self.judged(base, holds_out)?, self.judged(with, holds_out)?);
        let off = self.mean_errors(added, &off);
        let on = self.mean_errors(added, &on);
        let pairs = off
            .iter()
            .zip(&on)
            .map(|(&l1_off, &l1_on)| ErrorPair { l1_off, l1_on })
            .filter(|pair| pair.l1_off.is_finite() && pair.l1_on.is_finite());
        let pairs: Vec<ErrorPair> = pairs.collect();
        if self.is_honest {
            return Ok(Comparison::Blocks(pairs));
        }
        // Without a pair no row is of the kind that the effect is about.
        let count = pairs.len().max(1) as f64;
        Ok(Comparison::Short(ErrorPair {
            l1_off: pairs.iter().map(|pair| pair.l1_off).sum::<f64>() / count,
            l1_on: pairs.iter().map(|pair| pair.l1_on).sum::<f64>() / count,
        }))
    }

    /// Finds the rise of every segment's reflectance beside the effects of `base`, where it is not known yet: what a
    /// missing effect hides, the rise would take up.
    pub(super) fn fit(&mut self, base: EffectSet) -> anyhow::Result<()> {
        if self
            .fresnel
            .as_ref()
            .is_some_and(|(known, _)| *known == base)
        {
            return Ok(());
        }
        let fits = self.fresnel_fits(base)?;
        self.fresnel = Some((base, fits));
        self.judged
            .retain(|(set, _), _| !set.contains(Effect::Fresnel));
        Ok(())
    }

    /// |residual| of every row that can be judged with `set`: by fits that do not hold its block, or, where none is held
    /// out, by the fit of all.
    fn judged(&mut self, set: EffectSet, holds_out: bool) -> anyhow::Result<Rc<RowErrors>> {
        if let Some(known) = self.judged.get(&(set, holds_out)) {
            return Ok(Rc::clone(known));
        }
        let found = match self.blocks.as_ref().filter(|_| holds_out) {
            None => self.residuals(set, &|_| true, &|_| true)?,
            Some(plan) => {
                let mut found = Vec::new();
                for turn in 0..TURNS {
                    let is_held = |block: usize| block % TURNS == turn;
                    let fits = |frame: u32| plan.is_fitted(frame as usize, is_held);
                    let judges = |frame: u32| plan.block_of(frame as usize).is_some_and(is_held);
                    found.extend(self.residuals(set, &fits, &judges)?);
                }
                found
            }
        };
        let found = Rc::new(found);
        self.judged.insert((set, holds_out), Rc::clone(&found));
        Ok(found)
    }

    /// Whether a row is one of those that an effect is about: for first bounces the blocked ones.
    fn concerns(&self, effect: Effect, row: usize) -> bool {
        match effect {
            Effect::FirstBounce => self.rows[row].bounce.is_some(),
            Effect::FirstBounceSpecular => self.rows[row].second.is_some(),
            Effect::Visibility
            | Effect::Fresnel
            | Effect::Vignetting
            | Effect::Response
            | Effect::Saturation
            | Effect::Noise
            | Effect::PoseRefinement => true,
        }
    }

    /// Mean error in codes of the rows that effects are about: of each block, or of all as one.
    fn mean_errors(&self, effects: EffectSet, residuals: &[(usize, f64)]) -> Vec<f64> {
        let block_of = |row: usize| match &self.blocks {
            None => Some(0),
            Some(plan) => plan.block_of(self.rows[row].base.frame as usize),
        };
        let count = self.blocks.as_ref().map_or(1, |plan| plan.blocks.len());
        let mut sums = vec![(0.0, 0.0); count];
        for &(row, residual) in residuals {
            if let Some(block) =
                block_of(row).filter(|_| effects.iter().any(|effect| self.concerns(effect, row)))
            {
                sums[block].0 += residual;
                sums[block].1 += 1.0;
            }
        }
        let means = sums.into_iter().map(|(sum, count)| CODES * sum / count);
        means.collect()
    }

    /// Solves the rows whose frame `fits` and gives |residual| (luminance) of those whose frame `judges`, by row, where
    /// the fit knows their part of the surface.
    fn residuals(
        &self,
        set: EffectSet,
        fits: &dyn Fn(u32) -> bool,
        judges: &dyn Fn(u32) -> bool,
    ) -> anyhow::Result<RowErrors> {
        let fit: Rows = self
            .rows
            .iter()
            .filter(|row| fits(row.base.frame))
            .map(|row| self.composed(row, set, self.fresnel()))
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
                let row = self.composed(row, set, self.fresnel());
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
            && let Some(colors) = &row.bounce
        {
            let color = colors[self.blur];
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
                let share = self.bounce_gains.get(&row.base.segment);
                let gain = GAIN * factor * share.copied().unwrap_or(1.0);
                composed.known = shown.map(|value| value * gain);
            }
        }
        composed.taps = composed.taps.map(|tap| tap * factor);
        composed
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
