//! Aggregation that keeps failures (hard-cases L12).

use geometry::robust::median;

/// Which direction of a measure is good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Better {
    /// Errors, distances.
    Lower,
    /// PSNR, SSIM, correlation.
    Higher,
}

/// Runs of one experiment, failures among them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Median over all runs, a failure ranking as the worst value; `None` when it falls on a failure.
    pub median: Option<f64>,
    /// Mean over the runs that did not fail; to be shown only beside `failed_count`. `None` when all failed.
    pub mean: Option<f64>,
    /// Worst value over all runs; `None` when a run failed, which is worse than any value.
    pub worst: Option<f64>,
    /// Number of runs, failures included.
    pub count: usize,
    /// Number of runs without a finite value.
    pub failed_count: usize,
}

impl Summary {
    /// Of one value per run; `None` or a value that is not finite is a failure.
    pub fn of(values: &[Option<f64>], better: Better) -> Self {
        let worst_possible = match better {
            Better::Lower => f64::INFINITY,
            Better::Higher => f64::NEG_INFINITY,
        };
        let good: Vec<f64> = values
            .iter()
            .copied()
            .flatten()
            .filter(|v| v.is_finite())
            .collect();
        let failed_count = values.len() - good.len();
        let mut ranked = good.clone();
        ranked.resize(values.len(), worst_possible);
        let worst = match better {
            Better::Lower => good.iter().copied().reduce(f64::max),
            Better::Higher => good.iter().copied().reduce(f64::min),
        };
        Self {
            median: median(&mut ranked).filter(|v| v.is_finite()),
            mean: (!good.is_empty()).then(|| good.iter().sum::<f64>() / good.len() as f64),
            worst: worst.filter(|_| failed_count == 0),
            count: values.len(),
            failed_count,
        }
    }
}
