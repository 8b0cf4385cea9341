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

/// Held-out errors that differ by less than this share are alike: the one reflectance and the one lobe
/// that the model assumes cost more than that.
pub const AS_GOOD: f64 = 0.05;

/// Result of the choices.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Tried weights in order.
    pub trials: Vec<WeightTrial>,
    /// The chosen weight, between trials.
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

/// Solves the fit rows for each weight, judges on the held-out frames, and decides weight and segments.
///
/// `weights`, ascending and not empty, are tried in order, each from the solution of the one before. Of those
/// that are as good as the best within [`AS_GOOD`], the largest wins, interpolated between trials: the data
/// do not see the offset, and a darker D is the stated gauge (hard-cases H02).
pub fn choose(
    rows: &Rows,
    vertex_count: usize,
    panorama: PanoramaSize,
    settings: &JointSettings,
    weights: &[f64],
) -> Result<Choice, SrmError> {
    let Split { fit, judge } = split_by_frames(rows);
    if judge.is_empty() {
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
    let mut trials: Vec<(WeightTrial, Errors)> = Vec::new();
    let mut start = vec![[0.0; 3]; problem.unknown_count()];
    for &weight in weights {
        let settings = JointSettings {
            diffuse: DiffuseTreatment::PulledToZero { weight },
            ..settings.clone()
        };
        let solution = problem.solve_from(&settings, start);
        // A weight is judged by its S: the darkening of D is its price for the split, not an error of S.
        let refitted = problem.refit_diffuse(&solution, &settings);
        let joint = Errors {
            all: judged(&refitted),
            free: judged_free(&refitted),
        };
        start = solution.unknowns;
        let (error, sigma) = pooled(&joint.all, |_| true);
        trials.push((
            WeightTrial {
                weight,
                error,
                sigma,
            },
            joint,
        ));
    }
    let best = trials
        .iter()
        .min_by(|a, b| a.0.error.total_cmp(&b.0.error))
        .ok_or(SrmError::NoRows)?;
    let limit = (1.0 + AS_GOOD) * best.0.error;
    let largest = trials
        .iter()
        .rposition(|(trial, _)| trial.error <= limit)
        .unwrap_or(0);
    let (chosen, joint) = &trials[largest];
    let weight = match trials.get(largest + 1) {
        Some((beyond, _)) => weight_at(limit, chosen, beyond),
        None => chosen.weight,
    };
    let segments = judge_segments(&alone, &joint.free);
    let specular = |segment: u16| {
        segments
            .iter()
            .any(|s| s.segment == segment && s.is_specular)
    };
    let (_, held_out_sigma) = pooled(&joint.all, specular);
    Ok(Choice {
        trials: trials.iter().map(|(trial, _)| *trial).collect(),
        weight,
        segments,
        held_out_sigma,
    })
}

/// The weight between two trials at which the error reaches `limit`, on a logarithmic scale of weights:
/// the choice then follows the data without jumps.
fn weight_at(limit: f64, below: &WeightTrial, beyond: &WeightTrial) -> f64 {
    let share = ((limit - below.error) / (beyond.error - below.error)).clamp(0.0, 1.0);
    below.weight * (beyond.weight / below.weight).powf(share)
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
        let (below, beyond) = (trial(0.1, 1.0), trial(0.4, 1.2));
        assert!((weight_at(1.0, &below, &beyond) - 0.1).abs() < 1e-12);
        assert!((weight_at(1.1, &below, &beyond) - 0.2).abs() < 1e-12);
        assert!((weight_at(1.2, &below, &beyond) - 0.4).abs() < 1e-12);
    }
}
