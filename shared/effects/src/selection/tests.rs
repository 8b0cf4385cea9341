use super::*;
use crate::verdict::{ErrorPair, Habit};

const RULE: Rule = Rule {
    n0_codes: 1.0,
    habit: Habit::Cheap,
};

fn candidate(effect: Effect, bound_codes: f64, cost_s: f64) -> Candidate {
    Candidate {
        effect,
        bound_codes,
        cost_s,
        previous: None,
    }
}

/// A world in which the error of a set of effects is known.
fn compare_by<'a>(
    error: impl Fn(EffectSet) -> f64 + 'a,
) -> impl FnMut(EffectSet, EffectSet) -> Result<Comparison, ()> + 'a {
    move |base, added| {
        assert!(added.iter().all(|effect| !base.contains(effect)));
        Ok(Comparison::Blocks(
            (0..10)
                .map(|block| {
                    let noise = 0.001 * f64::from(block);
                    ErrorPair {
                        l1_off: error(base) + noise,
                        l1_on: error(added.iter().fold(base, EffectSet::with)),
                    }
                })
                .collect(),
        ))
    }
}

fn verdicts(selection: &Selection) -> Vec<(Effect, Verdict)> {
    selection
        .judged
        .iter()
        .map(|judged| (judged.effect, judged.decision.verdict))
        .collect()
}

#[test]
fn needs_come_first_then_promise_for_cost() {
    let order: Vec<Effect> = ordered(&[
        candidate(Effect::FirstBounce, 9.0, 1.0),
        candidate(Effect::Fresnel, 2.0, 0.1),
        candidate(Effect::Visibility, 3.0, 1.0),
    ])
    .iter()
    .map(|c| c.effect)
    .collect();
    assert_eq!(
        order,
        [Effect::Fresnel, Effect::Visibility, Effect::FirstBounce]
    );
}

#[test]
fn what_gains_is_on_and_what_stands_on_nothing_off() {
    let error = |set: EffectSet| {
        5.0 - if set.contains(Effect::Fresnel) {
            1.0
        } else {
            0.0
        }
    };
    let selection = select(
        &[
            candidate(Effect::Visibility, 3.0, 1.0),
            candidate(Effect::FirstBounce, 9.0, 1.0),
            candidate(Effect::Fresnel, 2.0, 0.1),
        ],
        EffectSet::NONE,
        &RULE,
        &mut compare_by(error),
    )
    .unwrap();
    assert_eq!(
        verdicts(&selection),
        [
            (Effect::Fresnel, Verdict::On),
            (Effect::Visibility, Verdict::Off),
            (Effect::FirstBounce, Verdict::Off)
        ]
    );
    assert_eq!(selection.judged[2].decision.by, DecidedBy::Need);
}

#[test]
fn two_effects_that_only_pay_together_are_found() {
    let error = |set: EffectSet| {
        let (v, b) = (
            set.contains(Effect::Visibility),
            set.contains(Effect::FirstBounce),
        );
        match (v, b) {
            (true, true) => 4.0,
            (true, false) => 7.0,
            (false, _) => 5.0,
        }
    };
    let candidates = [
        candidate(Effect::Visibility, 9.0, 1.0),
        candidate(Effect::FirstBounce, 3.0, 1.0),
    ];
    let run = |candidates: &[Candidate]| {
        select(candidates, EffectSet::NONE, &RULE, &mut compare_by(error)).unwrap()
    };
    let selection = run(&candidates);
    assert!(
        selection
            .judged
            .iter()
            .all(|j| j.decision.verdict == Verdict::On)
    );
    assert_eq!(
        selection.interactions,
        [[Effect::Visibility, Effect::FirstBounce]]
    );
    // The bite: on its own the first one is off.
    let alone = run(&candidates[..1]);
    assert_eq!(alone.judged[0].decision.verdict, Verdict::Off);
}

#[test]
fn an_effect_that_another_makes_needless_is_removed() {
    // Fresnel explains what noise weights only hid.
    let error = |set: EffectSet| {
        let (a, b) = (set.contains(Effect::Noise), set.contains(Effect::Fresnel));
        match (a, b) {
            (false, false) => 5.0,
            (true, false) => 4.0,
            (_, true) => 3.0,
        }
    };
    let selection = select(
        &[
            candidate(Effect::Noise, 9.0, 0.1),
            candidate(Effect::Fresnel, 2.0, 1.0),
        ],
        EffectSet::NONE,
        &RULE,
        &mut compare_by(error),
    )
    .unwrap();
    assert_eq!(
        verdicts(&selection),
        [
            (Effect::Noise, Verdict::Off),
            (Effect::Fresnel, Verdict::On)
        ]
    );
    assert_eq!(selection.interactions, [[Effect::Fresnel, Effect::Noise]]);
}

#[test]
fn a_budget_takes_what_pays_most_with_what_it_needs() {
    let effects = [
        (Effect::Visibility, 0.2, 4.0),
        (Effect::FirstBounce, 6.0, 2.0),
        (Effect::Fresnel, 1.0, 1.0),
    ];
    let fits = |budget| within_budget(&effects, budget).to_string();
    assert_eq!(fits(0.5), "none");
    assert_eq!(fits(5.0), "visibility,fresnel");
    assert_eq!(fits(6.0), "visibility,first-bounce");
    assert_eq!(fits(7.0), "visibility,first-bounce,fresnel");
}

#[test]
fn an_audit_looks_only_where_the_bound_was_close() {
    let off = Decision::off(DecidedBy::Bound);
    assert!(needs_audit(off, 0.2, &RULE));
    assert!(!needs_audit(off, 0.05, &RULE));
    assert!(!needs_audit(Decision::off(DecidedBy::Probe), 0.2, &RULE));
    let figures = |gain: f64| {
        ProbeFigures::of(&Comparison::Short(ErrorPair {
            l1_off: 5.0,
            l1_on: 5.0 - gain,
        }))
    };
    assert!(audit_warning(Effect::Fresnel, 0.2, &figures(0.05)).is_none());
    let warning = audit_warning(Effect::Fresnel, 0.2, &figures(1.0)).unwrap();
    assert!(warning.contains("fresnel"));
}
