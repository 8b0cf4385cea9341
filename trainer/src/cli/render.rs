//! `glint render`: its flags.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::Summary;
use crate::progress::Progress;
use crate::render::painter::{DrawnModel, Scale};
use crate::render::{RenderOptions, ViewPath, render};
use crate::run_folder::RunFolder;

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  glint render run --path recorded -o views")]
pub(super) struct RenderArgs {
    /// The run folder.
    run: PathBuf,
    /// `recorded`, `test` (the held-out frames), or a TUM file of poses (world from colour camera).
    #[arg(long)]
    path: ViewPath,
    /// Folder for the pictures.
    #[arg(short, long)]
    output: PathBuf,
    /// Size over that of the photographs.
    #[arg(long, value_enum, default_value = "1")]
    scale: Scale,
    /// Samples of a pixel.
    #[arg(long, default_value_t = 1, value_parser = parse_samples)]
    samples: u32,
    /// What is drawn.
    #[arg(long, value_enum, default_value = "composition")]
    model: DrawnModel,
    /// Draw as the camera would have coded it, with vignetting and response; when absent plain sRGB.
    #[arg(long)]
    camera: bool,
}

fn parse_samples(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "4" => Ok(4),
        _ => Err(format!(
            "`{text}` is no number of samples: give 1 or 4 a pixel"
        )),
    }
}

pub(super) fn run(args: &RenderArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let folder = RunFolder::open(&args.run)?;
    let options = RenderOptions {
        scale: args.scale,
        samples: args.samples,
        model: args.model,
        camera: args.camera,
    };
    let drawn = render(&folder, &args.path, &args.output, &options, progress)?;
    let text = format!(
        "{} pictures in {}; {:.1} core-ms a picture, {:.1} core-seconds before the first",
        drawn.pictures,
        args.output.display(),
        drawn.draw_core_ms,
        drawn.prep_core_s
    );
    let mut json = serde_json::to_value(drawn)?;
    json["output"] = json!(args.output);
    Ok(Summary::whole(text, json))
}
