//! The line from device time to host time, under all arrivals.

use std::collections::VecDeque;

/// Arrivals older than this, by device time, are forgotten.
const WINDOW_NANOS: i64 = 60_000_000_000;
/// One arrival is kept in each slot of device time, the one with the least delay. Two clocks drift apart by
/// at most 20 µs meanwhile, and all of the window is 601 arrivals at any frame rate.
const SLOT_NANOS: i64 = 100_000_000;
const MAX_ARRIVALS: usize = (WINDOW_NANOS / SLOT_NANOS) as usize + 1;
/// Before the window spans this, a rate from it is worse than 1: a few of 1e-6 is what it is after.
const MIN_SPAN_NANOS: i64 = 10_000_000_000;
/// No quartz errs by more than 100 ppm, and the device and the host have one each.
const MAX_DRIFT: f64 = 200e-6;

/// Host time as a line over device time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockLine {
    /// Host seconds for each second of the device, 1 ± 200 ppm.
    pub rate: f64,
    /// A point of the line: device time, nanoseconds …
    pub device_origin_nanos: i64,
    /// … and the host time then, nanoseconds.
    pub host_origin_nanos: i64,
}

impl ClockLine {
    /// Host time, nanoseconds, at which a stamp `device_nanos` would arrive with the least delay seen.
    pub fn host_from_device(&self, device_nanos: i64) -> i64 {
        let passed = device_nanos.saturating_sub(self.device_origin_nanos);
        // Apart, since passed times rate would round to more than a nanosecond after 100 days.
        let drift = (passed as f64 * (self.rate - 1.0)).round() as i64;
        self.host_origin_nanos
            .saturating_add(passed)
            .saturating_add(drift)
    }
}

/// Fits a [`ClockLine`] to the arrivals of the last 60 s (hard-cases B09).
///
/// A packet is never early and its delay has a long tail, so least squares would be late by the mean delay.
/// The fit is the highest line under all arrivals, highest at their mean device time: an edge of their
/// lower convex hull (Moon, Skelly and Towsley 1999; the likeliest line when delays are exponential). Its
/// slope is limited to 1 ± 200 ppm, and is 1 until the arrivals span 10 s. A delay that every packet
/// has cannot be told from the clocks' offset and stays in the line.
///
/// Memory: 601 arrivals and their hull, under 32 KiB, allocated once.
#[derive(Clone, Debug)]
pub struct ClockFit {
    /// Ascending in device time, at most one for each slot.
    arrivals: VecDeque<Arrival>,
    /// Kept between fits for its memory alone.
    hull: Vec<Point>,
}

#[derive(Clone, Copy, Debug)]
struct Arrival {
    device_nanos: i64,
    host_nanos: i64,
}

impl Arrival {
    fn delay_nanos(&self) -> i128 {
        i128::from(self.host_nanos) - i128::from(self.device_nanos)
    }

    fn slot(&self) -> i64 {
        self.device_nanos.div_euclid(SLOT_NANOS)
    }
}

/// An arrival from the newest one on: device time and delay, nanoseconds.
#[derive(Clone, Copy, Debug)]
struct Point {
    x: i64,
    delay: i128,
}

impl Default for ClockFit {
    fn default() -> Self {
        Self {
            arrivals: VecDeque::with_capacity(MAX_ARRIVALS),
            hull: Vec::with_capacity(MAX_ARRIVALS),
        }
    }
}

impl ClockFit {
    /// Adds a stamp that was made at `device_nanos` (unwrapped, [`TickUnwrapper`](super::TickUnwrapper))
    /// and arrived at `host_nanos`. One that is out of order came late and says nothing; one more than 60 s
    /// before the newest begins anew.
    pub fn observe(&mut self, device_nanos: i64, host_nanos: i64) {
        let arrival = Arrival {
            device_nanos,
            host_nanos,
        };
        if let Some(newest) = self.arrivals.back_mut() {
            if arrival.slot() == newest.slot() {
                if arrival.delay_nanos() < newest.delay_nanos() {
                    *newest = arrival;
                }
                return;
            }
            if newest.device_nanos.saturating_sub(device_nanos) > WINDOW_NANOS {
                self.arrivals.clear();
            } else if arrival.slot() < newest.slot() {
                return;
            }
        }
        let oldest_nanos = device_nanos.saturating_sub(WINDOW_NANOS);
        while self
            .arrivals
            .front()
            .is_some_and(|oldest| oldest.device_nanos < oldest_nanos)
            || self.arrivals.len() >= MAX_ARRIVALS
        {
            self.arrivals.pop_front();
        }
        self.arrivals.push_back(arrival);
    }

    /// The line through the arrivals of the window; `None` before the first. Takes time in proportion to
    /// the arrivals, some microseconds.
    pub fn fit(&mut self) -> Option<ClockLine> {
        let newest = *self.arrivals.back()?;
        let mean_x = self.build_hull(&newest);
        let drift = self.drift_at(mean_x);
        // The highest line of this slope under all arrivals touches the hull.
        let delay = self
            .hull
            .iter()
            .map(|point| point.delay as f64 - drift * point.x as f64)
            .fold(f64::INFINITY, f64::min);
        Some(ClockLine {
            rate: 1.0 + drift,
            device_origin_nanos: newest.device_nanos,
            host_origin_nanos: newest.host_nanos.saturating_add(delay.round() as i64),
        })
    }

    /// Makes the lower convex hull of all arrivals, ascending, and answers their mean device time; both from
    /// `newest` on.
    fn build_hull(&mut self, newest: &Arrival) -> i64 {
        self.hull.clear();
        let mut sum_x = 0;
        for arrival in &self.arrivals {
            let point = Point {
                // The window is 60 s.
                x: arrival.device_nanos - newest.device_nanos,
                delay: arrival.delay_nanos() - newest.delay_nanos(),
            };
            sum_x += point.x;
            while let [.., before, last] = self.hull.as_slice() {
                if turns_left(before, last, &point) {
                    break;
                }
                self.hull.pop();
            }
            self.hull.push(point);
        }
        sum_x / self.arrivals.len().max(1) as i64
    }

    /// Slope, less 1, of the hull's edge over `mean_x`.
    fn drift_at(&self, mean_x: i64) -> f64 {
        let [first, .., last] = self.hull.as_slice() else {
            return 0.0;
        };
        if last.x - first.x < MIN_SPAN_NANOS {
            return 0.0;
        }
        let edges = self.hull.windows(2);
        let slopes = edges.filter_map(|edge| match edge {
            [a, b] if b.x >= mean_x => Some((b.delay - a.delay) as f64 / (b.x - a.x) as f64),
            _ => None,
        });
        // Slopes ascend, so that the first is the edge over the mean.
        slopes
            .into_iter()
            .next()
            .map_or(0.0, |slope| slope.clamp(-MAX_DRIFT, MAX_DRIFT))
    }

    /// Arrivals that are kept.
    #[cfg(test)]
    pub(super) fn kept(&self) -> (usize, usize, usize) {
        (
            self.arrivals.len(),
            self.arrivals.capacity(),
            self.hull.capacity(),
        )
    }
}

/// Whether `b` lies below the line from `a` to `c`.
fn turns_left(a: &Point, b: &Point, c: &Point) -> bool {
    i128::from(b.x - a.x) * (c.delay - a.delay) > i128::from(c.x - a.x) * (b.delay - a.delay)
}
