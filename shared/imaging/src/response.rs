//! The response of a sensor: how linear radiance becomes 8-bit codes, and back.

use crate::error::ImagingError;

/// Smallest rise from one code to the next in a repaired curve, as a share of the curve's whole range.
/// Far below the half step that rounding to codes costs, far above what f32 resolves near 1.
const TINY_SLOPE: f64 = 1e-6;

/// What a code says about its radiance (hard-cases B06).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CodeFlag {
    /// Code 0: the radiance is at most that of half a code.
    Low,
    /// Codes 1 to 254: the radiance is known to half a code.
    Ok,
    /// Code 255: the radiance is at least that of code 254.5, without an upper bound.
    High,
}

impl CodeFlag {
    /// What `code` says.
    #[inline]
    pub fn of(code: u8) -> Self {
        match code {
            0 => Self::Low,
            255 => Self::High,
            _ => Self::Ok,
        }
    }
}

/// What [`Response::from_table`] had to change, per channel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ResponseRepair {
    /// How many of the 256 entries were changed.
    pub changed_count: [u32; 3],
    /// Largest change of an entry, in units of the table.
    pub largest_change: [f32; 3],
}

impl ResponseRepair {
    /// Whether the table was usable as it came.
    pub fn is_none(&self) -> bool {
        self.changed_count == [0; 3]
    }
}

/// Linear radiance of each of the 256 codes, strictly increasing, per channel (red, green, blue).
/// 1.0 is the white level where the description says so ([`Response::gamma`] and [`Response::identity`] do).
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    table: [[f32; 256]; 3],
}

impl Response {
    /// linear = (code / 255)^`g`, the same for all channels. Refuses `g` outside [0.1, 10]: beyond it the
    /// darkest codes are no longer distinct in f32 arithmetic that follows.
    pub fn gamma(g: f64) -> Result<Self, ImagingError> {
        if !(0.1..=10.0).contains(&g) {
            return Err(ImagingError::Parameter {
                name: "response gamma",
                value: g,
                expected: "in [0.1, 10]",
            });
        }
        let channel = std::array::from_fn(|code| ((code as f64 / 255.0).powf(g)) as f32);
        Ok(Self {
            table: [channel; 3],
        })
    }

    /// linear = code / 255.
    pub fn identity() -> Self {
        let channel = std::array::from_fn(|code| (code as f64 / 255.0) as f32);
        Self {
            table: [channel; 3],
        }
    }

    /// A measured curve: the radiance of each code, per channel.
    ///
    /// Entries below 0 are raised to 0, dips are levelled by isotonic regression (the least change in the
    /// squares that makes the curve rise), and level stretches get a tiny slope; what changed is returned.
    /// Refuses entries that are not finite and curves that do not rise at all.
    pub fn from_table(table: [[f32; 256]; 3]) -> Result<(Self, ResponseRepair), ImagingError> {
        let mut repair = ResponseRepair::default();
        let mut result = table;
        for channel in 0..3 {
            if table[channel].iter().any(|v| !v.is_finite()) {
                return Err(ImagingError::Response {
                    channel,
                    reason: "an entry is not a finite number",
                });
            }
            result[channel] = rising(&table[channel]).ok_or(ImagingError::Response {
                channel,
                reason: "the curve does not rise",
            })?;
            for (old, new) in table[channel].iter().zip(&result[channel]) {
                if old != new {
                    repair.changed_count[channel] += 1;
                    repair.largest_change[channel] =
                        repair.largest_change[channel].max((old - new).abs());
                }
            }
        }
        Ok((Self { table: result }, repair))
    }

    /// Radiance of a code in channel 0 (red), 1 (green) or 2 (blue). Codes 0 and 255 stand for intervals:
    /// ask [`CodeFlag::of`].
    #[inline]
    pub fn linear(&self, code: u8, channel: usize) -> f32 {
        self.table[channel][usize::from(code)]
    }

    /// The 256 radiances of a channel, strictly increasing.
    pub fn table(&self, channel: usize) -> &[f32; 256] {
        &self.table[channel]
    }

    /// The continuous code in [0, 255] of a radiance: linear between the entries, clipped at both ends.
    /// NaN gives NaN.
    #[inline]
    pub fn code(&self, linear: f32, channel: usize) -> f32 {
        let table = &self.table[channel];
        if linear.is_nan() {
            return f32::NAN;
        }
        // Number of entries at or below the value; the curve rises, so they are the first ones.
        let above = table.partition_point(|&entry| entry <= linear);
        if above == 0 {
            return 0.0;
        }
        if above == 256 {
            return 255.0;
        }
        let (low, high) = (table[above - 1], table[above]);
        (above - 1) as f32 + (linear - low) / (high - low)
    }
}

/// The nearest strictly increasing curve; `None` when there is none with a positive range.
fn rising(curve: &[f32; 256]) -> Option<[f32; 256]> {
    if curve[0] >= 0.0 && curve.is_sorted_by(|a, b| a < b) {
        return Some(*curve);
    }
    let level = isotonic(&curve.map(|v| f64::from(v.max(0.0))));
    let range = level[255] - level[0];
    if range <= 0.0 {
        return None;
    }
    let step = TINY_SLOPE * range;
    let mut result = [level[0] as f32; 256];
    for code in 1..256 {
        let before = result[code - 1];
        let value = level[code].max(f64::from(before) + step) as f32;
        // A step below the resolution of f32 at this value still has to rise.
        result[code] = if value > before {
            value
        } else {
            before.next_up()
        };
    }
    result[255].is_finite().then_some(result)
}

/// Isotonic regression by pooling adjacent violators: the non-decreasing sequence nearest in the squares.
fn isotonic(values: &[f64; 256]) -> [f64; 256] {
    let mut pools: Vec<(f64, usize)> = Vec::with_capacity(256);
    for &value in values {
        let mut pool = (value, 1);
        while let Some(&(sum, count)) = pools.last() {
            if sum / count as f64 <= pool.0 / pool.1 as f64 {
                break;
            }
            pools.pop();
            pool = (sum + pool.0, count + pool.1);
        }
        pools.push(pool);
    }
    let mut result = [0.0; 256];
    let mut at = 0;
    for (sum, count) in pools {
        result[at..at + count].fill(sum / count as f64);
        at += count;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gamma_curve_is_its_formula() {
        let response = Response::gamma(2.2).unwrap();
        assert!((f64::from(response.linear(128, 1)) - (128.0_f64 / 255.0).powf(2.2)).abs() < 1e-7);
        assert_eq!(response.linear(255, 0), 1.0);
        assert_eq!(response.linear(0, 2), 0.0);
        for g in [0.1, 0.45, 1.0, 2.2, 10.0] {
            let table = *Response::gamma(g).unwrap().table(0);
            assert!(table.is_sorted_by(|a, b| a < b), "gamma {g}");
        }
        for g in [f64::NAN, 0.0, -1.0, f64::INFINITY, 11.0] {
            assert!(Response::gamma(g).is_err());
        }
    }

    #[test]
    fn isotonic_regression_averages_a_dip() {
        let mut values: [f64; 256] = std::array::from_fn(|i| i as f64);
        values[10] = 13.0;
        values[11] = 9.0;
        values[12] = 11.0;
        let level = isotonic(&values);
        assert_eq!(&level[9..14], &[9.0, 11.0, 11.0, 11.0, 13.0]);
    }
}
