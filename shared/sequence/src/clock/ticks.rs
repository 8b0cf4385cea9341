//! A device's counter, which wraps, as nanoseconds since its first stamp.

const NANOS_PER_SECOND: i128 = 1_000_000_000;
/// A stamp that is less than this before the latest one is a packet out of order.
const REORDER_SECONDS: i128 = 2;
/// A step of the counter that is further than this from the host's is not believed (the limit of OpenNI2's
/// sanity check; a host that stalls that long has lost its frames anyway).
const DISAGREEMENT_SECONDS: i128 = 10;
/// Keeps every product below within 128 bits.
const MAX_TICK_HZ: u64 = 1_000_000_000_000;

/// What one stamp of the counter means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unwrapped {
    /// Nanoseconds since the first stamp, rounded down; negative for a stamp that was sent before it. A
    /// repeated stamp has the same nanoseconds again.
    pub nanos: i64,
    /// Sent before a stamp that was seen already, by less than 2 s. `nanos` is the stamp's own time all the
    /// same; without such stamps `nanos` never falls.
    pub out_of_order: bool,
    /// The stamp contradicts the host's clock by more than 10 s, as after a restart of the device or when
    /// it is damaged: `nanos` was taken from the host and errs by the delay of the arrivals.
    pub from_host: bool,
}

/// Unwraps the counter of one stream (hard-cases B08).
///
/// With d the difference to the latest stamp as a signed number of the counter's width and p its period,
/// the step is d + k p, k >= 0, whichever is nearest to the time that passed on the host; so a gap may last
/// any number of periods, and a duplicate or a swapped packet is no wrap. The host decides among steps that
/// are a period apart and never enters `nanos` otherwise: they are the exact sum of ticks, by integers.
///
/// A step that is no such multiple (see [`Unwrapped::from_host`]) changes nothing until the stamp after it
/// agrees with it; then the counter goes on from there. One damaged stamp thus costs its own time only.
///
/// Limits: arrivals must be right within half a period (35.8 s for 32 bits at 60 MHz), the counter's drift
/// over a gap included: gaps up to 14 h at 200 ppm.
#[derive(Clone, Debug)]
pub struct TickUnwrapper {
    tick_hz: i128,
    period: i128,
    /// Ticks of the greatest time that fits `i64` nanoseconds.
    max_ticks: i128,
    latest: Option<Stamp>,
    suspect: Option<Stamp>,
}

#[derive(Clone, Copy, Debug)]
struct Stamp {
    raw: i128,
    /// Since the first stamp.
    ticks: i128,
    host_nanos: i64,
}

impl TickUnwrapper {
    /// For a counter of `bits` bits, 8 to 64, that runs at `tick_hz`, 1 Hz to 1 THz (1 000 000 for one in
    /// microseconds); `None` for others. A counter of 64 bits wraps as well, after years.
    pub fn new(tick_hz: u64, bits: u32) -> Option<Self> {
        if !(1..=MAX_TICK_HZ).contains(&tick_hz) || !(8..=64).contains(&bits) {
            return None;
        }
        let tick_hz = i128::from(tick_hz);
        Some(Self {
            tick_hz,
            period: 1 << bits,
            max_ticks: i128::from(i64::MAX) * tick_hz / NANOS_PER_SECOND,
            latest: None,
            suspect: None,
        })
    }

    /// The time of a stamp `raw` that arrived at `host_nanos`. Bits of `raw` above the counter's width are
    /// ignored; a host time before the latest one counts as the latest.
    pub fn unwrap(&mut self, raw: u64, host_nanos: i64) -> Unwrapped {
        let raw = i128::from(raw).rem_euclid(self.period);
        let Some(latest) = self.latest else {
            self.latest = Some(Stamp {
                raw,
                ticks: 0,
                host_nanos,
            });
            return self.in_order(0);
        };
        if let Some(step) = self.step(&latest, raw, host_nanos) {
            self.suspect = None;
            let ticks = self.clamped(latest.ticks + step);
            if step > 0 {
                self.latest = Some(Stamp {
                    raw,
                    ticks,
                    host_nanos,
                });
            }
            return Unwrapped {
                out_of_order: step < 0,
                ..self.in_order(ticks)
            };
        }
        if let Some(suspect) = self.suspect
            && let Some(step @ 1..) = self.step(&suspect, raw, host_nanos)
        {
            self.suspect = None;
            let ticks = self.clamped(suspect.ticks + step);
            self.latest = Some(Stamp {
                raw,
                ticks,
                host_nanos,
            });
            return self.in_order(ticks);
        }
        let ticks = self.clamped(latest.ticks + self.passed_ticks(&latest, host_nanos));
        self.suspect = Some(Stamp {
            raw,
            ticks,
            host_nanos,
        });
        Unwrapped {
            from_host: true,
            ..self.in_order(ticks)
        }
    }

    /// Ticks from `from` to the stamp `raw`, negative when it is out of order; `None` when no number of
    /// wraps makes the counter agree with the host.
    fn step(&self, from: &Stamp, raw: i128, host_nanos: i64) -> Option<i128> {
        let half = self.period / 2;
        let difference = (raw - from.raw + half).rem_euclid(self.period) - half;
        let passed = self.passed_ticks(from, host_nanos);
        let wrap_count = (passed - difference + half).div_euclid(self.period).max(0);
        let step = difference + wrap_count * self.period;
        let agrees = (step - passed).abs() <= DISAGREEMENT_SECONDS * self.tick_hz;
        (agrees && step > -REORDER_SECONDS * self.tick_hz).then_some(step)
    }

    /// Time on the host since `from`, in ticks.
    fn passed_ticks(&self, from: &Stamp, host_nanos: i64) -> i128 {
        let passed_nanos = i128::from(host_nanos) - i128::from(from.host_nanos);
        passed_nanos.max(0) * self.tick_hz / NANOS_PER_SECOND
    }

    fn clamped(&self, ticks: i128) -> i128 {
        ticks.clamp(-self.max_ticks, self.max_ticks)
    }

    fn in_order(&self, ticks: i128) -> Unwrapped {
        let nanos = (ticks * NANOS_PER_SECOND).div_euclid(self.tick_hz);
        Unwrapped {
            // Within the range by `clamped`.
            nanos: nanos as i64,
            out_of_order: false,
            from_host: false,
        }
    }
}
