//! Paired comparison on held-out blocks of frames.

use std::ops::Range;

/// Fewest blocks that an interval is made from where the recording is long enough.
pub const BLOCK_COUNT: usize = 10;
/// Fewest frames of a block, in correlation times: shorter ones are not independent.
pub const BLOCK_TAUS: f64 = 3.0;
/// Blocks of a recording that is too short for those: few and long, because a free map foresees the frames beside those
/// that it was fitted to, whatever stands in the way of the mirrored rays.
pub const SHORT_BLOCKS: usize = 4;
/// Frames on both sides of a held-out block that take no part in fitting, in correlation times.
pub const GUARD_TAUS: f64 = 1.0;
/// Fewest blocks that may remain when some of them say nothing.
pub const FEWEST_BLOCKS: usize = 5;

/// Contiguous blocks of recorded frames, each held out in its turn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockPlan {
    /// The blocks, in order, without gaps.
    pub blocks: Vec<Range<usize>>,
    /// Frames beside a held-out block that are not fitted.
    pub guard: usize,
}

impl BlockPlan {
    /// Blocks of a recording of `frame_count` frames with correlation time `tau_frames`; `None` when it is shorter
    /// than 30 correlation times: then no probe is honest.
    pub fn new(frame_count: usize, tau_frames: f64) -> Option<Self> {
        let tau = tau_frames.max(1.0);
        let least = BLOCK_COUNT as f64 * BLOCK_TAUS * tau;
        // NaN fails.
        if !(frame_count as f64 >= least) {
            return None;
        }
        let blocks = (0..BLOCK_COUNT)
            .map(|i| i * frame_count / BLOCK_COUNT..(i + 1) * frame_count / BLOCK_COUNT)
            .collect();
        Some(Self {
            blocks,
            guard: (GUARD_TAUS * tau).ceil() as usize,
        })
    }

    /// [`SHORT_BLOCKS`] blocks of a recording that is too short for [`BlockPlan::new`], without guards. They depend on
    /// each other, so that no interval may be made from them.
    pub fn dependent(frame_count: usize) -> Self {
        let blocks = (0..SHORT_BLOCKS)
            .map(|i| i * frame_count / SHORT_BLOCKS..(i + 1) * frame_count / SHORT_BLOCKS)
            .collect();
        Self { blocks, guard: 0 }
    }

    /// The block of a frame.
    pub fn block_of(&self, frame: usize) -> Option<usize> {
        self.blocks.iter().position(|block| block.contains(&frame))
    }

    /// Whether a frame may be fitted while the blocks of which `is_held` says so are held out.
    pub fn is_fitted(&self, frame: usize, is_held: impl Fn(usize) -> bool) -> bool {
        let low = frame.saturating_sub(self.guard);
        let high = frame.saturating_add(self.guard);
        let mut near = self.blocks.iter().enumerate();
        !near.any(|(index, block)| is_held(index) && block.start <= high && low < block.end)
    }
}

/// Lag-one autocorrelation; 0 for fewer than three values or without variance.
pub fn autocorrelation(values: &[f64]) -> f64 {
    if values.len() < 3 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    let lagged: f64 = values
        .windows(2)
        .map(|pair| (pair[0] - mean) * (pair[1] - mean))
        .sum();
    if variance > 0.0 {
        lagged / variance
    } else {
        0.0
    }
}

/// Correlation time τ = (1 + ρ₁)/(1 − ρ₁) in frames, from the autocorrelation of values `step` frames apart, under
/// ρ at a distance d being ρ₁ to the power of d. At least 1.
pub fn correlation_time(rho_of_step: f64, step: f64) -> f64 {
    // Below this, chance and no correlation are the same; above, the frames say one thing.
    let rho = rho_of_step.clamp(0.02, 0.98);
    let one = rho.powf(1.0 / step.max(1.0));
    ((1.0 + one) / (1.0 - one)).max(1.0)
}

/// Mean and two-sided 95 % interval of independent values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Mean.
    pub mean: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Number of values.
    pub count: usize,
}

/// The t-interval of block means; `None` below [`FEWEST_BLOCKS`]. Fewer blocks widen it by themselves.
pub fn interval(block_means: &[f64]) -> Option<Interval> {
    let count = block_means.len();
    if count < FEWEST_BLOCKS || block_means.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let n = count as f64;
    let mean = block_means.iter().sum::<f64>() / n;
    let square: f64 = block_means.iter().map(|v| (v - mean) * (v - mean)).sum();
    let error = (square / (n - 1.0) / n).sqrt();
    let reach = student_quantile(count - 1) * error;
    Some(Interval {
        mean,
        low: mean - reach,
        high: mean + reach,
        count,
    })
}

/// 97.5 % quantiles of Student's t for 1 to 30 degrees of freedom.
const QUANTILES: [f64; 30] = [
    12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281, 2.2010,
    2.1788, 2.1604, 2.1448, 2.1314, 2.1199, 2.1098, 2.1009, 2.0930, 2.0860, 2.0796, 2.0739, 2.0687,
    2.0639, 2.0595, 2.0555, 2.0518, 2.0484, 2.0452, 2.0423,
];

/// 97.5 % quantile of Student's t; infinite without a degree of freedom.
pub fn student_quantile(degrees: usize) -> f64 {
    if degrees == 0 {
        return f64::INFINITY;
    }
    if let Some(&quantile) = QUANTILES.get(degrees - 1) {
        return quantile;
    }
    // Cornish-Fisher around the normal quantile; its error is below 1e-5 from 30 on.
    let z: f64 = 1.959_963_984_540_054;
    let n = degrees as f64;
    z + (z.powi(3) + z) / (4.0 * n)
        + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * n * n)
}

#[cfg(test)]
mod tests;
