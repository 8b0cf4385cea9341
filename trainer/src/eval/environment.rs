//! The environment score, exactly as srm-feasibility section 1 and effects-and-tradeoffs C1 define it.

use std::path::Path;

use anyhow::Context as _;
use geometry::{DQuat, DVec2, PanoramaSize, robust, rotation};
use imaging::{Image, LinearImage, measures, read_channel_exr, read_confidence_exr, read_rgb_exr};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Rows of the grid that scores are taken on (128 x 64).
const GRID_HEIGHT: u32 = 64;
/// Rows that the truth is averaged to before the lobe is applied (256 x 128).
const LOBE_HEIGHT: u32 = 128;
/// Texels with truth in this range set the scale.
const SCALE_RANGE: std::ops::Range<f64> = 0.02..0.9;

/// One score: clipped correlation and logarithmic error at one common scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Weighted Pearson of the clipped luminances; 0 where undefined.
    pub corr: f64,
    /// Root mean square of the difference of natural logarithms.
    pub log_rmse: f64,
    /// Pearson of the logarithms.
    pub log_corr: f64,
    /// The scale that fits the map to the truth.
    pub scale: f64,
    /// Share of the reach's solid angle that was scored.
    pub coverage: f64,
}

/// The environment's figures.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EnvironmentMetrics {
    /// GGX width of the lobe that the truth was blurred with.
    pub truth_alpha: f64,
    /// Angle by which the map was turned into the axes of the poses `source`, degrees: the alignment of the
    /// trajectory it was trained from. Absent where it was trained from `source`, or the recording has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_rotation_deg: Option<f64>,
    /// Correlation over claimed texels, against the lobe.
    pub env_corr: f64,
    /// Logarithmic error over claimed texels.
    pub env_log_rmse: f64,
    /// Share of the reach that is claimed.
    pub coverage: f64,
    /// Share of the upper hemisphere that is claimed.
    pub coverage_hemisphere: f64,
    /// Correlation over the whole reach.
    pub env_corr_reach: f64,
    /// Logarithmic error over the whole reach.
    pub env_log_rmse_reach: f64,
    /// Scale over the whole reach.
    pub scale_reach: f64,
    /// Correlation a channel over the whole reach, one scale a channel.
    pub env_corr_rgb: [f64; 3],
    /// Against the truth without blur, whole reach, for information.
    pub sharp: Score,
    /// A constant map, whole reach.
    pub constant: Score,
    /// The true lobe map turned by 90 degrees in yaw, whole reach.
    pub turned: Score,
    /// Share of claimed texels whose truth lies within 1.64 σ.
    pub within_sigma_fraction: f64,
}

/// A map on the grid.
type Grid = Vec<[f64; 3]>;

/// Scores `srm` with `confidence` against the `truth` folder of a plain folder. `truth_from_map` turns the map's
/// directions into those of the truth, where they differ.
pub fn evaluate(
    srm: &Path,
    confidence: &Path,
    truth: &Path,
    truth_from_map: Option<DQuat>,
    alpha: f64,
    fixed_scale: Option<f64>,
) -> anyhow::Result<EnvironmentMetrics> {
    let (map, _) = read_rgb_exr(srm)?;
    let confidence = read_confidence_exr(confidence)?;
    let environment = truth.join("environment.exr");
    let (environment, _) = read_rgb_exr(&environment)
        .with_context(|| format!("no readable truth at {}", environment.display()))?;
    let reach = read_channel_exr(&truth.join("reach.exr"), None)
        .context("reading the reach of the truth")?;
    let size = PanoramaSize::from_height(GRID_HEIGHT).expect("64 rows make a panorama");
    let reach = grid_scalar(&reach, size);
    let turn = |map: &LinearImage| truth_from_map.map_or_else(|| map.clone(), |q| turned(map, q));
    let turned_confidence = turn(&confidence.confidence.map(|c| [c; 3])).map(|c| c[0]);
    let (map_on_grid, confidence_on_grid) = grid_map(&turn(&map), &turned_confidence, size);
    let sigma_map = confidence
        .sigma
        .map(|s| s.map(|v| if v.is_finite() { v } else { 10.0 }));
    let (sigma_on_grid, _) = grid_map(&turn(&sigma_map), &turned_confidence, size);
    let sharp = block_mean(&environment, size);
    let lobe = lobe_map(&environment, size, alpha);
    let ones = vec![1.0; size.texel_count()];
    let claimed = Domain::new(size, &reach, &confidence_on_grid);
    let whole = Domain::new(size, &reach, &ones);
    let score = |domain: &Domain, map: &Grid, truth: &Grid| score(domain, map, truth, fixed_scale);
    let on_claimed = score(&claimed, &map_on_grid, &lobe);
    let on_reach = score(&whole, &map_on_grid, &lobe);
    let constant = score(&whole, &vec![[0.3; 3]; size.texel_count()], &lobe);
    let turned = score(&whole, &turned_quarter(&lobe, size), &lobe);
    let rgb = [0, 1, 2].map(|channel| {
        let only = |grid: &Grid| grid.iter().map(|v| [v[channel]; 3]).collect::<Grid>();
        score(&whole, &only(&map_on_grid), &only(&lobe)).corr
    });
    Ok(EnvironmentMetrics {
        truth_alpha: alpha,
        map_rotation_deg: truth_from_map.map(|q| rotation::log(q).length().to_degrees()),
        env_corr: on_claimed.corr,
        env_log_rmse: on_claimed.log_rmse,
        coverage: on_claimed.coverage,
        coverage_hemisphere: claimed.weight / hemisphere_weight(size),
        env_corr_reach: on_reach.corr,
        env_log_rmse_reach: on_reach.log_rmse,
        scale_reach: on_reach.scale,
        env_corr_rgb: rgb,
        sharp: score(&whole, &map_on_grid, &sharp),
        constant,
        turned,
        within_sigma_fraction: within_sigma(
            &claimed,
            &map_on_grid,
            &sigma_on_grid,
            &lobe,
            on_claimed.scale,
        ),
    })
}

/// Texels that are scored, with their weights.
struct Domain {
    texels: Vec<(usize, f64)>,
    weight: f64,
    reach_weight: f64,
}

impl Domain {
    fn new(size: PanoramaSize, reach: &[f64], confidence: &[f64]) -> Self {
        let width = size.width() as usize;
        let mut domain = Self {
            texels: Vec::new(),
            weight: 0.0,
            reach_weight: 0.0,
        };
        for index in 0..size.texel_count() / 2 {
            if reach[index] < 0.5 {
                continue;
            }
            let weight = size.latitude((index / width) as u32).cos();
            domain.reach_weight += weight;
            if confidence[index] >= 0.5 {
                domain.weight += weight;
                domain.texels.push((index, weight));
            }
        }
        domain
    }
}

fn hemisphere_weight(size: PanoramaSize) -> f64 {
    (0..size.height() / 2)
        .map(|row| size.latitude(row).cos() * f64::from(size.width()))
        .sum()
}

fn luminance(value: [f64; 3]) -> f64 {
    srm::rows::luminance(value)
}

/// Items 2 to 8 of the definition.
fn score(domain: &Domain, map: &Grid, truth: &Grid, fixed_scale: Option<f64>) -> Score {
    let coverage = if domain.reach_weight > 0.0 {
        domain.weight / domain.reach_weight
    } else {
        0.0
    };
    let mut ratios = Vec::new();
    for &(index, weight) in &domain.texels {
        let (s, t) = (luminance(map[index]).max(0.0), luminance(truth[index]));
        if SCALE_RANGE.contains(&t) && t > SCALE_RANGE.start && s > 0.0 {
            ratios.push(((t / s).ln(), weight));
        }
    }
    let scale = fixed_scale
        .or_else(|| robust::weighted_median(&mut ratios).map(f64::exp))
        .unwrap_or(1.0);
    let mut clipped = Vec::new();
    let mut logarithms = Vec::new();
    for &(index, weight) in &domain.texels {
        let a = (scale * luminance(map[index]).max(0.0)).clamp(0.0, 1.0);
        let b = luminance(truth[index]).clamp(0.0, 1.0);
        clipped.push((a, b, weight));
        logarithms.push((a.max(0.01).ln(), b.max(0.01).ln(), weight));
    }
    let sum: f64 = domain.weight.max(1e-300);
    let square: f64 = logarithms
        .iter()
        .map(|(a, b, w)| w * (a - b) * (a - b))
        .sum();
    Score {
        corr: measures::weighted_pearson(&clipped).unwrap_or(0.0),
        log_rmse: (square / sum).sqrt(),
        log_corr: measures::weighted_pearson(&logarithms).unwrap_or(0.0),
        scale,
        coverage,
    }
}

fn within_sigma(domain: &Domain, map: &Grid, sigma: &Grid, truth: &Grid, scale: f64) -> f64 {
    let inside: f64 = domain
        .texels
        .iter()
        .filter(|(index, _)| {
            let (s, t) = (scale * luminance(map[*index]), luminance(truth[*index]));
            // Above the white level a capture cannot know: both sides are clipped.
            (s.min(1.0) - t.min(1.0)).abs() <= 1.64 * scale * luminance(sigma[*index])
        })
        .map(|(_, weight)| weight)
        .sum();
    if domain.weight > 0.0 {
        inside / domain.weight
    } else {
        0.0
    }
}

fn turned_quarter(grid: &Grid, size: PanoramaSize) -> Grid {
    let width = size.width() as usize;
    (0..grid.len())
        .map(|index| grid[index / width * width + (index % width + width / 4) % width])
        .collect()
}

/// Source texels and counts of every grid block; sizes that do not divide are sampled bilinearly at four
/// times the grid first.
fn blocks(width: u32, height: u32, size: PanoramaSize) -> Option<u32> {
    let factor = height / size.height();
    (factor >= 1 && factor * size.height() == height && width == 2 * height).then_some(factor)
}

fn resampled(image: &LinearImage, size: PanoramaSize) -> LinearImage {
    let fine = PanoramaSize::from_height(4 * size.height()).expect("a multiple of the grid");
    turned_to(image, fine, DQuat::IDENTITY)
}

/// The map in other axes, at its own size; `turn` takes its directions to the new ones.
fn turned(image: &LinearImage, turn: DQuat) -> LinearImage {
    match PanoramaSize::from_height(image.height()) {
        Some(size) => turned_to(image, size, turn),
        None => image.clone(),
    }
}

/// The map at another size and in other axes, bilinear.
fn turned_to(image: &LinearImage, fine: PanoramaSize, turn: DQuat) -> LinearImage {
    let source = PanoramaSize::from_height(image.height());
    let back = turn.conjugate();
    let pixels = (0..fine.texel_count())
        .map(|index| {
            let texel = DVec2::new(
                (index % fine.width() as usize) as f64,
                (index / fine.width() as usize) as f64,
            );
            let Some(source) = source else {
                return [0.0; 3];
            };
            let taps = source.taps(back * fine.direction_from_texel(texel));
            let mut value = [0.0_f32; 3];
            for (&texel, weight) in taps.texels.iter().zip(taps.weights) {
                let color = image.pixels()[texel as usize];
                for c in 0..3 {
                    value[c] += weight * color[c];
                }
            }
            value
        })
        .collect();
    Image::from_vec(fine.width(), fine.height(), pixels).expect("one value a texel")
}

fn block_mean(image: &LinearImage, size: PanoramaSize) -> Grid {
    let ones = Image::new(image.width(), image.height(), 1.0_f32);
    grid_map(image, &ones, size).0
}

fn grid_scalar(image: &Image<f32>, size: PanoramaSize) -> Vec<f64> {
    let wide = image.map(|v| [v; 3]);
    block_mean(&wide, size).into_iter().map(|v| v[0]).collect()
}

/// Item 1: the map by the confidence-weighted block mean, the confidence by the plain one.
fn grid_map(map: &LinearImage, confidence: &Image<f32>, size: PanoramaSize) -> (Grid, Vec<f64>) {
    let (map, confidence) = match blocks(map.width(), map.height(), size) {
        Some(_) => (map.clone(), confidence.clone()),
        None => (
            resampled(map, size),
            resampled(&confidence.map(|c| [c; 3]), size).map(|v| v[0]),
        ),
    };
    let factor = map.height() / size.height();
    let mut values = Vec::with_capacity(size.texel_count());
    let mut confidences = Vec::with_capacity(size.texel_count());
    for row in 0..size.height() {
        for column in 0..size.width() {
            let (mut sum, mut weight, mut plain) = ([0.0; 3], 0.0, 0.0);
            for y in row * factor..(row + 1) * factor {
                for x in column * factor..(column + 1) * factor {
                    let color = map.at(x, y).map(f64::from);
                    let finite = color.iter().all(|v| v.is_finite());
                    let c = if finite {
                        f64::from(confidence.at(x, y))
                    } else {
                        0.0
                    };
                    plain += c;
                    if finite {
                        weight += c + 1e-6;
                        for channel in 0..3 {
                            sum[channel] += color[channel] * (c + 1e-6);
                        }
                    }
                }
            }
            values.push(if weight > 0.0 {
                sum.map(|s| s / weight)
            } else {
                [0.0; 3]
            });
            confidences.push(plain / f64::from(factor * factor));
        }
    }
    (values, confidences)
}

/// Item 5: the truth convolved with the GGX lobe of width `alpha`, over all texels of its 256 x 128 mean.
fn lobe_map(environment: &LinearImage, size: PanoramaSize, alpha: f64) -> Grid {
    let fine = PanoramaSize::from_height(LOBE_HEIGHT).expect("128 rows make a panorama");
    let mean = block_mean(environment, fine);
    let sources: Vec<_> = (0..fine.texel_count())
        .map(|index| {
            let (row, column) = (index / fine.width() as usize, index % fine.width() as usize);
            let direction = fine.direction_from_texel(DVec2::new(column as f64, row as f64));
            (direction, mean[index], fine.solid_angle(row as u32))
        })
        .collect();
    (0..size.texel_count())
        .into_par_iter()
        .map(|index| {
            let width = size.width() as usize;
            // Only the upper half is ever scored.
            if index / width >= size.height() as usize / 2 {
                return [0.0; 3];
            }
            let axis = size
                .direction_from_texel(DVec2::new((index % width) as f64, (index / width) as f64));
            let (mut sum, mut weight) = ([0.0; 3], 0.0);
            for (direction, radiance, solid_angle) in &sources {
                let cosine = axis.dot(*direction);
                if cosine <= 0.0 {
                    continue;
                }
                let k = lobe_kernel(cosine, alpha) * solid_angle;
                weight += k;
                for c in 0..3 {
                    sum[c] += k * radiance[c];
                }
            }
            sum.map(|s| s / weight)
        })
        .collect()
}

/// k = D(θ/2) max(cos θ, 0) with D(x) = 1/(cos⁴x (1 + tan²x/α²)²), from cos θ by the half-angle identities.
fn lobe_kernel(cosine: f64, alpha: f64) -> f64 {
    let cos2_half = 0.5 * (1.0 + cosine);
    let sin2_half = 0.5 * (1.0 - cosine).max(0.0);
    let spread = cos2_half + sin2_half / (alpha * alpha);
    cosine / (spread * spread)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lobe_kernel_equals_its_definition() {
        for alpha in [0.02, 0.1, 0.5] {
            for theta in [0.0_f64, 0.01, 0.3, 1.2] {
                let x = 0.5 * theta;
                let d = 1.0 / (x.cos().powi(4) * (1.0 + x.tan().powi(2) / (alpha * alpha)).powi(2));
                let expected = d * theta.cos();
                assert!((lobe_kernel(theta.cos(), alpha) / expected - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_true_map_scores_one_and_scale_does_not_matter() {
        let size = PanoramaSize::from_height(GRID_HEIGHT).unwrap();
        let truth: Grid = (0..size.texel_count())
            .map(|i| [0.1 + 0.6 * ((i % 128) as f64 / 128.0); 3])
            .collect();
        let ones = vec![1.0; size.texel_count()];
        let domain = Domain::new(size, &ones, &ones);
        let same = score(&domain, &truth, &truth, None);
        assert!(same.corr > 1.0 - 1e-12 && same.log_rmse < 1e-12);
        let brighter: Grid = truth.iter().map(|v| v.map(|v| 7.0 * v)).collect();
        let scaled = score(&domain, &brighter, &truth, None);
        assert!(
            (scaled.corr - same.corr).abs() < 1e-9
                && (scaled.log_rmse - same.log_rmse).abs() < 1e-9
        );
        let turned = score(&domain, &turned_quarter(&truth, size), &truth, None);
        assert!(turned.corr < 0.6);
    }

    #[test]
    fn a_turned_map_turns_back() {
        let size = PanoramaSize::from_height(64).unwrap();
        let toward = |index: usize| {
            let (column, row) = (index % 128, index / 128);
            size.direction_from_texel(DVec2::new(column as f64, row as f64))
        };
        // Smooth, so that bilinear taps cost little.
        let value = |d: geometry::DVec3| [(0.5 + 0.3 * d.x + 0.2 * d.y * d.z) as f32; 3];
        let turn = rotation::exp(geometry::DVec3::new(0.3, -0.8, 0.2));
        let in_map = (0..size.texel_count()).map(|i| value(toward(i))).collect();
        let map = Image::from_vec(128, 64, in_map).unwrap();
        let found = turned(&map, turn);
        for (index, pixel) in found.pixels().iter().enumerate() {
            let expected = value(turn.conjugate() * toward(index));
            assert!((pixel[0] - expected[0]).abs() < 2e-3);
        }
        assert_eq!(
            turned(&map, DQuat::IDENTITY).pixels().len(),
            map.pixels().len()
        );
    }

    #[test]
    fn a_constant_map_has_no_correlation() {
        let size = PanoramaSize::from_height(GRID_HEIGHT).unwrap();
        let truth: Grid = (0..size.texel_count())
            .map(|i| [0.1 + (i % 7) as f64 * 0.1; 3])
            .collect();
        let ones = vec![1.0; size.texel_count()];
        let domain = Domain::new(size, &ones, &ones);
        let constant = score(&domain, &vec![[0.3; 3]; size.texel_count()], &truth, None);
        assert_eq!(constant.corr, 0.0);
        assert!(constant.log_rmse > 0.1);
    }
}
