//! What became of a budget.

use std::fmt;

use serde::Serialize;

use super::{MOST_SPENT, Pacer};

/// Share of the plan below which it was a poor one.
const POOR_PLAN: f64 = 0.5;

/// A plan beside what was spent, `budget.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spent {
    /// Core-seconds that were given.
    pub budget_core_s: f64,
    /// The chosen point.
    pub point: String,
    /// Core-seconds that were planned, without reserve.
    pub predicted_core_s: f64,
    /// Core-seconds of the whole program, planning included.
    pub actual_core_s: f64,
    /// The latter over the former.
    pub actual_over_predicted: f64,
    /// Core-seconds over the budget.
    pub budget_fraction: f64,
    /// What gave way.
    pub gave_way: Vec<String>,
}

impl Spent {
    /// Up to now.
    pub fn of(pacer: &Pacer) -> Self {
        let (plan, actual) = (pacer.plan(), pacer.spent_s());
        Self {
            budget_core_s: plan.budget_s,
            point: plan.chosen.name.clone(),
            predicted_core_s: plan.chosen.core_s,
            actual_core_s: actual,
            actual_over_predicted: actual / plan.chosen.core_s.max(1e-9),
            budget_fraction: actual / plan.budget_s,
            gave_way: pacer.notes(),
        }
    }

    /// Whether the plan was far off, or more was spent than a budget allows.
    pub fn is_warning(&self) -> bool {
        !(POOR_PLAN..=MOST_SPENT).contains(&self.actual_over_predicted)
            || self.budget_fraction > MOST_SPENT
    }
}

impl fmt::Display for Spent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "budget: {:.1} of {:.1} core-seconds spent on {}, {:.1} were planned ({:.2} of the plan)",
            self.actual_core_s,
            self.budget_core_s,
            self.point,
            self.predicted_core_s,
            self.actual_over_predicted
        )?;
        if self.is_warning() {
            write!(f, "; note: the plan was not a good one here")?;
        }
        for note in &self.gave_way {
            write!(f, "\n{note}")?;
        }
        Ok(())
    }
}
