//! `glint tradeoff render`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::super::Summary;
use super::{RunArgs, child_threads, stem, summary, this_program};
use crate::progress::Progress;
use crate::run_folder::RunFolder;
use crate::tradeoff::render::{RenderRunner, content_hash};
use crate::tradeoff::{TradeoffOptions, measure};

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint tradeoff render run --masks recordings/two-cans/masks --threads 1 -o tradeoff"
)]
pub(super) struct RenderArgs {
    /// The run folder; its recording has held-out frames.
    run: PathBuf,
    /// Folder for render.csv, render.svg, render.html and render.points.jsonl; a measurement that is in it goes on.
    #[arg(short, long)]
    output: PathBuf,
    /// Folder with the object's masks (NNNNNN.png, 1 bit); when absent the shiny segments are the mask.
    #[arg(long)]
    masks: Option<PathBuf>,
    #[command(flatten)]
    measuring: RunArgs,
}

pub(super) fn run(args: &RenderArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let masks = args.masks.clone();
    let (runner, options) = render(&args.run, masks, &args.output, &args.measuring)?;
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, &args.output))
}

/// Runner and options of `render`.
pub(super) fn render(
    run: &Path,
    masks: Option<PathBuf>,
    output: &Path,
    measuring: &RunArgs,
) -> anyhow::Result<(RenderRunner, TradeoffOptions)> {
    let program = this_program()?;
    let recording = RunFolder::open(run)?.manifest()?.recording;
    let options = measuring.options(
        output,
        format!("a run of {}", stem(&recording)),
        content_hash(run)?,
        &program,
    );
    let runner = RenderRunner::open(program, run.to_owned(), masks, child_threads())?;
    Ok((runner, options))
}
