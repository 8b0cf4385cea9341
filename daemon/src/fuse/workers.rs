//! The threads that fuse: a small pool, made once, behind the recorder in rank, whose processor time is known.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use rustix::process::{getpriority_process, setpriority_process};

use crate::latency::{Work, thread_nanos};

/// How far behind the recorder the pool ranks, in steps of `nice`.
const NICE_STEPS: i32 = 5;

/// A pool of workers.
pub struct Workers {
    pool: rayon::ThreadPool,
    clocks: Arc<Clocks>,
}

/// Where the system says what each worker has used, `None` where it does not.
struct Clocks(Vec<OnceLock<Option<File>>>);

/// Work of all workers that is being done; read by the worker that began.
pub struct PoolBegun {
    wall: Instant,
    own_nanos: u64,
    other_nanos: u64,
}

impl Workers {
    /// So many workers, at least one.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub fn new(count: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        let count = count.max(1);
        let clocks = Arc::new(Clocks((0..count).map(|_| OnceLock::new()).collect()));
        let known = Arc::clone(&clocks);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .thread_name(|index| format!("fuse-{index}"))
            .start_handler(move |index| {
                rank_behind();
                if let Some(clock) = known.0.get(index) {
                    // `thread-self` is resolved when it is opened.
                    let _ = clock.set(File::open("/proc/thread-self/schedstat").ok());
                }
            })
            .build()?;
        // So that every worker has begun.
        pool.broadcast(|_| ());
        Ok(Self { pool, clocks })
    }

    /// Runs `work` in the pool.
    pub fn run<R: Send>(&self, work: impl FnOnce(&StageClock) -> R + Send) -> R {
        let clock = StageClock(Arc::clone(&self.clocks));
        self.pool.install(|| work(&clock))
    }
}

/// Measures work that all workers share.
pub struct StageClock(Arc<Clocks>);

impl StageClock {
    /// Begins now.
    pub fn begin(&self) -> PoolBegun {
        PoolBegun {
            wall: Instant::now(),
            own_nanos: thread_nanos(),
            other_nanos: self.other_nanos(),
        }
    }

    /// Ends now, in the worker that began. The time of the other workers is as exact as the system's accounting, which
    /// is up to date when they sleep.
    pub fn end(&self, begun: &PoolBegun) -> Work {
        let own = thread_nanos().saturating_sub(begun.own_nanos);
        let others = self.other_nanos().saturating_sub(begun.other_nanos);
        Work {
            wall_nanos: u64::try_from(begun.wall.elapsed().as_nanos()).unwrap_or(u64::MAX),
            core_nanos: own.saturating_add(others),
        }
    }

    /// Processor time of the workers but this one.
    fn other_nanos(&self) -> u64 {
        let own = rayon::current_thread_index();
        let others = self
            .0
            .0
            .iter()
            .enumerate()
            .filter(|(index, _)| Some(*index) != own);
        let nanos = others.filter_map(|(_, clock)| run_nanos(clock.get()?.as_ref()?));
        nanos.fold(0, u64::saturating_add)
    }
}

/// The first number of `schedstat`: nanoseconds on a processor. Allocates nothing.
fn run_nanos(clock: &File) -> Option<u64> {
    let mut text = [0; 64];
    let length = clock.read_at(&mut text, 0).ok()?;
    let number = text[..length].split(|byte| *byte == b' ').next()?;
    std::str::from_utf8(number).ok()?.parse().ok()
}

/// Lowers the rank of this thread; a system that refuses leaves it.
fn rank_behind() {
    // Linux takes "this process" as this thread.
    if let Ok(nice) = getpriority_process(None) {
        let _ = setpriority_process(None, nice + NICE_STEPS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_of_both_workers_is_counted() {
        let workers = Workers::new(2).unwrap();
        let spin = || (0..20_000_000_u64).fold(1_u64, |a, b| std::hint::black_box(a ^ b));
        let work = workers.run(|clock| {
            let begun = clock.begin();
            rayon::join(spin, spin);
            clock.end(&begun)
        });
        assert!(work.core_nanos > 0);
    }
}
