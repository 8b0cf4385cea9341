//! What survey and bounds say of each effect before any comparison.

use effects::survey::CODES;
use effects::verdict::{by_bound, by_condition};
use effects::{DecidedBy, Decision, Effect, EffectCost, EffectRecord, Gate, Rule, Verdict};

use super::decide::{Request, Survey};

/// Share of clipped pixels from which they are bounds instead of values.
const SATURATED_ABOVE: f64 = 1e-4;
/// Ratio of noise between bright and dark from which rows are weighted, less one.
const NOISE_RATIO_ABOVE: f64 = 0.5;
/// Blocked share of Ω below which nothing is in the way.
const LEAST_HITS: f64 = 1e-3;
/// Core-seconds of one mirrored ray in a fused mesh, measured on a 2.5 GHz x86 core; only predicts.
const RAY_SECONDS: f64 = 1.2e-6;
/// Core-seconds of one factor or weight of a row.
const FACTOR_SECONDS: f64 = 2e-8;
/// Core-seconds that refinement takes a frame.
const REFINEMENT_SECONDS: f64 = 0.4;

fn previous_verdict(request: &Request<'_>, effect: Effect) -> Option<Verdict> {
    let record = request.previous?.of(effect)?;
    // A verdict that was typed says nothing about the scene.
    (record.by != DecidedBy::Forced).then_some(record.verdict)
}

/// The most that an effect can change; `None` where there is no such number.
fn bound_of(effect: Effect, survey: &Survey) -> Option<f64> {
    let bounds = &survey.bounds;
    match effect {
        Effect::Visibility => Some(bounds.visibility),
        Effect::FirstBounce => Some(bounds.first_bounce),
        Effect::FirstBounceSpecular => Some(bounds.first_bounce_specular),
        Effect::Fresnel => Some(bounds.fresnel),
        Effect::Vignetting => Some(bounds.vignetting),
        Effect::Response => Some(bounds.response),
        Effect::PoseRefinement => Some(CODES * bounds.gradient * survey.misregistration.rigid_px),
        Effect::Saturation | Effect::Noise => None,
    }
}

fn cost_of(effect: Effect, survey: &Survey, request: &Request<'_>) -> EffectCost {
    let bounds = &survey.bounds;
    let size = &survey.views.camera;
    let scale = PIXELS_PER_SIDE_OF_SURVEY / f64::from(request.stride.max(1));
    let pixels = f64::from(size.width() * size.height()) * scale * scale;
    let frames = survey.views.frame_count;
    let object = bounds.mask_fraction * pixels * frames as f64;
    let blocked = bounds.hit_fraction * object;
    let seconds = match effect {
        Effect::Visibility => object * RAY_SECONDS,
        Effect::FirstBounce => blocked * RAY_SECONDS,
        Effect::FirstBounceSpecular => blocked * RAY_SECONDS,
        Effect::Fresnel | Effect::Noise => object * FACTOR_SECONDS,
        Effect::Vignetting | Effect::Response | Effect::Saturation => 0.0,
        Effect::PoseRefinement => frames as f64 * REFINEMENT_SECONDS,
    };
    EffectCost::predicted(seconds, frames)
}

/// Photograph's pixels per survey pixel on a side: VGA over 160 columns.
const PIXELS_PER_SIDE_OF_SURVEY: f64 = 4.0;

/// What is known of an effect before any comparison. Effects that a comparison must decide are off by survey.
pub(super) fn first_record(
    effect: Effect,
    survey: &Survey,
    rule: &Rule,
    request: &Request<'_>,
    is_specular: bool,
) -> EffectRecord {
    let previous = previous_verdict(request, effect);
    let bound = bound_of(effect, survey);
    let (decision, note) = if effect.is_specular() && !is_specular {
        let Gate {
            eskew_codes,
            etile_codes,
        } = survey.gate;
        let note = format!(
            "view dependence {eskew_codes:.2} and {etile_codes:.2} codes, as of a matte surface"
        );
        (Decision::off(DecidedBy::Gate), note)
    } else {
        let decided = bound.and_then(|bound| by_bound(bound, rule, previous));
        match effect {
            Effect::Saturation => {
                let share = survey.bounds.saturated_fraction;
                let note = format!("{:.3} % of the object's pixels are clipped", 100.0 * share);
                (by_condition(share, SATURATED_ABOVE, previous), note)
            }
            Effect::Noise => {
                let ratio = survey.bounds.noise_ratio;
                let note = format!("noise of bright pixels is {ratio:.2} times that of dark ones");
                (by_condition(ratio - 1.0, NOISE_RATIO_ABOVE, previous), note)
            }
            Effect::Visibility if survey.bounds.hit_fraction < LEAST_HITS => (
                Decision::off(DecidedBy::Bound),
                "no mirrored ray meets the surface again".to_owned(),
            ),
            Effect::PoseRefinement => pose_decision(decided, request),
            Effect::Vignetting | Effect::Response => {
                let note = String::new();
                (decided.unwrap_or(Decision::on(DecidedBy::Bound)), note)
            }
            Effect::Visibility
            | Effect::FirstBounce
            | Effect::FirstBounceSpecular
            | Effect::Fresnel => (
                decided.unwrap_or(Decision::off(DecidedBy::Survey)),
                String::new(),
            ),
        }
    };
    EffectRecord {
        requested: request.requests.of(effect),
        bound_codes: bound,
        off_below_codes: bound.map(|_| rule.off_below()),
        cost: cost_of(effect, survey, request),
        previous,
        note,
        ..EffectRecord::new(effect, decision.verdict, decision.by)
    }
}

/// Refinement is its own probe: what it did decides once it ran.
fn pose_decision(decided: Option<Decision>, request: &Request<'_>) -> (Decision, String) {
    match (request.refinement, decided) {
        (Some(summary), _) => {
            let verdict = if summary.is_used {
                Decision::on(DecidedBy::Probe)
            } else {
                Decision::off(DecidedBy::Probe)
            };
            (verdict, summary.reason.clone())
        }
        (None, Some(decision)) => (decision, String::new()),
        (None, None) => (Decision::on(DecidedBy::Bound), String::new()),
    }
}
