//! From survey to verdicts, `effects.json` and the plan that the stages follow.

use std::collections::BTreeMap;

use effects::record::FILE_VERSION;
use effects::selection::{Candidate, Selection, audit_warning, needs_audit, select};
use effects::survey::{CODES, L1_OF_SIGMA};
use effects::{
    BlockPlan, DecidedBy, Decision, Effect, EffectRecord, EffectRequests, EffectSet, EffectsFile,
    Gate, Habit, ProbeFigures, Rule, SurveyNumbers, Verdict, probe,
};
use sequence::Recording;

use super::bounds::{Bounds, bounds};
use super::evidence::first_record;
use super::noise::NoiseCurve;
use super::shifts::{Misregistration, misregistration};
use super::texture::{Texture, gate, level_gains};
use super::trial::Trial;
use super::views::{SurveyViews, look};
use super::{EffectPlan, FresnelFit};
use crate::clock::Stopwatch;
use crate::refine::RefinementSummary;
use crate::run_folder::RunFolder;
use crate::stages::observe::{ColorView, PixelRules, Surface};
use crate::stages::poses::PosedFrame;

/// Name of the file inside a run folder.
pub const EFFECTS_FILE: &str = "effects.json";

/// Change of a view's gain from which the surface's look is read again.
const LEAST_GAIN_CHANGE: f64 = 0.01;

/// What decides besides the images.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// The switches.
    pub requests: &'a EffectRequests,
    /// What undecided means.
    pub habit: Habit,
    /// Verdicts of the run before in this folder.
    pub previous: Option<&'a EffectsFile>,
    /// What refinement of the poses did, where it ran.
    pub refinement: Option<&'a RefinementSummary>,
    /// Whether to compare at all: else survey and bounds only.
    pub compares: bool,
    /// Every how many pixels in x and y training will use.
    pub stride: u32,
    /// Seed of the run.
    pub seed: u64,
}

/// What was decided.
pub struct Decided {
    /// What the stages compute.
    pub plan: EffectPlan,
    /// What is stored.
    pub file: EffectsFile,
    /// Whether the poses should be refined before anything else: then decide again on the new surface.
    pub wants_refinement: bool,
}

/// The verdicts of the run before in a folder; none where there is none or it cannot be read: it is about to be
/// replaced.
pub fn previous_file(folder: &RunFolder) -> Option<EffectsFile> {
    let text = std::fs::read_to_string(folder.path(EFFECTS_FILE)).ok()?;
    match EffectsFile::from_json(&text) {
        Ok(file) => Some(file),
        Err(error) => {
            tracing::info!("the verdicts of the run before are left aside: {error}");
            None
        }
    }
}

impl Decided {
    /// Refinement ran and the start stands: nothing else changes by it.
    pub fn without_refinement(mut self, summary: &RefinementSummary) -> Self {
        self.wants_refinement = false;
        self.plan.computed = self.plan.computed.without(Effect::PoseRefinement);
        let records = self.file.effects.iter_mut();
        for record in records.filter(|record| record.id == Effect::PoseRefinement) {
            record.verdict = Verdict::Off;
            record.by = DecidedBy::Probe;
            record.note.clone_from(&summary.reason);
        }
        self
    }
}

/// What the survey measured.
pub(super) struct Survey {
    pub(super) views: SurveyViews,
    pub(super) noise: NoiseCurve,
    pub(super) bounds: Bounds,
    pub(super) misregistration: Misregistration,
    pub(super) gate: Gate,
}

/// Surveys the frames and decides.
///
/// # Errors
/// When a frame cannot be read.
pub fn decide(
    recording: &Recording,
    surface: &Surface,
    frames: &[PosedFrame],
    request: &Request<'_>,
) -> anyhow::Result<Decided> {
    let watch = Stopwatch::start();
    let wanted = request.requests.resolve(EffectSet::all());
    let Some(survey) = survey(recording, surface, frames, wanted)? else {
        return Ok(undecided(request));
    };
    let mut numbers = numbers(&survey, request);
    numbers.seconds = watch.cost().core_s;
    let rule = Rule {
        n0_codes: numbers.n0_codes,
        habit: request.habit,
    };
    let asks_specular = request.requests.resolve(EffectSet::NONE);
    let is_specular = survey.gate.is_specular() || asks_specular.iter().any(Effect::is_specular);
    let mut records: Vec<EffectRecord> = Effect::ALL
        .into_iter()
        .map(|effect| first_record(effect, &survey, &rule, request, is_specular))
        .collect();
    let mut interactions = Vec::new();
    let mut fresnel = None;
    let mut bounce_gains = BTreeMap::new();
    let mut contradictions = Vec::new();
    if is_specular && let Some(mut trial) = Trial::new(&survey.views, surface) {
        let chosen = probed(
            &mut trial,
            &survey,
            &rule,
            request,
            &mut records,
            &mut numbers,
        )?;
        interactions = chosen.interactions;
        if request.compares {
            contradictions = audit(&mut trial, &rule, &records)?;
        }
        fresnel = trial.fresnel().cloned();
        bounce_gains = trial.bounce_gains().clone();
    }
    settle(&mut records, request.requests);
    let file = EffectsFile {
        version: FILE_VERSION,
        survey: numbers,
        warnings: [contradictions, warnings(&records)].concat(),
        effects: records,
        interactions,
    };
    let refines = file.of(Effect::PoseRefinement).map(|r| r.verdict) == Some(Verdict::On);
    Ok(Decided {
        plan: EffectPlan {
            computed: file.computed(),
            is_specular,
            noise: survey.noise,
            fresnel: fresnel.unwrap_or_default(),
            bounce_gains,
        },
        wants_refinement: refines && request.refinement.is_none(),
        file,
    })
}

fn survey(
    recording: &Recording,
    surface: &Surface,
    frames: &[PosedFrame],
    wanted: EffectSet,
) -> anyhow::Result<Option<Survey>> {
    let view = ColorView::with_effects(recording, wanted);
    let wants_rays = wanted.contains(Effect::Visibility);
    let Some(mut views) = look(recording, &view, surface, frames, wants_rays)? else {
        return Ok(None);
    };
    let noise = NoiseCurve::of(views.views.iter().flat_map(|v| v.noise.clone()).collect());
    let texture = Texture::of(&views, surface);
    let largest = level_gains(&mut views, surface, &texture);
    let texture = if largest > LEAST_GAIN_CHANGE {
        Texture::of(&views, surface)
    } else {
        texture
    };
    let misregistration = misregistration(&views, surface, &texture);
    let bounds = bounds(recording, &views, surface, &texture, &noise);
    // A survey pixel is the mean of a block of the photograph's.
    let block = f64::from(view.camera.width() / views.camera.width());
    let gate = gate(
        &views,
        surface,
        &texture,
        bounds.sigma / block,
        misregistration.delta_px,
    );
    Ok(Some(Survey {
        views,
        noise,
        bounds,
        misregistration,
        gate,
    }))
}

fn numbers(survey: &Survey, request: &Request<'_>) -> SurveyNumbers {
    let Survey {
        views,
        bounds,
        misregistration,
        gate,
        ..
    } = survey;
    let sigma_codes = CODES * bounds.sigma;
    SurveyNumbers {
        frames: views.views.len(),
        size: [views.camera.width(), views.camera.height()],
        mask_fraction: bounds.mask_fraction,
        sigma_codes,
        n0_codes: L1_OF_SIGMA * sigma_codes,
        eskew_codes: gate.eskew_codes,
        etile_codes: gate.etile_codes,
        delta_px: misregistration.delta_px,
        emis_codes: CODES * bounds.gradient * misregistration.delta_px,
        p_hit: bounds.hit_fraction,
        p_saturated: bounds.saturated_fraction,
        tau_frames: 1.0,
        blocks: 0,
        seconds: 0.0,
        seed: request.seed,
    }
}

/// Whether a comparison must still decide an effect.
fn is_open(record: &EffectRecord) -> bool {
    record.id.is_specular()
        && record.by == DecidedBy::Survey
        && record.requested == effects::Request::Auto
}

/// Compares what bounds did not settle, and writes the verdicts into the records.
fn probed(
    trial: &mut Trial,
    survey: &Survey,
    rule: &Rule,
    request: &Request<'_>,
    records: &mut [EffectRecord],
    numbers: &mut SurveyNumbers,
) -> anyhow::Result<Selection> {
    let forced = request.requests.resolve(EffectSet::NONE);
    let candidates: Vec<Candidate> = records
        .iter()
        .filter(|record| is_open(record) && !forced.contains(record.id))
        .map(|record| Candidate {
            effect: record.id,
            bound_codes: record.bound_codes.unwrap_or(0.0),
            cost_s: record.cost.predicted_s,
            previous: record.previous,
        })
        .collect();
    let nothing = Selection {
        judged: Vec::new(),
        interactions: Vec::new(),
    };
    if !request.compares {
        for record in records.iter_mut().filter(|record| is_open(record)) {
            record.note = format!(
                "at most {:.2} codes, so a comparison has to decide",
                record.bound_codes.unwrap_or(0.0)
            );
        }
        return Ok(nothing);
    }
    let start: EffectSet = forced
        .iter()
        .filter(|effect| effect.is_specular())
        .collect();
    if !candidates.is_empty() {
        let blocked = candidates.iter().map(|candidate| candidate.effect);
        let fullest: EffectSet = blocked.filter(|&e| e != Effect::Fresnel).collect();
        let errors = trial.error_by_view(start.iter().chain(fullest.iter()).collect())?;
        let step = survey.views.frame_count as f64 / survey.views.views.len().max(1) as f64;
        numbers.tau_frames = probe::correlation_time(probe::autocorrelation(&errors), step);
        let blocks = BlockPlan::new(survey.views.frame_count, numbers.tau_frames);
        numbers.blocks = blocks.as_ref().map_or(0, |plan| plan.blocks.len());
        trial.hold_out(blocks, survey.views.frame_count);
    }
    let selection = select(&candidates, start, rule, &mut |base, added| {
        trial.compare(base, added)
    })?;
    // What is asked for was not compared, but its parameters are wanted.
    if start.contains(Effect::Fresnel) {
        trial.fit(start.without(Effect::Fresnel))?;
    }
    for judged in &selection.judged {
        if let Some(record) = records.iter_mut().find(|record| record.id == judged.effect) {
            record.verdict = judged.decision.verdict;
            record.by = judged.decision.by;
            record.probe = judged.figures;
        }
    }
    note_fresnel(records, trial.fresnel().into_iter().flatten());
    Ok(selection)
}

/// Compares once each effect that its bound switched off narrowly; contradictions are warnings.
fn audit(trial: &mut Trial, rule: &Rule, records: &[EffectRecord]) -> anyhow::Result<Vec<String>> {
    let on = records
        .iter()
        .filter(|record| record.verdict == Verdict::On);
    let computed: EffectSet = on.map(|record| record.id).collect();
    let mut found = Vec::new();
    for record in records.iter().filter(|record| record.id.is_specular()) {
        let Some(bound) = record.bound_codes else {
            continue;
        };
        let decision = Decision {
            verdict: record.verdict,
            by: record.by,
        };
        let stands = record
            .id
            .needed_effect()
            .is_none_or(|needed| computed.contains(needed));
        if stands && needs_audit(decision, bound, rule) {
            let figures =
                ProbeFigures::of(&trial.compare(computed, EffectSet::NONE.with(record.id))?);
            found.extend(audit_warning(record.id, bound, &figures));
        }
    }
    Ok(found)
}

/// Says what rise was found beside the verdict.
fn note_fresnel<'a>(
    records: &mut [EffectRecord],
    fits: impl Iterator<Item = (&'a u16, &'a FresnelFit)>,
) {
    let kappas: Vec<String> = fits
        .map(|(segment, fit)| format!("part {segment}: {:.1}", fit.kappa))
        .collect();
    let record = records.iter_mut().find(|r| r.id == Effect::Fresnel);
    if let Some(record) = record.filter(|_| !kappas.is_empty()) {
        let gain = record.probe.as_ref().map_or(String::new(), |probe| {
            let interval = probe.ci.map_or_else(
                || "on fitted frames".to_owned(),
                |[low, high]| format!("{low:.2} to {high:.2}, {} blocks", probe.blocks),
            );
            format!(
                "gains {:.2} codes ({interval}), threshold {:.2}; ",
                probe.delta, probe.on_above
            )
        });
        record.note = format!("{gain}rise (1 - R0)/R0 of {}", kappas.join(", "));
    }
}

/// The switches have the last word, and nothing stands on what is off.
fn settle(records: &mut [EffectRecord], requests: &EffectRequests) {
    let automatic: EffectSet = records
        .iter()
        .filter(|record| record.verdict == Verdict::On)
        .map(|record| record.id)
        .collect();
    let computed = requests.resolve(automatic);
    for record in records {
        let verdict = if computed.contains(record.id) {
            Verdict::On
        } else {
            Verdict::Off
        };
        let is_typed = requests.of(record.id) != effects::Request::Auto;
        if is_typed || requests.is_implied(record.id) {
            record.by = DecidedBy::Forced;
        } else if verdict != record.verdict {
            record.by = DecidedBy::Need;
        }
        record.verdict = verdict;
    }
}

/// Switches that go against what was measured.
fn warnings(records: &[EffectRecord]) -> Vec<String> {
    records
        .iter()
        .filter(|record| record.by == DecidedBy::Forced && record.verdict == Verdict::Off)
        .filter_map(|record| {
            let (bound, limit) = (record.bound_codes?, record.off_below_codes?);
            (bound > limit).then(|| {
                format!(
                    "{} is switched off although it can change up to {bound:.2} codes",
                    record.id
                )
            })
        })
        .collect()
}

/// Without a picture to look at: what is asked for, the rest off.
fn undecided(request: &Request<'_>) -> Decided {
    let computed = request.requests.resolve(EffectSet::NONE);
    let records = Effect::ALL
        .into_iter()
        .map(|effect| {
            let verdict = if computed.contains(effect) {
                Verdict::On
            } else {
                Verdict::Off
            };
            let by = if request.requests.of(effect) == effects::Request::Auto {
                DecidedBy::Survey
            } else {
                DecidedBy::Forced
            };
            EffectRecord {
                requested: request.requests.of(effect),
                note: "no frame could be surveyed".to_owned(),
                ..EffectRecord::new(effect, verdict, by)
            }
        })
        .collect();
    Decided {
        plan: EffectPlan::unmeasured(computed),
        file: EffectsFile {
            version: FILE_VERSION,
            survey: SurveyNumbers {
                seed: request.seed,
                ..SurveyNumbers::default()
            },
            effects: records,
            interactions: Vec::new(),
            warnings: Vec::new(),
        },
        wants_refinement: computed.contains(Effect::PoseRefinement) && request.refinement.is_none(),
    }
}

/// What pixels training uses under a plan.
impl EffectPlan {
    /// The rules of the pixels under this plan.
    pub fn pixel_rules(&self, stride: u32) -> PixelRules {
        PixelRules {
            effects: self.computed,
            is_specular: self.is_specular,
            stride,
            ..PixelRules::default()
        }
    }
}
