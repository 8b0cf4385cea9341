//! From the camera's counter to device time and to the numbers of frames.

use ps1080::stream::{DeviceTicks, TickRate};
use sequence::clock::TickUnwrapper;

/// Bits of the camera's counter.
const TICK_BITS: u32 = 32;
/// How far a stamp may be ahead of the host before it is not believed: no packet comes before it was sent, but the first
/// ones may have been late.
const AHEAD_NANOS: i64 = 100_000_000;
/// The same where packets are known to be missing, so that a step over several frames is what is to be expected.
const LOSSY_AHEAD_NANOS: i64 = 1_000_000_000;
/// The two clocks may drift apart by this share: 2000 millionths, ten times what quartzes do.
const DRIFT_DIVISOR: i64 = 500;
/// Stamps in a row that contradict the host are believed from this one on: the camera has begun to count anew.
const BELIEVED_AT: u32 = 3;

/// The first stamp of any stream: time 0 of all of them, since the counter is one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Origin(Option<(DeviceTicks, i64)>);

/// What a frame's stamp means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamped {
    /// Device time, nanoseconds since the origin.
    pub(super) nanos: i64,
    /// Frames since the one before by time: 1 where none is missing. 0 for the first.
    pub(super) step_count: u64,
}

/// Of one stream.
#[derive(Clone, Debug)]
pub(super) struct FrameClock {
    unwrapper: TickUnwrapper,
    is_primed: bool,
    period_nanos: i64,
    /// Device time of the last frame.
    last_nanos: Option<i64>,
    /// Least of host time less device time: of packets that were not late.
    least_offset_nanos: i64,
    disbelieved_count: u32,
}

impl FrameClock {
    /// For a stream of `fps` frames a second; `None` for a rate that no counter has.
    pub(super) fn new(rate: TickRate, fps: u16) -> Option<Self> {
        Some(Self {
            unwrapper: TickUnwrapper::new(rate.hz(), TICK_BITS)?,
            is_primed: false,
            period_nanos: 1_000_000_000 / i64::from(fps.max(1)),
            last_nanos: None,
            least_offset_nanos: i64::MAX,
            disbelieved_count: 0,
        })
    }

    /// The time of a frame whose last byte came at `host_nanos`. Times rise strictly from frame to frame. A stamp before
    /// the last one, or ahead of the host by more than `is_lossy` explains, is damaged: it does not move the camera's
    /// time, and its frame gets the time at which a frame is due by the host. The stamp of the very next frame is always
    /// believed, however early it comes: those before may have been late.
    pub(super) fn stamp(
        &mut self,
        ticks: DeviceTicks,
        host_nanos: i64,
        is_lossy: bool,
        origin: &mut Origin,
    ) -> Stamped {
        let (first_ticks, first_host_nanos) = *origin.0.get_or_insert((ticks, host_nanos));
        if !self.is_primed {
            self.is_primed = true;
            self.unwrapper
                .unwrap(first_ticks.0.into(), first_host_nanos);
        }
        let mut trial = self.unwrapper.clone();
        let unwrapped = trial.unwrap(ticks.0.into(), host_nanos);
        let offset_nanos = host_nanos.saturating_sub(unwrapped.nanos);
        let Some(last_nanos) = self.last_nanos else {
            self.unwrapper = trial;
            self.last_nanos = Some(unwrapped.nanos);
            self.least_offset_nanos = offset_nanos;
            return Stamped {
                nanos: unwrapped.nanos,
                step_count: 0,
            };
        };
        let allowed_nanos = if is_lossy {
            LOSSY_AHEAD_NANOS
        } else {
            AHEAD_NANOS
        };
        let passed_nanos = unwrapped.nanos.saturating_sub(last_nanos);
        let is_next =
            passed_nanos.abs_diff(self.period_nanos) <= self.period_nanos.unsigned_abs() / 4;
        let is_ahead = offset_nanos < self.least_offset_nanos.saturating_sub(allowed_nanos);
        let is_believed =
            !unwrapped.from_host && unwrapped.nanos > last_nanos && (is_next || !is_ahead);
        let nanos = if is_believed || self.disbelieved_count + 1 >= BELIEVED_AT {
            if !is_believed {
                self.least_offset_nanos = offset_nanos;
            }
            self.unwrapper = trial;
            self.disbelieved_count = 0;
            unwrapped.nanos.max(last_nanos.saturating_add(1))
        } else {
            self.disbelieved_count += 1;
            let now_nanos = host_nanos.saturating_sub(self.least_offset_nanos);
            let step_count = self.steps(now_nanos.saturating_sub(last_nanos));
            last_nanos.saturating_add(step_count.saturating_mul(self.period_nanos))
        };
        let passed_nanos = nanos.saturating_sub(last_nanos);
        self.last_nanos = Some(nanos);
        self.least_offset_nanos = self
            .least_offset_nanos
            .saturating_add(passed_nanos / DRIFT_DIVISOR)
            .min(host_nanos.saturating_sub(nanos));
        Stamped {
            nanos,
            step_count: self.steps(passed_nanos).unsigned_abs(),
        }
    }

    /// Whole periods, at least one.
    fn steps(&self, nanos: i64) -> i64 {
        let half = self.period_nanos / 2;
        (nanos.saturating_add(half) / self.period_nanos).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_TICKS: u64 = 2_000_000;

    fn clock() -> FrameClock {
        FrameClock::new(TickRate::PS1080, 30).unwrap()
    }

    fn host(frame: u64) -> i64 {
        frame as i64 * 33_333_333
    }

    #[test]
    fn numbers_count_what_is_missing_over_wraps() {
        let (mut clock, mut origin) = (clock(), Origin::default());
        let start = DeviceTicks(u32::MAX - 5_000_000);
        let mut steps = Vec::new();
        for frame in [0, 1, 2, 5, 6, 4000] {
            let stamped = clock.stamp(
                start.after(PERIOD_TICKS * frame),
                host(frame) + 1_000_000 * (frame as i64 % 7),
                false,
                &mut origin,
            );
            steps.push(stamped.step_count);
            assert_eq!(stamped.nanos, frame as i64 * 100_000_000 / 3);
        }
        assert_eq!(steps, [0, 1, 1, 3, 1, 3994]);
    }

    #[test]
    fn two_streams_share_one_zero() {
        let mut origin = Origin::default();
        let (mut depth, mut color) = (clock(), clock());
        let start = DeviceTicks(u32::MAX - 100);
        assert_eq!(depth.stamp(start, 5, false, &mut origin).nanos, 0);
        let later = color.stamp(start.after(600_000), 5 + 10_000_000, false, &mut origin);
        assert_eq!((later.nanos, later.step_count), (10_000_000, 0));
    }

    #[test]
    fn packets_that_come_late_and_then_all_at_once_are_missing_nothing() {
        let (mut clock, mut origin) = (clock(), Origin::default());
        for frame in 0..60 {
            let late = if (20..40).contains(&frame) { 40 } else { frame };
            let stamped = clock.stamp(
                DeviceTicks(5).after(PERIOD_TICKS * frame),
                host(frame.max(late)),
                false,
                &mut origin,
            );
            assert_eq!(stamped.nanos, frame as i64 * 100_000_000 / 3);
            assert_eq!(stamped.step_count, u64::from(frame > 0));
        }
    }

    #[test]
    fn a_start_that_is_late_and_lossy_is_believed() {
        let (mut clock, mut origin) = (clock(), Origin::default());
        let mut numbers = Vec::new();
        for (frame, late_nanos, is_lossy) in [
            (0, 400_000_000, false),
            (1, 390_000_000, false),
            (6, 90_000_000, true),
            (7, 60_000_000, false),
            (8, 1_000_000, false),
        ] {
            let ticks = DeviceTicks(5).after(PERIOD_TICKS * frame);
            let at_nanos = host(frame) + late_nanos;
            let stamped = clock.stamp(ticks, at_nanos, is_lossy, &mut origin);
            assert_eq!(stamped.nanos, frame as i64 * 100_000_000 / 3);
            numbers.push(stamped.step_count);
        }
        assert_eq!(numbers, [0, 1, 5, 1, 1]);
    }

    #[test]
    fn one_damaged_stamp_costs_its_own_time_only() {
        for bit in [24, 27, 28, 30, 31] {
            let (mut clock, mut origin) = (clock(), Origin::default());
            for frame in 0..20 {
                let ticks = DeviceTicks(1000).after(PERIOD_TICKS * frame);
                let damaged = DeviceTicks(if frame == 9 {
                    ticks.0 ^ (1 << bit)
                } else {
                    ticks.0
                });
                let stamped = clock.stamp(damaged, host(frame), false, &mut origin);
                let expected = frame as i64 * 100_000_000 / 3;
                assert!(
                    stamped.nanos.abs_diff(expected) <= 2,
                    "bit {bit} frame {frame}: {stamped:?}"
                );
                assert_eq!(stamped.step_count, u64::from(frame > 0), "bit {bit}");
            }
        }
    }
}
