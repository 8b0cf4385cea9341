//! A short fuzz run; `cargo run --release -p glint --example oni_fuzz -- 10000000` runs longer.

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use super::mutate::{Counts, execute};

#[test]
fn no_mutant_makes_a_panic_or_a_frame_of_another_size() {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut counts = Counts::default();
    for _ in 0..100_000 {
        execute(&mut random, &mut counts);
    }
    println!("{counts:?}");
    assert!(counts.files > 10_000 && counts.frames > 30_000 && counts.refused > 30_000);
}
