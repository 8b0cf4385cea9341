//! How long it takes to open a recording and to read a pair of it by a random time.
//!
//! ```text
//! cargo run --release -p sequence --example seek -- RECORDING
//! ```

use std::time::Instant;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sequence::Recording;

/// Pairs that are read.
const READ_COUNT: usize = 2000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give a recording")?;
    let begun = Instant::now();
    let recording = Recording::open(path.as_ref())?;
    println!(
        "open: {:.2} ms, {} pairs",
        begun.elapsed().as_secs_f64() * 1e3,
        recording.frame_count()
    );
    let last = recording.frame_count() - 1;
    let span = recording.time_nanos(0)..=recording.time_nanos(last);
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut millis = Vec::with_capacity(READ_COUNT);
    for _ in 0..READ_COUNT {
        let nanos = random.random_range(span.clone());
        let begun = Instant::now();
        let index = recording.frame_at(nanos).ok_or("no frame")?;
        let depth = recording.depth_raw(index)?;
        let color = recording.color_raw(index)?;
        millis.push(begun.elapsed().as_secs_f64() * 1e3);
        std::hint::black_box((depth, color));
    }
    // The first pass brings the file into memory.
    let mut warm = millis.split_off(READ_COUNT / 2);
    warm.sort_by(f64::total_cmp);
    let at = |fraction: f64| warm[(fraction * (warm.len() - 1) as f64) as usize];
    println!(
        "seek by time and decode a pair: median {:.2} ms, p99 {:.2} ms, worst {:.2} ms",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    Ok(())
}
