//! One point: a fresh process, watched, timed, and what became of it.

use std::fs::File;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};

use super::machine;

/// How a point ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PointStatus {
    /// With figures.
    Ok,
    /// Without.
    Failed,
    /// It took too long.
    Timeout,
    /// The kernel ended it.
    OutOfMemory,
    /// It ended, but lost what it was to measure.
    Lost,
}

impl std::fmt::Display for PointStatus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Ok => "ok",
            Self::Failed => "failed",
            Self::Timeout => "timeout",
            Self::OutOfMemory => "out-of-memory",
            Self::Lost => "lost",
        })
    }
}

/// What a process cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChildCost {
    /// Processor seconds outside the kernel.
    pub user_s: f64,
    /// Processor seconds inside.
    pub sys_s: f64,
    /// Seconds on the wall clock.
    pub wall_s: f64,
    /// Share of the machine's processor time that its host took away meanwhile.
    pub steal_fraction: f64,
    /// Load average of the last minute at the end.
    pub load_average: f64,
}

impl ChildCost {
    /// Processor seconds.
    pub fn core_s(&self) -> f64 {
        self.user_s + self.sys_s
    }
}

/// A process that has ended.
#[derive(Clone, Debug)]
pub(super) struct Ended {
    pub(super) status: PointStatus,
    /// Last line of standard error where it did not end well.
    pub(super) reason: String,
    /// Last line of standard output.
    pub(super) last_line: String,
    pub(super) cost: ChildCost,
}

/// How often a process is looked at.
const LOOK: Duration = Duration::from_millis(5);
/// Exit code of a program that lost data.
const LOST_CODE: i32 = 3;

/// Runs `command` in `desk` until it ends, takes longer than `timeout`, or this program is stopped.
///
/// # Errors
/// When it cannot be started or watched, and [`crate::interrupt::Interrupted`] once a signal came: the point
/// counts as not run.
pub(super) fn run(mut command: Command, desk: &Path, timeout: Duration) -> anyhow::Result<Ended> {
    let (out, err) = (desk.join("stdout"), desk.join("stderr"));
    command
        .stdin(Stdio::null())
        .stdout(File::create(&out)?)
        .stderr(File::create(&err)?);
    let before = machine::children_seconds();
    let [stolen_before, all_before] = machine::stolen_and_all();
    let start = Instant::now();
    let mut child = command.spawn().with_context(|| {
        format!(
            "{} cannot be started",
            command.get_program().to_string_lossy()
        )
    })?;
    let status = wait(&mut child, start + timeout)?;
    let wall_s = start.elapsed().as_secs_f64();
    let after = machine::children_seconds();
    let [stolen, all] = machine::stolen_and_all();
    let cost = ChildCost {
        user_s: after[0] - before[0],
        sys_s: after[1] - before[1],
        wall_s,
        steal_fraction: (stolen - stolen_before) / (all - all_before).max(1.0),
        load_average: machine::load_average(),
    };
    let last_line = last_line(&out)?;
    let (status, reason) = match status {
        None => (
            PointStatus::Timeout,
            format!("it took longer than {} s", timeout.as_secs()),
        ),
        Some(status) => verdict(status, &err)?,
    };
    Ok(Ended {
        status,
        reason,
        last_line,
        cost,
    })
}

/// The status of a child that ended by itself; `None` when it was ended at the deadline.
fn wait(child: &mut Child, deadline: Instant) -> anyhow::Result<Option<ExitStatus>> {
    loop {
        let ended = child.try_wait()?;
        if let Err(interrupted) = crate::interrupt::check() {
            if ended.is_none() {
                stop(child)?;
            }
            return Err(interrupted.into());
        }
        if ended.is_some() {
            return Ok(ended);
        }
        if Instant::now() >= deadline {
            stop(child)?;
            return Ok(None);
        }
        std::thread::sleep(LOOK);
    }
}

fn stop(child: &mut Child) -> anyhow::Result<()> {
    child.kill()?;
    child.wait()?;
    Ok(())
}

fn verdict(status: ExitStatus, err: &Path) -> anyhow::Result<(PointStatus, String)> {
    if status.success() {
        return Ok((PointStatus::Ok, String::new()));
    }
    // Only the kernel sends this signal unasked, and for want of memory.
    if status.signal() == Some(9) {
        return Ok((PointStatus::OutOfMemory, "ended by signal 9".to_owned()));
    }
    let kind = if status.code() == Some(LOST_CODE) {
        PointStatus::Lost
    } else {
        PointStatus::Failed
    };
    let said = last_line(err)?;
    let reason = if said.is_empty() {
        status.to_string()
    } else {
        said
    };
    Ok((kind, reason))
}

/// The last line of a file that is not empty.
fn last_line(path: &Path) -> anyhow::Result<String> {
    let bytes = std::fs::read(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.lines().map(str::trim);
    Ok(lines
        .rfind(|line| !line.is_empty())
        .unwrap_or_default()
        .to_owned())
}
