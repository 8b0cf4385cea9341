//! The camera's own time.

use ps1080::stream::DeviceTicks;

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// From the host's nanoseconds to the camera's and back. The camera's begin with 0 when it is plugged in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeviceClock {
    epoch_nanos: i64,
    drift_ppb: i64,
    first_ticks: u32,
    ticks_per_microsecond: u32,
}

impl DeviceClock {
    pub(crate) fn new(
        epoch_nanos: i64,
        drift_ppm: f64,
        first_ticks: u32,
        ticks_per_microsecond: u32,
    ) -> Self {
        Self {
            epoch_nanos,
            // A clock that is wrong by more than a tenth is none.
            drift_ppb: (drift_ppm.clamp(-1e5, 1e5) * 1e3).round() as i64,
            first_ticks,
            ticks_per_microsecond,
        }
    }

    pub(crate) fn device_nanos(&self, host_nanos: i64) -> i64 {
        let since = host_nanos - self.epoch_nanos;
        since + scaled(since, self.drift_ppb, NANOS_PER_SECOND)
    }

    pub(crate) fn host_nanos(&self, device_nanos: i64) -> i64 {
        let ahead = scaled(
            device_nanos,
            self.drift_ppb,
            NANOS_PER_SECOND + self.drift_ppb,
        );
        self.epoch_nanos + device_nanos - ahead
    }

    /// The counter at a time of the camera that is not before 0.
    pub(crate) fn ticks(&self, device_nanos: i64) -> DeviceTicks {
        let ticks = scaled(device_nanos, i64::from(self.ticks_per_microsecond), 1000);
        DeviceTicks(self.first_ticks).after(ticks.max(0).cast_unsigned())
    }
}

/// `value * numerator / denominator` without overflow on the way, rounded down.
fn scaled(value: i64, numerator: i64, denominator: i64) -> i64 {
    let product = i128::from(value) * i128::from(numerator);
    // The factor is about 1 or 0.06 times a time in nanoseconds: it fits again.
    product.div_euclid(i128::from(denominator)) as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn host_and_device_time_are_inverse_to_a_nanosecond() {
        for drift_ppm in [-200.0, 0.0, 0.3, 150.0] {
            let clock = DeviceClock::new(5_000, drift_ppm, 0, 60);
            for device_nanos in [0, 1, 33_333_333, 86_400_000_000_000] {
                let again = clock.device_nanos(clock.host_nanos(device_nanos));
                assert!((again - device_nanos).abs() <= 1, "{drift_ppm} ppm");
            }
        }
    }

    #[test]
    fn the_counter_runs_at_60_mhz_and_wraps() {
        let clock = DeviceClock::new(0, 0.0, u32::MAX - 59, 60);
        assert_eq!(clock.ticks(0), DeviceTicks(u32::MAX - 59));
        assert_eq!(clock.ticks(1000), DeviceTicks(0));
        assert_eq!(clock.ticks(2000), DeviceTicks(60));
    }
}
