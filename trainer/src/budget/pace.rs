//! Keeping to a budget while it is spent: what gives way when the rest would not fit.

use std::sync::Mutex;

use effects::EffectRequests;
use rustix::time::{ClockId, clock_gettime};

use super::pick::{Plan, with_poses};
use crate::stages::linear::LinearSettings;

/// Every how many pixels are left in the last resort.
const LARGEST_STRIDE: u32 = 8;
/// One pixel in this many gives a row, in the last resort.
const LARGEST_ROW_STEP: usize = 32;
/// Rounds of reweighting that are left where rows alone do not save enough.
const FEW_ROUNDS: usize = 2;
/// What these cost of all rounds.
const FEW_ROUNDS_SHARE: f64 = 0.8;
/// Rows of the map in the last resort.
const SMALL_MAP: u32 = 62;

/// Beyond this a stage was another kind of work than planned, and says nothing of the rest.
const SLOWEST: f64 = 3.0;

/// Core-seconds that were spent so far: of this process, from its start.
pub type SpentSoFar = Box<dyn Fn() -> f64 + Send + Sync>;

/// Compares what was spent with the plan before every stage, and goes to a cheaper setting for what is left.
pub struct Pacer {
    plan: Plan,
    spent: SpentSoFar,
    /// Spent when the plan was made, which is no stage's.
    spent_before: f64,
    /// Largest pace so far: stages that are left out later would hide how slow it is.
    slowest: Mutex<f64>,
    notes: Mutex<Vec<String>>,
}

impl Pacer {
    /// With the processor time of this process.
    pub fn new(plan: Plan) -> Self {
        Self::with_clock(plan, Box::new(process_seconds))
    }

    /// With core-seconds from elsewhere.
    pub fn with_clock(plan: Plan, spent: SpentSoFar) -> Self {
        Self {
            plan,
            spent_before: spent(),
            spent,
            slowest: Mutex::new(1.0),
            notes: Mutex::default(),
        }
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What gave way, in order.
    pub fn notes(&self) -> Vec<String> {
        self.notes.lock().map_or_else(|_| Vec::new(), |n| n.clone())
    }

    /// Core-seconds spent so far.
    pub fn spent_s(&self) -> f64 {
        (self.spent)()
    }

    /// The effects to be decided: none where trying them would not leave enough for the rest.
    pub fn before_effects(&self, requests: &EffectRequests) -> EffectRequests {
        let pace = self.pace(&["poses", "geometry"]);
        let rest = self.planned(&["effects", "diffuse", "linear"]);
        if pace * rest <= self.left() {
            return requests.clone();
        }
        // What was asked about poses has been followed already.
        let none = "none"
            .parse()
            .ok()
            .as_ref()
            .map(|none| with_poses(none, requests));
        let Some(Ok(none)) = none else {
            return requests.clone();
        };
        if *requests == none {
            return none;
        }
        self.say(pace * rest, "no effects are tried".to_owned());
        none
    }

    /// Every how many pixels are looked at: more where the rest would not fit.
    pub fn before_diffuse(&self, stride: u32) -> u32 {
        let pace = self.pace(&["poses", "geometry", "effects"]);
        let diffuse = self.planned(&["diffuse"]);
        let linear = self.planned(&["linear"]);
        let left = self.left();
        // Half of looking is reading frames and finding what they see; rows go by the square of the stride.
        let rest = |wider: u32| {
            let pixels = (f64::from(stride) / f64::from(wider)).powi(2);
            pace * (diffuse * (0.5 + 0.5 * pixels) + linear * pixels)
        };
        if rest(stride) <= left {
            return stride;
        }
        let wider = (stride..=LARGEST_STRIDE.max(stride)).find(|wider| rest(*wider) <= left);
        let wider = wider.unwrap_or(LARGEST_STRIDE.max(stride));
        if wider > stride {
            let change = format!("pixels are {wider} apart instead of {stride}");
            self.say(rest(stride), change);
        }
        wider
    }

    /// How `pixel_count` pixels are solved: fewer of them, a smaller map, fewer rounds, until the stage fits.
    pub fn before_linear(&self, settings: LinearSettings, pixel_count: usize) -> LinearSettings {
        let pace = self.pace(&["poses", "geometry", "effects", "diffuse"]);
        let left = self.left();
        let cost = pace * self.plan.chosen.linear_s.at(pixel_count as f64);
        if cost <= left {
            return settings;
        }
        let steps = 2..=LARGEST_ROW_STEP;
        let thinner = steps
            .clone()
            .map(|row_step| LinearSettings {
                row_step,
                ..settings
            })
            .find(|thinner| cost / thinner.row_step as f64 <= left);
        // Below a quarter of the rows a smaller map loses less than still fewer rows.
        let chosen = match thinner {
            Some(thinner) if thinner.row_step <= 4 => thinner,
            _ => {
                let share = FEW_ROUNDS_SHARE * self.small_map_share(settings.map_height);
                let step = steps
                    .clone()
                    .find(|step| share * cost / *step as f64 <= left);
                LinearSettings {
                    row_step: step.unwrap_or(LARGEST_ROW_STEP),
                    map_height: settings.map_height.min(SMALL_MAP),
                    rounds: Some(FEW_ROUNDS),
                    ..settings
                }
            }
        };
        let mut change = format!("one pixel in {} gives a row", chosen.row_step);
        if chosen.map_height < settings.map_height {
            change += &format!(
                ", the map has {} rows, {FEW_ROUNDS} rounds of reweighting",
                chosen.map_height
            );
        }
        self.say(cost, change);
        chosen
    }

    /// What `linear` costs with a small map over what it costs with the full one, as measured.
    fn small_map_share(&self, map_height: u32) -> f64 {
        if map_height <= SMALL_MAP {
            return 1.0;
        }
        let linear = |name: &str| self.plan.point(name)?.stages.get("linear").copied();
        match (
            linear(&format!("map-height={SMALL_MAP}")),
            linear("default"),
        ) {
            (Some(small), Some(full)) if full > 0.0 => (small / full).min(1.0),
            _ => 1.0,
        }
    }

    /// Planned core-seconds of some stages.
    fn planned(&self, stages: &[&str]) -> f64 {
        let planned = stages
            .iter()
            .filter_map(|stage| self.plan.chosen.stages.get(stage));
        planned.sum()
    }

    /// How much slower than planned it went so far, at its worst; never less than 1, since what was cheaper than
    /// planned may have been another kind of work.
    fn pace(&self, stages: &[&str]) -> f64 {
        let planned = self.planned(stages);
        let now = if planned > 0.0 {
            ((self.spent_s() - self.spent_before) / planned).clamp(1.0, SLOWEST)
        } else {
            1.0
        };
        let Ok(mut slowest) = self.slowest.lock() else {
            return now;
        };
        *slowest = slowest.max(now);
        *slowest
    }

    fn left(&self) -> f64 {
        self.plan.budget_s - self.spent_s()
    }

    fn say(&self, needed: f64, change: String) {
        let note = format!(
            "budget: {:.1} of {:.1} core-seconds spent, the rest would take {needed:.1}: {change}",
            self.spent_s(),
            self.plan.budget_s
        );
        tracing::warn!("{note}");
        if let Ok(mut notes) = self.notes.lock() {
            notes.push(note);
        }
    }
}

fn process_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
