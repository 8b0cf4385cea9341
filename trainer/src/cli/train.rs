//! `glint train`: its flags.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use effects::{Effect, EffectRequests, EffectsFile, Request};

use super::Summary;
use crate::budget::{Pacer, SAFETY, Spent, Target, parse_budget, plan, tables};
use crate::effects::EFFECTS_FILE;
use crate::progress::Progress;
use crate::run_folder::RunFolder;
use crate::stages::linear::{DiffuseOrder, MAP_HEIGHTS, SRM_HEIGHT};
use crate::stages::object::WorldBox;
use crate::stages::poses::{REFINED, default_set};
use crate::train::{TrainConfig, explain, require_colors, train_paced};

/// A point on the line from fast to accurate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Profile {
    /// Minutes, no networks.
    Draft,
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glint train recordings/two-cans.glint -o run --profile draft")]
pub(super) struct TrainArgs {
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

pub(super) fn run(
    args: &TrainArgs,
    threads: usize,
    progress: &Progress,
) -> anyhow::Result<Summary> {
    let Profile::Draft = args.profile;
    // The recording is looked at before the folder is touched.
    let recording = sequence::Recording::open(&args.recording)?;
    require_colors(&recording)?;
    let poses = args.poses.clone();
    let poses = poses.unwrap_or_else(|| default_set(&recording).to_owned());
    let target = match args.budget {
        Some(_) => Some(Target::measured(&recording)?),
        None => None,
    };
    drop(recording);
    let mut config = TrainConfig {
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
    // Before the folder is touched: a budget may be too small.
    let pacer = match (args.budget, target) {
        (Some(budget_s), Some(target)) => Some(paced(budget_s, target, &mut config)?),
        _ => None,
    };
    let folder = RunFolder::create(output, args.overwrite)?;
    let summary = train_paced(&config, &folder, pacer.as_ref(), progress)?;
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
    let mut json = serde_json::to_value(&summary)?;
    if let Some(pacer) = &pacer {
        let spent = Spent::of(pacer);
        text = format!("{text}\n{spent}");
        json["budget"] = serde_json::to_value(&spent)?;
        folder.write_json("budget.json", &spent)?;
    }
    Ok(Summary::whole(text, json))
}

/// Makes the plan for a budget, takes its setting, and gives what keeps to it.
fn paced(budget_s: f64, target: Target, config: &mut TrainConfig) -> anyhow::Result<Pacer> {
    let plan = plan(&tables()?, &target, budget_s)?;
    plan.chosen.apply(config)?;
    tracing::info!(
        "budget: {budget_s:.0} core-seconds buy {}, planned {:.1}, {:.1} with its reserve",
        plan.chosen.name,
        plan.chosen.core_s,
        SAFETY * plan.chosen.core_s
    );
    Ok(Pacer::new(plan))
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
