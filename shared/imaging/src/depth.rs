//! From depth codes to metres, with every way of saying "no measurement" mapped to one.

use std::ops::RangeInclusive;

use crate::image::{DepthImage, Image};

/// The depth that says "no measurement". Test with [`is_measured`], never by comparing.
pub const NO_DEPTH: f32 = 0.0;

/// Whether `depth` (metres) is a measurement: finite and above zero.
#[inline]
pub fn is_measured(depth: f32) -> bool {
    depth.is_finite() && depth > 0.0
}

/// What became of the samples of a depth image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DepthCounts {
    /// Samples with a depth inside the valid range.
    pub measured_count: u64,
    /// Samples that the sensor itself calls "no measurement".
    pub missing_count: u64,
    /// Samples with a depth outside the valid range.
    pub out_of_range_count: u64,
}

/// Depth codes to metres: depth = code · `scale_m_per_unit`, kept where it lies in `valid_range` (metres).
///
/// Codes 0 and 65535 are "no measurement" (design.md section 2); they and depths outside the range become
/// [`NO_DEPTH`] and are counted by reason. A scale or a range that is not a number leaves no measurement.
pub fn metres_from_raw(
    raw: &Image<u16>,
    scale_m_per_unit: f64,
    valid_range: RangeInclusive<f32>,
) -> (DepthImage, DepthCounts) {
    let mut counts = DepthCounts::default();
    let metres = raw.map(|code| match code {
        0 | u16::MAX => {
            counts.missing_count += 1;
            NO_DEPTH
        }
        _ => in_range(
            (f64::from(code) * scale_m_per_unit) as f32,
            &valid_range,
            &mut counts,
        ),
    });
    (metres, counts)
}

/// Depth that is in metres already (a float file, a renderer), under the same rules: what is not a
/// measurement by [`is_measured`] is missing, what lies outside `valid_range` is out of range; infinite
/// depth is out of range.
pub fn metres_from_float(
    metres: &Image<f32>,
    valid_range: RangeInclusive<f32>,
) -> (DepthImage, DepthCounts) {
    let mut counts = DepthCounts::default();
    let metres = metres.map(|depth| {
        if depth.is_nan() || depth <= 0.0 {
            counts.missing_count += 1;
            NO_DEPTH
        } else {
            in_range(depth, &valid_range, &mut counts)
        }
    });
    (metres, counts)
}

fn in_range(depth: f32, valid_range: &RangeInclusive<f32>, counts: &mut DepthCounts) -> f32 {
    if is_measured(depth) && valid_range.contains(&depth) {
        counts.measured_count += 1;
        depth
    } else {
        counts.out_of_range_count += 1;
        NO_DEPTH
    }
}
