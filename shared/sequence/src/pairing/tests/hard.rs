//! The rows of hard-cases.md that are about pairs.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::*;

/// The n-th with the n-th.
fn naive_by_position(streams: &Streams) -> Vec<(usize, usize)> {
    let count = streams.depth.len().min(streams.color.len());
    (0..count).map(|index| (index, index)).collect()
}

/// The nearest of all, for each depth frame.
fn naive_nearest<T: Copy + PartialOrd + std::ops::Sub<Output = T>>(
    depth: &[T],
    color: &[T],
) -> Vec<(usize, usize)> {
    let mut nearest = 0;
    let apart = |a: T, b: T| if a > b { a - b } else { b - a };
    let pairs = depth.iter().enumerate().map(|(index, &nanos)| {
        while let [here, next, ..] = color[nearest..]
            && apart(next, nanos) <= apart(here, nanos)
        {
            nearest += 1;
        }
        (index, nearest)
    });
    pairs.collect()
}

/// One hour; colour is 4 ms late and its clock, where the truth still goes by exposures, 1 ppm slow.
fn dropped(is_depth_dropped: fn(i64) -> bool, is_color_dropped: fn(i64) -> bool) -> Streams {
    let time = |index: i64| index * PERIOD;
    Streams::together(
        HOUR / PERIOD,
        |index| (!is_depth_dropped(index)).then(|| time(index)),
        |index| {
            (!is_color_dropped(index)).then(|| time(index) + time(index) / 1_000_000 + 4_000_000)
        },
    )
}

/// One hour of two free clocks 20 ppm apart: they drift by two frames, so the truth is the one frame within
/// half a period.
fn drifting() -> Streams {
    let (depth_period, color_period) = (PERIOD, PERIOD + PERIOD / 50_000);
    let count = HOUR / PERIOD;
    let depth: Vec<i64> = (0..count).map(|index| index * depth_period).collect();
    let color: Vec<i64> = (0..count)
        .map(|index| index * color_period + 4_000_000)
        .collect();
    let true_pair = |index: usize| {
        let near = (depth[index] - 4_000_000).div_euclid(color_period).max(0) as usize;
        let mut candidates = (near.saturating_sub(1)..near + 3).filter(|&candidate| {
            let color_nanos = color.get(candidate);
            color_nanos.is_some_and(|nanos| nanos.abs_diff(depth[index]) <= HALF_PERIOD as u64)
        });
        candidates.next().map(|candidate| (index, candidate))
    };
    let true_pairs = (0..depth.len()).filter_map(true_pair).collect();
    Streams {
        depth,
        color,
        true_pairs,
    }
}

#[test]
fn hc_b12_lost_frames_and_drift_keep_pairs_true() {
    const TOLERANCE: usize = 0;
    let listed = [
        ("1 of 7", dropped(|_| false, |index| index % 7 == 3)),
        (
            "1 of 7 and of 11",
            dropped(|index| index % 11 == 4, |index| index % 7 == 3),
        ),
        (
            "burst of 5",
            dropped(|_| false, |index| (1000..1005).contains(&index)),
        ),
        ("20 ppm", drifting()),
    ];
    let mut worst = 0;
    for (name, streams) in &listed {
        let position = streams.wrong_count(&naive_by_position(streams));
        let nearest = streams.wrong_count(&naive_nearest(&streams.depth, &streams.color));
        println!("B12, {name}: naive forms make {position} and {nearest} errors");
        assert!(position > TOLERANCE && nearest > TOLERANCE, "{name}");
        worst = worst.max(streams.shipped_wrong_count());
    }
    for seed in 0..NEIGHBOURS {
        let streams = any_streams(&mut Pcg64Mcg::seed_from_u64(seed), 0);
        worst = worst.max(streams.shipped_wrong_count());
    }
    println!("B12, worst {worst} errors in pairs, tolerance {TOLERANCE}");
    assert_eq!(worst, TOLERANCE);
}

#[test]
fn hc_b11_times_of_a_hundred_hours_stay_exact() {
    const TOLERANCE: usize = 0;
    let seconds = |nanos: &[i64]| -> Vec<f32> {
        nanos
            .iter()
            .map(|&nanos| (nanos as f64 * 1e-9) as f32)
            .collect()
    };
    let start = 100 * HOUR;
    let time = |index: i64| Some(start + index * PERIOD);
    let listed = Streams::together(3000, time, |index| {
        time(index).map(|nanos| nanos + 8_000_000)
    });
    for [a, b] in listed.depth.array_windows() {
        assert_eq!(b - a, PERIOD);
    }
    let (depth, color) = (seconds(&listed.depth), seconds(&listed.color));
    let steps = depth.array_windows().map(|[a, b]| f64::from(b - a));
    let step_error = steps
        .map(|step| (step - PERIOD as f64 * 1e-9).abs())
        .fold(0.0, f64::max);
    let naive = listed.wrong_count(&naive_nearest(&depth, &color));
    println!("B11, f32 seconds: steps err by {step_error:.4} s, {naive} errors in pairs");
    assert!(
        step_error > 0.02 && naive > TOLERANCE,
        "f32 must lose frames"
    );
    let mut worst = listed.shipped_wrong_count();
    for seed in 0..NEIGHBOURS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let start = random.random_range(0..1 << 62);
        worst = worst.max(any_streams(&mut random, start).shipped_wrong_count());
    }
    println!("B11, worst {worst} errors in pairs, tolerance {TOLERANCE}");
    assert_eq!(worst, TOLERANCE);
}

fn shuffled(nanos: &[i64], random: &mut Pcg64Mcg) -> (Vec<i64>, Vec<usize>) {
    let mut order: Vec<usize> = (0..nanos.len()).collect();
    for last in (1..order.len()).rev() {
        order.swap(last, random.random_range(0..=last));
    }
    (order.iter().map(|&index| nanos[index]).collect(), order)
}

/// Both lists walked once, as they are.
fn naive_in_given_order(depth: &[i64], color: &[i64]) -> Vec<(usize, usize)> {
    let (mut pairs, mut i, mut j) = (Vec::new(), 0, 0);
    while i < depth.len() && j < color.len() {
        let gap = color[j] - depth[i];
        if gap.abs() <= HALF_PERIOD {
            pairs.push((i, j));
        }
        i += usize::from(gap >= -HALF_PERIOD);
        j += usize::from(gap <= HALF_PERIOD);
    }
    pairs
}

#[test]
fn hc_k15_shuffled_stamps_make_the_same_pairs() {
    const TOLERANCE: usize = 0;
    let (mut worst, mut least_naive) = (0, usize::MAX);
    for seed in 0..NEIGHBOURS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let streams = any_streams(&mut random, HOUR);
        let (depth, depth_order) = shuffled(&streams.depth, &mut random);
        let (color, color_order) = shuffled(&streams.color, &mut random);
        let back = |pairs: Vec<(usize, usize)>| {
            let pairs = pairs
                .into_iter()
                .map(|(i, j)| (depth_order[i], color_order[j]));
            pairs.collect::<Vec<_>>()
        };
        let pairs = back(positions(&pair_by_time(&depth, &color, HALF_PERIOD)));
        worst = worst.max(streams.wrong_count(&pairs));
        let mut naive = back(naive_in_given_order(&depth, &color));
        naive.sort_unstable();
        least_naive = least_naive.min(streams.wrong_count(&naive));
    }
    println!(
        "K15, {least_naive} errors at least without sorting, worst {worst}, tolerance {TOLERANCE}"
    );
    assert!(least_naive > TOLERANCE, "the naive form must lose pairs");
    assert_eq!(worst, TOLERANCE);
}
