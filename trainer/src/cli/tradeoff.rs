//! `glint tradeoff`: its flags.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail, ensure};
use clap::{Args, Subcommand};
use sequence::Recording;
use serde_json::json;

use super::Summary;
use crate::progress::Progress;
use crate::tradeoff::codec::{CodecRunner, parse_setting, run_point};
use crate::tradeoff::front::OnFront;
use crate::tradeoff::fusion::careful::careful_mesh;
use crate::tradeoff::fusion::{self, FusionRunner};
use crate::tradeoff::subject::Setting;
use crate::tradeoff::{Measurement, TradeoffOptions, measure, program_key};

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
    Fusion(FusionArgs),
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

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint tradeoff fusion kitchen.glint -o tradeoff --glintd target/release/glintd"
)]
struct FusionArgs {
    /// Recordings with poses `source`, which are taken as right.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Folder for fusion.csv, fusion.svg, fusion.html and fusion.points.jsonl, with several recordings a folder in
    /// it for each, by its name; a measurement that is in it goes on.
    #[arg(short, long)]
    output: PathBuf,
    /// The recorder; when absent the one beside this program, else the one on PATH.
    #[arg(long, value_name = "PATH")]
    glintd: Option<PathBuf>,
    /// Mesh (PLY) of the true shape in the world of the poses `source`; when absent that of a run that spares nothing.
    #[arg(long, value_name = "PLY")]
    reference_mesh: Option<PathBuf>,
    #[command(flatten)]
    run: RunArgs,
}

pub(super) fn run(args: &TradeoffArgs, progress: &Progress) -> anyhow::Result<Summary> {
    match &args.subject {
        SubjectArgs::Codec(args) => run_codec(args, progress),
        SubjectArgs::Fusion(args) => run_fusion(args, progress),
    }
}

fn run_codec(args: &CodecArgs, progress: &Progress) -> anyhow::Result<Summary> {
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
    let options = TradeoffOptions {
        output: args.output.clone(),
        scene: format!("{}, {} pairs", stem(&args.recording), args.pairs),
        scene_blake3: recording.content_hash().to_string(),
        program,
        repetitions: args.run.repetitions,
        seed: args.run.seed,
        timeout: Duration::from_secs(args.run.timeout_s),
    };
    drop(recording);
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, &args.output))
}

fn run_fusion(args: &FusionArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let program = match &args.glintd {
        Some(path) => path.clone(),
        None => find_recorder()?,
    };
    let [first, others @ ..] = &args.recordings[..] else {
        bail!("give a recording");
    };
    if others.is_empty() {
        return fusion_of(first, &args.output, &program, args, progress);
    }
    ensure!(
        args.reference_mesh.is_none(),
        "--reference-mesh is of one recording, here are {}; measure them one by one",
        args.recordings.len()
    );
    let mut names: Vec<String> = args.recordings.iter().map(|path| stem(path)).collect();
    names.sort();
    if let Some([twin, _]) = names.array_windows().find(|[a, b]| a == b) {
        bail!("two recordings are named `{twin}`: their results would have one folder; rename one");
    }
    let mut text = String::new();
    let mut parts = Vec::new();
    for recording in &args.recordings {
        let folder = args.output.join(stem(recording));
        let part = fusion_of(recording, &folder, &program, args, progress)?;
        text += &format!("{}:\n{}\n", stem(recording), part.text);
        parts.push(part.json);
    }
    let json = json!({"subject": fusion::SUBJECT.name, "recordings": parts});
    Ok(Summary::whole(text.trim_end().to_owned(), json))
}

/// Measures one recording, with its results in `output`.
fn fusion_of(
    path: &Path,
    output: &Path,
    program: &Path,
    args: &FusionArgs,
    progress: &Progress,
) -> anyhow::Result<Summary> {
    let recording = Recording::open(path)?;
    ensure!(
        recording.poses("source").is_some(),
        "{} has no poses `source`, by which the tracked path is judged; give a recording that has",
        path.display()
    );
    let options = TradeoffOptions {
        output: output.to_owned(),
        scene: format!("{}, {} pairs", stem(path), recording.frame_count()),
        scene_blake3: recording.content_hash().to_string(),
        program: program.to_owned(),
        repetitions: args.run.repetitions,
        seed: args.run.seed,
        timeout: Duration::from_secs(args.run.timeout_s),
    };
    drop(recording);
    let mut runner = FusionRunner {
        subject: fusion::SUBJECT,
        flags: fusion::FLAGS,
        program: program.to_owned(),
        recording: path.to_owned(),
        mesh: None,
        judged_meshes: fusion::JudgedMeshes::default(),
    };
    runner.mesh = Some(match &args.reference_mesh {
        Some(mesh) => mesh.clone(),
        None => careful_mesh(
            &runner,
            output,
            &program_key(&options)?,
            options.timeout,
            progress,
        )?,
    });
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, output))
}

/// `glintd` beside this program, else on PATH.
fn find_recorder() -> anyhow::Result<PathBuf> {
    let program = std::env::current_exe().context("cannot find this program again")?;
    let beside = program.parent().map(Path::to_owned);
    let on_path = std::env::var_os("PATH").unwrap_or_default();
    let folders = beside.into_iter().chain(std::env::split_paths(&on_path));
    let mut found = folders.map(|folder| folder.join("glintd"));
    found
        .find(|path| path.is_file())
        .context("there is no glintd beside this program nor on PATH; give it with --glintd PATH")
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
