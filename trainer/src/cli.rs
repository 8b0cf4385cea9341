//! The command line: one definition of every flag, and exit codes.
//!
//! 0 success · 2 the user's input cannot be used, with one sentence · 3 done, but part of the input is lost,
//! with a list · 101 a bug.

mod eval;
mod render;
mod simulate;
mod tradeoff;
mod train;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, Parser, Subcommand};
use serde_json::json;

use crate::export::{ExportOptions, ExportTarget, LostData, export};
use crate::import::{ImportFormat, ImportOptions, import};
use crate::progress::Progress;
use crate::report;
use crate::run_folder::RunFolder;

/// Finds the room in the reflections of a shiny object filmed with an RGB-D camera.
#[derive(Debug, Parser)]
#[command(
    name = "glint",
    version,
    about,
    after_help = "Example:\n  glint train recordings/two-cans.glint -o run\n  glint report run"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print one JSON event a line on standard output; the last is the summary.
    #[arg(long, global = true)]
    json: bool,
    /// Worker threads; the results do not depend on them. Default: all processors.
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a recording from a folder of frames (7-Scenes, TUM RGB-D, or a plain folder) with a rig file.
    Import(ImportArgs),
    /// Film a scene that does not exist: a recording, and its truth beside it.
    Simulate(simulate::SimulateArgs),
    /// Rebuild shape and specular map from a recording's training frames.
    Train(train::TrainArgs),
    /// Measure a run: room, held-out photographs, camera path, shape; or the camera path of a recording.
    Eval(eval::EvalArgs),
    /// Measure what accuracy costs in time, one knob at a time; goes on where it was stopped.
    Tradeoff(tradeoff::TradeoffArgs),
    /// Write one self-contained page about a run.
    Report(ReportArgs),
    /// Draw the object from a path of views.
    Render(render::RenderArgs),
    /// Write frames, trajectory, mesh or map for other programs.
    Export(ExportArgs),
}

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint import captures/kitchen --rig recordings/redkitchen-rig.toml --range 122..222 -o kitchen.glint"
)]
struct ImportArgs {
    /// Folder with the frames, or a recording of OpenNI (.oni).
    input: PathBuf,
    /// Recording to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Layout of the input; recognised when absent.
    #[arg(long, value_enum)]
    format: Option<ImportFormat>,
    /// Rig file (TOML); when absent, `rig.toml` in the folder, or the nominal cameras of the recording of OpenNI.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Split file (JSON: train, unused, test, numbered as for --range); `split.json` in the folder when
    /// absent, else all train.
    #[arg(long)]
    split: Option<PathBuf>,
    /// Frames A..B (B excluded), by the numbers in their names; in TUM folders and recordings of OpenNI depth images by
    /// position, from 0.
    #[arg(long, value_parser = parse_range)]
    range: Option<std::ops::Range<usize>>,
    /// Replace the recording if it exists.
    #[arg(long)]
    overwrite: bool,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glint report run -o report.html")]
struct ReportArgs {
    /// The run folder.
    run: PathBuf,
    /// The page; `report.html` in the run folder when absent.
    #[arg(short, long)]
    output: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint export recordings/two-cans.glint --to tum-trajectory -o poses.txt"
)]
struct ExportArgs {
    /// A recording (frames, trajectory, points) or a run folder (mesh, map).
    input: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    to: ExportTarget,
    /// File or new folder to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Pose set that is written: source, live, refined; when absent `source`, if there is one.
    #[arg(long)]
    poses: Option<String>,
    /// Pair that becomes points with --to ply; the middle one when absent.
    #[arg(long)]
    frame: Option<usize>,
}

fn parse_range(text: &str) -> Result<std::ops::Range<usize>, String> {
    let wrong = || format!("`{text}` is no range: write A..B with A below B");
    let (start, end) = text.split_once("..").ok_or_else(wrong)?;
    let (start, end) = (
        start.parse().map_err(|_| wrong())?,
        end.parse().map_err(|_| wrong())?,
    );
    if start < end {
        Ok(start..end)
    } else {
        Err(wrong())
    }
}

/// Parses the arguments, runs the command and gives the exit code.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    let level = if cli.json {
        tracing::Level::WARN
    } else {
        tracing::Level::INFO
    };
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .with_max_level(level)
        .init();
    match execute(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if let Some(lost) = error.downcast_ref::<LostData>() {
                // After the summary, which has the list too: it is the last event.
                eprintln!("glint: {lost}:\n  {}", lost.missing.join("\n  "));
                return ExitCode::from(3);
            }
            if cli.json {
                println!(
                    "{}",
                    json!({"event": "error", "message": format!("{error:#}")})
                );
            }
            eprintln!("glint: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn execute(cli: &Cli) -> anyhow::Result<()> {
    crate::interrupt::listen().context("cannot listen for signals")?;
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = cli.threads.map_or(available, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    let progress = Progress::new();
    let summary = pool.install(|| match &cli.command {
        Command::Import(args) => run_import(args, &progress),
        Command::Simulate(args) => simulate::run(args, &progress),
        Command::Train(args) => train::run(args, threads, &progress),
        Command::Eval(args) => eval::run(args, &progress),
        Command::Tradeoff(args) => tradeoff::run(args, &progress),
        Command::Report(args) => run_report(args),
        Command::Render(args) => render::run(args, &progress),
        Command::Export(args) => run_export(args, &progress),
    });
    progress.finish();
    let Summary {
        text,
        json: value,
        missing,
    } = summary?;
    if cli.json {
        let mut event = json!({"event": "summary"});
        if let (Some(event), Some(value)) = (event.as_object_mut(), value.as_object()) {
            event.extend(value.clone());
        }
        println!("{event}");
    } else {
        println!("{text}");
    }
    if missing.is_empty() {
        Ok(())
    } else {
        Err(LostData { missing }.into())
    }
}

/// What a command did.
struct Summary {
    text: String,
    json: serde_json::Value,
    /// What was lost of its input, a line each.
    missing: Vec<String>,
}

impl Summary {
    fn whole(text: String, json: serde_json::Value) -> Self {
        Self {
            text,
            json,
            missing: Vec::new(),
        }
    }
}

fn run_import(args: &ImportArgs, progress: &Progress) -> anyhow::Result<Summary> {
    if args.output.exists() && !args.overwrite {
        bail!(
            "{} exists: give another name with -o, or --overwrite to replace it",
            args.output.display()
        );
    }
    let options = ImportOptions {
        input: args.input.clone(),
        output: args.output.clone(),
        format: args.format,
        rig: args.rig.clone(),
        split: args.split.clone(),
        range: args.range.clone(),
    };
    progress.stage("import");
    let report = import(&options, &mut |done, of| progress.step(done, of))?;
    Ok(Summary {
        json: serde_json::to_value(&report)?,
        text: report.to_string(),
        missing: report.missing,
    })
}

fn run_report(args: &ReportArgs) -> anyhow::Result<Summary> {
    let folder = RunFolder::open(&args.run)?;
    let output = args
        .output
        .clone()
        .unwrap_or_else(|| folder.path("report.html"));
    let bytes = report::write(&folder, &output)?;
    let text = format!("{} ({bytes} bytes)", output.display());
    Ok(Summary::whole(
        text,
        json!({"report": output, "bytes": bytes}),
    ))
}

fn run_export(args: &ExportArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let options = ExportOptions {
        input: args.input.clone(),
        target: args.to,
        output: args.output.clone(),
        poses: args.poses.clone(),
        frame: args.frame,
    };
    progress.stage("export");
    let report = export(&options, &mut |done, of| progress.step(done, of))?;
    Ok(Summary {
        json: json!({"output": args.output, "wrote": report.text, "missing": report.missing}),
        text: report.text,
        missing: report.missing,
    })
}
