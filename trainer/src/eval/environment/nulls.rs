//! Maps that show nothing of the room's detail, and how well they score (effects-and-tradeoffs.md C1, item 6).

use geometry::PanoramaSize;
use geometry::robust::quantile;
use imaging::LinearImage;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::grid::Grid;
use super::lobe::blurred_map;
use super::score::{Domain, Score, clipped_corr, score};

/// Full width at half maximum of the blurred truth, degrees.
const BLUR_DEG: f64 = 20.0;
/// Place of the constant map among the nulls.
pub(super) const CONSTANT: usize = 0;
/// Place of the truth turned by a quarter.
pub(super) const TURNED: usize = 2;
/// Luminance of the constant map; its scale is fitted.
const GREY: f64 = 0.3;
/// Side of the blocks of texels that are drawn together: neighbours are alike.
const BLOCK_TEXELS: usize = 8;
/// Draws of the bootstrap.
const DRAW_COUNT: usize = 400;
const SEED: u64 = 6;

/// One null beside the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NullScore {
    /// What it is, in words.
    pub name: String,
    /// Over claimed texels.
    pub claimed: Score,
    /// 95 % interval of its correlation over claimed texels.
    pub claimed_interval: [f64; 2],
    /// Over the whole reach.
    pub reach: Score,
    /// 95 % interval of its correlation over the whole reach.
    pub reach_interval: [f64; 2],
}

/// Whether a map does better than all nulls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NullVerdict {
    /// The null with the largest correlation.
    pub best_null: String,
    /// That correlation.
    pub best_corr: f64,
    /// Upper end of its 95 % interval: what a map must exceed.
    pub bar: f64,
    /// Whether the map's correlation does.
    pub shows_detail: bool,
}

impl NullVerdict {
    /// In words; `corr` is the map's correlation over `domain`.
    pub fn sentence(&self, domain: &str, corr: f64) -> String {
        let Self {
            best_null,
            best_corr,
            bar,
            ..
        } = self;
        if self.shows_detail {
            format!(
                "over {domain} the map ({corr:.3}) shows more than the best null, {best_null} ({best_corr:.3}, up to {bar:.3})"
            )
        } else {
            format!(
                "no detail shown: over {domain} the map ({corr:.3}) is not above the best null, {best_null} ({best_corr:.3}, up to {bar:.3})"
            )
        }
    }
}

/// All nulls of a truth: `lobe` is the truth that maps are compared with.
pub(super) fn null_maps(
    environment: &LinearImage,
    lobe: &Grid,
    size: PanoramaSize,
) -> Vec<(String, Grid)> {
    let mut maps = vec![
        (
            "a constant map".to_owned(),
            vec![[GREY; 3]; size.texel_count()],
        ),
        (
            format!("the truth blurred by {BLUR_DEG} degrees"),
            blurred_map(environment, size, BLUR_DEG),
        ),
    ];
    for quarters in 1..4 {
        let name = format!("the truth turned by {} degrees", 90 * quarters);
        maps.push((name, turned_quarters(lobe, size, quarters)));
    }
    maps.push((
        "the truth mirrored east to west".to_owned(),
        mirrored(lobe, size),
    ));
    maps
}

/// Scores the nulls over both domains.
pub(super) fn null_scores(
    maps: &[(String, Grid)],
    truth: &Grid,
    size: PanoramaSize,
    claimed: &Domain,
    whole: &Domain,
    fixed_scale: Option<f64>,
) -> Vec<NullScore> {
    maps.iter()
        .map(|(name, map)| {
            let judged = |domain: &Domain| {
                let score = score(domain, map, truth, fixed_scale);
                let interval = interval(domain, size, |part| {
                    clipped_corr(part, map, truth, score.scale)
                });
                (score, interval)
            };
            let (on_claimed, claimed_interval) = judged(claimed);
            let (on_reach, reach_interval) = judged(whole);
            NullScore {
                name: name.clone(),
                claimed: on_claimed,
                claimed_interval,
                reach: on_reach,
                reach_interval,
            }
        })
        .collect()
}

/// Compares a map's correlation over the claimed texels with the best of `nulls`; `None` of none.
pub(super) fn verdict_claimed(corr: f64, nulls: &[NullScore]) -> Option<NullVerdict> {
    verdict(corr, nulls, |n| (n.claimed.corr, n.claimed_interval))
}

/// As [`verdict_claimed`], over the whole reach.
pub(super) fn verdict_reach(corr: f64, nulls: &[NullScore]) -> Option<NullVerdict> {
    verdict(corr, nulls, |n| (n.reach.corr, n.reach_interval))
}

fn verdict(
    corr: f64,
    nulls: &[NullScore],
    figures: impl Fn(&NullScore) -> (f64, [f64; 2]),
) -> Option<NullVerdict> {
    let best = nulls
        .iter()
        .max_by(|a, b| figures(a).0.total_cmp(&figures(b).0))?;
    let (best_corr, [_, high]) = figures(best);
    let bar = high.max(best_corr);
    Some(NullVerdict {
        best_null: best.name.clone(),
        best_corr,
        bar,
        shows_detail: corr > bar,
    })
}

/// The map turned about the vertical by quarters: what stood a quarter to the right stands in the middle.
pub(super) fn turned_quarters(grid: &Grid, size: PanoramaSize, quarters: usize) -> Grid {
    let width = size.width() as usize;
    let shift = quarters * width / 4;
    (0..grid.len())
        .map(|index| grid[index / width * width + (index % width + shift) % width])
        .collect()
}

fn mirrored(grid: &Grid, size: PanoramaSize) -> Grid {
    let width = size.width() as usize;
    (0..grid.len())
        .map(|index| grid[index / width * width + width - 1 - index % width])
        .collect()
}

/// The 95 % interval of `figure` when blocks of texels are drawn with replacement, seeded.
fn interval(
    domain: &Domain,
    size: PanoramaSize,
    figure: impl Fn(&[(usize, f64)]) -> f64,
) -> [f64; 2] {
    let width = size.width() as usize;
    let blocks_across = width.div_ceil(BLOCK_TEXELS);
    let mut blocks: std::collections::BTreeMap<usize, Vec<(usize, f64)>> = Default::default();
    for &(index, weight) in &domain.texels {
        let (row, column) = (index / width, index % width);
        let block = row / BLOCK_TEXELS * blocks_across + column / BLOCK_TEXELS;
        blocks.entry(block).or_default().push((index, weight));
    }
    let blocks: Vec<_> = blocks.into_values().collect();
    let mut rng = Pcg64::seed_from_u64(SEED);
    let mut draws: Vec<f64> = (0..DRAW_COUNT)
        .map(|_| {
            let texels: Vec<(usize, f64)> = (0..blocks.len())
                .flat_map(|_| blocks[rng.random_range(0..blocks.len())].iter().copied())
                .collect();
            figure(&texels)
        })
        .collect();
    [0.025, 0.975].map(|q| quantile(&mut draws, q).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::environment::grid::{block_mean, grid_size};
    use imaging::Image;

    fn room() -> LinearImage {
        // Windows of 6 degrees on a slope: detail that a blur of 20 degrees loses.
        Image::from_fn(128, 64, |x, y| {
            let window = (x / 2 + 3 * (y / 2)) % 5 == 0;
            [0.05 + 0.002 * (x as f32) + if window { 0.5 } else { 0.0 }; 3]
        })
    }

    fn judged(map: &Grid) -> (f64, NullVerdict, Vec<NullScore>) {
        let size = grid_size();
        let room = room();
        let truth = block_mean(&room, size);
        let ones = vec![1.0; size.texel_count()];
        let domain = Domain::new(size, &ones, &ones);
        let maps = null_maps(&room, &truth, size);
        let nulls = null_scores(&maps, &truth, size, &domain, &domain, None);
        let corr = score(&domain, map, &truth, None).corr;
        (corr, verdict_claimed(corr, &nulls).unwrap(), nulls)
    }

    #[test]
    fn a_true_map_shows_detail_and_a_blurred_one_does_not() {
        let size = grid_size();
        let (_, of_truth, nulls) = judged(&block_mean(&room(), size));
        assert_eq!(nulls.len(), 6);
        assert!(of_truth.shows_detail, "{of_truth:?}");
        let (corr, of_blurred, _) = judged(&blurred_map(&room(), size, 30.0));
        assert!(!of_blurred.shows_detail, "{of_blurred:?}");
        assert!(
            of_blurred
                .sentence("all texels", corr)
                .starts_with("no detail shown")
        );
    }

    #[test]
    fn intervals_hold_the_score_are_seeded_and_a_constant_has_none() {
        let (_, _, nulls) = judged(&block_mean(&room(), grid_size()));
        for null in &nulls {
            let [low, high] = null.claimed_interval;
            assert!(
                low <= null.claimed.corr && null.claimed.corr <= high,
                "{null:?}"
            );
            assert_eq!(null.claimed_interval, null.reach_interval);
        }
        assert_eq!(
            (nulls[0].claimed.corr, nulls[0].claimed_interval),
            (0.0, [0.0; 2])
        );
        let empty = Domain::new(grid_size(), &vec![0.0; 8192], &vec![1.0; 8192]);
        assert_eq!(interval(&empty, grid_size(), |_| 0.0), [0.0; 2]);
        assert_eq!(verdict_reach(0.5, &[]), None);
    }

    #[test]
    fn turns_and_mirrors_undo_themselves() {
        let size = grid_size();
        let truth = block_mean(&room(), size);
        let around = turned_quarters(&turned_quarters(&truth, size, 1), size, 3);
        assert_eq!(around, truth);
        assert_ne!(turned_quarters(&truth, size, 2), truth);
        assert_ne!(mirrored(&truth, size), truth);
        assert_eq!(mirrored(&mirrored(&truth, size), size), truth);
    }
}
