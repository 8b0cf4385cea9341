//! What noise, clipping, bad conditions and people do to the solve.

use rand::RngExt as _;
use srm::weights::row_weights;
use srm::{JointSettings, Row, Rows, TexelFlags};

use crate::scene::{GAIN, generator, problem, report, row, scene, tight};

#[test]
fn hc_h07_a_rough_material_gives_its_blurred_room_and_not_its_inverse() {
    // A blurred ring of 64 directions seen with 1 % noise.
    const NOISE: f64 = 0.01;
    let mut rng = generator(7);
    let sharp: Vec<f64> = (0..64)
        .map(|i| if i % 16 < 3 { 1.0 } else { 0.1 })
        .collect();
    let kernel: Vec<f64> = (-20..=20)
        .map(|d| (-0.5 * (f64::from(d) / 5.0).powi(2)).exp())
        .collect();
    let total: f64 = kernel.iter().sum();
    let blurred: Vec<f64> = (0..64)
        .map(|i| {
            kernel
                .iter()
                .enumerate()
                .map(|(k, w)| w / total * sharp[(i + 64 + k - 20) % 64])
                .sum()
        })
        .collect();
    let panorama = geometry::PanoramaSize::from_height(32).unwrap();
    let mut rows = Rows::default();
    for _ in 0..8 {
        for (i, value) in blurred.iter().enumerate() {
            let noise = NOISE * (rng.random::<f64>() - 0.5) * 3.4;
            // A black point reflects the equator.
            rows.push(row(0, (16 * 64 + i) as u32, 1.0, value + noise));
        }
    }
    // A second, diffuse-only row pins D at zero.
    for _ in 0..200 {
        rows.push(row(0, 0, 0.0, 0.0));
    }
    let solved = problem(rows, 1, panorama).solve(&tight(0.5));
    let ours: Vec<f64> = (0..64)
        .map(|i| f64::from(solved.specular[16 * 64 + i][0]))
        .collect();
    let error = ours
        .iter()
        .zip(&blurred)
        .map(|(a, b)| (a - b).abs())
        .sum::<f64>()
        / 64.0;
    // Naive: undo the blur by repeated correction until it fits the noise.
    let noisy: Vec<f64> = blurred
        .iter()
        .map(|b| b + NOISE * (rng.random::<f64>() - 0.5) * 3.4)
        .collect();
    let mut naive = noisy.clone();
    for _ in 0..20_000 {
        let again: Vec<f64> = (0..64)
            .map(|i| {
                kernel
                    .iter()
                    .enumerate()
                    .map(|(k, w)| w / total * naive[(i + 64 + k - 20) % 64])
                    .sum::<f64>()
            })
            .collect();
        for i in 0..64 {
            naive[i] += noisy[i] - again[i];
        }
    }
    assert!(
        naive.iter().copied().fold(f64::INFINITY, f64::min) < -0.05,
        "naive: rings below zero"
    );
    assert!(ours.iter().all(|v| *v >= 0.0));
    report("H07", error, 1.5 * NOISE);
    assert!(error <= 1.5 * NOISE, "{error}");
}

#[test]
fn hc_h08_conjugate_gradients_reach_the_answer_of_a_bad_condition() {
    const TOLERANCE: f64 = 1e-5;
    let panorama = geometry::PanoramaSize::from_height(16).unwrap();
    let mut rng = generator(8);
    let mut rows = Rows::default();
    let mut expected = Vec::new();
    for i in 0..400_u32 {
        let (d, s) = (
            0.2 + 0.3 * rng.random::<f64>(),
            0.3 + 0.4 * rng.random::<f64>(),
        );
        // Two views whose taps differ by 0.3 %: the condition is about 1e6.
        let pair = [0.3_f32, 0.301].map(|tap| row(i, i, tap, d + f64::from(tap) * s));
        let [a, b] = pair.map(|r| (f64::from(r.taps[0]), f64::from(r.observed[0])));
        let s_exact = (b.1 - a.1) / (b.0 - a.0);
        expected.push((a.1 - a.0 * s_exact, s_exact, a, b));
        for one in pair {
            rows.push(one);
        }
    }
    let mut settings = tight(1e-13);
    settings.smoothness = 0.0;
    settings.specular_to_zero = 1e-13;
    settings.rounds = 1;
    let solved = problem(rows, 400, panorama).solve(&settings);
    let mut worst: f64 = 0.0;
    let mut naive_worst: f64 = 0.0;
    for (i, (d, s, a, b)) in expected.iter().enumerate() {
        worst = worst
            .max((solved.unknowns[i][0] - d).abs())
            .max((solved.unknowns[400 + i][0] - s).abs());
        naive_worst = naive_worst.max((f64::from(naive_normal_equations(*a, *b)) - s).abs());
    }
    let (reported, recursive) = (
        solved.report.relative_residual,
        solved.report.recursive_residual,
    );
    assert!(
        naive_worst > 100.0 * TOLERANCE,
        "naive f32 normal equations: {naive_worst}"
    );
    report("H08", worst, TOLERANCE);
    assert!(worst <= TOLERANCE, "{worst}");
    assert!(
        reported < 1e-9 && recursive < 1e-9,
        "{reported} {recursive}"
    );
}

/// S of two rows by f32 normal equations.
fn naive_normal_equations(a: (f64, f64), b: (f64, f64)) -> f32 {
    let (a0, y0, a1, y1) = (a.0 as f32, a.1 as f32, b.0 as f32, b.1 as f32);
    let (h00, h01, h11) = (2.0_f32, a0 + a1, a0 * a0 + a1 * a1);
    let (g0, g1) = (y0 + y1, a0 * y0 + a1 * y1);
    (h00 * g1 - h01 * g0) / (h00 * h11 - h01 * h01)
}

#[test]
fn hc_h09_the_bounded_answer_meets_its_optimality_conditions() {
    const TOLERANCE: f64 = 1e-4;
    // Dark room, noisy rows: many texels want to be negative.
    let mut seen = scene(9, 8, 60, 24, 128, 0.0);
    let mut rng = generator(99);
    seen.rows = seen
        .rows
        .iter()
        .map(|r| {
            let dark = r.texels[0] % 3 != 0;
            let base = seen.diffuse[r.vertices[0] as usize]
                + if dark {
                    0.0
                } else {
                    f64::from(GAIN) * seen.specular[r.texels[0] as usize]
                };
            let noise = 0.1 * (rng.random::<f64>() - 0.5);
            Row {
                observed: [(base + noise) as f32; 3],
                ..*r
            }
        })
        .collect();
    let mut settings = tight(0.05);
    settings.smoothness = 1e-3;
    settings.rounds = 1;
    let solver = problem(seen.rows, 60, seen.panorama);
    let weights = solver.first_weights();
    let violation = |x: &[[f64; 3]]| {
        let gradient = solver.apply(&weights, &settings.regularisation(), x);
        let right = solver.right_side(&weights);
        let diagonal = solver.information(&weights);
        let mut worst: f64 = 0.0;
        for i in 0..x.len() {
            let g = (gradient[i][0] - right[i][0]) / (diagonal[i][0] + 0.05);
            worst = worst.max(if x[i][0] > 0.0 {
                g.abs()
            } else {
                (-g).max(0.0)
            });
        }
        worst
    };
    let solved = solver.solve(&settings);
    assert!(
        solved.specular.iter().filter(|v| v[0] == 0.0).count() > 10,
        "bounds are at work"
    );
    // Naive: the unbounded answer, clamped at the end.
    let held = vec![false; solver.unknown_count()];
    let quadratic = srm::solver::Quadratic {
        problem: &solver,
        weights: &weights,
        regularisation: settings.regularisation(),
        right_side: solver.right_side(&weights),
        held: &held,
    };
    let mut naive = vec![[0.0; 3]; solver.unknown_count()];
    quadratic.solve_unbounded(&mut naive, &settings.solver);
    for value in &mut naive {
        *value = value.map(|v| v.max(0.0));
    }
    let (held, failed) = (violation(&solved.unknowns), violation(&naive));
    assert!(failed > 10.0 * TOLERANCE, "naive clamp: {failed}");
    report("H09", held, TOLERANCE);
    assert!(held <= TOLERANCE, "{held}");
}

#[test]
fn hc_h10_clipped_pixels_are_lower_bounds() {
    // Two lamps ten times the white level on the equator; each point sees them and the walls with
    // different taps. The second lamp is only ever seen clipped.
    const LAMP: usize = 4 * 16 + 3;
    const BOUND: usize = 4 * 16 + 11;
    let panorama = geometry::PanoramaSize::from_height(8).unwrap();
    let mut rng = generator(10);
    let truth: Vec<f64> = (0..128)
        .map(|i| if i == LAMP || i == BOUND { 10.0 } else { 0.3 })
        .collect();
    let mut rows = Rows::default();
    for view in 0..1000_u32 {
        for vertex in 0..20_u32 {
            let texel = rng.random_range(0..128_u32);
            let tap = if texel as usize == BOUND {
                0.3
            } else {
                0.03 + 0.15 * rng.random::<f32>()
            };
            let value = 0.05 + f64::from(tap) * truth[texel as usize];
            let mut row = row(vertex, texel, tap, value.min(1.0));
            row.clipped = if value >= 1.0 { 0b111 } else { 0 };
            row.frame = view;
            rows.push(row);
        }
    }
    let clipped: Rows = rows.iter().copied().collect();
    let settings = JointSettings {
        rounds: 12,
        ..tight(1e-3)
    };
    let solver = problem(rows, 20, panorama);
    let solved = solver.solve(&settings);
    // Naive: the clipped code is taken for the value.
    let equal: Rows = clipped.iter().map(|r| Row { clipped: 0, ..*r }).collect();
    let naive = problem(equal, 20, panorama).solve(&settings);
    let (lamp, dimmed) = (
        f64::from(solved.specular[LAMP][0]),
        f64::from(naive.specular[LAMP][0]),
    );
    assert!(
        (dimmed - 10.0).abs() > 2.0,
        "naive: the lamp dims to {dimmed}"
    );
    assert!((lamp - 10.0).abs() <= 0.5, "{lamp}");
    let bound = f64::from(solved.specular[BOUND][0]);
    assert!(bound >= 0.95 / 0.3 - 0.5, "a lower bound is met: {bound}");
    let worst = (0..128)
        .filter(|&i| i != LAMP && i != BOUND)
        .map(|i| (f64::from(solved.specular[i][0]) / 0.3 - 1.0).abs())
        .fold(0.0, f64::max);
    report("H10", worst, 0.02);
    assert!(worst <= 0.02, "{worst}");
    let confidence = solver.confidence(&solved, settings.smoothness, 0.01, true);
    assert!(
        confidence.flags[BOUND].has(TexelFlags::SATURATED)
            && !confidence.flags[5].has(TexelFlags::SATURATED)
    );
}

#[test]
fn hc_h11_no_row_outweighs_the_others_a_hundred_times() {
    let mut rng = generator(11);
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    let (mut naive_least, mut naive_most) = (f64::INFINITY, 0.0_f64);
    for _ in 0..20_000 {
        let residual = if rng.random::<f64>() < 0.3 {
            0.0
        } else {
            2.0 * (rng.random::<f64>() - 0.5)
        };
        let weight = f64::from(row_weights(&row(0, 0, GAIN, residual), [0.0; 3], 0.03)[0]);
        (least, most) = (least.min(weight), most.max(weight));
        let naive = 1.0 / residual.abs().max(1e-8);
        (naive_least, naive_most) = (naive_least.min(naive), naive_most.max(naive));
    }
    assert!(naive_most / naive_least > 1e6, "naive L1 weights");
    report("H11", most / least, 100.0);
    assert!(most / least <= 100.0);
}

#[test]
fn hc_h12_the_predicted_bar_is_the_one_that_normal_noise_leaves() {
    let mut rng = generator(12);
    for degrees in [0.25_f64, 0.5, 1.0, 2.0] {
        let sigma = degrees.to_radians();
        let predicted = srm::resolution::finest_bar(sigma);
        // Reflections err by twice the normal: average a wave over that error and find where 0.1 is left.
        let errors: Vec<f64> = (0..20_000)
            .map(|_| {
                let gauss: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                2.0 * sigma * gauss
            })
            .collect();
        let modulation = |bar: f64| {
            let wave = std::f64::consts::PI / bar;
            errors.iter().map(|e| (wave * e).cos()).sum::<f64>() / errors.len() as f64
        };
        let mut measured = predicted * 0.2;
        while modulation(measured) < 0.1 {
            measured *= 1.02;
        }
        // Naive: the normal's own error, as if a mirror did not double it.
        let naive = srm::resolution::finest_bar(0.5 * sigma);
        assert!(measured / naive > 1.5, "naive");
        report("H12", (measured / predicted).max(predicted / measured), 1.5);
        assert!(
            (measured / predicted).max(predicted / measured) < 1.5,
            "{measured} {predicted}"
        );
    }
}

#[test]
fn hc_h14_a_person_who_walks_along_leaves_no_bias_outside_the_trail() {
    // In 5 % of the rows a dark person stands before the room.
    let seen = scene(14, 8, 60, 60, 128, 0.005);
    let mut rng = generator(140);
    let mut trail = vec![0_usize; 128];
    let rows: Rows = seen
        .rows
        .iter()
        .map(|r| {
            let texel = r.texels[0] as usize;
            let mut r = *r;
            if rng.random::<f64>() < 0.05 {
                trail[texel] += 1;
                r.observed = [seen.diffuse[r.vertices[0] as usize] as f32; 3];
            }
            r
        })
        .collect();
    let bias = |settings: &JointSettings| {
        let solved = problem(rows.clone(), 60, seen.panorama).solve(settings);
        let sum: f64 = (0..128)
            .map(|i| f64::from(solved.specular[i][0]) - seen.specular[i])
            .sum();
        (sum / seen.specular.iter().sum::<f64>()).abs()
    };
    // What remains without a person is the prior's own, not the trail's.
    let mut robust = tight(1e-3);
    robust.specular_to_zero = 1e-5;
    robust.rounds = 8;
    let mut naive = robust.clone();
    naive.rounds = 1;
    let (held, failed) = (bias(&robust), bias(&naive));
    report("H14", held, 0.03);
    assert!(failed > 0.03, "naive least squares: {failed}");
    assert!(held <= 0.03, "{held}");
}
