//! `glint simulate`.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use effects::EffectRequests;
use serde_json::json;

use super::Summary;
use crate::progress::Progress;
use crate::simulate::{SimulateOptions, Switches, simulate, truth_folder};

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint simulate mirror-ball -o ball.glint\n  glint train ball.glint -o run\n  glint eval run --truth ball.truth\n\n`glint simulate list` prints all scenes."
)]
pub(super) struct SimulateArgs {
    /// Name of the scene, or `list`.
    scene: String,
    /// Recording to write; its truth goes into a folder beside it, `x.truth` for `x.glint`.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Frames over the whole path; the scene's own number when absent.
    #[arg(long, value_parser = clap::value_parser!(u32).range(4..=100_000))]
    frames: Option<u32>,
    /// Width of the images, a multiple of 4; the height is three quarters of it.
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(32..=1920))]
    width: u32,
    /// Seed of all noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Effects that are simulated: +id, -id, auto:id (as the scene has it), all, none, separated by commas.
    /// Without saturation all light is dimmed to below the white level; pose-refinement stands for wrong poses.
    #[arg(long, default_value = "", allow_hyphen_values = true)]
    effects: EffectRequests,
    /// Panorama (EXR, linear, 1.0 = white level) in place of the room.
    #[arg(long)]
    environment: Option<PathBuf>,
    /// Seconds from the first row of the colour sensor to the last.
    #[arg(long, default_value_t = 0.0, value_parser = parse_seconds)]
    rolling_shutter: f64,
    /// Seconds that a row of the colour sensor sees.
    #[arg(long, default_value_t = 0.0, value_parser = parse_seconds)]
    motion_blur: f64,
    /// The person who films is seen in the reflections.
    #[arg(long)]
    operator: bool,
    /// Deviation of the recorded poses: millimetres and degrees, as 2,0.2.
    #[arg(long, value_parser = parse_pose_noise)]
    pose_noise: Option<[f64; 2]>,
    /// Deviation of the surface that the depth sensor meets, millimetres.
    #[arg(long, value_parser = parse_millimetres)]
    mesh_noise: Option<f64>,
    /// Factor of the surface that the depth sensor meets.
    #[arg(long, value_parser = parse_scale)]
    mesh_scale: Option<f64>,
    /// Write the truth of every Nth frame as pictures.
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    truth_every: u32,
    /// Replace the recording and its truth if they exist.
    #[arg(long)]
    overwrite: bool,
}

fn number(text: &str, range: std::ops::RangeInclusive<f64>, what: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if range.contains(&value) => Ok(value),
        _ => Err(format!(
            "`{text}` is no {what}: give a number from {} to {}",
            range.start(),
            range.end()
        )),
    }
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    number(text, 0.0..=1.0, "time in seconds")
}

fn parse_millimetres(text: &str) -> Result<f64, String> {
    number(text, 0.0..=50.0, "deviation in millimetres")
}

fn parse_scale(text: &str) -> Result<f64, String> {
    number(text, 0.5..=2.0, "factor")
}

fn parse_pose_noise(text: &str) -> Result<[f64; 2], String> {
    let (millimetres, degrees) = text
        .split_once(',')
        .ok_or_else(|| format!("`{text}` is no pose noise: write millimetres,degrees"))?;
    Ok([
        parse_millimetres(millimetres)?,
        number(degrees, 0.0..=20.0, "deviation in degrees")?,
    ])
}

/// Films the scene, or prints all.
pub(super) fn run(args: &SimulateArgs, progress: &Progress) -> anyhow::Result<Summary> {
    if args.scene == "list" {
        return list();
    }
    let Some(output) = &args.output else {
        bail!("give a name for the recording with -o");
    };
    for path in [output.clone(), truth_folder(output)] {
        if path.exists() && !args.overwrite {
            bail!(
                "{} exists: give another name with -o, or --overwrite to replace it",
                path.display()
            );
        }
    }
    let options = SimulateOptions {
        scene: args.scene.clone(),
        output: output.clone(),
        frame_count: args.frames,
        width: args.width,
        seed: args.seed,
        effects: args.effects.clone(),
        environment: args.environment.clone(),
        switches: Switches {
            readout: args.rolling_shutter,
            exposure: args.motion_blur,
            has_operator: args.operator,
            pose_noise: args.pose_noise,
            mesh_noise_mm: args.mesh_noise,
            mesh_scale: args.mesh_scale,
        },
        truth_every: args.truth_every,
        may_replace: args.overwrite,
    };
    progress.stage("simulate");
    let report = simulate(&options, &mut |done, of| progress.step(done, of))?;
    let text = format!(
        "{}: {} frames ({} train, {} unused, {} test), effects {}; {:.1} s wall, {:.1} core-seconds\n{}",
        output.display(),
        report.frame_count,
        report.train_count,
        report.unused_count,
        report.test_count,
        report.effects,
        report.cost.wall_s,
        report.cost.core_s,
        report.truth.display(),
    );
    Ok(Summary::whole(text, serde_json::to_value(&report)?))
}

fn list() -> anyhow::Result<Summary> {
    let mut lines = Vec::new();
    let mut scenes = Vec::new();
    for name in scene::catalogue::names() {
        let design = scene::catalogue::design(name)?;
        lines.push(format!(
            "{name:15} {:4} frames  {}",
            design.split.count(),
            design.about
        ));
        scenes.push(json!({"name": name, "frames": design.split.count(), "about": design.about}));
    }
    Ok(Summary::whole(lines.join("\n"), json!({"scenes": scenes})))
}
