//! The camera's counter. What it means in nanoseconds, wraps over long gaps included, is for those who know the host's
//! clock.

/// A stamp of the camera's 32-bit counter, which wraps (every 71.58 s at 60 MHz).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DeviceTicks(pub u32);

impl DeviceTicks {
    /// Ticks from `earlier` to this stamp by the shorter way round, negative where this one was sent before: so a
    /// repeated or swapped packet is no wrap (hard-cases B08). Right for stamps less than half a period apart.
    pub fn since(self, earlier: Self) -> i32 {
        self.0.wrapping_sub(earlier.0).cast_signed()
    }

    /// The stamp `ticks` later, around the end of the counter.
    #[must_use]
    pub fn after(self, ticks: u64) -> Self {
        // Modulo 2³², as the counter counts.
        Self(self.0.wrapping_add(ticks as u32))
    }
}

/// How fast the counter runs: what the frequency block says (protocol section 3, algorithm type 0x80). It is to be
/// asked again at every start of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TickRate {
    hz: u64,
}

impl TickRate {
    /// The rate of all PS1080 seen so far: 60 ticks a microsecond.
    pub const PS1080: Self = Self { hz: 60_000_000 };

    /// Of `ticks` per microsecond, rounded to whole hertz; `None` outside 1e-3 to 1e6 and for NaN.
    pub fn from_ticks_per_microsecond(ticks: f32) -> Option<Self> {
        if !(1e-3..=1e6).contains(&ticks) {
            return None;
        }
        // At most 1e12, positive: adding a half and cutting off is rounding, and exact in f64.
        let hz = (f64::from(ticks) * 1e6 + 0.5) as u64;
        Some(Self { hz })
    }

    /// Ticks a second.
    pub fn hz(self) -> u64 {
        self.hz
    }
}
