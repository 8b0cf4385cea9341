//! `glint tradeoff srm`.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::Args;
use sequence::Recording;

use super::super::Summary;
use super::{RunArgs, child_threads, stem, summary, this_program};
use crate::progress::Progress;
use crate::tradeoff::srm::SrmRunner;
use crate::tradeoff::{TradeoffOptions, measure};

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint tradeoff srm recordings/two-cans.glint --truth recordings/two-cans/truth --threads 1 -o tradeoff"
)]
pub(super) struct SrmArgs {
    /// The recording, with poses `source`.
    recording: PathBuf,
    /// Folder for srm.csv, srm.svg, srm.html and srm.points.jsonl; a measurement that is in it goes on.
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    truth: TruthArgs,
    #[command(flatten)]
    run: RunArgs,
}

/// What a map is judged by; training does not get it.
#[derive(Debug, Args)]
pub(super) struct TruthArgs {
    /// Folder with environment.exr and reach.exr; `masks` beside it or in it gives the object's masks.
    #[arg(long)]
    pub(super) truth: Option<PathBuf>,
    /// GGX width of the lobe that dominates the map.
    #[arg(long, default_value_t = 0.02)]
    pub(super) truth_alpha: f64,
}

impl TruthArgs {
    /// The folder of masks that goes with the truth, if there is one.
    pub(super) fn masks(&self) -> Option<PathBuf> {
        let truth = self.truth.as_ref()?;
        [truth.join("masks"), truth.join("../masks")]
            .into_iter()
            .find(|folder| folder.is_dir())
    }
}

pub(super) fn run(args: &SrmArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let (runner, options) = srm(&args.recording, &args.truth, &args.output, &args.run)?;
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, &args.output))
}

/// Runner and options of `srm`.
pub(super) fn srm(
    path: &Path,
    truth: &TruthArgs,
    output: &Path,
    run: &RunArgs,
) -> anyhow::Result<(SrmRunner, TradeoffOptions)> {
    let recording = Recording::open(path)?;
    ensure!(
        recording.poses("source").is_some(),
        "{} has no poses `source`, in whose world the truth is; give a recording that has",
        path.display()
    );
    let Some(folder) = &truth.truth else {
        bail!("give the true room with --truth: a folder with environment.exr and reach.exr");
    };
    ensure!(
        truth.truth_alpha > 0.0 && truth.truth_alpha <= 1.0,
        "--truth-alpha {} is no GGX width: give a value above 0 and up to 1",
        truth.truth_alpha
    );
    ensure!(
        folder.join("environment.exr").is_file(),
        "{} holds no environment.exr",
        folder.display()
    );
    let program = this_program()?;
    let options = run.options(
        output,
        format!("{}, {} pairs", stem(path), recording.frame_count()),
        recording.content_hash().to_string(),
        &program,
    );
    let runner = SrmRunner {
        program,
        recording: path.to_owned(),
        truth: folder.clone(),
        truth_alpha: truth.truth_alpha,
        masks: truth.masks(),
        threads: child_threads(),
        judged: Default::default(),
    };
    Ok((runner, options))
}
