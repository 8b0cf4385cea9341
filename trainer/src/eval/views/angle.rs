//! LPIPS against the angle to the nearest training view (effects-and-tradeoffs.md C2).

use geometry::robust::median;
use serde::{Deserialize, Serialize};

/// Where bins begin, degrees; the last has no end.
const BIN_STARTS_DEG: [f64; 8] = [0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0];

/// Bins with fewer blocks say nothing certain.
const LEAST_BLOCKS: usize = 3;

/// How frames are grouped: neighbours in time see nearly the same, so they count as one.
const BLOCK_RULE: &str = "a block is a run of held-out frames with consecutive numbers; intervals are those of Student's t over the medians of the blocks";

/// The figures of all methods on the same frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AngleMetrics {
    /// What a block is.
    pub blocks: String,
    /// One a method, in the order composition, diffuse only, nearest view.
    pub methods: Vec<AngleCurve>,
}

/// One method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AngleCurve {
    /// Key of the method in the metrics.
    pub method: String,
    /// Least-squares slope of LPIPS over all frames, for 10 degrees; absent where angles do not differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slope_per_10_deg: Option<f64>,
    /// Bins that hold frames.
    pub bins: Vec<AngleBin>,
}

/// Frames of similar angle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AngleBin {
    /// First angle, degrees.
    pub from_deg: f64,
    /// Where the next bin begins; absent of the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_deg: Option<f64>,
    /// Frames.
    pub frame_count: usize,
    /// Blocks that these frames are of.
    pub block_count: usize,
    /// Median LPIPS of the frames.
    pub median: f64,
    /// 95 % interval over blocks; absent with fewer than 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<[f64; 2]>,
    /// Fewer than 3 blocks: drawn hollow.
    pub is_hollow: bool,
}

/// One held-out frame with the values of all methods.
#[derive(Clone, Copy, Debug)]
pub(super) struct AngleSample {
    /// Number in the recording.
    pub(super) frame: usize,
    /// Angle to the nearest training view, degrees.
    pub(super) angle_deg: f64,
    /// LPIPS a method; a frame without still belongs to its run.
    pub(super) values: Option<[f64; 3]>,
}

/// A frame with its block: what a bin is made of.
#[derive(Clone, Copy)]
struct Point {
    block: usize,
    angle_deg: f64,
    value: f64,
}

/// Bins, blocks and slopes of all held-out frames in order; `None` when none has a value.
pub(super) fn by_angle(methods: [&str; 3], samples: &[AngleSample]) -> Option<AngleMetrics> {
    let blocks = blocks(samples);
    let methods: Vec<AngleCurve> = methods
        .into_iter()
        .enumerate()
        .filter_map(|(k, method)| {
            let points: Vec<Point> = samples
                .iter()
                .zip(&blocks)
                .filter_map(|(sample, &block)| {
                    Some(Point {
                        block,
                        angle_deg: sample.angle_deg,
                        value: sample.values?[k],
                    })
                })
                .collect();
            (!points.is_empty()).then(|| AngleCurve {
                method: method.to_owned(),
                slope_per_10_deg: slope(&points).map(|slope| 10.0 * slope),
                bins: (0..BIN_STARTS_DEG.len())
                    .filter_map(|index| bin(index, &points))
                    .collect(),
            })
        })
        .collect();
    (!methods.is_empty()).then(|| AngleMetrics {
        blocks: BLOCK_RULE.to_owned(),
        methods,
    })
}

/// The block of each sample.
fn blocks(samples: &[AngleSample]) -> Vec<usize> {
    let mut block = 0;
    let mut previous: Option<usize> = None;
    samples
        .iter()
        .map(|sample| {
            if previous.is_some_and(|p| p + 1 != sample.frame) {
                block += 1;
            }
            previous = Some(sample.frame);
            block
        })
        .collect()
}

fn bin(index: usize, points: &[Point]) -> Option<AngleBin> {
    let from_deg = BIN_STARTS_DEG[index];
    let to_deg = BIN_STARTS_DEG.get(index + 1).copied();
    let mut values = Vec::new();
    let mut of_block: Vec<(usize, Vec<f64>)> = Vec::new();
    for point in points {
        if point.angle_deg < from_deg || to_deg.is_some_and(|end| point.angle_deg >= end) {
            continue;
        }
        values.push(point.value);
        // Points come in order of their blocks.
        match of_block.last_mut() {
            Some((last, values)) if *last == point.block => values.push(point.value),
            _ => of_block.push((point.block, vec![point.value])),
        }
    }
    let frame_count = values.len();
    let block_medians: Vec<f64> = of_block
        .iter_mut()
        .filter_map(|(_, values)| median(values))
        .collect();
    Some(AngleBin {
        from_deg,
        to_deg,
        frame_count,
        block_count: block_medians.len(),
        median: median(&mut values)?,
        interval: t_interval(&block_medians),
        is_hollow: block_medians.len() < LEAST_BLOCKS,
    })
}

/// Least-squares slope of the value over the angle, for a degree.
fn slope(points: &[Point]) -> Option<f64> {
    let count = points.len() as f64;
    let mean_x = points.iter().map(|p| p.angle_deg).sum::<f64>() / count;
    let mean_y = points.iter().map(|p| p.value).sum::<f64>() / count;
    let (mut xx, mut xy) = (0.0, 0.0);
    for point in points {
        let x = point.angle_deg - mean_x;
        xx += x * x;
        xy += x * (point.value - mean_y);
    }
    // A spread below a thousandth of a degree is no spread.
    (xx > 1e-6 * count).then(|| xy / xx)
}

/// The two-sided 95 % interval of the mean of independent values; `None` of fewer than 2.
fn t_interval(values: &[f64]) -> Option<[f64; 2]> {
    if values.len() < 2 {
        return None;
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (count - 1.0);
    let half = effects::probe::student_quantile(values.len() - 1) * (variance / count).sqrt();
    Some([mean - half, mean + half])
}

#[cfg(test)]
mod tests {
    use super::*;

    const METHODS: [&str; 3] = ["composition", "diffuse_only", "nearest_view"];

    fn sample(frame: usize, angle_deg: f64, value: f64) -> AngleSample {
        AngleSample {
            frame,
            angle_deg,
            values: Some([value, 2.0 * value, 0.5]),
        }
    }

    #[test]
    fn runs_of_frames_are_blocks_and_bins_by_hand() {
        let samples = [
            sample(10, 1.0, 0.1),
            AngleSample {
                frame: 11,
                angle_deg: 1.2,
                values: None,
            },
            sample(12, 1.5, 0.3),
            sample(20, 1.0, 0.4),
            sample(30, 0.0, 0.6),
            sample(31, 2.0, 0.8),
            sample(90, 60.0, 0.9),
        ];
        let metrics = by_angle(METHODS, &samples).unwrap();
        let [near, next, far] = metrics.methods[0].bins[..] else {
            panic!("three bins hold frames");
        };
        assert_eq!((near.frame_count, near.block_count), (4, 3));
        assert!(!near.is_hollow && (near.median - 0.35).abs() < 1e-12);
        // Block medians 0.2, 0.4, 0.6: mean 0.4, standard error 0.2/√3, t of 2 degrees 4.3027.
        let half = 4.3027 * 0.2 / 3.0_f64.sqrt();
        let [low, high] = near.interval.unwrap();
        assert!((low - (0.4 - half)).abs() < 1e-9 && (high - (0.4 + half)).abs() < 1e-9);
        assert_eq!(
            (next.from_deg, next.to_deg, next.frame_count),
            (2.0, Some(5.0), 1)
        );
        assert!(next.is_hollow && next.interval.is_none());
        assert_eq!((far.from_deg, far.to_deg), (45.0, None));
        assert_eq!(metrics.methods[1].bins[2].median, 1.8);
        assert_eq!(by_angle(METHODS, &[]), None);
    }

    #[test]
    fn the_slope_is_that_of_a_line_and_absent_where_angles_agree() {
        let line: Vec<_> = (0..20)
            .map(|i| sample(2 * i, f64::from(i as u32), 0.1 + 0.02 * i as f64))
            .collect();
        let metrics = by_angle(METHODS, &line).unwrap();
        let slopes: Vec<_> = metrics.methods.iter().map(|m| m.slope_per_10_deg).collect();
        assert!((slopes[0].unwrap() - 0.2).abs() < 1e-9);
        assert!((slopes[1].unwrap() - 0.4).abs() < 1e-9);
        assert!(slopes[2].unwrap().abs() < 1e-12);
        let same: Vec<_> = (0..5).map(|i| sample(i, 7.0, 0.1 * i as f64)).collect();
        assert_eq!(
            by_angle(METHODS, &same).unwrap().methods[0].slope_per_10_deg,
            None
        );
    }
}
