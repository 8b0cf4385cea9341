//! A short fuzz run; `cargo run --release -p sequence --example recording_fuzz` runs longer.

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use super::memory::MemoryFile;
use super::mutate::{Corpus, Counts};
use super::{small, vectors};

#[test]
fn no_mutant_makes_a_reader_panic_or_a_frame_up() {
    let mut files: Vec<Vec<u8>> = vectors::vectors()
        .iter()
        .map(vectors::Vector::bytes)
        .collect();
    for chunk_frames in [3, 100] {
        let file = MemoryFile::default();
        small::write(file.layer(), chunk_frames, small::Waiting::InPlace).unwrap();
        files.push(file.bytes());
    }
    let corpus = Corpus::new(files);
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut counts = Counts::default();
    let execution_count = if cfg!(debug_assertions) { 2000 } else { 20_000 };
    for _ in 0..execution_count {
        corpus.execute(&mut random, &mut counts);
    }
    println!("{counts:?}");
    assert!(counts.frame_count > counts.execution_count && counts.refused_count > 0);
}
