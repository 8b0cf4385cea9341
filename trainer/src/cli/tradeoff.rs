//! `glint tradeoff`: its flags.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use clap::{Args, Subcommand};
use sequence::Recording;
use serde_json::json;

use super::Summary;
use crate::progress::Progress;
use crate::tradeoff::codec::{CodecRunner, parse_setting, run_point};
use crate::tradeoff::front::OnFront;
use crate::tradeoff::subject::Setting;
use crate::tradeoff::{Measurement, TradeoffOptions, measure};

#[derive(Debug, Args)]
pub(super) struct TradeoffArgs {
    #[command(subcommand)]
    subject: SubjectArgs,
}

#[derive(Debug, Subcommand)]
enum SubjectArgs {
    /// Depth coders, zstd, chunks and threads of a recording: core-milliseconds against bytes.
    Codec(CodecArgs),
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glint tradeoff codec kitchen.glint -o tradeoff")]
struct CodecArgs {
    /// The recording.
    recording: PathBuf,
    /// Folder for codec.csv, codec.svg, codec.html and codec.points.jsonl; a measurement that is in it goes on.
    #[arg(short, long)]
    output: PathBuf,
    /// Pairs that are coded at every point, spread evenly over the recording.
    #[arg(long, default_value_t = 120, value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pairs: u32,
    /// Times that every point is run.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repetitions: u32,
    /// Seed of the order and of the intervals.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Longest time of a run, seconds.
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..))]
    timeout_s: u64,
    /// Run this point here and print its figures: what the program calls itself with.
    #[arg(long, hide = true, value_parser = parse_setting)]
    point: Option<Setting>,
}

pub(super) fn run(args: &TradeoffArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let SubjectArgs::Codec(args) = &args.subject;
    if let Some(setting) = &args.point {
        let figures = run_point(&args.recording, setting, args.pairs as usize, &args.output)?;
        let json = serde_json::to_value(&figures)?;
        return Ok(Summary::whole(json.to_string(), json));
    }
    let recording = Recording::open(&args.recording)?;
    let program = std::env::current_exe().context("cannot find this program again")?;
    let runner = CodecRunner {
        program: program.clone(),
        recording: args.recording.clone(),
        pair_count: args.pairs,
    };
    let scene = args.recording.file_stem().unwrap_or_default();
    let options = TradeoffOptions {
        output: args.output.clone(),
        scene: format!("{}, {} pairs", scene.to_string_lossy(), args.pairs),
        scene_blake3: recording.content_hash().to_string(),
        program,
        repetitions: args.repetitions,
        seed: args.seed,
        timeout: Duration::from_secs(args.timeout_s),
    };
    drop(recording);
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, &args.output))
}

fn summary(measurement: &Measurement, output: &std::path::Path) -> Summary {
    let front: Vec<&str> = measurement
        .points
        .iter()
        .filter(|point| point.front != OnFront::No)
        .map(|point| point.name.as_str())
        .collect();
    let failed: Vec<String> = measurement
        .points
        .iter()
        .filter(|point| measurement.place(point).is_none())
        .map(|point| format!("{}: {}", point.name, point.reason()))
        .collect();
    let mut text = format!(
        "{}\non the front: {}",
        measurement.sentence(),
        front.join(", ")
    );
    for line in &failed {
        text.push_str(&format!("\nfailed: {line}"));
    }
    let name = measurement.subject.name;
    text.push_str(&format!("\n{}/{name}.csv, .svg, .html", output.display()));
    let json = json!({
        "subject": name,
        "points": measurement.points.len(),
        "front": front,
        "failed": failed,
        "default_front": measurement.default_point().map(|point| point.front.to_string()),
        "sentence": measurement.sentence(),
        "output": output,
    });
    Summary::whole(text, json)
}
