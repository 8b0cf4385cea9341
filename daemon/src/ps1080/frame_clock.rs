//! From the camera's counter to device time and to the numbers of frames.

use ps1080::stream::{DeviceTicks, TickRate};
use sequence::clock::TickUnwrapper;

/// Bits of the camera's counter.
const TICK_BITS: u32 = 32;
/// How far a stamp's step may be from the host's before it is not believed: the queues in flight and a host that was
/// busy for a while.
const DISBELIEF_NANOS: i64 = 250_000_000;
/// Stamps in a row that agree with each other and not with the host are believed from this one on.
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
    /// Device and host time of the last frame.
    last: Option<(i64, i64)>,
    disbelieved_count: u32,
}

impl FrameClock {
    /// For a stream of `fps` frames a second; `None` for a rate that no counter has.
    pub(super) fn new(rate: TickRate, fps: u16) -> Option<Self> {
        Some(Self {
            unwrapper: TickUnwrapper::new(rate.hz(), TICK_BITS)?,
            is_primed: false,
            period_nanos: 1_000_000_000 / i64::from(fps.max(1)),
            last: None,
            disbelieved_count: 0,
        })
    }

    /// The time of a frame whose last byte came at `host_nanos`. Times rise strictly from frame to frame; a stamp that
    /// contradicts the host's clock does not move the camera's, and its frame gets the host's time.
    pub(super) fn stamp(
        &mut self,
        ticks: DeviceTicks,
        host_nanos: i64,
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
        let Some((last_nanos, last_host_nanos)) = self.last else {
            self.unwrapper = trial;
            self.last = Some((unwrapped.nanos, host_nanos));
            return Stamped {
                nanos: unwrapped.nanos,
                step_count: 0,
            };
        };
        let passed_nanos = host_nanos.saturating_sub(last_host_nanos).max(0);
        let expected_nanos = last_nanos.saturating_add(passed_nanos);
        let is_believed = !unwrapped.from_host
            && unwrapped.nanos > last_nanos
            && unwrapped.nanos.abs_diff(expected_nanos) <= DISBELIEF_NANOS.unsigned_abs();
        let nanos = if is_believed || self.disbelieved_count + 1 >= BELIEVED_AT {
            self.unwrapper = trial;
            self.disbelieved_count = 0;
            unwrapped.nanos.max(last_nanos.saturating_add(1))
        } else {
            self.disbelieved_count += 1;
            let step_count = self.steps(passed_nanos);
            last_nanos.saturating_add(step_count.saturating_mul(self.period_nanos))
        };
        self.last = Some((nanos, host_nanos));
        let step_count = self.steps(nanos.saturating_sub(last_nanos));
        Stamped {
            nanos,
            step_count: step_count.unsigned_abs(),
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
        assert_eq!(depth.stamp(start, 5, &mut origin).nanos, 0);
        let later = color.stamp(start.after(600_000), 5 + 10_000_000, &mut origin);
        assert_eq!((later.nanos, later.step_count), (10_000_000, 0));
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
                let stamped = clock.stamp(damaged, host(frame), &mut origin);
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
