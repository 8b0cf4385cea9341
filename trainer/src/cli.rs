//! The command line: one definition of every flag, and exit codes.
//!
//! 0 success · 2 the user's input cannot be used, with one sentence · 3 done, but part of the input is lost,
//! with a list · 101 a bug.

mod eval;
mod render;
mod simulate;
mod tradeoff;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::{Args, Parser, Subcommand, ValueEnum};
use effects::{Effect, EffectRequests, EffectsFile, Request};
use serde_json::json;

use crate::budget::parse_budget;
use crate::effects::EFFECTS_FILE;
use crate::export::{ExportOptions, ExportTarget, LostData, export};
use crate::import::{ImportFormat, ImportOptions, import};
use crate::progress::Progress;
use crate::report;
use crate::run_folder::RunFolder;
use crate::stages::linear::{DiffuseOrder, MAP_HEIGHTS, SRM_HEIGHT};
use crate::stages::object::WorldBox;
use crate::stages::poses::{REFINED, default_set};
use crate::train::{TrainConfig, explain, train};

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
    Train(TrainArgs),
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
    /// Folder with the frames.
    input: PathBuf,
    /// Recording to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Layout of the folder; recognised when absent.
    #[arg(long, value_enum)]
    format: Option<ImportFormat>,
    /// Rig file (TOML); `rig.toml` in the folder when absent.
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Split file (JSON: train, unused, test, numbered as for --range); `split.json` in the folder when
    /// absent, else all train.
    #[arg(long)]
    split: Option<PathBuf>,
    /// Frames A..B (B excluded), by the numbers in their names; in TUM folders depth images by position,
    /// from 0.
    #[arg(long, value_parser = parse_range)]
    range: Option<std::ops::Range<usize>>,
    /// Replace the recording if it exists.
    #[arg(long)]
    overwrite: bool,
}

/// A point on the line from fast to accurate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Profile {
    /// Minutes, no networks.
    Draft,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glint train recordings/two-cans.glint -o run --profile draft")]
struct TrainArgs {
    /// The recording.
    recording: PathBuf,
    /// Run folder to make.
    #[arg(short, long, required_unless_present = "dry_run")]
    output: Option<PathBuf>,
    /// Profile.
    #[arg(long, value_enum, default_value = "draft")]
    profile: Profile,
    /// Poses to train from: source, live, another set of the recording, or refined, which starts from live (else
    /// source) and makes them fit each other; when absent `source` if there is one, else live, refined if the
    /// recording calls for it.
    #[arg(long)]
    poses: Option<String>,
    /// Effects that are computed: +id, -id, auto:id, all, none or auto, with commas between; the rest is decided by
    /// what the recording shows.
    #[arg(
        long,
        default_value = "",
        hide_default_value = true,
        allow_hyphen_values = true
    )]
    effects: EffectRequests,
    /// Say for every effect what was decided, by what, and what it costs.
    #[arg(long)]
    explain: bool,
    /// With --explain: survey and bounds only, nothing is trained or written.
    #[arg(long, requires = "explain")]
    dry_run: bool,
    /// Box that holds the object: x0,y0,z0,x1,y1,z1 in world metres.
    #[arg(long = "box", value_parser = parse_box, allow_hyphen_values = true)]
    object_box: Option<WorldBox>,
    /// Voxel edge of the mesh, millimetres.
    #[arg(long, default_value_t = 2.0, value_parser = parse_voxel)]
    voxel_mm: f64,
    /// Use every Nth pixel in x and y.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    pixel_stride: u32,
    /// Rows of the specular map, which is twice as wide.
    #[arg(long, default_value_t = SRM_HEIGHT, value_parser = parse_map_height)]
    map_height: u32,
    /// Use every Nth training frame.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frame_stride: u32,
    /// Core-seconds that training may take (90s, 5min, 1h): the measured setting that errs least of those that fit
    /// is taken, and gives way where it would take longer.
    #[arg(long, value_parser = parse_budget,
        conflicts_with_all = ["voxel_mm", "pixel_stride", "map_height", "frame_stride", "effects"])]
    budget: Option<f64>,
    /// What is done with the diffuse texture.
    #[arg(long, value_enum, default_value = "joint")]
    diffuse: DiffuseOrder,
    /// Seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Replace a run that is in the folder.
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

fn parse_voxel(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.5..=50.0).contains(&value) => Ok(value),
        _ => Err(format!(
            "`{text}` is no voxel size: give millimetres from 0.5 to 50"
        )),
    }
}

fn parse_map_height(text: &str) -> Result<u32, String> {
    let height = text
        .parse()
        .ok()
        .filter(|height| MAP_HEIGHTS.contains(height));
    height.ok_or_else(|| {
        let (least, most) = (MAP_HEIGHTS.start(), MAP_HEIGHTS.end());
        format!("`{text}` is no height of a map: give {least} to {most} rows")
    })
}

fn parse_box(text: &str) -> Result<WorldBox, String> {
    let values: Vec<f64> = text
        .split(',')
        .map(|value| value.trim().parse::<f64>())
        .collect::<Result<_, _>>()
        .map_err(|_| format!("`{text}` is no box: write x0,y0,z0,x1,y1,z1 in metres"))?;
    let [x0, y0, z0, x1, y1, z1] = values[..] else {
        return Err(format!(
            "a box has 6 numbers (x0,y0,z0,x1,y1,z1), here are {}",
            values.len()
        ));
    };
    if !(x0 < x1 && y0 < y1 && z0 < z1) {
        return Err(format!(
            "`{text}` is an empty box: each first corner must be below the second"
        ));
    }
    Ok(WorldBox {
        low: [x0, y0, z0],
        high: [x1, y1, z1],
    })
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
        Command::Train(args) => run_train(args, threads, &progress),
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
    let json = serde_json::to_value(&report)?;
    Ok(Summary::whole(report.to_string(), json))
}

fn run_train(args: &TrainArgs, threads: usize, progress: &Progress) -> anyhow::Result<Summary> {
    let Profile::Draft = args.profile;
    // The recording is looked at before the folder is touched.
    let recording = sequence::Recording::open(&args.recording)?;
    let poses = args.poses.clone();
    let poses = poses.unwrap_or_else(|| default_set(&recording).to_owned());
    drop(recording);
    let config = TrainConfig {
        recording: args.recording.clone(),
        profile: "draft".to_owned(),
        poses,
        voxel_mm: args.voxel_mm,
        pixel_stride: args.pixel_stride,
        map_height: args.map_height,
        frame_stride: args.frame_stride,
        diffuse: args.diffuse,
        object_box: args.object_box,
        effects: asked_effects(args)?,
        seed: args.seed,
        threads,
    };
    if args.dry_run {
        let file = explain(&config, progress)?;
        return Ok(Summary::whole(
            explained(&file),
            serde_json::to_value(&file)?,
        ));
    }
    let output = args.output.as_ref().context("give a run folder with -o")?;
    let folder = RunFolder::create(output, args.overwrite)?;
    let summary = train(&config, &folder, progress)?;
    let mut text = format!(
        "{}\n{} frames, {} triangles, {} rows; {:.1} % of the panorama claimed; {:.1} s wall, {:.1} core-seconds\n{}",
        summary.sentence,
        summary.frames,
        summary.triangles,
        summary.rows,
        100.0 * summary.claimed_fraction,
        summary.cost.wall_s,
        summary.cost.core_s,
        output.display(),
    );
    if args.explain {
        let file: EffectsFile = folder.read_json(EFFECTS_FILE)?;
        text = format!("{}\n{text}", explained(&file));
    }
    Ok(Summary::whole(text, serde_json::to_value(&summary)?))
}

/// The effects asked for; poses that are named say whether they are refined.
fn asked_effects(args: &TrainArgs) -> anyhow::Result<EffectRequests> {
    let wish = args.effects.of(Effect::PoseRefinement);
    match args.poses.as_deref() {
        Some(REFINED) if wish == Request::Off => bail!(
            "--poses {REFINED} and --effects -{} contradict each other: leave one out",
            Effect::PoseRefinement
        ),
        Some(set) if wish == Request::Auto => {
            let sign = if set == REFINED { '+' } else { '-' };
            let effects = format!("{},{sign}{}", args.effects, Effect::PoseRefinement);
            Ok(effects.trim_start_matches(',').parse()?)
        }
        Some(_) | None => Ok(args.effects.clone()),
    }
}

/// One line for each effect, and the warnings.
fn explained(file: &EffectsFile) -> String {
    let lines = file.effects.iter().map(effects::explain::line);
    let warnings = file.warnings.iter().map(|text| format!("note: {text}"));
    lines.chain(warnings).collect::<Vec<_>>().join("\n")
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
