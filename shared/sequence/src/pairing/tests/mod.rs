mod hard;
mod streaming;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::*;

const NEIGHBOURS: u64 = 1000;
const PERIOD: i64 = 33_333_333;
const HALF_PERIOD: i64 = PERIOD / 2;
const HOUR: i64 = 3_600_000_000_000;

fn positions(pairing: &Pairing) -> Vec<(usize, usize)> {
    let pairs = pairing.pairs.iter();
    pairs.map(|pair| (pair.depth, pair.color)).collect()
}

/// Two streams and the pairs that are true: those frames that were exposed together and are both there.
struct Streams {
    depth: Vec<i64>,
    color: Vec<i64>,
    true_pairs: Vec<(usize, usize)>,
}

impl Streams {
    /// Exposure k of depth is at `depth_nanos(k)`, of colour at `color_nanos(k)`; dropped where `None`.
    fn together(
        count: i64,
        mut depth_nanos: impl FnMut(i64) -> Option<i64>,
        mut color_nanos: impl FnMut(i64) -> Option<i64>,
    ) -> Self {
        let mut streams = Self {
            depth: Vec::new(),
            color: Vec::new(),
            true_pairs: Vec::new(),
        };
        for index in 0..count {
            let (depth, color) = (depth_nanos(index), color_nanos(index));
            if depth.is_some() && color.is_some() {
                let pair = (streams.depth.len(), streams.color.len());
                streams.true_pairs.push(pair);
            }
            streams.depth.extend(depth);
            streams.color.extend(color);
        }
        streams
    }

    /// Pairs that are not true, and true pairs that are missing.
    fn wrong_count(&self, pairs: &[(usize, usize)]) -> usize {
        let mut true_pairs = self.true_pairs.iter().peekable();
        let mut found = 0;
        for pair in pairs {
            while true_pairs.next_if(|other| *other < pair).is_some() {}
            found += usize::from(true_pairs.next_if_eq(&pair).is_some());
        }
        pairs.len() + self.true_pairs.len() - 2 * found
    }

    fn shipped_wrong_count(&self) -> usize {
        let pairing = pair_by_time(&self.depth, &self.color, HALF_PERIOD);
        self.wrong_count(&positions(&pairing))
    }
}

fn any_streams(random: &mut Pcg64Mcg, start: i64) -> Streams {
    let loss = random.random_range(0.0..0.4);
    let skew = random.random_range(-8_000_000..8_000_000);
    let mut color_random = Pcg64Mcg::seed_from_u64(random.random());
    let time = |random: &mut Pcg64Mcg, index: i64| {
        let jitter = random.random_range(-2_000_000..2_000_000);
        (!random.random_bool(loss)).then_some(start + index * PERIOD + jitter)
    };
    Streams::together(
        200,
        |index| time(random, index),
        |index| time(&mut color_random, index).map(|nanos| nanos + skew),
    )
}

/// Pairs and their sum of |Δt|; asserts that the answer is a pairing at all.
fn measured(depth: &[i64], color: &[i64], max_gap: i64) -> (usize, u128) {
    let pairing = pair_by_time(depth, color, max_gap);
    let mut cost = 0;
    let (mut depth_seen, mut color_seen) = (vec![0; depth.len()], vec![0; color.len()]);
    for pair in &pairing.pairs {
        let (depth_nanos, color_nanos) = (depth[pair.depth], color[pair.color]);
        let gap = depth_nanos.abs_diff(color_nanos);
        assert!(gap <= max_gap as u64, "{depth:?} {color:?} {pairing:?}");
        assert_eq!(pair.skew_nanos, color_nanos - depth_nanos);
        cost += u128::from(gap);
        depth_seen[pair.depth] += 1;
        color_seen[pair.color] += 1;
    }
    for [a, b] in pairing.pairs.array_windows() {
        assert!((depth[a.depth], a.depth) < (depth[b.depth], b.depth));
        assert!((color[a.color], a.color) < (color[b.color], b.color));
    }
    pairing
        .unmatched_depth
        .iter()
        .for_each(|&i| depth_seen[i] += 1);
    pairing
        .unmatched_color
        .iter()
        .for_each(|&i| color_seen[i] += 1);
    assert!(
        depth_seen
            .iter()
            .chain(&color_seen)
            .all(|&count| count == 1)
    );
    (pairing.pairs.len(), cost)
}

/// The same by a table over all prefixes.
fn reference(depth: &[i64], color: &[i64], max_gap: i64) -> (usize, u128) {
    let (mut depth, mut color) = (depth.to_vec(), color.to_vec());
    depth.sort_unstable();
    color.sort_unstable();
    // (−pairs, cost), least first.
    let mut row = vec![(0_i64, 0_u128); color.len() + 1];
    for &depth_nanos in &depth {
        let mut diagonal = row[0];
        for (index, &color_nanos) in color.iter().enumerate() {
            let gap = depth_nanos.abs_diff(color_nanos);
            let mut best = row[index].min(row[index + 1]);
            if max_gap >= 0 && gap <= max_gap as u64 {
                best = best.min((diagonal.0 - 1, diagonal.1 + u128::from(gap)));
            }
            diagonal = row[index + 1];
            row[index + 1] = best;
        }
    }
    let (pairs, cost) = row[color.len()];
    (pairs.unsigned_abs() as usize, cost)
}

#[test]
fn no_pairing_has_more_pairs_or_less_distance() {
    let mut random = Pcg64Mcg::seed_from_u64(12);
    for round in 0..30_000 {
        let span = [3, 10, 30, 200, 1000][round % 5];
        let mut any = || {
            let count = random.random_range(0..if round % 50 == 0 { 60 } else { 12 });
            let times = (0..count).map(|_| random.random_range(-span..span));
            times.collect::<Vec<i64>>()
        };
        let (depth, color) = (any(), any());
        let max_gap = random.random_range(0..[2, 5, 20, 300][round % 4]);
        assert_eq!(
            measured(&depth, &color, max_gap),
            reference(&depth, &color, max_gap),
            "{depth:?} {color:?} {max_gap}"
        );
    }
}

#[test]
fn the_ends_of_time_do_not_overflow() {
    let times = [i64::MIN, i64::MIN, -1, 0, 5, i64::MAX, i64::MAX];
    for max_gap in [0, 1, 4, i64::MAX] {
        let (depth, color) = (&times[1..], &times[..6]);
        let expected = reference(depth, color, max_gap);
        assert_eq!(measured(depth, color, max_gap), expected);
    }
    let none = pair_by_time(&times, &times, -1);
    assert_eq!((none.pairs.len(), none.unmatched_depth.len()), (0, 7));
}

#[test]
fn a_million_frames_within_one_window_take_linear_time() {
    // Blocks of one stream after the other make the list of slopes as long as the streams.
    let mut depth = Vec::new();
    let mut color = Vec::new();
    for time in 0..400_000 {
        if time / 40_000 % 2 == 0 {
            depth.push(time);
        } else {
            color.push(time);
        }
    }
    let (pairs, cost) = measured(&depth, &color, i64::MAX);
    assert_eq!((pairs, cost), (200_000, 5 * 40_000 * 40_000));
    let equal = vec![7; 200_000];
    assert_eq!(measured(&equal, &equal, 0), (200_000, 0));
}

#[test]
fn equal_stamps_are_taken_in_the_order_of_their_positions() {
    let depth = [20, 10, 10, 20, 10];
    let color = [10, 20, 10];
    let pairing = pair_by_time(&depth, &color, 5);
    assert_eq!(pairing.pairs.len(), 3);
    assert!(pairing.unmatched_color.is_empty());
    for [a, b] in pairing.pairs.array_windows() {
        assert!((depth[a.depth], a.depth) < (depth[b.depth], b.depth));
        assert!((color[a.color], a.color) < (color[b.color], b.color));
    }
    let zero_skew = pairing.pairs.iter().all(|pair| pair.skew_nanos == 0);
    assert!(zero_skew);
}
