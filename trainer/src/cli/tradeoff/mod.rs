//! `glint tradeoff`: its flags.

mod audit;
mod fusion;
mod render;
mod srm;

use std::path::{Path, PathBuf};
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
    /// Voxels, prediction, alignment of live tracking and fusion: core-milliseconds a frame against the error of the path.
    Fusion(fusion::FusionArgs),
    /// Pixels, voxels, frames, size of the map of a training: core-seconds against the error of the map.
    Srm(srm::SrmArgs),
    /// Size, samples and model of drawn views: core-milliseconds a view against their error.
    Render(render::RenderArgs),
    /// Run random rows of tables again: figures must repeat, costs within a quarter.
    Audit(audit::AuditArgs),
}

/// What all subjects share.
#[derive(Debug, Args)]
struct RunArgs {
    /// Times that every point is run.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repetitions: u32,
    /// Seed of the order and of the intervals.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Longest time of a run, seconds.
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..))]
    timeout_s: u64,
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
    #[command(flatten)]
    run: RunArgs,
    /// Run this point here and print its figures: what the program calls itself with.
    #[arg(long, hide = true, value_parser = parse_setting)]
    point: Option<Setting>,
}

pub(super) fn run(args: &TradeoffArgs, progress: &Progress) -> anyhow::Result<Summary> {
    match &args.subject {
        SubjectArgs::Codec(args) => run_codec(args, progress),
        SubjectArgs::Fusion(args) => fusion::run(args, progress),
        SubjectArgs::Srm(args) => srm::run(args, progress),
        SubjectArgs::Render(args) => render::run(args, progress),
        SubjectArgs::Audit(args) => audit::run(args, progress),
    }
}

fn run_codec(args: &CodecArgs, progress: &Progress) -> anyhow::Result<Summary> {
    if let Some(setting) = &args.point {
        let figures = run_point(&args.recording, setting, args.pairs as usize, &args.output)?;
        let json = serde_json::to_value(&figures)?;
        return Ok(Summary::whole(json.to_string(), json));
    }
    let (runner, options) = codec(&args.recording, args.pairs, &args.output, &args.run)?;
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, &args.output))
}

/// Runner and options of `codec`.
fn codec(
    path: &Path,
    pair_count: u32,
    output: &Path,
    run: &RunArgs,
) -> anyhow::Result<(CodecRunner, TradeoffOptions)> {
    let recording = Recording::open(path)?;
    let program = this_program()?;
    let options = run.options(
        output,
        format!("{}, {pair_count} pairs", stem(path)),
        recording.content_hash().to_string(),
        &program,
    );
    let runner = CodecRunner {
        program,
        recording: path.to_owned(),
        pair_count,
    };
    Ok((runner, options))
}

impl RunArgs {
    fn options(
        &self,
        output: &Path,
        scene: String,
        scene_blake3: String,
        program: &Path,
    ) -> TradeoffOptions {
        TradeoffOptions {
            output: output.to_owned(),
            scene,
            scene_blake3,
            program: program.to_owned(),
            repetitions: self.repetitions,
            seed: self.seed,
            timeout: Duration::from_secs(self.timeout_s),
        }
    }
}

/// This program, to be run again.
fn this_program() -> anyhow::Result<PathBuf> {
    std::env::current_exe().context("cannot find this program again")
}

/// Threads that children are given: those of this command.
fn child_threads() -> usize {
    rayon::current_num_threads()
}

/// Name of a recording without folder and ending.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn summary(measurement: &Measurement, output: &Path) -> Summary {
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
