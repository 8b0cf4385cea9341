//! The Pareto front, with how sure it is (effects-and-tradeoffs B5).

use geometry::robust;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Draws of the bootstrap.
const DRAW_COUNT: usize = 1000;
/// Share of the draws from which a verdict is sure.
const SURE_FRACTION: f64 = 0.9;
/// Costs within this share are equal: the lower error wins.
const COST_TIE: f64 = 0.01;

/// Whether a point is on the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnFront {
    /// Not beaten, and not in 9 of 10 draws.
    Sure,
    /// Neither.
    Maybe,
    /// Beaten, and in 9 of 10 draws.
    No,
}

impl std::fmt::Display for OnFront {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Sure => "sure",
            Self::Maybe => "maybe",
            Self::No => "no",
        })
    }
}

/// A point as the front sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Cost of each repetition; the same repetitions at every point.
    pub costs: Vec<f64>,
    /// Error of each part of the input; the same parts at every point.
    pub blocks: Vec<f64>,
}

/// A verdict for every candidate. Candidates without a cost or an error are not on the front and beat nobody.
///
/// Repetitions and parts are drawn together for all points: what disturbs a repetition or makes a part hard
/// disturbs them all.
pub fn front(candidates: &[Candidate], seed: u64) -> Vec<OnFront> {
    let repetitions = candidates.iter().map(|c| c.costs.len()).max().unwrap_or(0);
    let parts = candidates.iter().map(|c| c.blocks.len()).max().unwrap_or(0);
    let every = |count: usize| (0..count).collect::<Vec<usize>>();
    let measured = places(candidates, &every(repetitions), &every(parts));
    let mut beaten_count = vec![0_usize; candidates.len()];
    let mut rng = Pcg64::seed_from_u64(seed);
    for _ in 0..DRAW_COUNT {
        let mut draw = |count: usize| -> Vec<usize> {
            (0..count).map(|_| rng.random_range(0..count)).collect()
        };
        let (repetitions, parts) = (draw(repetitions), draw(parts));
        let drawn = places(candidates, &repetitions, &parts);
        for (index, count) in beaten_count.iter_mut().enumerate() {
            *count += usize::from(is_beaten(&drawn, index));
        }
    }
    let verdict = |(index, count): (usize, &usize)| {
        let beaten_fraction = *count as f64 / DRAW_COUNT as f64;
        match measured[index] {
            None => OnFront::No,
            Some(_) if is_beaten(&measured, index) => {
                if beaten_fraction >= SURE_FRACTION {
                    OnFront::No
                } else {
                    OnFront::Maybe
                }
            }
            Some(_) if beaten_fraction <= 1.0 - SURE_FRACTION => OnFront::Sure,
            Some(_) => OnFront::Maybe,
        }
    };
    beaten_count.iter().enumerate().map(verdict).collect()
}

/// Median cost and mean error over drawn repetitions and parts.
fn places(
    candidates: &[Candidate],
    repetitions: &[usize],
    parts: &[usize],
) -> Vec<Option<(f64, f64)>> {
    let place = |candidate: &Candidate| {
        let costs = repetitions.iter().filter_map(|i| candidate.costs.get(*i));
        let cost = robust::median(&mut costs.copied().collect())?;
        let drawn = parts.iter().filter_map(|i| candidate.blocks.get(*i));
        let blocks: Vec<f64> = drawn.copied().collect();
        let error = blocks.iter().sum::<f64>() / blocks.len() as f64;
        error.is_finite().then_some((cost, error))
    };
    candidates.iter().map(place).collect()
}

/// Whether another point costs no more and errs no more, and one of them less; costs within 1 % are the same
/// where the error is lower.
fn is_beaten(places: &[Option<(f64, f64)>], index: usize) -> bool {
    let Some((cost, error)) = places[index] else {
        return false;
    };
    let beats = |(other_cost, other_error): (f64, f64)| {
        let errs_less = other_error < error && other_cost <= cost * (1.0 + COST_TIE);
        let costs_less = other_cost < cost * (1.0 - COST_TIE) && other_error <= error;
        errs_less || costs_less
    };
    places.iter().flatten().any(|place| beats(*place))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(cost: f64, error: f64) -> Candidate {
        Candidate {
            costs: vec![0.98 * cost, cost, 1.02 * cost],
            blocks: (0..10)
                .map(|part| error * (0.9 + 0.02 * f64::from(part)))
                .collect(),
        }
    }

    #[test]
    fn a_clear_front_is_sure() {
        let candidates = [
            candidate(1.0, 10.0),
            candidate(2.0, 5.0),
            candidate(3.0, 6.0),
            candidate(4.0, 1.0),
        ];
        let verdicts = front(&candidates, 1);
        assert_eq!(
            verdicts,
            [OnFront::Sure, OnFront::Sure, OnFront::No, OnFront::Sure]
        );
    }

    #[test]
    fn what_the_repetitions_cannot_tell_apart_is_maybe() {
        let noisy = |shift: f64, error: f64| Candidate {
            costs: vec![1.0 + shift, 1.4 - shift, 1.2],
            blocks: vec![error; 10],
        };
        // The second errs a little more and costs the same within the noise of the repetitions.
        let mut second = noisy(0.3, 1.01);
        second.costs = vec![1.3, 1.0, 1.15];
        let verdicts = front(&[noisy(0.0, 1.0), second], 1);
        assert_eq!(verdicts[1], OnFront::Maybe);
    }

    #[test]
    fn equal_costs_keep_the_lower_error() {
        let verdicts = front(&[candidate(1.0, 5.0), candidate(1.005, 4.0)], 1);
        assert_eq!(verdicts, [OnFront::No, OnFront::Sure]);
        // Twins do not beat each other.
        let verdicts = front(&[candidate(1.0, 5.0), candidate(1.0, 5.0)], 1);
        assert_eq!(verdicts, [OnFront::Sure, OnFront::Sure]);
    }

    #[test]
    fn what_was_not_measured_beats_nobody() {
        let empty = Candidate {
            costs: Vec::new(),
            blocks: Vec::new(),
        };
        let verdicts = front(&[empty.clone(), candidate(1.0, 1.0), empty], 1);
        assert_eq!(verdicts, [OnFront::No, OnFront::Sure, OnFront::No]);
        assert!(front(&[], 1).is_empty());
    }
}
