//! A long recording under bad conditions: two busy loops beside it, and a disk that stands still for two seconds
//! every minute. Says what was lost, whether the books balance, and whether memory grows.
//!
//! ```text
//! cargo run --release -p glintd --example soak -- RECORDING OUTPUT SECONDS
//! ```
//!
//! RECORDING is played round and round at the speed of the camera. Exit code 3 when a frame is missing.

use std::io;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use glintd::capture::{CaptureOptions, capture_with};
use glintd::outcome::resident_mb;
use glintd::status::StopFlag;
use sequence::file_layer::{self, FileLayer, Syncer, WritePath};
use sequence::verify::verify;

/// Busy threads beside the recorder.
const BUSY_COUNT: usize = 2;
/// The disk stands still this often.
const STALL_EVERY: Duration = Duration::from_secs(60);
/// For so long.
const STALL: Duration = Duration::from_secs(2);

/// A disk that stands still now and then: for all who call it.
#[derive(Clone)]
struct Late(Arc<Mutex<Instant>>);

impl Late {
    fn wait(&self) {
        let mut next_stall = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if Instant::now() >= *next_stall {
            std::thread::sleep(STALL);
            *next_stall = Instant::now() + STALL_EVERY;
        }
    }
}

/// A file on it.
struct LateFile {
    file: Box<dyn FileLayer>,
    disk: Late,
}

/// What syncs the file in another thread.
struct LateSyncer {
    syncer: Box<dyn Syncer>,
    disk: Late,
}

impl Syncer for LateSyncer {
    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        self.disk.wait();
        self.syncer.sync(offset, bytes)
    }
}

impl FileLayer for LateFile {
    fn allocate(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        self.disk.wait();
        self.file.allocate(offset, bytes)
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        self.disk.wait();
        self.file.write_at(offset, bytes)
    }

    fn sync(&mut self, offset: u64, bytes: u64) -> io::Result<()> {
        self.disk.wait();
        self.file.sync(offset, bytes)
    }

    fn syncer(&self) -> io::Result<Option<Box<dyn Syncer>>> {
        let disk = self.disk.clone();
        let late = |syncer| Box::new(LateSyncer { syncer, disk }) as Box<dyn Syncer>;
        Ok(self.file.syncer()?.map(late))
    }

    fn set_len(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn free_bytes(&mut self) -> io::Result<u64> {
        self.file.free_bytes()
    }

    fn release_before(&mut self, offset: u64) {
        self.file.release_before(offset);
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recording, output, seconds] = arguments.as_slice() else {
        eprintln!("give RECORDING OUTPUT SECONDS");
        return ExitCode::from(2);
    };
    match soak(recording, Path::new(output), seconds) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(3),
        Err(error) => {
            eprintln!("soak: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn soak(recording: &str, output: &Path, seconds: &str) -> anyhow::Result<bool> {
    let mut options = CaptureOptions::new(
        format!("replay:{recording}?speed=1&loop").parse()?,
        output.to_path_buf(),
    );
    options.duration = Some(Duration::from_secs(seconds.parse()?));
    options.make_layer = Some(Box::new(|path: &Path| {
        Ok(Box::new(LateFile {
            file: file_layer::create(path, WritePath::default())?,
            disk: Late(Arc::new(Mutex::new(Instant::now() + STALL_EVERY / 2))),
        }))
    }));
    let stop = StopFlag::default();
    stop.stop_on_signals()?;
    let is_over = AtomicBool::new(false);
    let mut samples: Vec<(f64, f64)> = Vec::new();
    let mut worst_fill = 0;
    let begun = Instant::now();
    let outcome = std::thread::scope(|scope| {
        for _ in 0..BUSY_COUNT {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let outcome = capture_with(options, &stop, &mut |status| {
            worst_fill = worst_fill.max(status.ring_fill_percent);
            samples.push((begun.elapsed().as_secs_f64(), resident_mb()));
        });
        is_over.store(true, Ordering::Relaxed);
        outcome
    })?;
    print!("{outcome}");
    println!("fullest buffer: {worst_fill} %");
    // The first seconds fill pools and maps.
    let steady: Vec<(f64, f64)> = samples.into_iter().filter(|(at, _)| *at > 10.0).collect();
    let (mean, slope) = line(&steady);
    println!(
        "resident: {mean:.1} MB mean, {:.3} MB a minute",
        60.0 * slope
    );
    let found = verify(output, false)?;
    for book in &found.books {
        println!(
            "stream {}: {} recorded + {} in gaps of {:.2}: {}",
            book.stream,
            book.frames,
            book.in_gaps,
            book.expected.unwrap_or_default(),
            if book.balances {
                "balances"
            } else {
                "does NOT balance"
            }
        );
    }
    println!(
        "verify: {}",
        if found.is_whole() {
            "whole"
        } else {
            "NOT whole"
        }
    );
    Ok(outcome.is_whole() && found.is_whole())
}

/// Mean, and slope by least squares.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let count = points.len().max(1) as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (x_mean, y_mean) = (mean(|point| point.0), mean(|point| point.1));
    let covariance: f64 = points
        .iter()
        .map(|(x, y)| (x - x_mean) * (y - y_mean))
        .sum();
    let variance: f64 = points.iter().map(|(x, _)| (x - x_mean).powi(2)).sum();
    (
        y_mean,
        if variance > 0.0 {
            covariance / variance
        } else {
            0.0
        },
    )
}
