//! Feeds mutants of `.oni` files and frames to the reader: `oni_fuzz COUNT [SEED]`.
//!
//! A panic ends the program; each thousand executions begin with a seed of their own, which is printed then.

use std::error::Error;
use std::panic;

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use crate::mutate::{Counts, execute};

#[path = "../../tests/import/oni/made.rs"]
mod made;
#[path = "../../tests/import/oni/mutate.rs"]
mod mutate;

/// Executions between two seeds.
const ROUND: u64 = 1000;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [count, rest @ ..] = arguments.as_slice() else {
        return Err("oni_fuzz COUNT [SEED]".into());
    };
    let count: u64 = count.parse()?;
    let first = rest.first().map_or(Ok(1), |seed| seed.parse())?;
    let mut counts = Counts::default();
    for round in 0..count.div_ceil(ROUND) {
        let seed = first + round;
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let executed = panic::catch_unwind(panic::AssertUnwindSafe(|| {
            for _ in 0..ROUND.min(count - round * ROUND) {
                execute(&mut random, &mut counts);
            }
        }));
        if executed.is_err() {
            return Err(
                format!("found with seed {seed}: run with COUNT 1000 and that SEED").into(),
            );
        }
    }
    println!("no finding: {counts:?}");
    Ok(())
}
