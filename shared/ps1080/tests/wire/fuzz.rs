//! A short fuzz run; `cargo run --release -p ps1080 --example wire_fuzz -- stream 10000000` runs longer.

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use super::mutate::{Counts, Target, execute};

#[test]
fn no_mutant_makes_a_panic_or_a_wrong_frame() {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut counts = Counts::default();
    let execution_count = if cfg!(debug_assertions) {
        20_000
    } else {
        200_000
    };
    for execution in 0..execution_count {
        let target = Target::ALL[execution % Target::ALL.len()];
        execute(target, &mut random, &mut counts);
    }
    let execution_count = execution_count as u64;
    println!("{counts:?}");
    assert_eq!(counts.execution_count, execution_count);
    assert!(counts.frame_count > execution_count / 4 && counts.lost_count > execution_count / 20);
    assert!(counts.damaged_count > execution_count / 20);
    assert!(counts.reply_count > execution_count / 100 && counts.refused_count > 0);
}
