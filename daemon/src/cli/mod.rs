//! The command line: one definition of every flag, and exit codes.
//!
//! 0 success · 2 the user's input cannot be used, with one sentence · 3 frames are missing or damaged, with a
//! list · 101 a bug.

mod camera;
mod config;
mod record;

use std::io::IsTerminal as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use sequence::copy::{Copied, cut, recover};
use sequence::summary::Summary;
use sequence::verify::verify;
use serde_json::json;

use self::camera::{DoctorArgs, run_doctor};
use self::record::{RecordArgs, run_record};
use crate::inspect::{follow, info};
use crate::status::StopFlag;

/// Records RGB-D cameras into files that can be trusted.
#[derive(Debug, Parser)]
#[command(
    name = "glintd",
    version,
    about,
    after_help = "Example:\n  glintd record replay:recordings/two-cans.glint -o copy.glint"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print one JSON event a line on standard output; the last is the summary.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Record a source into a new file, until it ends or a signal comes.
    Record(Box<RecordArgs>),
    /// Say which cameras are plugged in, with serial number and firmware.
    #[cfg(feature = "usb")]
    #[command(after_help = "Example:\n  glintd list --json")]
    List,
    /// Say what stands in the way of a good recording on this machine, and how to mend it.
    Doctor(DoctorArgs),
    /// Say what a recording holds; works while it is written.
    Info(InfoArgs),
    /// Check every byte, and that no frame is missing.
    Verify(VerifyArgs),
    /// Make a whole recording from what is left of a damaged or unfinished one.
    Recover(RecoverArgs),
    /// Copy a range of frames into a new recording.
    Cut(CutArgs),
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glintd info recordings/two-cans.glint")]
struct InfoArgs {
    /// The recording.
    recording: PathBuf,
    /// Go on until the file is closed, saying what is added.
    #[arg(long)]
    follow: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glintd verify recordings/two-cans.glint --decode")]
struct VerifyArgs {
    /// The recording.
    recording: PathBuf,
    /// Also decode every frame.
    #[arg(long)]
    decode: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glintd recover broken.glint -o whole.glint")]
struct RecoverArgs {
    /// The damaged recording.
    recording: PathBuf,
    /// Recording to make; must not exist.
    #[arg(short, long)]
    output: PathBuf,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glintd cut recordings/two-cans.glint --range 10..20 -o part.glint"
)]
struct CutArgs {
    /// The recording.
    recording: PathBuf,
    /// Numbers of depth frames A..B (B excluded); colour of the same time goes with them.
    #[arg(long, value_parser = parse_range)]
    range: Range<u64>,
    /// Recording to make; must not exist.
    #[arg(short, long)]
    output: PathBuf,
}

/// Frames are missing or damaged.
const EXIT_LOST: u8 = 3;

/// Runs the program.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .with_target(false)
        .init();
    match dispatch(&cli) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("glintd: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn dispatch(cli: &Cli) -> anyhow::Result<ExitCode> {
    match &cli.command {
        Command::Record(args) => run_record(args, cli.json),
        #[cfg(feature = "usb")]
        Command::List => camera::run_list(cli.json),
        Command::Doctor(args) => run_doctor(args, cli.json),
        Command::Info(args) => run_info(args, cli.json),
        Command::Verify(args) => run_verify(args, cli.json),
        Command::Recover(args) => {
            let copied = recover(&args.recording, &args.output)?;
            say_copied(&copied, &args.output, cli.json);
            Ok(exit_code(copied.missing.is_empty()))
        }
        Command::Cut(args) => {
            let copied = cut(&args.recording, &args.output, args.range.clone())?;
            say_copied(&copied, &args.output, cli.json);
            Ok(exit_code(copied.missing.is_empty()))
        }
    }
}

fn exit_code(is_whole: bool) -> ExitCode {
    if is_whole {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(EXIT_LOST)
    }
}

/// SIGINT and SIGTERM end a recording; what was taken is kept.
fn stop_on_signals() -> anyhow::Result<StopFlag> {
    let stop = StopFlag::default();
    stop.stop_on_signals()?;
    Ok(stop)
}

fn run_info(args: &InfoArgs, json: bool) -> anyhow::Result<ExitCode> {
    if !args.follow {
        let summary = info(&args.recording)?;
        if json {
            println!("{}", with_event(&summary, "summary")?);
        } else {
            print!("{summary}");
        }
        return Ok(ExitCode::SUCCESS);
    }
    let stop = stop_on_signals()?;
    let mut failed = None;
    let last = follow(&args.recording, &stop, &mut |summary| {
        if json {
            match status_of(summary) {
                Ok(event) => println!("{event}"),
                Err(error) => failed = Some(error),
            }
        } else {
            let frames: Vec<String> = summary
                .streams
                .iter()
                .map(|stream| format!("{} {}", stream.frames, stream.kind))
                .collect();
            println!(
                "{} chunks, {:.1} MB, frames: {}",
                summary.chunk_count,
                summary.sealed_bytes as f64 / 1e6,
                frames.join(", ")
            );
        }
    })?;
    if let Some(error) = failed {
        return Err(error);
    }
    if let Some(summary) = last {
        if json {
            println!("{}", with_event(&summary, "summary")?);
        } else {
            print!("{summary}");
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// A summary for a file that grows: what only grows longer stands in the last one.
fn status_of(summary: &Summary) -> anyhow::Result<serde_json::Value> {
    let mut status = with_event(summary, "status")?;
    if let Some(keys) = status.as_object_mut() {
        keys.remove("events");
        keys.remove("histograms");
    }
    Ok(status)
}

fn with_event(value: &impl serde::Serialize, event: &str) -> anyhow::Result<serde_json::Value> {
    let mut json = serde_json::to_value(value)?;
    json["event"] = json!(event);
    Ok(json)
}

fn run_verify(args: &VerifyArgs, json: bool) -> anyhow::Result<ExitCode> {
    let found = verify(&args.recording, args.decode)?;
    if json {
        let mut event = with_event(&found, "summary")?;
        event["is_whole"] = json!(found.is_whole());
        println!("{event}");
        return Ok(exit_code(found.is_whole()));
    }
    print!("{}", found.summary);
    for finding in &found.findings {
        println!("found: {finding}");
    }
    for missing in &found.missing {
        println!("missing: {missing}");
    }
    for book in &found.books {
        let expected = book.expected.map_or_else(
            || "no rate is promised".to_owned(),
            |expected| format!("{expected:.2} by device time"),
        );
        println!(
            "books of stream {}: {} recorded + {} in gaps, {expected}: {}",
            book.stream,
            book.frames,
            book.in_gaps,
            if book.balances {
                "they balance"
            } else {
                "they do NOT balance"
            }
        );
    }
    for remark in &found.remarks {
        println!("note: {remark}");
    }
    println!(
        "{}",
        if found.is_whole() {
            "whole"
        } else {
            "NOT whole"
        }
    );
    Ok(exit_code(found.is_whole()))
}

fn say_copied(copied: &Copied, output: &Path, json: bool) {
    if json {
        let mut event = json!(copied);
        event["event"] = json!("summary");
        event["output"] = json!(output);
        println!("{event}");
        return;
    }
    let frames: Vec<String> = copied
        .frames
        .iter()
        .map(|(stream, count)| format!("{count} of stream {stream}"))
        .collect();
    println!(
        "{}: {:.1} MB, frames: {}",
        output.display(),
        copied.bytes as f64 / 1e6,
        frames.join(", ")
    );
    if copied.from_tail > 0 {
        println!(
            "{} frames came from behind the last sealed chunk",
            copied.from_tail
        );
    }
    for finding in &copied.findings {
        println!("found: {finding}");
    }
    for missing in &copied.missing {
        println!("missing: {missing}");
    }
}

fn parse_range(text: &str) -> Result<Range<u64>, String> {
    let parts = text.split_once("..");
    let numbers = parts.and_then(|(start, end)| Some((start.parse().ok()?, end.parse().ok()?)));
    match numbers {
        Some((start, end)) if start < end => Ok(start..end),
        _ => Err(format!("`{text}` is no range; write A..B with A below B")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory as _;
        Cli::command().debug_assert();
    }
}
