//! The decision rule for one effect: bound, probe, survey, hysteresis.

use serde::{Deserialize, Serialize};

use crate::probe::{Interval, interval};

/// Whether an effect is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Computed.
    On,
    /// Not computed.
    Off,
}

/// Who decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DecidedBy {
    /// Nothing on the object is specular.
    Gate,
    /// What it needs is off.
    Need,
    /// The upper limit of what it can change, or a measured condition of the scene.
    Bound,
    /// The held-out comparison.
    Probe,
    /// The comparison on fitted frames or on held-out blocks that depend on each other: the recording is too short for an
    /// honest probe.
    Survey,
    /// Undecided: the verdict of the run before stands.
    Previous,
    /// Undecided and never decided: the profile's habit.
    Profile,
    /// The budget does not reach.
    Budget,
    /// The switches.
    Forced,
}

/// What an undecided effect is where no run decided before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Habit {
    /// Off: profile `draft`.
    #[default]
    Cheap,
    /// On: profiles `standard` and `paper`.
    Careful,
}

/// Limits of a run, codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// Noise as mean absolute error, N₀.
    pub n0_codes: f64,
    /// What undecided means.
    pub habit: Habit,
}

/// Least change that is worth a probe, codes.
const LEAST_BOUND: f64 = 0.25;
/// The same as a share of the noise.
const BOUND_OF_NOISE: f64 = 0.1;
/// Least gain that is worth computing, codes.
const LEAST_GAIN: f64 = 0.1;
/// The same as a share of the error without the effect.
const GAIN_OF_ERROR: f64 = 0.01;

impl Rule {
    /// τ_off: an effect that changes at most this is off without a probe.
    pub fn off_below(&self) -> f64 {
        (BOUND_OF_NOISE * self.n0_codes).max(LEAST_BOUND)
    }
}

/// τ_on: an effect is on when it gains surely more than this.
pub fn on_above(l1_off: f64) -> f64 {
    (GAIN_OF_ERROR * l1_off).max(LEAST_GAIN)
}

/// Errors of the same rows without and with the effect, codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorPair {
    /// Without.
    pub l1_off: f64,
    /// With.
    pub l1_on: f64,
}

impl ErrorPair {
    /// What the effect gains.
    pub fn gain(&self) -> f64 {
        self.l1_off - self.l1_on
    }
}

/// What a comparison found.
#[derive(Clone, Debug, PartialEq)]
pub enum Comparison {
    /// Held-out blocks.
    Blocks(Vec<ErrorPair>),
    /// Means over blocks that depend on each other: no interval is honest.
    Short(ErrorPair),
}

/// Numbers of a comparison, part of `effects.json`, codes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeFigures {
    /// Mean error without the effect.
    pub l1_off: f64,
    /// Mean error with it.
    pub l1_on: f64,
    /// Mean gain.
    pub delta: f64,
    /// Its 95 % interval; absent where no probe was honest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci: Option<[f64; 2]>,
    /// Blocks behind the interval, 0 without one.
    pub blocks: usize,
    /// Repetitions with other random numbers; 1 where nothing is random.
    pub seeds: usize,
    /// Gain from which the effect is on.
    pub on_above: f64,
}

impl ProbeFigures {
    /// The figures of a comparison.
    pub fn of(comparison: &Comparison) -> Self {
        let (pair, interval) = match comparison {
            Comparison::Short(pair) => (*pair, None),
            Comparison::Blocks(pairs) => {
                let gains: Vec<f64> = pairs.iter().map(ErrorPair::gain).collect();
                let n = pairs.len().max(1) as f64;
                let pair = ErrorPair {
                    l1_off: pairs.iter().map(|pair| pair.l1_off).sum::<f64>() / n,
                    l1_on: pairs.iter().map(|pair| pair.l1_on).sum::<f64>() / n,
                };
                (pair, interval(&gains))
            }
        };
        Self {
            l1_off: pair.l1_off,
            l1_on: pair.l1_on,
            delta: pair.gain(),
            ci: interval.map(|Interval { low, high, .. }| [low, high]),
            blocks: interval.map_or(0, |interval| interval.count),
            seeds: 1,
            on_above: on_above(pair.l1_off),
        }
    }
}

/// A verdict and who gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// The verdict.
    pub verdict: Verdict,
    /// Who decided.
    pub by: DecidedBy,
}

impl Decision {
    /// On.
    pub fn on(by: DecidedBy) -> Self {
        Self {
            verdict: Verdict::On,
            by,
        }
    }

    /// Off.
    pub fn off(by: DecidedBy) -> Self {
        Self {
            verdict: Verdict::Off,
            by,
        }
    }
}

/// Rule 2: off where the most that the effect can change is too little. A verdict stored as on needs half of that,
/// so that noise near the limit does not switch it.
pub fn by_bound(bound_codes: f64, rule: &Rule, previous: Option<Verdict>) -> Option<Decision> {
    let limit = match previous {
        Some(Verdict::On) => 0.5 * rule.off_below(),
        Some(Verdict::Off) | None => rule.off_below(),
    };
    (bound_codes <= limit).then(|| Decision::off(DecidedBy::Bound))
}

/// Rules 3 and 4: the comparison decides where it is sure, else the run before, else the profile. Without an honest
/// probe the mean gain over dependent blocks decides, in every profile.
pub fn by_probe(figures: &ProbeFigures, rule: &Rule, previous: Option<Verdict>) -> Decision {
    let limit = figures.on_above;
    let Some([low, high]) = figures.ci else {
        let needed = match previous {
            Some(Verdict::On) => 0.5 * limit,
            Some(Verdict::Off) | None => limit,
        };
        return if figures.delta > needed {
            Decision::on(DecidedBy::Survey)
        } else {
            Decision::off(DecidedBy::Survey)
        };
    };
    if low > limit {
        return Decision::on(DecidedBy::Probe);
    }
    if high < 0.5 * limit {
        return Decision::off(DecidedBy::Probe);
    }
    match (previous, rule.habit) {
        (Some(verdict), _) => Decision {
            verdict,
            by: DecidedBy::Previous,
        },
        (None, Habit::Cheap) => Decision::off(DecidedBy::Profile),
        (None, Habit::Careful) => Decision::on(DecidedBy::Profile),
    }
}

/// A measured condition of the scene instead of a bound: on above `on_above`; a verdict stored as on goes off only
/// below half of it.
pub fn by_condition(value: f64, on_above: f64, previous: Option<Verdict>) -> Decision {
    let limit = match previous {
        Some(Verdict::On) => 0.5 * on_above,
        Some(Verdict::Off) | None => on_above,
    };
    if value > limit {
        Decision::on(DecidedBy::Bound)
    } else {
        Decision::off(DecidedBy::Bound)
    }
}

#[cfg(test)]
mod tests;
