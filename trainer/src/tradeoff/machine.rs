//! What the kernel says of this machine and of processes.

use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

/// The machine that figures belong to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the processor.
    pub processor: String,
    /// Processors that may be used.
    pub processor_count: usize,
    /// Memory, mebibytes.
    pub memory_mib: u64,
    /// Release of the kernel.
    pub kernel: String,
    /// Architecture and vector instructions in use.
    pub instructions: String,
}

impl Machine {
    /// This machine.
    pub fn here() -> Self {
        let info = read("/proc/cpuinfo");
        let memory = field(&read("/proc/meminfo"), "MemTotal:").unwrap_or(0);
        let avx2 = match raytrace::Level::detect() {
            raytrace::Level::Avx2 => " with AVX2",
            raytrace::Level::Scalar => "",
        };
        Self {
            processor: info
                .lines()
                .find_map(|line| line.strip_prefix("model name"))
                .map_or("unknown processor", |rest| {
                    rest.trim_start_matches([' ', '\t', ':'])
                })
                .to_owned(),
            processor_count: std::thread::available_parallelism().map_or(1, usize::from),
            memory_mib: memory / 1024,
            kernel: read("/proc/sys/kernel/osrelease").trim().to_owned(),
            instructions: format!("{}{avx2}", std::env::consts::ARCH),
        }
    }

    /// A short name: the hash of the line.
    pub fn id(&self) -> String {
        short_hash(self.to_string().as_bytes())
    }
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {} processors, {} MiB, Linux {}, {}",
            self.processor, self.processor_count, self.memory_mib, self.kernel, self.instructions
        )
    }
}

/// The first 12 digits of a BLAKE3: enough to tell rows and machines apart.
pub(super) fn short_hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..12].to_owned()
}

fn read(path: &str) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

/// The number after a key at the beginning of a line.
fn field(text: &str, key: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(key))?;
    rest.split_whitespace().next()?.parse().ok()
}

/// Processor time that children took which have ended and were waited for, seconds: user, system. What
/// `getrusage(RUSAGE_CHILDREN)` counts, in ticks of 10 ms.
pub(super) fn children_seconds() -> [f64; 2] {
    let stat = read("/proc/self/stat");
    // The name in parentheses may hold anything; after it, state is field 3.
    let after = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let fields: Vec<&str> = after.split_whitespace().collect();
    let ticks = rustix::param::clock_ticks_per_second() as f64;
    [16, 17].map(|number: usize| {
        let value = fields
            .get(number - 3)
            .and_then(|text| text.parse::<f64>().ok());
        value.unwrap_or(0.0) / ticks
    })
}

/// Processor time of the whole machine so far, in ticks: stolen by the host, all.
pub(super) fn stolen_and_all() -> [f64; 2] {
    let stat = read("/proc/stat");
    let line = stat.lines().next().unwrap_or_default();
    let ticks: Vec<f64> = line
        .split_whitespace()
        .skip(1)
        // Guest time is in user time already.
        .take(8)
        .filter_map(|word| word.parse().ok())
        .collect();
    [ticks.get(7).copied().unwrap_or(0.0), ticks.iter().sum()]
}

/// Processes that wanted to run, mean of the last minute.
pub(super) fn load_average() -> f64 {
    let text = read("/proc/loadavg");
    let first = text.split_whitespace().next();
    first.and_then(|word| word.parse().ok()).unwrap_or(f64::NAN)
}

/// Largest resident memory of this process so far, mebibytes.
pub fn rss_peak_mb() -> f64 {
    field(&read("/proc/self/status"), "VmHWM:").unwrap_or(0) as f64 / 1024.0
}

/// How often this process was taken off a processor, all threads.
pub fn involuntary_switches() -> u64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else {
        return 0;
    };
    let of_task = |task: std::io::Result<std::fs::DirEntry>| -> Option<u64> {
        let status = std::fs::read_to_string(task.ok()?.path().join("status")).ok()?;
        field(&status, "nonvoluntary_ctxt_switches:")
    };
    tasks.filter_map(of_task).sum()
}

/// Now, as `2026-11-26T14:03:27Z`.
pub(super) fn utc_now() -> String {
    let elapsed = SystemTime::now().duration_since(UNIX_EPOCH);
    utc(elapsed.map_or(0, |elapsed| elapsed.as_secs()))
}

/// Seconds of Unix time as a date and time (civil calendar by eras of 400 years, Hinnant 2013).
fn utc(seconds: u64) -> String {
    let (day, second) = (seconds / 86_400, seconds % 86_400);
    let shifted = day + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 {
        month_from_march + 3
    } else {
        month_from_march - 9
    };
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    format!(
        "{year:04}-{month:02}-{day_of_month:02}T{:02}:{:02}:{:02}Z",
        second / 3600,
        second / 60 % 60,
        second % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_700_000_000, "2023-11-14T22:13:20Z"),
            (4_107_542_399, "2100-02-28T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), text);
        }
    }

    #[test]
    fn the_time_of_a_child_is_counted_once_it_was_waited_for() {
        let [user_before, system_before] = children_seconds();
        let spin = "i=0; while [ $i -lt 300000 ]; do i=$((i+1)); done";
        let status = std::process::Command::new("sh").args(["-c", spin]).status();
        assert!(status.unwrap().success());
        let [user, system] = children_seconds();
        assert!(user + system > user_before + system_before);
        assert!(rss_peak_mb() > 1.0);
        let [stolen, all] = stolen_and_all();
        assert!(stolen >= 0.0 && all > stolen);
    }
}
