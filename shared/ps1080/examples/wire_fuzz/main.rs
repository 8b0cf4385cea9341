//! Feeds mutants to the receivers and decoders: `wire_fuzz stream|host|samples|color COUNT [SEED]`.
//!
//! A panic ends the program; each thousand executions begin with a seed of their own, which is printed then.

use std::error::Error;
use std::panic;

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use crate::mutate::{Counts, Target, execute};

#[path = "../../tests/wire/made.rs"]
#[expect(dead_code, reason = "the tests use all of it")]
mod made;
#[path = "../../tests/wire/mutate.rs"]
mod mutate;
#[path = "../../tests/wire/receive.rs"]
mod receive;

/// Executions between two seeds.
const ROUND: u64 = 1000;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [target, count, rest @ ..] = arguments.as_slice() else {
        return Err("wire_fuzz stream|host|samples|color COUNT [SEED]".into());
    };
    let target = Target::ALL
        .into_iter()
        .find(|known| format!("{known:?}").eq_ignore_ascii_case(target))
        .ok_or("no such target")?;
    let count: u64 = count.parse()?;
    let first = rest.first().map_or(Ok(1), |seed| seed.parse())?;
    let mut counts = Counts::default();
    for round in 0..count.div_ceil(ROUND) {
        let seed = first + round;
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let executed = panic::catch_unwind(panic::AssertUnwindSafe(|| {
            for _ in 0..ROUND.min(count - round * ROUND) {
                execute(target, &mut random, &mut counts);
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
