//! All runs of a point together, and what the front says of it.

use geometry::robust;

use super::audit::AuditRecord;
use super::child::PointStatus;
use super::front::{Candidate, OnFront, front};
use super::journal::{Beginning, PointRecord, counting};
use super::subject::{DEFAULT_POINT, Setting, Subject};

/// Share of tracked frames below which a point cannot be on the front.
const LEAST_TRACKED: f64 = 0.95;

/// Share by which an error must be lower to be worth a sentence.
const LEAST_GAIN: f64 = 0.01;

/// A measurement, ready to be shown.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// What was compared.
    pub subject: Subject,
    /// What all runs share.
    pub beginning: Beginning,
    /// The points in the order of the grid.
    pub points: Vec<PointResult>,
    /// Records whose log is not what their figures were read from; they are left out.
    pub rejected_count: usize,
    /// Rows that were run again, in order.
    pub audits: Vec<AuditRecord>,
}

/// A point of the grid.
#[derive(Clone, Debug)]
pub struct PointResult {
    /// Name.
    pub name: String,
    /// All levels.
    pub setting: Setting,
    /// The run that counts for each repetition, by repetition; fewer where some are missing.
    pub runs: Vec<PointRecord>,
    /// How the point ended: not ok where any repetition did not.
    pub status: Option<PointStatus>,
    /// Whether it is on the front.
    pub front: OnFront,
}

impl Measurement {
    /// Puts the runs together.
    pub fn of(subject: &Subject, beginning: Beginning, records: &[PointRecord]) -> Self {
        let genuine: Vec<PointRecord> =
            records.iter().filter(|r| r.is_genuine()).cloned().collect();
        let counting = counting(&genuine);
        let mut points: Vec<PointResult> = subject
            .points()
            .into_iter()
            .map(|point| {
                let runs: Vec<PointRecord> = (0..beginning.repetitions)
                    .filter_map(|repetition| counting.get(&(point.name.clone(), repetition)))
                    .map(|record| (*record).clone())
                    .collect();
                let failed = runs.iter().find(|run| run.status != PointStatus::Ok);
                let status = failed.or(runs.first()).map(|run| run.status);
                PointResult {
                    name: point.name,
                    setting: point.setting,
                    runs,
                    status,
                    front: OnFront::No,
                }
            })
            .collect();
        let candidates: Vec<Candidate> = points
            .iter()
            .map(|point| candidate(subject, point))
            .collect();
        for (point, verdict) in points.iter_mut().zip(front(&candidates, beginning.seed)) {
            point.front = verdict;
        }
        Self {
            subject: *subject,
            beginning,
            points,
            rejected_count: records.len() - genuine.len(),
            audits: Vec::new(),
        }
    }

    /// The same with `audits`.
    pub(super) fn with_audits(self, audits: &[AuditRecord]) -> Self {
        Self {
            audits: audits.to_vec(),
            ..self
        }
    }

    /// The point with every knob at its default.
    pub fn default_point(&self) -> Option<&PointResult> {
        self.points.iter().find(|point| point.name == DEFAULT_POINT)
    }

    /// Cost and error of a point that was measured.
    pub fn place(&self, point: &PointResult) -> Option<(f64, f64)> {
        if point.status != Some(PointStatus::Ok) {
            return None;
        }
        let cost = point.median(self.subject.cost.key)?;
        let error = point.median(self.subject.error.key)?;
        Some((cost, error))
    }

    /// Why a point is no candidate for the front, though it was measured: what the subject says, or too few
    /// frames tracked.
    pub fn no_candidate(&self, point: &PointResult) -> Option<&'static str> {
        no_candidate(&self.subject, point)
    }

    /// Points that have no run of a repetition.
    pub fn missing(&self) -> Vec<&str> {
        let wanted = self.beginning.repetitions as usize;
        let short = self.points.iter().filter(|point| point.runs.len() < wanted);
        short.map(|point| point.name.as_str()).collect()
    }

    /// What the default costs, and what a better point would.
    pub fn sentence(&self) -> String {
        let (cost, error) = (self.subject.cost.label, self.subject.error.label);
        let Some((default, place)) = self
            .default_point()
            .and_then(|point| Some((point, self.place(point)?)))
        else {
            return "the default was not measured".to_owned();
        };
        let better = self.points.iter().filter_map(|point| {
            let found = self.place(point)?;
            let is_better = found.1 < (1.0 - LEAST_GAIN) * place.1;
            (point.front != OnFront::No && is_better).then_some((point, found))
        });
        let next = better.min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let going_on = match next {
            Some((point, found)) => format!(
                "going to {} costs {:+.0} % for {:+.1} %",
                point.name,
                100.0 * (found.0 / place.0 - 1.0),
                100.0 * (found.1 / place.1 - 1.0)
            ),
            None => "no point of the front errs 1 % less".to_owned(),
        };
        format!(
            "default: {} {cost}, {} {error}, on the front: {}; {going_on}",
            digits(place.0),
            digits(place.1),
            default.front
        )
    }
}

impl PointResult {
    /// Median of a figure over the runs that ended well.
    pub fn median(&self, key: &str) -> Option<f64> {
        let runs = self.runs.iter().filter(|run| run.status == PointStatus::Ok);
        let values = runs.filter_map(|run| run.figures.metrics.get(key).copied());
        robust::median(&mut values.collect())
    }

    /// Why it did not end well.
    pub fn reason(&self) -> &str {
        let failed = self.runs.iter().find(|run| run.status != PointStatus::Ok);
        failed.map_or("", |run| run.reason.as_str())
    }
}

fn no_candidate(subject: &Subject, point: &PointResult) -> Option<&'static str> {
    let named = subject.no_candidates.iter();
    let mut named = named.filter(|(name, _)| *name == point.name);
    if let Some((_, reason)) = named.next() {
        return Some(reason);
    }
    let tracked = subject.tracked.and_then(|key| point.median(key))?;
    (tracked < LEAST_TRACKED).then_some("fewer than 95 % of the frames were tracked")
}

/// What the front is told of a point: nothing where it failed or is no candidate.
fn candidate(subject: &Subject, point: &PointResult) -> Candidate {
    if point.status != Some(PointStatus::Ok) || no_candidate(subject, point).is_some() {
        return Candidate {
            costs: Vec::new(),
            blocks: Vec::new(),
        };
    }
    let costs = point.runs.iter();
    let costs = costs.filter_map(|run| run.figures.metrics.get(subject.cost.key).copied());
    let block_count = point.runs.iter().map(|run| run.figures.blocks.len()).min();
    let block = |index: usize| {
        let values = point.runs.iter().map(|run| run.figures.blocks[index]);
        values.sum::<f64>() / point.runs.len() as f64
    };
    Candidate {
        costs: costs.collect(),
        blocks: (0..block_count.unwrap_or(0)).map(block).collect(),
    }
}

/// Four digits, or all in front of the point.
pub(super) fn digits(value: f64) -> String {
    let before = value.abs().max(1e-9).log10().floor() as i32 + 1;
    let behind = usize::try_from((4 - before).clamp(0, 6)).unwrap_or(0);
    format!("{value:.behind$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_four_digits() {
        for (value, text) in [
            (123_456.7, "123457"),
            (12.345_6, "12.35"),
            (0.012_345, "0.01235"),
            (0.0, "0.000000"),
        ] {
            assert_eq!(digits(value), text);
        }
    }
}
