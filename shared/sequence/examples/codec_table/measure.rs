//! One row of a table: code, decode, compare, time.

use std::path::{Path, PathBuf};

use rustix::time::{ClockId, clock_gettime};

pub(crate) type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Times that a frame is coded and decoded.
const REPETITIONS: usize = 5;

type Encode<'a, T> = Box<dyn FnMut(&[T], &mut Vec<u8>) -> Result<(), Failure> + 'a>;
type Decode<'a, T> = Box<dyn FnMut(&[u8], &mut [T]) -> Result<(), Failure> + 'a>;

/// A codec under measurement: `encode` replaces what `payload` holds, `decode` fills the frame.
pub(crate) struct Candidate<'a, T> {
    pub(crate) name: &'static str,
    pub(crate) encode: Encode<'a, T>,
    pub(crate) decode: Decode<'a, T>,
}

fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}

fn sorted(mut times: Vec<f64>) -> Vec<f64> {
    times.sort_by(f64::total_cmp);
    times
}

pub(crate) fn print_head(title: &str) {
    println!(
        "\n| {title} | ratio | % of raw | bit/px | encode ms, median (min) | decode ms, median (min) |"
    );
    println!("|---|---|---|---|---|---|");
}

/// Measures `candidate` on `frames` of `pixel_count` pixels and prints its row.
pub(crate) fn print_row<T: Copy + Default + PartialEq>(
    frames: &[Vec<T>],
    pixel_count: usize,
    mut candidate: Candidate<'_, T>,
) -> Result<(), Failure> {
    let mut payload = Vec::new();
    let mut decoded = vec![T::default(); frames[0].len()];
    let (mut encode_ms, mut decode_ms, mut byte_count) = (Vec::new(), Vec::new(), 0);
    for frame in frames {
        let (mut encode_best, mut decode_best) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..REPETITIONS {
            let start = cpu_ms();
            (candidate.encode)(frame, &mut payload)?;
            let middle = cpu_ms();
            (candidate.decode)(&payload, &mut decoded)?;
            encode_best = encode_best.min(middle - start);
            decode_best = decode_best.min(cpu_ms() - middle);
        }
        if decoded != *frame {
            return Err(format!("{} is not lossless", candidate.name).into());
        }
        encode_ms.push(encode_best);
        decode_ms.push(decode_best);
        byte_count += payload.len();
    }
    let raw = (frames.len() * size_of_val(frames[0].as_slice())) as f64;
    let (encode_ms, decode_ms) = (sorted(encode_ms), sorted(decode_ms));
    let median = frames.len() / 2;
    println!(
        "| {} | {:.2} | {:.2} | {:.3} | {:.2} ({:.2}) | {:.2} ({:.2}) |",
        candidate.name,
        raw / byte_count as f64,
        100.0 * byte_count as f64 / raw,
        8.0 * byte_count as f64 / (frames.len() * pixel_count) as f64,
        encode_ms[median],
        encode_ms[0],
        decode_ms[median],
        decode_ms[0],
    );
    Ok(())
}

/// Files of `folder` that end in `ending`, sorted, every `every`-th.
pub(crate) fn files(folder: &Path, ending: &str, every: usize) -> Result<Vec<PathBuf>, Failure> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.to_string_lossy().ends_with(ending) {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() {
        return Err(format!("{} has no *{ending}", folder.display()).into());
    }
    Ok(paths.into_iter().step_by(every.max(1)).collect())
}
