//! Sums over rows: nothing is lost, and their order does not depend on the number of threads.

use geometry::PanoramaSize;
use srm::{JointSettings, Problem, Rows};

use crate::scene::{report, row, scene};

#[test]
fn hc_f07_scattered_sums_lose_nothing() {
    const TOLERANCE: f64 = 1e-6;
    const COUNT: usize = 3_000_000;
    const ADDED: f32 = 1e-3;
    // All rows scatter into one texel.
    let mut rows = Rows::default();
    for _ in 0..COUNT {
        rows.push(row(0, 7, 1.0, f64::from(ADDED)));
    }
    let problem = Problem::new(rows, 1, PanoramaSize::from_height(4).unwrap()).unwrap();
    let expected = f64::from(ADDED) * COUNT as f64;
    let mut naive = 0.0_f32;
    for _ in 0..COUNT {
        naive += ADDED;
    }
    let naive_error = (f64::from(naive) / expected - 1.0).abs();
    assert!(naive_error > 1e-2, "naive f32 sum: off by {naive_error}");
    let weights = problem.first_weights();
    let sum_on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| problem.right_side(&weights))
    };
    let one = sum_on(1);
    let held = (one[1 + 7][0] / expected - 1.0).abs();
    report("F07", held, TOLERANCE);
    assert!(held <= TOLERANCE, "{held}");
    for threads in [2, 3, 8] {
        assert_eq!(one, sum_on(threads), "{threads} threads give other bits");
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let seen = scene(20, 16, 400, 30, 512, 0.01);
    let solver = Problem::new(seen.rows, 400, seen.panorama).unwrap();
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| solver.solve(&JointSettings::default()).unknowns)
    };
    let one = solve(1);
    assert_eq!(one, solve(2));
    assert_eq!(one, solve(5));
}
