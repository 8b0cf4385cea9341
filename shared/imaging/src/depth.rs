//! From depth codes to metres, with every way of saying "no measurement" mapped to one.

use std::ops::RangeInclusive;

use rayon::prelude::*;

use crate::error::ImagingError;
use crate::image::{DepthImage, Image};
use crate::undistortion::Undistortion;

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

/// Metres of each of the 65,536 samples of a depth stream, made once: one look-up a pixel.
#[derive(Clone, Debug)]
pub struct DepthTable(Box<[f32]>);

/// Pixels that a task converts: a few rows.
const TASK_PIXELS: usize = 16 * 640;

impl DepthTable {
    /// Samples that are proportional to depth, by the rules of [`metres_from_raw`].
    pub fn of_values(scale_m_per_unit: f64, valid_range: RangeInclusive<f32>) -> Self {
        Self::new(
            |sample| (f64::from(sample) * scale_m_per_unit) as f32,
            &valid_range,
        )
    }

    /// Samples that are shifts, with the depth of each in mm, 0 for none; shifts beyond the table are none.
    pub fn of_codes(table_mm: &[u16], valid_range: RangeInclusive<f32>) -> Self {
        let metres = |sample: u16| {
            let mm = table_mm.get(usize::from(sample)).copied();
            mm.map_or(NO_DEPTH, |mm| (f64::from(mm) / 1000.0) as f32)
        };
        Self::new(metres, &valid_range)
    }

    fn new(metres: impl Fn(u16) -> f32, valid_range: &RangeInclusive<f32>) -> Self {
        let mut counts = DepthCounts::default();
        let entry = |sample: u16| match sample {
            0 | u16::MAX => NO_DEPTH,
            _ => in_range(metres(sample), valid_range, &mut counts),
        };
        Self((0..=u16::MAX).map(entry).collect())
    }

    /// Metres of a sample, [`NO_DEPTH`] for none.
    #[inline]
    pub fn metres(&self, sample: u16) -> f32 {
        self.0[usize::from(sample)]
    }

    /// Metres of `samples` (of the camera with its distortion) as the ideal pinhole sees them. Allocates nothing.
    ///
    /// # Errors
    /// [`ImagingError::PixelCount`] unless `samples` and `metres` have a place for each pixel of the camera.
    pub fn metres_into(
        &self,
        samples: &[u16],
        undistortion: &Undistortion,
        metres: &mut [f32],
    ) -> Result<(), ImagingError> {
        let camera = undistortion.camera();
        let (width, height) = (camera.width(), camera.height());
        let expected = u64::from(width) * u64::from(height);
        for got in [samples.len() as u64, metres.len() as u64] {
            if got != expected {
                return Err(ImagingError::PixelCount {
                    width,
                    height,
                    expected,
                    got,
                });
            }
        }
        if undistortion.is_identity() {
            let rows = samples.par_chunks(TASK_PIXELS);
            let tasks = metres.par_chunks_mut(TASK_PIXELS).zip(rows);
            tasks.for_each(|(metres, samples)| {
                for (metres, &sample) in metres.iter_mut().zip(samples) {
                    *metres = self.metres(sample);
                }
            });
            return Ok(());
        }
        let sources = undistortion.sources().par_chunks(TASK_PIXELS);
        let tasks = metres.par_chunks_mut(TASK_PIXELS).zip(sources);
        tasks.for_each(|(metres, sources)| {
            for (metres, &source) in metres.iter_mut().zip(sources) {
                // A source beyond the image is a ray that the lens does not see.
                let sample = samples.get(source as usize).copied().unwrap_or_default();
                *metres = self.metres(sample);
            }
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use geometry::{Distortion, Intrinsics};

    use super::*;

    #[test]
    fn a_table_says_what_the_formula_says() {
        let range = 0.4..=4.0;
        let table = DepthTable::of_values(0.001, range.clone());
        let raw = Image::from_fn(256, 256, |x, y| (256 * y + x) as u16);
        let (expected, _) = metres_from_raw(&raw, 0.001, range);
        let undistortion =
            Undistortion::new(&Intrinsics::pinhole(256, 256, 200.0, 200.0, 127.5, 127.5).unwrap());
        let mut metres = vec![-1.0; 256 * 256];
        table
            .metres_into(raw.pixels(), &undistortion, &mut metres)
            .unwrap();
        assert_eq!(metres, expected.pixels());
    }

    #[test]
    fn shifts_have_the_depth_of_their_table_and_none_beyond_it() {
        let table = DepthTable::of_codes(&[0, 500, 0, 5000, 800], 0.4..=4.0);
        let metres: Vec<f32> = [0, 1, 2, 3, 4, 5, 2047, u16::MAX]
            .into_iter()
            .map(|sample| table.metres(sample))
            .collect();
        assert_eq!(metres, [0.0, 0.5, 0.0, 0.0, 0.8, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_lens_moves_samples_and_mixes_none() {
        let lens = Distortion {
            k1: -0.2,
            ..Distortion::default()
        };
        let camera = Intrinsics::new(64, 48, 50.0, 50.0, 31.5, 23.5, lens).unwrap();
        let undistortion = Undistortion::new(&camera);
        let samples: Vec<u16> = (0..64 * 48)
            .map(|index| if index % 64 < 6 { 600 } else { 2000 })
            .collect();
        let mut metres = vec![-1.0; samples.len()];
        let table = DepthTable::of_values(0.001, 0.4..=4.0);
        table
            .metres_into(&samples, &undistortion, &mut metres)
            .unwrap();
        assert!(metres.iter().all(|depth| [0.0, 0.6, 2.0].contains(depth)));
        let moved = metres
            .iter()
            .zip(&samples)
            .filter(|(metres, sample)| **metres != f32::from(**sample) / 1000.0);
        assert!(moved.count() > 40);
        assert!(
            table
                .metres_into(&samples[1..], &undistortion, &mut metres)
                .is_err()
        );
    }
}
