//! What decides the split between D and S: coverage, offset, visibility, separate parts.

use rand::RngExt as _;
use srm::{JointSettings, Problem, Regularisation, Row, Rows};

use crate::scene::{GAIN, generator, problem, report, row, scene, tight};

#[test]
fn hc_h01_unseen_texels_stay_out_of_the_solve() {
    const TOLERANCE: f64 = 1e-6;
    let seen = scene(1, 8, 60, 30, 90, 0.0);
    let mut settings = tight(0.5);
    settings.rounds = 1;
    let solution = problem(seen.rows.clone(), 60, seen.panorama);
    let covered = solution.covered().to_vec();
    assert!(
        covered.iter().skip(90).all(|c| !c),
        "only the first 90 of 128 texels are ever seen"
    );
    // Naive: Jacobi scaling divides by the empty columns.
    let information = solution.information(&solution.first_weights());
    let naive_scale: Vec<f64> = information.iter().map(|i| 1.0 / i[0]).collect();
    assert!(naive_scale.iter().any(|s| s.is_infinite()), "naive: 1/0");
    let solved = solution.solve(&settings);
    assert!(solved.unknowns.iter().flatten().all(|v| v.is_finite()));
    // Without them: the normal equations of the covered unknowns only, by dense elimination.
    let expected = dense_reference(&solution, &settings.regularisation());
    let mut worst: f64 = 0.0;
    for (index, value) in solved.unknowns.iter().enumerate() {
        if index < 60 || covered[index - 60] {
            worst = worst.max((value[0] - expected[index]).abs());
        } else {
            assert_eq!(*value, [0.0; 3]);
        }
    }
    report("H01", worst, TOLERANCE);
    assert!(worst <= TOLERANCE, "{worst}");
}

/// Solves the unweighted normal equations on covered unknowns with the active set of the answer found by
/// repeated elimination; one channel, f64, no structure used.
fn dense_reference(problem: &Problem, regularisation: &Regularisation) -> Vec<f64> {
    let n = problem.unknown_count();
    let weights = problem.first_weights();
    let right = problem.right_side(&weights);
    let mut free: Vec<bool> = (0..n)
        .map(|i| i < problem.vertex_count() || problem.covered()[i - problem.vertex_count()])
        .collect();
    let columns: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let mut unit = vec![[0.0; 3]; n];
            unit[i] = [1.0; 3];
            problem
                .apply(&weights, regularisation, &unit)
                .iter()
                .map(|v| v[0])
                .collect()
        })
        .collect();
    let usable = free.clone();
    let mut x = vec![0.0; n];
    for _ in 0..60 {
        let chosen: Vec<usize> = (0..n).filter(|&i| free[i]).collect();
        let mut matrix: Vec<Vec<f64>> = chosen
            .iter()
            .map(|&i| {
                chosen
                    .iter()
                    .map(|&j| columns[j][i])
                    .chain([right[i][0]])
                    .collect()
            })
            .collect();
        let solved = eliminate(&mut matrix);
        x = vec![0.0; n];
        for (&i, value) in chosen.iter().zip(&solved) {
            x[i] = *value;
        }
        let mut changed = false;
        for i in 0..n {
            if free[i] && x[i] < 0.0 {
                free[i] = false;
                changed = true;
            } else if usable[i] && !free[i] {
                let gradient: f64 =
                    (0..n).map(|j| columns[j][i] * x[j].max(0.0)).sum::<f64>() - right[i][0];
                if gradient < -1e-10 && !changed {
                    free[i] = true;
                    changed = true;
                }
            }
        }
        if !changed {
            break;
        }
    }
    x.iter().map(|v| v.max(0.0)).collect()
}

fn eliminate(matrix: &mut [Vec<f64>]) -> Vec<f64> {
    let n = matrix.len();
    for column in 0..n {
        let best = (column..n)
            .max_by(|&a, &b| matrix[a][column].abs().total_cmp(&matrix[b][column].abs()))
            .unwrap();
        matrix.swap(column, best);
        let pivot = matrix[column].clone();
        for (r, row) in matrix.iter_mut().enumerate() {
            let factor = row[column] / pivot[column];
            if r != column && factor != 0.0 {
                for (value, known) in row.iter_mut().zip(&pivot).skip(column) {
                    *value -= factor * known;
                }
            }
        }
    }
    (0..n).map(|i| matrix[i][n] / matrix[i][i]).collect()
}

#[test]
fn hc_h02_the_offset_does_not_depend_on_the_start() {
    const TOLERANCE: f64 = 1e-3;
    let seen = scene(2, 8, 80, 40, 128, 0.002);
    let solver = problem(seen.rows.clone(), 80, seen.panorama);
    let shifted_start = |shift: f64| {
        let mut start = vec![[0.0; 3]; solver.unknown_count()];
        for (value, s) in start[80..].iter_mut().zip(&seen.specular) {
            *value = [s + shift; 3];
        }
        for (value, d) in start[..80].iter_mut().zip(&seen.diffuse) {
            *value = [d - f64::from(GAIN) * shift; 3];
        }
        start
    };
    let from = |settings: &JointSettings, shift: f64| -> Vec<f64> {
        solver
            .solve_from(settings, shifted_start(shift))
            .unknowns
            .iter()
            .map(|v| v[0])
            .collect()
    };
    let distance = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    };
    let settings = tight(0.5);
    let held = distance(&from(&settings, 0.0), &from(&settings, 0.2));
    // Naive: no gauge. A few steps of an unregularised descent stay wherever they started.
    let mut naive = tight(1e-9);
    naive.smoothness = 0.0;
    naive.specular_to_zero = 0.0;
    naive.solver.steps = 60;
    naive.solver.passes = 1;
    naive.rounds = 1;
    let mut positive = scene(2, 8, 80, 40, 128, 0.0);
    // Without black prints nothing bounds the offset.
    positive.rows = positive
        .rows
        .iter()
        .map(|r| Row {
            observed: r.observed.map(|v| v + 0.2),
            ..*r
        })
        .collect();
    let free = problem(positive.rows, 80, positive.panorama);
    let start = |shift: f64| {
        let mut start = shifted_start(shift);
        for value in &mut start[..80] {
            *value = value.map(|v| v + 0.2);
        }
        start
    };
    let solve = |shift: f64| -> Vec<f64> {
        free.solve_from(&naive, start(shift))
            .unknowns
            .iter()
            .map(|v| v[0])
            .collect()
    };
    let naive_distance = distance(&solve(0.0), &solve(0.2));
    assert!(naive_distance > 0.1, "naive: {naive_distance}");
    report("H02", held, TOLERANCE);
    assert!(held <= TOLERANCE, "{held}");
}

#[test]
fn hc_h02_a_floor_of_zero_is_a_worse_gauge_than_a_dark_texture() {
    // Light walls: S never falls below 0.2.
    let seen = scene(12, 8, 80, 40, 128, 0.002);
    let solved = problem(seen.rows.clone(), 80, seen.panorama).solve(&tight(0.5));
    let log_rmse = |values: &[f64]| {
        let sum: f64 = values
            .iter()
            .zip(&seen.specular)
            .map(|(s, t)| (s.clamp(0.01, 1.0).ln() - t.clamp(0.01, 1.0).ln()).powi(2))
            .sum();
        (sum / values.len() as f64).sqrt()
    };
    let ours: Vec<f64> = solved.specular.iter().map(|v| f64::from(v[0])).collect();
    let mut sorted = ours.clone();
    let floor = geometry::robust::quantile(&mut sorted, 0.01).unwrap();
    let naive: Vec<f64> = ours.iter().map(|s| (s - floor).max(0.0)).collect();
    let (held, failed) = (log_rmse(&ours), log_rmse(&naive));
    report("H02 gauge", held, 0.2);
    assert!(
        failed > 2.0 * held && held < 0.2,
        "ours {held}, zero floor {failed}"
    );
}

#[test]
fn hc_h03_a_few_wrong_visibilities_do_not_move_the_map() {
    let mean_shift = |settings: &JointSettings, share: f64, edge_weight: f32| {
        let seen = scene(3, 7, 300, 12, 98, 0.002);
        let mut rng = generator(33);
        let mut right = Rows::default();
        let mut wrong = Rows::default();
        for row in seen.rows.iter() {
            let blocked = rng.random::<f64>() < 0.01;
            let mut clean = *row;
            if blocked {
                // The mirrored ray meets black: only D is seen.
                let texel = clean.texels[0] as usize;
                clean.observed = clean
                    .observed
                    .map(|v| v - GAIN * seen.specular[texel] as f32);
                clean.taps = [0.0; 4];
                clean.weight = edge_weight;
            }
            let mut flipped = clean;
            if rng.random::<f64>() < share {
                flipped.taps = if blocked { row.taps } else { [0.0; 4] };
                flipped.weight = edge_weight;
            }
            right.push(clean);
            wrong.push(flipped);
        }
        let mean = |rows: Rows| {
            let solved = problem(rows, 300, seen.panorama).solve(settings);
            solved.specular.iter().map(|v| f64::from(v[0])).sum::<f64>() / 98.0
        };
        (mean(right) - mean(wrong)).abs()
    };
    // Naive: least squares, no gauge, all rows alike.
    let mut naive = tight(1e-6);
    naive.smoothness = 0.0;
    naive.specular_to_zero = 1e-9;
    naive.residual_scale = 1e6;
    naive.rounds = 1;
    let failed = mean_shift(&naive, 0.01, 1.0);
    let (few, many) = (
        mean_shift(&tight(0.5), 0.001, 0.25),
        mean_shift(&tight(0.5), 0.01, 0.25),
    );
    report("H03", many, 0.02);
    assert!(failed > 0.02, "naive: {failed}");
    assert!(few <= 0.005 && many <= 0.02, "{few} {many}");
}

#[test]
fn hc_h13_disjoint_mirrors_are_two_parts_with_offsets_of_their_own() {
    let panorama = geometry::PanoramaSize::from_height(8).unwrap();
    let mut rng = generator(13);
    let mut rows = Rows::default();
    for _ in 0..2000 {
        let side = rng.random_range(0..2_u32);
        let (vertex, texel) = (
            side * 10 + rng.random_range(0..10),
            side * 64 + rng.random_range(0..30),
        );
        // Both sides have one dark print each; the second room is lighter.
        let dark = if vertex % 10 == 0 { 0.0 } else { 0.2 };
        rows.push(row(
            vertex,
            texel,
            GAIN,
            dark + f64::from(GAIN) * (0.3 + 0.4 * f64::from(side)),
        ));
    }
    let solver = problem(rows, 20, panorama);
    let mut settings = tight(0.05);
    settings.specular_to_zero = 1e-6;
    let solved = solver.solve(&settings);
    assert_eq!(solver.component_count(), 2);
    let mean = |from: usize| {
        (from..from + 30)
            .map(|i| f64::from(solved.specular[i][0]))
            .sum::<f64>()
            / 30.0
    };
    let (first, second) = (mean(0), mean(64));
    let worst = (first - 0.3).abs().max((second - 0.7).abs());
    // Naive: one offset for both, that of the first mirror, taken from the whole.
    let naive = ((first + second) / 2.0 - 0.3_f64).abs();
    assert!(naive > 0.1);
    report("H13", worst, 0.05);
    assert!(worst <= 0.05, "{first} {second}");
}
