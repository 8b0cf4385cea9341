use super::*;
use crate::random::Normal;

/// P(|T| ≤ t) by Simpson's rule over the density, normalised by itself.
fn central_probability(degrees: usize, t: f64) -> f64 {
    let n = degrees as f64;
    // x = tan(a) turns the half line into a quarter turn.
    let density = |a: f64| {
        let x = a.tan();
        (1.0 + x * x / n).powf(-0.5 * (n + 1.0)) * (1.0 + x * x)
    };
    let simpson = |end: f64| {
        let steps = 20_000;
        let h = end / f64::from(steps);
        let inner: f64 = (1..steps)
            .map(|i| if i % 2 == 1 { 4.0 } else { 2.0 } * density(h * f64::from(i)))
            .sum();
        (density(0.0) + inner + density(end)) * h / 3.0
    };
    simpson(t.atan()) / simpson(std::f64::consts::FRAC_PI_2 - 1e-7)
}

#[test]
fn quantiles_are_those_of_the_density() {
    for degrees in [1, 2, 4, 9, 19, 30, 31, 60, 200] {
        let covered = central_probability(degrees, student_quantile(degrees));
        assert!((covered - 0.95).abs() < 2e-5, "{degrees}: {covered}");
    }
    assert!(student_quantile(0).is_infinite());
}

#[test]
fn blocks_cover_the_recording_and_guards_keep_their_distance() {
    let plan = BlockPlan::new(205, 5.0).unwrap();
    assert_eq!(plan.blocks.len(), BLOCK_COUNT);
    assert_eq!(plan.blocks[0].start, 0);
    assert_eq!(plan.blocks[9].end, 205);
    for pair in plan.blocks.windows(2) {
        assert_eq!(pair[0].end, pair[1].start);
    }
    let held = |block: usize| block == 3;
    let fitted: Vec<usize> = (0..205).filter(|&f| plan.is_fitted(f, held)).collect();
    let block = plan.blocks[3].clone();
    assert!(fitted.contains(&(block.start - plan.guard - 1)));
    assert!(!fitted.contains(&(block.start - plan.guard)));
    assert!(!fitted.contains(&(block.end + plan.guard - 1)));
    assert!(fitted.contains(&(block.end + plan.guard)));
    assert_eq!(plan.block_of(block.start), Some(3));
}

#[test]
fn a_short_recording_has_no_blocks() {
    assert!(BlockPlan::new(149, 5.0).is_none());
    assert!(BlockPlan::new(150, 5.0).is_some());
    assert!(
        BlockPlan::new(150, f64::NAN).is_some(),
        "unknown is at least one frame"
    );
    assert!(BlockPlan::new(29, 0.1).is_none());
}

#[test]
fn quarters_of_a_short_recording_cover_it_and_each_frame_is_fitted_or_judged() {
    for frame_count in [0, 1, 3, 4, 90, 205] {
        let plan = BlockPlan::dependent(frame_count);
        assert_eq!(plan.blocks.len(), SHORT_BLOCKS);
        assert_eq!(plan.blocks[SHORT_BLOCKS - 1].end, frame_count);
        let held = |block: usize| block % 2 == 1;
        for frame in 0..frame_count {
            let block = plan.block_of(frame).unwrap();
            assert_ne!(plan.is_fitted(frame, held), held(block), "{frame}");
        }
    }
}

#[test]
fn the_interval_of_too_few_or_unusable_blocks_is_absent() {
    assert!(interval(&[1.0; FEWEST_BLOCKS - 1]).is_none());
    let mut values = [1.0; 10];
    values[3] = f64::NAN;
    assert!(interval(&values).is_none());
    let same = interval(&[2.0; 10]).unwrap();
    assert_eq!((same.low, same.high), (2.0, 2.0));
}

/// AR(1) with unit variance.
fn correlated(normal: &mut Normal, rho: f64, count: usize) -> Vec<f64> {
    let mut value = normal.next();
    let mut values = Vec::with_capacity(count);
    for _ in 0..count {
        values.push(value);
        value = rho * value + (1.0 - rho * rho).sqrt() * normal.next();
    }
    values
}

/// Share of runs whose interval over ten blocks of `taus` correlation times holds the true mean, 0.
fn coverage(taus: f64, runs: usize) -> f64 {
    let rho: f64 = 0.95;
    let tau = (1.0 + rho) / (1.0 - rho);
    let length = (taus * tau).round() as usize;
    let mut normal = Normal::new(7);
    let held = (0..runs)
        .filter(|_| {
            let values = correlated(&mut normal, rho, BLOCK_COUNT * length);
            let means: Vec<f64> = values
                .chunks(length)
                .map(|block| block.iter().sum::<f64>() / block.len() as f64)
                .collect();
            let interval = interval(&means).unwrap();
            interval.low <= 0.0 && 0.0 <= interval.high
        })
        .count();
    held as f64 / runs as f64
}

#[test]
fn the_interval_covers_what_it_says_once_blocks_are_long_enough() {
    // Measured for the design: 81 % at 0.5 τ, 88 % at 1 τ, 94 % at 2.6 τ, 95 % at 5 τ (400 runs). Three standard
    // errors of 1500 runs beside those of 400: 6 points at most.
    const TOLERANCE: f64 = 0.06;
    for (taus, expected) in [(0.5, 0.81), (1.0, 0.88), (2.6, 0.94), (5.0, 0.95)] {
        let covered = coverage(taus, 1500);
        println!("blocks of {taus} tau: {covered:.3}, expected {expected}, tolerance {TOLERANCE}");
        assert!((covered - expected).abs() < TOLERANCE);
    }
    assert!(coverage(BLOCK_TAUS, 1500) > 0.92);
}

#[test]
fn single_frames_pretend_to_know_too_much() {
    // The bite: 200 correlated frames taken as independent cover the truth in about a quarter of the runs.
    let mut normal = Normal::new(3);
    let held = (0..400)
        .filter(|_| {
            let values = correlated(&mut normal, 0.95, 200);
            let interval = interval(&values).unwrap();
            interval.low <= 0.0 && 0.0 <= interval.high
        })
        .count();
    assert!((0.15..0.40).contains(&(held as f64 / 400.0)), "{held}");
}

#[test]
fn the_correlation_time_is_found_from_thinned_frames() {
    let mut normal = Normal::new(11);
    let values = correlated(&mut normal, 0.9, 60_000);
    let thinned: Vec<f64> = values.iter().copied().step_by(4).collect();
    let tau = correlation_time(autocorrelation(&thinned), 4.0);
    assert!((tau / 19.0 - 1.0).abs() < 0.1, "{tau}");
    assert!(correlation_time(0.0, 1.0) < 1.1);
    assert_eq!(autocorrelation(&[1.0, 1.0, 1.0, 1.0]), 0.0);
}
