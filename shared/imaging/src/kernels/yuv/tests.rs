use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::super::Level;
use super::{Gains, PairOrder, rgb_row, saturated_row};

/// Gains of limited Rec. 601.
const GAINS: Gains = Gains {
    luma: 76_309,
    black: 16,
    red_of_v: 26_149,
    green_of_u: -6419,
    green_of_v: -13_320,
    blue_of_u: 33_050,
    left: [0, 4, 0],
    right: [0, 2, 2],
};

#[test]
fn vector_rows_equal_their_scalar_twins() {
    if !Level::Avx2.is_usable() {
        println!("skipped: this machine has no AVX2");
        return;
    }
    let mut rng = Pcg64::seed_from_u64(31);
    let center = Gains {
        left: [1, 3, 0],
        right: [0, 3, 1],
        ..GAINS
    };
    for pair_count in 0..=4 * 8 + 1 {
        for gains in [GAINS, center] {
            for order in [PairOrder::Uyvy, PairOrder::Yuyv] {
                let mut byte = || -> u8 {
                    match rng.random_range(0..4) {
                        0 => 0,
                        1 => 255,
                        _ => rng.random(),
                    }
                };
                let pairs: Vec<[u8; 4]> = (0..pair_count)
                    .map(|_| [byte(), byte(), byte(), byte()])
                    .collect();
                let made = |level| {
                    let mut codes = vec![[7; 3]; 2 * pair_count];
                    let mut marks = vec![false; 2 * pair_count];
                    rgb_row(level, &gains, order, &pairs, &mut codes);
                    saturated_row(level, &gains, order, 250, &pairs, &mut marks);
                    (codes, marks)
                };
                assert_eq!(made(Level::Scalar), made(Level::Avx2), "{pair_count} pairs");
            }
        }
    }
}
