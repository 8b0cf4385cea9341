//! The rule over several effects: order, forward additions, one backward pass, budget, audit.

use crate::effect::{Effect, EffectSet};
use crate::verdict::{Comparison, DecidedBy, Decision, ProbeFigures, Rule, Verdict, by_probe};

/// An effect that its bound did not settle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The effect.
    pub effect: Effect,
    /// The most that it can change, codes.
    pub bound_codes: f64,
    /// Predicted cost, core-seconds.
    pub cost_s: f64,
    /// Verdict of the run before.
    pub previous: Option<Verdict>,
}

/// Verdict on a candidate with the numbers behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// The effect.
    pub effect: Effect,
    /// The verdict.
    pub decision: Decision,
    /// The comparison; absent where it was off because of another.
    pub figures: Option<ProbeFigures>,
}

/// What forward and backward selection found.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// A verdict for every candidate, in the order in which they were tried.
    pub judged: Vec<Judged>,
    /// Pairs that were judged together: both needed, or the second needless once the first was in.
    pub interactions: Vec<[Effect; 2]>,
}

/// Candidates by what they promise for their cost, each after what it needs.
pub fn ordered(candidates: &[Candidate]) -> Vec<Candidate> {
    let mut rest = candidates.to_vec();
    let promise = |candidate: &Candidate| candidate.bound_codes / candidate.cost_s.max(1e-3);
    rest.sort_by(|a, b| {
        promise(b)
            .total_cmp(&promise(a))
            .then(a.effect.cmp(&b.effect))
    });
    let mut order: Vec<Candidate> = Vec::with_capacity(rest.len());
    while !rest.is_empty() {
        let waits = |candidate: &Candidate| {
            let needed = candidate.effect.needed_effect();
            needed.is_some_and(|needed| rest.iter().any(|other| other.effect == needed))
        };
        let next = rest.iter().position(|candidate| !waits(candidate));
        order.push(rest.remove(next.unwrap_or(0)));
    }
    order
}

/// Tries the candidates in order, each on top of `start` and what is already on, then tries to remove each once.
/// `compare(base, added)` gives the errors of `base` without and with `added`, of which `base` holds nothing.
///
/// An effect that does not pay on its own is tried once more together with one that needs it: a blocked ray that shows
/// nothing can be worse than one that shows the room, while one that shows what it meets is better than both.
///
/// # Errors
/// Those of `compare`.
pub fn select<E>(
    candidates: &[Candidate],
    start: EffectSet,
    rule: &Rule,
    compare: &mut dyn FnMut(EffectSet, EffectSet) -> Result<Comparison, E>,
) -> Result<Selection, E> {
    let order = ordered(candidates);
    let mut on = start;
    let mut judged: Vec<Judged> = Vec::with_capacity(order.len());
    let mut interactions = Vec::new();
    let mut last_added = None;
    for (position, candidate) in order.iter().enumerate() {
        let effect = candidate.effect;
        if effect
            .needed_effect()
            .is_some_and(|needed| !on.contains(needed))
        {
            judged.push(Judged {
                effect,
                decision: Decision::off(DecidedBy::Need),
                figures: None,
            });
            continue;
        }
        let alone = EffectSet::NONE.with(effect);
        let mut figures = ProbeFigures::of(&compare(on, alone)?);
        let mut decision = by_probe(&figures, rule, candidate.previous);
        let partner = order[position + 1..]
            .iter()
            .find(|other| other.effect.needed_effect() == Some(effect));
        if decision.verdict == Verdict::Off
            && let Some(partner) = partner
        {
            let together = ProbeFigures::of(&compare(on, alone.with(partner.effect))?);
            let joint = by_probe(&together, rule, candidate.previous);
            if joint.verdict == Verdict::On {
                (figures, decision) = (together, joint);
                interactions.push([effect, partner.effect]);
            }
        }
        if decision.verdict == Verdict::On {
            on = on.with(effect);
            last_added = Some((position, effect));
        }
        judged.push(Judged {
            effect,
            decision,
            figures: Some(figures),
        });
    }
    let Some((last_position, last)) = last_added else {
        return Ok(Selection {
            judged,
            interactions,
        });
    };
    for (position, candidate) in order.iter().enumerate().take(last_position) {
        let effect = candidate.effect;
        let carries = on.iter().any(|other| other.needed_effect() == Some(effect));
        // The last one was tried on top of all others: only those before it can have lost their worth.
        if !on.contains(effect) || start.contains(effect) || carries {
            continue;
        }
        let figures = ProbeFigures::of(&compare(on.without(effect), EffectSet::NONE.with(effect))?);
        let decision = by_probe(&figures, rule, Some(Verdict::On));
        if decision.verdict == Verdict::Off {
            on = on.without(effect);
            judged[position].decision = decision;
            judged[position].figures = Some(figures);
            interactions.push([last, effect]);
        }
    }
    Ok(Selection {
        judged,
        interactions,
    })
}

/// Which of the effects that are worth computing fit into a budget: by gain for cost, each with what it needs.
/// `effects`: effect, gain in codes, cost in core-seconds.
pub fn within_budget(effects: &[(Effect, f64, f64)], budget_s: f64) -> EffectSet {
    let mut order = effects.to_vec();
    let worth = |(_, gain, cost): &(Effect, f64, f64)| gain / cost.max(1e-3);
    order.sort_by(|a, b| worth(b).total_cmp(&worth(a)).then(a.0.cmp(&b.0)));
    let offered: EffectSet = effects.iter().map(|(effect, _, _)| *effect).collect();
    let cost_of = |wanted: Effect| effects.iter().find(|(effect, _, _)| *effect == wanted);
    let mut chosen = EffectSet::NONE;
    let mut left = budget_s;
    for (effect, _, _) in order {
        // The effect with whatever of its needs is offered and not yet chosen.
        let mut group = vec![effect];
        let mut needed = effect.needed_effect();
        while let Some(below) = needed {
            if offered.contains(below) {
                group.push(below);
            }
            needed = below.needed_effect();
        }
        group.retain(|&member| !chosen.contains(member));
        let cost: f64 = group.iter().filter_map(|&e| cost_of(e)).map(|e| e.2).sum();
        if !group.is_empty() && cost <= left {
            left -= cost;
            chosen = group.into_iter().fold(chosen, EffectSet::with);
        }
    }
    chosen
}

/// An effect is audited when its bound left this share of the limit open.
const AUDIT_SHARE: f64 = 0.25;

/// Whether an effect that its bound switched off deserves a probe at the end of a full training.
pub fn needs_audit(decision: Decision, bound_codes: f64, rule: &Rule) -> bool {
    decision == Decision::off(DecidedBy::Bound) && bound_codes > AUDIT_SHARE * rule.off_below()
}

/// The warning of an audit that contradicts the bound; `None` where the probe agrees.
pub fn audit_warning(effect: Effect, bound_codes: f64, figures: &ProbeFigures) -> Option<String> {
    let gains = figures.ci.map_or(figures.delta, |[low, _]| low);
    (gains > figures.on_above).then(|| {
        format!(
            "{effect} is off because it changes at most {bound_codes:.2} codes, but a probe finds that it gains {:.2}; \
             ask for it with --effects +{effect}",
            figures.delta
        )
    })
}

#[cfg(test)]
mod tests;
