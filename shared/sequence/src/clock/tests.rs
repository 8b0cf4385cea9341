use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::*;

const NEIGHBOURS: u64 = 1000;
const SECOND: i64 = 1_000_000_000;
const FRAME_TICKS: i128 = 2_000_003;
const TICK_HZ: u64 = 60_000_000;

/// One stamp: ticks since the first, and the arrival on the host, nanoseconds.
type Arrival = (i128, i64);

fn truth(tick_hz: u64, ticks: i128) -> i64 {
    (ticks * 1_000_000_000).div_euclid(i128::from(tick_hz)) as i64
}

fn raw(ticks: i128, first_raw: i128, bits: u32) -> u64 {
    (first_raw + ticks).rem_euclid(1 << bits) as u64
}

/// Every stamp not later than the one before is a wrap (`XnDataProcessor.cpp` without its check).
fn naive_wraps_when_lower(raws: &[u64]) -> Vec<i64> {
    let (mut high, mut last) = (0, None);
    let first = raws.first().copied().unwrap_or(0);
    let nanos = raws.iter().map(|&raw| {
        if last.is_some_and(|last| raw <= last) {
            high += 1_i128 << 32;
        }
        last = Some(raw);
        truth(TICK_HZ, high + i128::from(raw) - i128::from(first))
    });
    nanos.collect()
}

/// Signed differences, without the host.
fn naive_signed_difference(raws: &[u64]) -> Vec<i64> {
    let (mut ticks, mut last) = (0, raws.first().map_or(0, |&raw| raw as u32));
    let nanos = raws.iter().map(|&raw| {
        ticks += i128::from((raw as u32).wrapping_sub(last) as i32);
        last = raw as u32;
        truth(TICK_HZ, ticks)
    });
    nanos.collect()
}

/// Greatest error in nanoseconds of the shipped form; in-order stamps never fall.
fn worst_error(tick_hz: u64, bits: u32, first_raw: i128, arrivals: &[Arrival]) -> u64 {
    let mut unwrapper = TickUnwrapper::new(tick_hz, bits).unwrap();
    let (mut worst, mut latest) = (0, i64::MIN);
    for &(ticks, host_nanos) in arrivals {
        let time = unwrapper.unwrap(raw(ticks, first_raw, bits), host_nanos);
        assert!(!time.from_host, "{ticks}");
        assert_eq!(time.out_of_order, time.nanos < latest, "{ticks}");
        latest = latest.max(time.nanos);
        worst = worst.max(time.nanos.abs_diff(truth(tick_hz, ticks)));
    }
    worst
}

fn worst_of(nanos: &[i64], arrivals: &[Arrival]) -> u64 {
    let errors = nanos
        .iter()
        .zip(arrivals)
        .map(|(nanos, (ticks, _))| nanos.abs_diff(truth(TICK_HZ, *ticks)));
    errors.max().unwrap_or(0)
}

/// 200 frames at 30 Hz, 3 s before the counter wraps, with a gap after the tenth.
fn frames_with_gap(gap_seconds: i128) -> Vec<Arrival> {
    let frame = |index: i128| {
        let gap = if index > 10 { gap_seconds } else { 0 };
        let ticks = index * FRAME_TICKS + gap * i128::from(TICK_HZ);
        (ticks, truth(TICK_HZ, ticks) + 2_000_000)
    };
    (0..200).map(frame).collect()
}

/// A stream of any counter with repeats, swaps, drops and gaps, late by up to 50 ms on a host that drifts.
fn any_arrivals(random: &mut Pcg64Mcg, tick_hz: u64) -> Vec<Arrival> {
    let hz = tick_hz as f64;
    let mut ticks: Vec<i128> = vec![0];
    for _ in 0..150 {
        let last = ticks[ticks.len() - 1];
        let seconds = match random.random_range(0..100) {
            0..3 => random.random_range(0.1..250.0),
            3..8 => 0.0,
            _ => random.random_range(0.030..0.070),
        };
        ticks.push(last + (seconds * hz) as i128);
    }
    for index in 1..ticks.len() {
        let is_near = ticks[index] - ticks[index - 1] < i128::from(tick_hz);
        if is_near && index > 1 && random.random_bool(0.05) {
            ticks.swap(index - 1, index);
        }
    }
    let drift = random.random_range(-200e-6..200e-6);
    let mut host_nanos = 0;
    let base = random.random_range(0..1_i64 << 50);
    let arrival = |ticks: i128| {
        let sent = truth(tick_hz, ticks) as f64 * (1.0 + drift);
        let arrived = base + sent as i64 + random.random_range(0..50_000_000);
        host_nanos = arrived.max(host_nanos);
        (ticks, host_nanos)
    };
    ticks.into_iter().map(arrival).collect()
}

#[test]
fn hc_b08_wraps_repeats_swaps_and_gaps_are_told_apart() {
    const TOLERANCE: u64 = 0;
    const JUMP: u64 = 71 * SECOND as u64;
    let first_raw = (1 << 32) - 3 * i128::from(TICK_HZ);
    let mut repeated = frames_with_gap(0);
    repeated.insert(21, (repeated[20].0, repeated[20].1 + 1_000_000));
    let mut swapped = frames_with_gap(0);
    let (a, b) = (swapped[20], swapped[21]);
    (swapped[20], swapped[21]) = ((b.0, a.1), (a.0, b.1));
    let listed = [
        ("wrap", frames_with_gap(0), false, false),
        ("repeat", repeated, true, false),
        ("swap", swapped, true, false),
        ("gap of 30 s", frames_with_gap(30), false, false),
        ("gap of 60 s", frames_with_gap(60), false, true),
        ("gap of 200 s", frames_with_gap(200), true, true),
    ];
    let mut worst = 0;
    for (name, arrivals, lower_jumps, signed_jumps) in &listed {
        let stamps = arrivals.iter().map(|&(ticks, _)| raw(ticks, first_raw, 32));
        let raws: Vec<u64> = stamps.collect();
        let lower = worst_of(&naive_wraps_when_lower(&raws), arrivals);
        let signed = worst_of(&naive_signed_difference(&raws), arrivals);
        println!("B08, {name}: naive forms err by {lower} and {signed} ns");
        assert_eq!(lower >= JUMP, *lower_jumps, "{name}: {lower}");
        assert_eq!(signed >= JUMP, *signed_jumps, "{name}: {signed}");
        worst = worst.max(worst_error(TICK_HZ, 32, first_raw, arrivals));
    }
    for seed in 0..NEIGHBOURS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let counters = [
            (TICK_HZ, 32),
            (1_000_000, 32),
            (1_000_000, 64),
            (TICK_HZ, 64),
            (90_000, 32),
            (1_000_000, 25),
        ];
        let (tick_hz, bits) = counters[random.random_range(0..counters.len())];
        let first_raw = random.random_range(0..1_i128 << bits);
        let arrivals = any_arrivals(&mut random, tick_hz);
        worst = worst.max(worst_error(tick_hz, bits, first_raw, &arrivals));
    }
    println!("B08, worst error {worst} ns, tolerance {TOLERANCE} ns");
    assert_eq!(worst, TOLERANCE);
}

#[test]
fn hc_b08_a_hundred_hours_do_not_drift() {
    const TOLERANCE: u64 = 0;
    let frame_count = 100 * 3600 * 30;
    let mut unwrapper = TickUnwrapper::new(TICK_HZ, 32).unwrap();
    let (mut worst, mut latest, mut naive) = (0, -1, 0);
    for index in 0..frame_count {
        let ticks = i128::from(index) * FRAME_TICKS;
        let expected = truth(TICK_HZ, ticks);
        let delay = index * 7919 % 30_000_000;
        let time = unwrapper.unwrap(raw(ticks, 12_345, 32), expected + delay);
        assert!(time.nanos > latest && !time.out_of_order && !time.from_host);
        latest = time.nanos;
        worst = worst.max(time.nanos.abs_diff(expected));
        if index > 0 {
            naive += truth(TICK_HZ, FRAME_TICKS);
        }
    }
    let naive_error = naive.abs_diff(latest);
    println!("B08, 100 h: naive {naive_error} ns, worst {worst} ns, tolerance {TOLERANCE} ns");
    assert!(naive_error > 1_000_000, "each step rounded must drift");
    assert_eq!(worst, TOLERANCE);
}

#[test]
fn a_damaged_stamp_costs_its_own_time_only() {
    let mut unwrapper = TickUnwrapper::new(TICK_HZ, 32).unwrap();
    for (index, (ticks, host_nanos)) in frames_with_gap(0).into_iter().enumerate() {
        let stamp = raw(ticks, 0, 32) ^ if index == 50 { 1 << 30 } else { 0 };
        let time = unwrapper.unwrap(stamp, host_nanos);
        assert_eq!(time.from_host, index == 50);
        let error = time.nanos.abs_diff(truth(TICK_HZ, ticks));
        assert!(error <= if index == 50 { 2_000_000 } else { 0 }, "{error}");
    }
}

#[test]
fn a_counter_that_restarts_goes_on_by_the_host() {
    for bits in [32, 64] {
        let mut unwrapper = TickUnwrapper::new(TICK_HZ, bits).unwrap();
        let frames = frames_with_gap(0);
        let restart = frames[100].0;
        let mut latest = -1;
        for (index, &(ticks, host_nanos)) in frames.iter().enumerate() {
            let since = ticks - if index >= 100 { restart } else { -(3 << 30) };
            let time = unwrapper.unwrap(raw(since, 0, bits), host_nanos);
            assert_eq!(time.from_host, index == 100);
            assert!(time.nanos > latest);
            latest = time.nanos;
            let error = time.nanos.abs_diff(truth(TICK_HZ, ticks));
            assert!(error <= 2_000_001, "{error}");
        }
    }
}

#[test]
fn counters_of_no_width_or_rate_are_refused() {
    for (tick_hz, bits) in [(0, 32), (1, 7), (1, 65), (1_000_000_000_001, 32)] {
        assert!(TickUnwrapper::new(tick_hz, bits).is_none());
    }
}

#[test]
fn no_number_makes_a_clock_panic() {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let extremes = [i64::MIN, i64::MIN + 1, -1, 0, 1, i64::MAX - 1, i64::MAX];
    let mut any = |shift| {
        if random.random_bool(0.3) {
            extremes[random.random_range(0..extremes.len())]
        } else {
            random.random::<i64>() >> shift
        }
    };
    for (tick_hz, bits) in [(1, 8), (1_000_000_000_000, 64), (TICK_HZ, 32), (1, 64)] {
        let mut unwrapper = TickUnwrapper::new(tick_hz, bits).unwrap();
        let mut fit = ClockFit::default();
        for index in 0..20_000 {
            let (stamp, host_nanos) = (any(index % 64), any(index % 64));
            let device_nanos = unwrapper.unwrap(stamp as u64, host_nanos).nanos;
            for device_nanos in [device_nanos, stamp] {
                fit.observe(device_nanos, host_nanos);
                let line = fit.fit().unwrap();
                assert!((line.rate - 1.0).abs() < 201e-6);
                let _ = line.host_from_device(any(0));
            }
        }
    }
}

/// Arrivals of 60 s at 30 Hz with delays of 3 ms on average, exponential.
fn delayed(random: &mut Pcg64Mcg, ppm: f64, start: i64, offset: i64) -> Vec<(i64, i64)> {
    let arrival = |index: i64| {
        let passed = index * SECOND / 30;
        let delay = -3e6 * (1.0 - random.random::<f64>()).ln();
        let drift = passed as f64 * ppm * 1e-6;
        (start + passed, offset + passed + (drift + delay) as i64)
    };
    (0..1801).map(arrival).collect()
}

/// Errors of the rate in ppm and of the host time of the last stamp in milliseconds.
fn fit_errors(line: &ClockLine, arrivals: &[(i64, i64)], ppm: f64) -> (f64, f64) {
    let (first, last) = (arrivals[0], arrivals[arrivals.len() - 1]);
    let passed = last.0 - first.0;
    let expected = passed + (passed as f64 * ppm * 1e-6) as i64;
    // The host's offset is the caller's: delays begin at 0.
    let host_nanos = line.host_from_device(last.0) - OFFSET;
    (
        ((line.rate - 1.0) * 1e6 - ppm).abs(),
        (host_nanos - expected) as f64 * 1e-6,
    )
}

const OFFSET: i64 = 7_000_123_456_789;

fn naive_least_squares(arrivals: &[(i64, i64)]) -> ClockLine {
    let last = arrivals[arrivals.len() - 1];
    let points = arrivals.iter().map(|(device, host)| {
        let x = (device - last.0) as f64;
        (x, (host - last.1) as f64 - x)
    });
    let count = arrivals.len() as f64;
    let (mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0);
    for (x, y) in points {
        (sx, sy, sxx, sxy) = (sx + x, sy + y, sxx + x * x, sxy + x * y);
    }
    let slope = (sxy - sx * sy / count) / (sxx - sx * sx / count);
    ClockLine {
        rate: 1.0 + slope,
        device_origin_nanos: last.0,
        host_origin_nanos: last.1 + ((sy - slope * sx) / count) as i64,
    }
}

#[test]
fn hc_b09_the_line_lies_under_late_arrivals() {
    const RATE_TOLERANCE_PPM: f64 = 2.0;
    const OFFSET_TOLERANCE_MS: f64 = 0.3;
    let mut random = Pcg64Mcg::seed_from_u64(9);
    let listed = delayed(&mut random, 37.0, 5 * SECOND, OFFSET);
    let (rate, offset) = fit_errors(&naive_least_squares(&listed), &listed, 37.0);
    println!("B09, least squares: {rate:.2} ppm, {offset:.3} ms");
    assert!(offset > OFFSET_TOLERANCE_MS, "least squares must be late");
    let (mut worst_rate, mut worst_offset) = (0.0_f64, 0.0_f64);
    let mut check = |arrivals: &[(i64, i64)], ppm| {
        let mut fit = ClockFit::default();
        for &(device_nanos, host_nanos) in arrivals {
            fit.observe(device_nanos, host_nanos);
        }
        let (rate, offset) = fit_errors(&fit.fit().unwrap(), arrivals, ppm);
        worst_rate = worst_rate.max(rate);
        worst_offset = worst_offset.max(offset.abs());
    };
    check(&listed, 37.0);
    for _ in 0..NEIGHBOURS {
        let ppm = random.random_range(-190.0..190.0);
        let start = random.random_range(-1_i64 << 50..1 << 50);
        check(&delayed(&mut random, ppm, start, OFFSET), ppm);
    }
    println!(
        "B09, worst {worst_rate:.3} ppm, tolerance {RATE_TOLERANCE_PPM} ppm; \
         worst {worst_offset:.4} ms, tolerance {OFFSET_TOLERANCE_MS} ms"
    );
    assert!(worst_rate <= RATE_TOLERANCE_PPM);
    assert!(worst_offset <= OFFSET_TOLERANCE_MS);
}

#[test]
fn the_slope_keeps_to_what_a_quartz_can_do() {
    for (ppm, expected) in [(500.0, 200.0), (-500.0, -200.0), (150.0, 150.0)] {
        let mut fit = ClockFit::default();
        for index in 0..600 {
            let device_nanos = index * SECOND / 10;
            let drift = (device_nanos as f64 * ppm * 1e-6) as i64;
            fit.observe(device_nanos, device_nanos + drift);
            let line = fit.fit().unwrap();
            if index < 90 {
                assert_eq!(line.rate, 1.0, "too early for a rate");
            }
        }
        let line = fit.fit().unwrap();
        assert!((line.rate - 1.0 - expected * 1e-6).abs() < 1e-9);
    }
}

#[test]
fn a_fit_is_bounded_and_begins_anew_after_a_restart() {
    let mut fit = ClockFit::default();
    assert!(fit.fit().is_none());
    let before = fit.kept();
    for index in 0..200_000_i64 {
        let device_nanos = index * 1_700_000;
        fit.observe(device_nanos, device_nanos + OFFSET + index % 7 * 1_000_000);
        if index % 5000 == 0 {
            let _ = fit.fit();
        }
    }
    let (count, ..) = fit.kept();
    assert!((590..=601).contains(&count), "{count}");
    assert_eq!((before.1, before.2), (fit.kept().1, fit.kept().2));
    // A packet out of order says nothing, a device that restarted is another line.
    fit.observe(300 * SECOND, 0);
    assert_eq!(fit.kept().0, count);
    fit.observe(0, 400 * SECOND);
    assert_eq!(fit.kept().0, 1);
    let line = fit.fit().unwrap();
    assert_eq!(line.host_from_device(SECOND), 401 * SECOND);
}
