//! Hard cases of the measures: rows L01 to L04, L08, L12, L13 (hard-cases.md).

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::*;
use crate::srgb;

const NEIGHBOURS: usize = 1000;

fn report(id: &str, worst: f64, tolerance: f64) {
    println!("{id}: worst error {worst:.3e}, tolerance {tolerance:.3e}");
    assert!(worst <= tolerance, "{id}: {worst} is above {tolerance}");
}

fn random_image(rng: &mut Pcg64, width: u32, height: u32) -> Image<[f32; 3]> {
    Image::from_fn(width, height, |_, _| {
        std::array::from_fn(|_| rng.random::<f32>())
    })
}

fn normal(rng: &mut Pcg64) -> f64 {
    // Irwin–Hall: the sum of twelve uniforms has variance 1.
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

#[test]
fn hc_l01_psnr_of_equal_images_is_capped_and_flagged() {
    let naive_psnr = |mse: f64| 10.0 * (1.0 / mse).log10();
    assert_eq!((naive_psnr(0.0) + naive_psnr(1e-3)) / 2.0, f64::INFINITY);

    let mut rng = Pcg64::seed_from_u64(1);
    let mut worst = 0.0_f64;
    let mut pooled = SquaredError::default();
    let mut rounding = SquaredError::default();
    for _ in 0..NEIGHBOURS {
        let image = random_image(&mut rng, 8, 6);
        let equal = psnr(&image, &image, None).unwrap().unwrap();
        assert_eq!(
            equal,
            Psnr {
                db: PSNR_CAP,
                capped: true
            }
        );
        let rounded = image.map(|pixel| pixel.map(|v| (v * 255.0).round() / 255.0));
        let error = squared_error(&rounded, &image, None).unwrap();
        rounding = rounding.and(error);
        pooled = pooled
            .and(squared_error(&image, &image, None).unwrap())
            .and(error);
        let own = error.psnr().unwrap();
        let mse = error.mse().unwrap();
        assert!(!own.capped);
        worst = worst.max((own.db - naive_psnr(mse)).abs());
    }
    report("L01 dB against the formula", worst, 1e-9);
    // 8-bit rounding: variance 1/(12·255²). Equal frames pooled in halve the error: 3.01 dB more.
    report(
        "L01 rounding, dB",
        (rounding.psnr().unwrap().db - 58.92).abs(),
        0.05,
    );
    let gain = pooled.psnr().unwrap().db - rounding.psnr().unwrap().db;
    report(
        "L01 pooling, dB",
        (gain - 2.0_f64.log10() * 10.0).abs(),
        1e-9,
    );
    assert_eq!(psnr_from_mse(0.0), PSNR_CAP);
    assert!(psnr_from_mse(f64::NAN).is_nan());
}

#[test]
fn hc_l02_correlation_with_a_constant_is_undefined() {
    // One pass in f32, E[x²] − E[x]².
    let naive_pearson = |pairs: &[(f64, f64, f64)]| {
        let n = pairs.len() as f32;
        let mean = |f: &dyn Fn(f32, f32) -> f32| {
            pairs
                .iter()
                .map(|&(a, b, _)| f(a as f32, b as f32))
                .sum::<f32>()
                / n
        };
        let (a, b) = (mean(&|a, _| a), mean(&|_, b| b));
        let (aa, bb) = (mean(&|a, _| a * a) - a * a, mean(&|_, b| b * b) - b * b);
        (mean(&|a, b| a * b) - a * b) / (aa * bb).sqrt()
    };
    let mut rng = Pcg64::seed_from_u64(2);
    let mut wrongly_defined = 0;
    let mut naive_defined = 0;
    let mut worst = 0.0_f64;
    for round in 0..=NEIGHBOURS {
        let constant = if round == 0 {
            0.3
        } else {
            2.0 * rng.random::<f64>()
        };
        let pairs: Vec<_> = (0..500)
            .map(|_| (constant, normal(&mut rng), 0.1 + rng.random::<f64>()))
            .collect();
        naive_defined += usize::from(naive_pearson(&pairs).is_finite());
        wrongly_defined += usize::from(weighted_pearson(&pairs).is_some());
        let swapped: Vec<_> = pairs.iter().map(|&(a, b, w)| (b, a, w)).collect();
        wrongly_defined += usize::from(weighted_pearson(&swapped).is_some());
        // A line has correlation ±1 whatever the weights, even on a large offset.
        let slope = if round % 2 == 0 { 2.5 } else { -0.01 };
        let line: Vec<_> = pairs
            .iter()
            .map(|&(_, b, w)| (1e3 + b, slope * b - 7.0, w))
            .collect();
        worst = worst.max((weighted_pearson(&line).unwrap() - f64::signum(slope)).abs());
    }
    assert!(
        naive_defined > 0,
        "the naive form gives a number in {naive_defined} of 1001 cases"
    );
    println!("L02: the naive form gives a number in {naive_defined} of 1001 cases");
    report(
        "L02 constants with a correlation",
        wrongly_defined as f64,
        0.0,
    );
    report("L02 lines", worst, 1e-9);
    assert_eq!(weighted_pearson(&[]), None);
    assert_eq!(weighted_pearson(&[(0.0, 1.0, 0.0), (1.0, 2.0, -1.0)]), None);
    assert_eq!(
        weighted_pearson(&[(0.0, 1.0, 1.0), (f64::NAN, 2.0, 1.0), (2.0, 0.0, 1.0)]),
        None
    );
    assert_eq!(
        weighted_pearson(&[(0.0, 1.0, 1.0), (1.0, 2.0, f64::INFINITY)]),
        None
    );
}

#[test]
fn weights_count_like_repetitions() {
    let weighted = [(0.1, 0.4, 3.0), (0.5, 0.2, 1.0), (0.9, 0.8, 2.0)];
    let repeated: Vec<_> = weighted
        .iter()
        .flat_map(|&(a, b, w)| std::iter::repeat_n((a, b, 1.0), w as usize))
        .collect();
    let difference = weighted_pearson(&weighted).unwrap() - weighted_pearson(&repeated).unwrap();
    assert!(difference.abs() < 1e-12);
    let difference = log_rmse(&weighted).unwrap() - log_rmse(&repeated).unwrap();
    assert!(difference.abs() < 1e-12);
}

/// Window by window, two passes, no separation.
fn reference_ssim(a: &Image<f64>, b: &Image<f64>, range: f64) -> f64 {
    let weight = |k: u32| (-0.5 * (f64::from(k) - 5.0).powi(2) / 2.25).exp();
    let total: f64 = (0..11)
        .flat_map(|j| (0..11).map(move |i| weight(i) * weight(j)))
        .sum();
    let (c1, c2) = ((0.01 * range).powi(2), (0.03 * range).powi(2));
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, y) in (0..=a.height() - 11).flat_map(|y| (0..=a.width() - 11).map(move |x| (x, y))) {
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            let taps = (0..11).flat_map(|j| (0..11).map(move |i| (i, j)));
            taps.map(|(i, j)| weight(i) * weight(j) * f(a.at(x + i, y + j), b.at(x + i, y + j)))
                .sum::<f64>()
                / total
        };
        let (ma, mb) = (mean(&|a, _| a), mean(&|_, b| b));
        let (va, vb) = (
            mean(&|a, _| (a - ma).powi(2)),
            mean(&|_, b| (b - mb).powi(2)),
        );
        let covariance = mean(&|a, b| (a - ma) * (b - mb));
        sum += (2.0 * ma * mb + c1) * (2.0 * covariance + c2)
            / ((ma * ma + mb * mb + c1) * (va + vb + c2));
        count += 1.0;
    }
    sum / count
}

/// The reference in f32 with E[x²] − E[x]².
fn naive_one_pass_ssim(a: &Image<f64>, b: &Image<f64>) -> f32 {
    let weight = |k: u32| (-0.5 * (k as f32 - 5.0).powi(2) / 2.25).exp();
    let total: f32 = (0..11)
        .flat_map(|j| (0..11).map(move |i| weight(i) * weight(j)))
        .sum();
    let (c1, c2) = (0.01_f32.powi(2), 0.03_f32.powi(2));
    let mut furthest = 0.0_f32;
    for (x, y) in (0..=a.height() - 11).flat_map(|y| (0..=a.width() - 11).map(move |x| (x, y))) {
        let mean = |f: &dyn Fn(f32, f32) -> f32| {
            let taps = (0..11).flat_map(|j| (0..11).map(move |i| (i, j)));
            taps.map(|(i, j)| {
                weight(i) * weight(j) * f(a.at(x + i, y + j) as f32, b.at(x + i, y + j) as f32)
            })
            .sum::<f32>()
                / total
        };
        let (ma, mb) = (mean(&|a, _| a), mean(&|_, b| b));
        let (va, vb) = (mean(&|a, _| a * a) - ma * ma, mean(&|_, b| b * b) - mb * mb);
        let covariance = mean(&|a, b| a * b) - ma * mb;
        let value = (2.0 * ma * mb + c1) * (2.0 * covariance + c2)
            / ((ma * ma + mb * mb + c1) * (va + vb + c2));
        if value.abs() > furthest.abs() {
            furthest = value;
        }
    }
    furthest
}

#[test]
fn hc_l03_ssim_constants_follow_the_range_and_windows_do_not_cancel() {
    let mut rng = Pcg64::seed_from_u64(3);
    // Bite 1: constants for 0…255 on values in [0, 1] hide noise of 0.05.
    let flat = Image::from_fn(24, 24, |x, y| {
        0.5 + 0.2 * (f64::from(x) / 7.0).sin() * (f64::from(y) / 5.0).cos()
    });
    let noisy = flat.map(|v| v + 0.05 * normal(&mut rng));
    let with_wrong_range = reference_ssim(&noisy, &flat, 255.0);
    let right = reference_ssim(&noisy, &flat, 1.0);
    assert!(
        with_wrong_range > 0.9999 && right < 0.99,
        "{with_wrong_range} {right}"
    );
    // Bite 2: one pass in f32 on an offset of 1000 leaves [−1, 1].
    let (far, far_noisy) = (flat.map(|v| v + 1000.0), noisy.map(|v| v + 1000.0));
    let naive = naive_one_pass_ssim(&far_noisy, &far);
    assert!(naive.abs() > 1.0, "naive SSIM {naive}");

    let mut worst = 0.0_f64;
    for round in 0..=NEIGHBOURS {
        let (a, b) = if round == 0 {
            (far_noisy.clone(), far.clone())
        } else {
            let offset = if round % 2 == 0 {
                0.0
            } else {
                2000.0 * rng.random::<f64>()
            };
            let sigma = 0.3 * rng.random::<f64>();
            let truth = Image::from_fn(14, 13, |_, _| offset + rng.random::<f64>());
            (truth.map(|v| v + sigma * normal(&mut rng)), truth)
        };
        let value = luma_ssim(&a, &b, None, 1.0).unwrap().unwrap();
        assert!((-1.0..=1.0).contains(&value));
        worst = worst.max((value - reference_ssim(&a, &b, 1.0)).abs());
    }
    report("L03 parity with the f64 reference", worst, 1e-6);
    // Values on another scale are refused.
    let codes = Image::new(16, 16, [128.0; 3]);
    assert!(ssim(&codes, &codes, None).is_err());
    assert!(luma_ssim(&flat, &flat, None, f64::NAN).is_err());
}

#[test]
fn ssim_counts_windows_centred_in_the_mask_over_images_filled_with_truth() {
    let mut rng = Pcg64::seed_from_u64(31);
    let truth = random_image(&mut rng, 20, 18);
    let mut predicted = truth.clone();
    *predicted.at_mut(9, 9) = [0.0; 3];
    // Wrong everywhere outside the mask: must not count, nor reach into the windows of the mask.
    let mask = Image::from_fn(20, 18, |x, y| (7..12).contains(&x) && (7..12).contains(&y));
    let mut spoiled = predicted.clone();
    for (x, y) in (0..18).flat_map(|y| (0..20).map(move |x| (x, y))) {
        if !mask.at(x, y) {
            *spoiled.at_mut(x, y) = [f32::NAN; 3];
        }
    }
    let masked = ssim(&predicted, &truth, Some(&mask)).unwrap().unwrap();
    assert!(masked < 0.999);
    assert_eq!(ssim(&spoiled, &truth, Some(&mask)).unwrap(), Some(masked));
    assert_eq!(ssim(&truth, &truth, Some(&mask)).unwrap(), Some(1.0));
    // No window inside the image has its centre in this mask; in the last image no window fits at all.
    let border = Image::from_fn(20, 18, |x, _| x < 5);
    assert_eq!(ssim(&predicted, &truth, Some(&border)).unwrap(), None);
    let small = random_image(&mut rng, 10, 30);
    assert_eq!(ssim(&small, &small, None).unwrap(), None);
}

#[test]
fn hc_l04_log_error_of_black_is_finite_and_scale_free() {
    // Bite: ln 0, and an ε so small that noise in the dark outweighs a factor of two everywhere else.
    let naive_log = |x: f64, epsilon: f64| (x + epsilon).ln();
    assert_eq!(naive_log(0.0, 0.0), f64::NEG_INFINITY);
    assert!((naive_log(1e-12, 1e-12) - naive_log(1e-6, 1e-12)).abs() > 13.0);

    let mut rng = Pcg64::seed_from_u64(4);
    let samples: Vec<MapSample> = (0..200)
        .map(|_| MapSample {
            estimate: 0.0,
            truth: 2.0 * rng.random::<f64>(),
            weight: rng.random(),
        })
        .collect();
    let black = map_score(&samples).unwrap();
    assert!(black.log_rmse.is_finite() && black.scale.is_none() && black.corr.is_none());

    let mut worst = 0.0_f64;
    let mut worst_formula = 0.0_f64;
    for _ in 0..NEIGHBOURS {
        let samples: Vec<MapSample> = (0..60)
            .map(|_| {
                let truth = 3.0 * rng.random::<f64>().powi(4);
                let estimate = (truth + 0.1 * normal(&mut rng)).max(0.0);
                MapSample {
                    estimate,
                    truth,
                    weight: 0.01 + rng.random::<f64>(),
                }
            })
            .collect();
        let score = map_score(&samples).unwrap();
        let factor = 10.0_f64.powf(8.0 * rng.random::<f64>() - 4.0);
        let scaled: Vec<_> = samples
            .iter()
            .map(|s| MapSample {
                estimate: factor * s.estimate,
                ..*s
            })
            .collect();
        let other = map_score(&scaled).unwrap();
        worst = worst
            .max((score.log_rmse - other.log_rmse).abs())
            .max((score.corr.unwrap() - other.corr.unwrap()).abs())
            .max((score.log_corr.unwrap() - other.log_corr.unwrap()).abs());
        // The formula of the row, written out once more.
        let k = score.scale.unwrap();
        let (mut sum, mut total) = (0.0, 0.0);
        for s in &samples {
            let a = (k * s.estimate).clamp(0.0, 1.0).max(0.01).ln();
            let b = s.truth.clamp(0.0, 1.0).max(0.01).ln();
            sum += s.weight * (a - b).powi(2);
            total += s.weight;
        }
        worst_formula = worst_formula.max((score.log_rmse - (sum / total).sqrt()).abs());
    }
    report("L04 change by scaling", worst, 1e-9);
    report("L04 against the formula", worst_formula, 1e-12);
    assert_eq!(map_score(&[]), None);
    assert_eq!(
        map_score(&[MapSample {
            estimate: f64::NAN,
            truth: 0.5,
            weight: 1.0
        }]),
        None
    );
    assert_eq!(log_rmse(&[(f64::NAN, 0.5, 1.0)]), None);
}

#[test]
fn hc_l08_masked_means_count_the_mask_alone() {
    // 5x4 pixels, 4 of them (20 %) inside, each wrong by 0.1, 0.2, 0.3, 0.4 in every channel.
    let truth = Image::new(5, 4, [0.5_f32; 3]);
    let mut predicted = truth.clone();
    for x in 0..4 {
        *predicted.at_mut(x, 1) = [0.6 + 0.1 * x as f32; 3];
    }
    let inside = Image::from_fn(5, 4, |x, y| y == 1 && x < 4);
    let one = Image::from_fn(5, 4, |x, y| (x, y) == (2, 1));
    let two = Image::from_fn(5, 4, |x, y| y == 1 && x >= 3);
    let naive_whole_frame = l1(&predicted, &truth, None).unwrap().unwrap();
    assert!(
        (0.25 / naive_whole_frame - 5.0).abs() < 1e-5,
        "coverage of 20 % flatters five times"
    );
    let mut worst = 0.0_f64;
    for (mask, l1_by_hand, mse_by_hand) in
        [(&inside, 0.25, 0.075), (&one, 0.3, 0.09), (&two, 0.2, 0.08)]
    {
        worst =
            worst.max((l1(&predicted, &truth, Some(mask)).unwrap().unwrap() - l1_by_hand).abs());
        worst =
            worst.max((mse(&predicted, &truth, Some(mask)).unwrap().unwrap() - mse_by_hand).abs());
    }
    report("L08 by hand", worst, 1e-6);

    let mut rng = Pcg64::seed_from_u64(8);
    let mut worst = 0.0_f64;
    for _ in 0..NEIGHBOURS {
        let (a, b) = (random_image(&mut rng, 7, 5), random_image(&mut rng, 7, 5));
        let mask = Image::from_fn(7, 5, |_, _| rng.random::<f64>() < 0.2);
        let differences: Vec<f64> = (0..35)
            .filter(|&i| mask.pixels()[i])
            .flat_map(|i| (0..3).map(move |c| (i, c)))
            .map(|(i, c)| (f64::from(a.pixels()[i][c]) - f64::from(b.pixels()[i][c])).abs())
            .collect();
        match l1(&a, &b, Some(&mask)).unwrap() {
            None => assert!(differences.is_empty()),
            Some(value) => {
                let by_list = differences.iter().sum::<f64>() / differences.len() as f64;
                worst = worst.max((value - by_list).abs());
            }
        }
    }
    report("L08 against a list", worst, 1e-12);
    let nothing = Image::new(5, 4, false);
    assert_eq!(l1(&predicted, &truth, Some(&nothing)).unwrap(), None);
    assert_eq!(mse(&predicted, &truth, Some(&nothing)).unwrap(), None);
    assert_eq!(psnr(&predicted, &truth, Some(&nothing)).unwrap(), None);
    assert_eq!(ssim(&predicted, &truth, Some(&nothing)).unwrap(), None);
    // A NaN counts only where the mask does, and is never averaged silently.
    *predicted.at_mut(0, 0) = [f32::NAN; 3];
    assert!(l1(&predicted, &truth, Some(&inside)).is_ok());
    assert!(l1(&predicted, &truth, None).is_err());
    assert!(l1(&predicted, &Image::new(4, 5, [0.5; 3]), None).is_err());
}

#[test]
fn hc_l12_a_failure_keeps_its_place_in_the_table() {
    let table = [Some(0.1), Some(0.2), None, Some(0.4), Some(0.3)];
    // Bite: dropping the failure moves the median from 0.3 to 0.25 and the worst from "failed" to 0.4.
    let mut dropped: Vec<f64> = table.iter().copied().flatten().collect();
    let naive_median = geometry::robust::median(&mut dropped).unwrap();
    assert!((naive_median - 0.25).abs() < 1e-12);
    let errors = Summary::of(&table, Better::Lower);
    assert_eq!(
        (errors.count, errors.failed_count, errors.worst),
        (5, 1, None)
    );
    assert_eq!(errors.median, Some(0.3));
    assert!((errors.mean.unwrap() - 0.25).abs() < 1e-12);
    assert_eq!(Summary::of(&table, Better::Higher).median, Some(0.2));
    let complete = Summary::of(&[Some(3.0), Some(1.0), Some(2.0)], Better::Higher);
    assert_eq!(
        (complete.median, complete.worst, complete.failed_count),
        (Some(2.0), Some(1.0), 0)
    );
    // Values that are not numbers fail too; half of failures leave no median.
    let half = Summary::of(
        &[Some(f64::NAN), Some(1.0), Some(f64::INFINITY), Some(2.0)],
        Better::Lower,
    );
    assert_eq!((half.median, half.count, half.failed_count), (None, 4, 2));
    let nothing = Summary::of(&[], Better::Lower);
    assert_eq!(
        (nothing.median, nothing.mean, nothing.worst, nothing.count),
        (None, None, None, 0)
    );

    let mut rng = Pcg64::seed_from_u64(12);
    let mut wrong_count = 0;
    for _ in 0..NEIGHBOURS {
        let runs: Vec<Option<f64>> = (0..1 + (rng.random::<u32>() % 9))
            .map(|_| (rng.random::<f64>() < 0.7).then(|| rng.random::<f64>()))
            .collect();
        let summary = Summary::of(&runs, Better::Lower);
        wrong_count += usize::from(summary.count != runs.len());
        wrong_count +=
            usize::from(summary.failed_count != runs.iter().filter(|r| r.is_none()).count());
        // A failure ranks last: replacing it by a huge error changes no median that is stated.
        let huge: Vec<Option<f64>> = runs.iter().map(|r| r.or(Some(1e9))).collect();
        let stated = summary.median.unwrap_or(1e9);
        let with_huge = Summary::of(&huge, Better::Lower).median.unwrap();
        wrong_count += usize::from(stated != with_huge && with_huge < 1e8);
    }
    report("L12 tables with wrong counts", wrong_count as f64, 0.0);
}

#[test]
fn hc_l13_psnr_states_its_transfer() {
    // Linear 0.05 against 0.06: 40 dB. Encoded: 0.247801 and 0.271848 by the standard, 32.38 dB.
    let (truth, predicted) = (
        Image::new(4, 4, [0.05_f32; 3]),
        Image::new(4, 4, [0.06_f32; 3]),
    );
    let naive_on_linear = psnr(&predicted, &truth, None).unwrap().unwrap().db;
    let encode = |image: &Image<[f32; 3]>| image.map(|pixel| pixel.map(srgb::encode));
    let encoded = psnr(&encode(&predicted), &encode(&truth), None)
        .unwrap()
        .unwrap()
        .db;
    let by_hand = |linear: f64| 1.055 * linear.powf(1.0 / 2.4) - 0.055;
    let expected = -20.0 * (by_hand(0.06) - by_hand(0.05)).log10();
    assert!(
        (naive_on_linear - encoded).abs() > 5.0,
        "{naive_on_linear} and {encoded} dB"
    );
    report(
        "L13 linear by hand, dB",
        (naive_on_linear - 40.0).abs(),
        1e-4,
    );
    report("L13 encoded by hand, dB", (encoded - expected).abs(), 1e-4);

    let mut rng = Pcg64::seed_from_u64(13);
    let mut worst = 0.0_f64;
    for _ in 0..NEIGHBOURS {
        let codes = Image::from_fn(3, 2, |_, _| std::array::from_fn(|_| rng.random::<u8>()));
        let other = codes.map(|pixel: [u8; 3]| pixel.map(|code| code ^ 1));
        // Every code is off by one: MSE is 1/255² in encoded values.
        let (a, b) = (
            srgb::encoded_from_rgb8(&codes),
            srgb::encoded_from_rgb8(&other),
        );
        worst =
            worst.max((psnr(&a, &b, None).unwrap().unwrap().db - 20.0 * 255.0_f64.log10()).abs());
    }
    report("L13 one code off, dB", worst, 1e-4);
}
