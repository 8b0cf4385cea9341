//! Exposure differences between frames, from surface points that look alike in all views.

use geometry::robust;

use super::Sample;

/// Rounds of alternating medians.
const ROUNDS: usize = 8;
/// Views that a point needs to say anything about a frame.
const ENOUGH_VIEWS: usize = 5;
/// Spread of the logarithm of luminance (robust σ) beyond that of noise up to which a point is matte.
const MATTE_SPREAD: f64 = 0.05;

/// The gain of each of `frame_count` frames relative to their common level (hard-cases G08): divide the
/// frame's radiance by it.
///
/// `points` holds the samples of one surface point each; `sigma` is the luminance noise of a sample. Only
/// matte points count: at least five unsaturated views whose luminance stays within 5 % plus noise of
/// their median. In logarithms, medians over views and over points alternate; the median gain is 1. A
/// frame without a matte sample has gain 1.
pub fn frame_gains(points: &[Vec<Sample>], frame_count: usize, sigma: f32) -> Vec<f64> {
    let matte: Vec<Vec<(usize, f64)>> = points
        .iter()
        .filter_map(|samples| matte_logs(samples, frame_count, f64::from(sigma)))
        .collect();
    let mut log_gains = vec![0.0; frame_count];
    let mut residuals: Vec<Vec<f64>> = vec![Vec::new(); frame_count];
    for _ in 0..ROUNDS {
        residuals.iter_mut().for_each(Vec::clear);
        for views in &matte {
            let mut levels: Vec<f64> = views
                .iter()
                .map(|&(frame, log)| log - log_gains[frame])
                .collect();
            let Some(level) = robust::median(&mut levels) else {
                continue;
            };
            for &(frame, log) in views {
                residuals[frame].push(log - level);
            }
        }
        for (gain, residuals) in log_gains.iter_mut().zip(&mut residuals) {
            *gain = robust::median(residuals).unwrap_or(0.0);
        }
        let seen = log_gains
            .iter()
            .zip(&residuals)
            .filter(|(_, r)| !r.is_empty());
        let common = robust::median(&mut seen.map(|(gain, _)| *gain).collect()).unwrap_or(0.0);
        for (gain, residuals) in log_gains.iter_mut().zip(&residuals) {
            *gain = if residuals.is_empty() {
                0.0
            } else {
                *gain - common
            };
        }
    }
    log_gains.into_iter().map(f64::exp).collect()
}

/// (frame, ln luminance) of a matte point's usable views, `None` for other points.
fn matte_logs(samples: &[Sample], frame_count: usize, sigma: f64) -> Option<Vec<(usize, f64)>> {
    let floor = (4.0 * sigma).max(1e-4);
    let views: Vec<(usize, f64)> = samples
        .iter()
        .filter(|s| !s.saturated && s.luminance().is_finite() && s.luminance() > floor)
        .filter(|s| (s.frame as usize) < frame_count)
        .map(|s| (s.frame as usize, s.luminance().ln()))
        .collect();
    if views.len() < ENOUGH_VIEWS {
        return None;
    }
    let logs: Vec<f64> = views.iter().map(|(_, log)| *log).collect();
    let level = robust::median(&mut logs.clone())?.exp();
    let spread = robust::mad_sigma(&logs, 0.0)?;
    (spread <= MATTE_SPREAD.hypot(sigma / level)).then_some(views)
}
