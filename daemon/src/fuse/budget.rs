//! What gives way when a frame takes longer than the time from one to the next: steps of effort, with hysteresis.

use fusion::live::Effort;

/// Share of a new measurement in the smoothed time.
const SHARE: f64 = 1.0 / 8.0;
/// Periods that a step is given to show what it brings: half a second at 30 Hz.
const SETTLE_PERIODS: f64 = 15.0;
/// Share of the period from which the next step is taken: a frame that takes longer than the others makes those behind
/// it wait, and what is left of the period catches up.
const TOO_LONG: f64 = 0.92;
/// Share of the period after its arrival from which a frame that begins is late.
const LATE: f64 = 0.45;
/// Below this share of the period a step is taken back.
const COMFORTABLE: f64 = 0.78;
/// Frames that must be comfortable before a step is taken back, at first …
const LEAST_PATIENCE: u32 = 45;
/// … and at most: it doubles each time that taking back proves wrong.
const MOST_PATIENCE: u32 = 1440;

/// How much has given way, 0 to [`Budget::LAST_LEVEL`]: prediction resolution, then the finest pass of the alignment,
/// then colour.
#[derive(Clone, Debug)]
pub struct Budget {
    period_nanos: f64,
    /// `None` before the first frame of a level.
    smoothed_nanos: Option<f64>,
    level: usize,
    /// Periods that are left to this level.
    settling: f64,
    comfortable_frames: u32,
    patience: u32,
    /// The last change took a step back, and has not proved right yet.
    is_on_trial: bool,
}

impl Budget {
    /// Everything that can give way has.
    pub const LAST_LEVEL: usize = 3;

    /// For a frame every `period_nanos`.
    pub fn new(period_nanos: i64) -> Self {
        Self {
            period_nanos: period_nanos.max(1) as f64,
            smoothed_nanos: None,
            level: 0,
            settling: SETTLE_PERIODS,
            comfortable_frames: 0,
            patience: LEAST_PATIENCE,
            is_on_trial: false,
        }
    }

    /// Steps that have been taken.
    pub fn level(&self) -> usize {
        self.level
    }

    /// The level for a frame that begins `age_nanos` after it came: one that begins late catches up, with all that can
    /// give way given way, and leaves the level of the others as it is.
    pub fn level_for(&self, age_nanos: i64) -> usize {
        if self.is_late(age_nanos) {
            Self::LAST_LEVEL
        } else {
            self.level
        }
    }

    /// What the frames of a level are given.
    pub fn effort(level: usize) -> Effort {
        Effort {
            coarse_view: level >= 1,
            skip_finest: level >= 2,
            skip_color: level >= 3,
        }
    }

    fn is_late(&self, age_nanos: i64) -> bool {
        age_nanos as f64 > LATE * self.period_nanos
    }

    /// What gives way in each level beyond the one before.
    pub fn name_of(level: usize) -> &'static str {
        match level {
            0 => "nothing",
            1 => "prediction resolution",
            2 => "the finest pass of the alignment",
            _ => "colour",
        }
    }

    /// Counts a frame that began `age_nanos` after it came and took `nanos`; the new level when it changes. One that
    /// began late had another effort than its level's: it counts at least as a time that changes nothing.
    pub fn count(&mut self, age_nanos: i64, nanos: i64) -> Option<usize> {
        let least = if self.is_late(age_nanos) {
            0.5 * (COMFORTABLE + TOO_LONG) * self.period_nanos
        } else {
            0.0
        };
        let nanos = (nanos as f64).max(least);
        let before = self.smoothed_nanos.unwrap_or(nanos);
        let smoothed_nanos = before + SHARE * (nanos - before);
        self.smoothed_nanos = Some(smoothed_nanos);
        if smoothed_nanos < COMFORTABLE * self.period_nanos {
            self.comfortable_frames = self.comfortable_frames.saturating_add(1);
        } else {
            self.comfortable_frames = 0;
        }
        // A frame stands for the periods that passed meanwhile.
        self.settling -= (nanos / self.period_nanos).max(1.0);
        if self.settling > 0.0 {
            return None;
        }
        if smoothed_nanos > TOO_LONG * self.period_nanos {
            if self.is_on_trial {
                self.patience = (2 * self.patience).min(MOST_PATIENCE);
            }
            self.is_on_trial = false;
            if self.level == Self::LAST_LEVEL {
                return None;
            }
            return Some(self.change_to(self.level + 1));
        }
        if self.is_on_trial && self.comfortable_frames >= LEAST_PATIENCE {
            self.is_on_trial = false;
            self.patience = LEAST_PATIENCE;
        }
        if self.level > 0 && self.comfortable_frames >= self.patience {
            self.is_on_trial = true;
            return Some(self.change_to(self.level - 1));
        }
        None
    }

    fn change_to(&mut self, level: usize) -> usize {
        self.level = level;
        self.settling = SETTLE_PERIODS;
        self.smoothed_nanos = None;
        self.comfortable_frames = 0;
        level
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: i64 = 33_000_000;

    /// Levels after each of `count` frames, which take what `cost` says of the level.
    fn levels(budget: &mut Budget, count: usize, cost: impl Fn(usize) -> i64) -> Vec<usize> {
        (0..count)
            .map(|_| {
                budget.count(0, cost(budget.level()));
                budget.level()
            })
            .collect()
    }

    #[test]
    fn steps_are_taken_one_at_a_time_in_their_order_and_taken_back() {
        let mut budget = Budget::new(PERIOD);
        let up = levels(&mut budget, 200, |_| 2 * PERIOD);
        assert!(up.windows(2).all(|pair| pair[1] - pair[0] <= 1));
        assert_eq!(up.last(), Some(&3));
        assert_eq!(
            Budget::effort(budget.level()),
            Effort {
                coarse_view: true,
                skip_finest: true,
                skip_color: true
            }
        );
        let down = levels(&mut budget, 400, |_| PERIOD / 4);
        assert!(down.windows(2).all(|pair| pair[0] - pair[1] <= 1));
        assert_eq!(down.last(), Some(&0));
        assert_eq!(Budget::effort(budget.level()), Effort::default());
    }

    #[test]
    fn a_late_frame_catches_up_and_the_level_stays() {
        let mut budget = Budget::new(PERIOD);
        assert_eq!(budget.level_for(PERIOD / 5), 0);
        assert_eq!(budget.level_for(PERIOD), Budget::LAST_LEVEL);
        for _ in 0..3 {
            assert_eq!(budget.count(PERIOD, PERIOD / 3), None);
        }
        levels(&mut budget, 40, |_| PERIOD / 2);
        assert_eq!((budget.level(), budget.level_for(0)), (0, 0));
        // Nor do late frames take a step back, however fast they are.
        levels(&mut budget, 40, |_| 2 * PERIOD);
        let level = budget.level();
        assert!(level > 0);
        assert!((0..500).all(|_| budget.count(PERIOD, PERIOD / 3).is_none()));
        assert_eq!(budget.level(), level);
    }

    #[test]
    fn one_slow_frame_changes_nothing() {
        let mut budget = Budget::new(PERIOD);
        levels(&mut budget, 100, |_| PERIOD / 2);
        assert_eq!(budget.count(0, 3 * PERIOD), None);
        assert_eq!(levels(&mut budget, 100, |_| PERIOD / 2), vec![0; 100]);
    }

    #[test]
    fn very_late_frames_do_not_take_seconds_to_be_noticed() {
        let mut budget = Budget::new(PERIOD);
        let up = levels(&mut budget, 12, |_| 10 * PERIOD);
        assert_eq!(up.last(), Some(&3), "{up:?}");
    }

    #[test]
    fn a_time_between_the_bounds_holds_the_level() {
        let mut budget = Budget::new(PERIOD);
        levels(&mut budget, 40, |_| 2 * PERIOD);
        let level = budget.level();
        assert!(level > 0);
        // What gave way was enough, and is not enough to be taken back.
        let held = levels(&mut budget, 500, |_| PERIOD * 85 / 100);
        assert!(
            held[100..].iter().all(|later| *later == held[100]),
            "{held:?}"
        );
    }

    #[test]
    fn a_step_that_proves_wrong_is_tried_ever_more_rarely() {
        let mut budget = Budget::new(PERIOD);
        // Full effort takes too long, the first step is ample.
        let cost = |level| {
            if level == 0 {
                PERIOD * 3 / 2
            } else {
                PERIOD / 2
            }
        };
        let levels = levels(&mut budget, 6000, cost);
        let changes = levels.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let naive = 6000 / (LEAST_PATIENCE as usize + 2 * SETTLE_PERIODS as usize);
        assert!(changes < naive / 2, "{changes} changes");
        assert!(levels.iter().filter(|level| **level == 1).count() > 5000);
    }
}
