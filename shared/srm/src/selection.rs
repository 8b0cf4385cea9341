//! Choices by frames that the solve never saw: the weight of D's prior, and which segments are shiny.

use crate::joint::{DiffuseTreatment, JointSettings, Solution, row_residual};
use crate::problem::{Problem, Rgb, SrmError};
use crate::rows::Rows;
use geometry::PanoramaSize;
use std::collections::BTreeMap;

/// Rows for solving and rows for judging, cut by frame.
#[derive(Clone, Debug)]
pub struct Split {
    /// Rows of frames that are solved from.
    pub fit: Rows,
    /// Rows of frames that judge.
    pub judge: Rows,
}

/// Frames in one block of consecutive held-out frames: neighbours are alike, so single frames judge
/// interpolation only.
pub const BLOCK_LENGTH: usize = 4;

/// One block in this many is held out.
pub const BLOCK_PERIOD: usize = 5;

/// Cuts rows by blocks of consecutive frames: blocks 2, 7, 12 … judge.
pub fn split_by_frames(rows: &Rows) -> Split {
    let frames = rows.frames();
    let held: std::collections::BTreeSet<u32> = frames
        .iter()
        .enumerate()
        .filter(|(position, _)| (position / BLOCK_LENGTH) % BLOCK_PERIOD == BLOCK_PERIOD / 2)
        .map(|(_, frame)| *frame)
        .collect();
    Split {
        fit: rows.filtered(|row| !held.contains(&row.frame)),
        judge: rows.filtered(|row| held.contains(&row.frame)),
    }
}

/// Held-out error of one model on one segment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeldOut {
    /// Mean of |r|/√(1 + (|r|/scale)²)-like robust cost, luminance, over judged rows.
    pub error: f64,
    /// 1.4826 · median |r|.
    pub sigma: f64,
    /// Judged rows.
    pub count: usize,
    /// Mean error of every frame, for the spread between frames.
    pub by_frame: BTreeMap<u32, f64>,
}

/// Judges unknowns on rows, segment by segment. Rows whose vertices were not seen in the fit say nothing
/// of the model and are left out (`known_vertices`).
pub fn held_out(
    problem: &Problem,
    judge: &Rows,
    unknowns: &[Rgb],
    known_vertices: &[bool],
    residual_scale: f64,
) -> BTreeMap<u16, HeldOut> {
    let mut residuals: BTreeMap<u16, Vec<(u32, f64)>> = BTreeMap::new();
    for row in judge.iter() {
        if row.vertices.iter().all(|&v| known_vertices[v as usize]) {
            let residual = row_residual(row, problem.predict(row, unknowns)).abs();
            residuals
                .entry(row.segment)
                .or_default()
                .push((row.frame, residual));
        }
    }
    residuals
        .into_iter()
        .map(|(segment, values)| {
            let cost =
                |r: f64| residual_scale * ((1.0 + (r / residual_scale).powi(2)).sqrt() - 1.0);
            let count = values.len();
            let error = values.iter().map(|(_, r)| cost(*r)).sum::<f64>() / count as f64;
            let mut frames: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
            for (frame, r) in &values {
                let entry = frames.entry(*frame).or_default();
                entry.0 += cost(*r);
                entry.1 += 1.0;
            }
            let by_frame = frames
                .into_iter()
                .map(|(frame, (sum, n))| (frame, sum / n))
                .collect();
            let mut absolute: Vec<f64> = values.iter().map(|(_, r)| *r).collect();
            let sigma = geometry::robust::MAD_TO_SIGMA
                * geometry::robust::median(&mut absolute).unwrap_or(f64::INFINITY);
            (
                segment,
                HeldOut {
                    error,
                    sigma,
                    count,
                    by_frame,
                },
            )
        })
        .collect()
}

/// Vertices that at least one fit row touches.
pub fn known_vertices(problem: &Problem) -> Vec<bool> {
    let mut known = vec![false; problem.vertex_count()];
    for row in problem.rows().iter() {
        for &vertex in &row.vertices {
            known[vertex as usize] = true;
        }
    }
    known
}

/// One tried weight of D's prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightTrial {
    /// Pull of D to zero.
    pub weight: f64,
    /// Held-out error over all segments.
    pub error: f64,
    /// Held-out residual, luminance.
    pub sigma: f64,
}

/// A segment that was judged.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentVerdict {
    /// The segment.
    pub segment: u16,
    /// Held-out error of D alone.
    pub diffuse_error: f64,
    /// Held-out error of D and S together.
    pub joint_error: f64,
    /// Judged rows.
    pub count: usize,
    /// Whether the segment keeps S.
    pub is_specular: bool,
}

/// S must lower the held-out error of a segment by at least this share: with the coarse map that chooses, matte sheets
/// gain up to 0.1 and the least shiny parts of the scenes 0.16 …
pub const LEAST_GAIN: f64 = 0.13;

/// … and in at least this share of the held-out frames, so that one lucky frame does not decide …
pub const LEAST_FRAME_SHARE: f64 = 0.6;

/// … and by more than this, linear radiance: less than a third of an 8-bit step is no evidence.
pub const LEAST_ERROR_DROP: f64 = 1e-4;

/// Decides for each segment whether S lowers its held-out error against D alone.
pub fn judge_segments(
    alone: &BTreeMap<u16, HeldOut>,
    joint: &BTreeMap<u16, HeldOut>,
) -> Vec<SegmentVerdict> {
    alone
        .iter()
        .filter_map(|(segment, diffuse)| {
            let together = joint.get(segment)?;
            let better_frames = diffuse
                .by_frame
                .iter()
                .filter(|(frame, error)| together.by_frame.get(frame).is_some_and(|e| e < error))
                .count();
            let frame_share = better_frames as f64 / diffuse.by_frame.len().max(1) as f64;
            let is_specular = together.error < (1.0 - LEAST_GAIN) * diffuse.error
                && frame_share >= LEAST_FRAME_SHARE
                && diffuse.error - together.error > LEAST_ERROR_DROP;
            Some(SegmentVerdict {
                segment: *segment,
                diffuse_error: diffuse.error,
                joint_error: together.error,
                count: diffuse.count,
                is_specular,
            })
        })
        .collect()
}

/// Result of the choices.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Tried weights, ascending.
    pub trials: Vec<WeightTrial>,
    /// The weight that errs least, between trials.
    pub weight: f64,
    /// Verdict of every segment.
    pub segments: Vec<SegmentVerdict>,
    /// Held-out residual of the chosen model over specular segments, luminance.
    pub held_out_sigma: f64,
}

/// Held-out errors of one trial by segment.
struct Errors {
    /// Over all judged rows.
    all: BTreeMap<u16, HeldOut>,
    /// Over those that reflect the room.
    free: BTreeMap<u16, HeldOut>,
}

/// Solves the fit rows with weights of D's prior, judges on the held-out frames, and decides weight and segments.
///
/// The `weights`, ascending and not empty, are walked from the middle one to the neighbour that errs less until none
/// does, each from the solution of the one before. The result lies between trials, where a parabola through the best
/// and its neighbours has its lowest point. Nothing beyond the error prefers a dark D: of weights that err by up to 5 %
/// more than the best, the largest lost 2 % of the log-RMSE on a scene of another renderer and 18 % on weak reflectors
/// of ours (docs/accuracy.md); the pull itself is the gauge of hard-cases H02.
///
/// # Errors
/// [`SrmError::NoRows`] when no frame is left to judge or no weight is given.
pub fn choose(
    rows: &Rows,
    vertex_count: usize,
    panorama: PanoramaSize,
    settings: &JointSettings,
    weights: &[f64],
) -> Result<Choice, SrmError> {
    let Split { fit, judge } = split_by_frames(rows);
    if judge.is_empty() || weights.is_empty() {
        return Err(SrmError::NoRows);
    }
    let problem = Problem::new(fit, vertex_count, panorama)?;
    let known = known_vertices(&problem);
    let scale = settings.residual_scale;
    let judged =
        |solution: &Solution| held_out(&problem, &judge, &solution.unknowns, &known, scale);
    // A row whose mirrored ray is blocked says nothing of S: it would only thin out what the others say.
    let free = judge.filtered(|row| row.taps != [0.0; 4]);
    let judged_free =
        |solution: &Solution| held_out(&problem, &free, &solution.unknowns, &known, scale);
    let alone = problem.solve(&JointSettings {
        diffuse: DiffuseTreatment::Alone,
        ..settings.clone()
    });
    let alone = judged_free(&alone);
    let mut trials: BTreeMap<usize, (WeightTrial, Errors)> = BTreeMap::new();
    let mut start = vec![[0.0; 3]; problem.unknown_count()];
    let best = walk_down(weights.len(), |index| {
        let weight = weights[index];
        let settings = JointSettings {
            diffuse: DiffuseTreatment::PulledToZero { weight },
            ..settings.clone()
        };
        let solution = problem.solve_from(&settings, std::mem::take(&mut start));
        // A weight is judged by its S: the darkening of D is its price for the split, not an error of S.
        let refitted = problem.refit_diffuse(&solution, &settings);
        let joint = Errors {
            all: judged(&refitted),
            free: judged_free(&refitted),
        };
        start = solution.unknowns;
        let (error, sigma) = pooled(&joint.all, |_| true);
        let trial = WeightTrial {
            weight,
            error,
            sigma,
        };
        trials.insert(index, (trial, joint));
        error
    });
    let trial = |index: usize| trials.get(&index).map(|(trial, _)| trial);
    let (chosen, joint) = &trials[&best];
    let weight = match (best.checked_sub(1).and_then(trial), trial(best + 1)) {
        (Some(below), Some(beyond)) => lowest_between(below, chosen, beyond),
        _ => chosen.weight,
    };
    let segments = judge_segments(&alone, &joint.free);
    let specular = |segment: u16| {
        segments
            .iter()
            .any(|s| s.segment == segment && s.is_specular)
    };
    let (_, held_out_sigma) = pooled(&joint.all, specular);
    Ok(Choice {
        trials: trials.values().map(|(trial, _)| *trial).collect(),
        weight,
        segments,
        held_out_sigma,
    })
}

/// The place in `0..count` from which no neighbour has less `error`, walking from the middle. `error` is asked once a
/// place. The larger place is taken where two are alike.
fn walk_down(count: usize, mut error: impl FnMut(usize) -> f64) -> usize {
    let middle = (count - 1) / 2;
    let lowest = error(middle);
    let mut walk = |step: isize| {
        let (mut at, mut least) = (middle, lowest);
        while let Some(next) = at.checked_add_signed(step).filter(|&next| next < count) {
            let found = error(next);
            let is_better = if step > 0 {
                found <= least
            } else {
                found < least
            };
            if !is_better {
                break;
            }
            (at, least) = (next, found);
        }
        at
    };
    match walk(1) {
        at if at == middle => walk(-1),
        at => at,
    }
}

/// The weight at which the parabola through three neighbouring trials, on a logarithmic scale of weights, is lowest;
/// `middle` errs least. The choice then follows the data without jumps.
fn lowest_between(below: &WeightTrial, middle: &WeightTrial, beyond: &WeightTrial) -> f64 {
    let (x, y) = (
        (below.weight / middle.weight).ln(),
        (beyond.weight / middle.weight).ln(),
    );
    let (left, right) = (below.error - middle.error, beyond.error - middle.error);
    let curvature = right * x - left * y;
    if curvature.abs() <= f64::MIN_POSITIVE {
        return middle.weight;
    }
    let lowest = 0.5 * (right * x * x - left * y * y) / curvature;
    middle.weight * lowest.clamp(x, y).exp()
}

/// Error and σ over segments, weighted by their rows.
fn pooled(by_segment: &BTreeMap<u16, HeldOut>, keep: impl Fn(u16) -> bool) -> (f64, f64) {
    let mut count = 0.0;
    let (mut error, mut sigma) = (0.0, 0.0);
    for (_, judged) in by_segment.iter().filter(|(segment, _)| keep(**segment)) {
        count += judged.count as f64;
        error += judged.error * judged.count as f64;
        sigma += judged.sigma * judged.count as f64;
    }
    if count > 0.0 {
        (error / count, sigma / count)
    } else {
        (f64::INFINITY, f64::INFINITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_weight_moves_without_jumps() {
        let trial = |weight, error| WeightTrial {
            weight,
            error,
            sigma: 0.0,
        };
        let chosen = |a, b, c| lowest_between(&trial(0.1, a), &trial(0.2, b), &trial(0.4, c));
        assert!((chosen(1.2, 1.0, 1.2) - 0.2).abs() < 1e-12);
        assert!((chosen(1.0, 1.0, 1.4) - 0.2 / 2f64.sqrt()).abs() < 1e-12);
        assert!((chosen(1.4, 1.0, 1.0) - 0.2 * 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(chosen(1.0, 1.0, 1.0), 0.2);
        // Steps of unlike length: (ln w)² has its lowest point at 1.
        let square = |w: f64| trial(w, w.ln().powi(2));
        let found = lowest_between(&square(0.7), &square(1.1), &square(2.0));
        assert!((found - 1.0).abs() < 1e-12, "{found}");
    }

    #[test]
    fn the_walk_asks_each_place_once_and_finds_the_lowest() {
        for count in 1..8 {
            for lowest in 0..count {
                let mut asked = Vec::new();
                let found = walk_down(count, |place| {
                    asked.push(place);
                    place.abs_diff(lowest) as f64
                });
                assert_eq!(found, lowest);
                asked.sort_unstable();
                asked.dedup();
                assert!(asked.len() <= lowest.abs_diff((count - 1) / 2) + 3);
            }
        }
        assert_eq!(walk_down(4, |_| 1.0), 3, "alike: the darker D");
    }
}
