//! How long things took, without keeping each.

use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

/// What a piece of work took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Time that passed, nanoseconds.
    pub wall_nanos: u64,
    /// Time of a processor, nanoseconds.
    pub core_nanos: u64,
}

/// Work that is being done by this thread.
#[derive(Clone, Copy, Debug)]
pub struct Begun {
    wall: Instant,
    core_nanos: u64,
}

impl Work {
    /// Begins now.
    pub fn begin() -> Begun {
        Begun {
            wall: Instant::now(),
            core_nanos: thread_nanos(),
        }
    }

    /// This work and that.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            wall_nanos: self.wall_nanos.saturating_add(other.wall_nanos),
            core_nanos: self.core_nanos.saturating_add(other.core_nanos),
        }
    }
}

impl Begun {
    /// Ends now, in the thread that began.
    pub fn end(self) -> Work {
        Work {
            wall_nanos: u64::try_from(self.wall.elapsed().as_nanos()).unwrap_or(u64::MAX),
            core_nanos: thread_nanos().saturating_sub(self.core_nanos),
        }
    }
}

/// Processor time of this thread.
pub(crate) fn thread_nanos() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    let nanos = time
        .tv_sec
        .saturating_mul(1_000_000_000)
        .saturating_add(time.tv_nsec);
    u64::try_from(nanos).unwrap_or_default()
}

/// Durations from a microsecond to a minute, to three digits; memory is made once.
#[derive(Clone, Debug)]
pub struct Latencies(hdrhistogram::Histogram<u64>);

/// Longest duration told apart, microseconds.
const LONGEST_MICROS: u64 = 60_000_000;

impl Default for Latencies {
    fn default() -> Self {
        let histogram = hdrhistogram::Histogram::new_with_bounds(1, LONGEST_MICROS, 3);
        Self(histogram.expect("the bounds are constants that the crate accepts"))
    }
}

impl Latencies {
    /// Counts nanoseconds.
    pub fn add_nanos(&mut self, nanos: u64) {
        self.add(Duration::from_nanos(nanos));
    }

    /// Counts a duration; one beyond a minute counts as a minute.
    pub fn add(&mut self, duration: Duration) {
        let micros = u64::try_from(duration.as_micros()).unwrap_or(u64::MAX);
        self.0.saturating_record(micros.clamp(1, LONGEST_MICROS));
    }

    /// The duration that `fraction` of all stay within, milliseconds; 0 of none.
    pub fn quantile_ms(&self, fraction: f64) -> f64 {
        self.0.value_at_quantile(fraction) as f64 / 1e3
    }

    /// How many were counted.
    pub fn count(&self) -> u64 {
        self.0.len()
    }

    /// The counts in bins that double, for the record `histogram`.
    pub fn histogram(&self, name: &str) -> sequence::Histogram {
        let mut edges = vec![0.0];
        let mut counts = Vec::new();
        let mut upper_micros = 125;
        while upper_micros < LONGEST_MICROS * 2 {
            let lower_micros = if counts.is_empty() {
                0
            } else {
                upper_micros / 2
            };
            counts.push(self.0.count_between(lower_micros, upper_micros - 1));
            edges.push(upper_micros as f64 / 1e3);
            upper_micros *= 2;
        }
        sequence::Histogram {
            name: name.to_owned(),
            unit: "ms".to_owned(),
            edges,
            counts,
        }
    }
}
