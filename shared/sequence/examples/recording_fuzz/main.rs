//! Feeds mutants of recordings to the readers: `recording_fuzz VECTORS COUNT [SEED]`.
//!
//! VECTORS is `recordings/vectors/recordings`. Half of the mutants have checksums that are right. A panic ends the
//! program; each thousand executions begin with a seed of their own, which is printed then.

use std::error::Error;
use std::path::Path;

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;
use serde_json::Value;

use crate::mutate::{Corpus, Counts};

#[path = "../../tests/format/edit.rs"]
mod edit;
#[path = "../../tests/format/holding.rs"]
#[expect(dead_code, reason = "the tests use all of it")]
mod holding;
#[path = "../../tests/format/mutate.rs"]
mod mutate;
#[path = "../../tests/format/seal.rs"]
mod seal;

/// Executions between two seeds.
const ROUND: u64 = 1000;

fn files(folder: &Path) -> Result<Vec<Vec<u8>>, Box<dyn Error>> {
    let read = |name: &str| std::fs::read(folder.join(name));
    let index: Vec<Value> = serde_json::from_slice(&read("index.json")?)?;
    let mut files = Vec::new();
    for entry in &index {
        let name = entry["file"].as_str().ok_or("a vector without a file")?;
        let edits = entry["edits"].as_array().ok_or("a vector without edits")?;
        files.push(edit::edited(&read, name, edits)?);
    }
    Ok(files)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, count, rest @ ..] = arguments.as_slice() else {
        return Err("recording_fuzz VECTORS COUNT [SEED]".into());
    };
    let (count, first_seed): (u64, u64) = (
        count.parse()?,
        rest.first().map_or(Ok(1), |seed| seed.parse())?,
    );
    let corpus = Corpus::new(files(Path::new(folder))?);
    let mut counts = Counts::default();
    for seed in first_seed..first_seed + count.div_ceil(ROUND) {
        let failing = SeedOnPanic(seed);
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for _ in 0..ROUND.min(count - counts.execution_count) {
            corpus.execute(&mut random, &mut counts);
        }
        drop(failing);
        if (seed - first_seed) % 1000 == 999 {
            eprintln!("{} executions", counts.execution_count);
        }
    }
    println!(
        "{} executions from seed {first_seed}: {} refused, {} frames decoded, {} damages named, no panic",
        counts.execution_count, counts.refused_count, counts.frame_count, counts.damage_count
    );
    Ok(())
}

/// Says which seed ran when a panic comes.
struct SeedOnPanic(u64);

impl Drop for SeedOnPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("this was seed {}", self.0);
        }
    }
}
