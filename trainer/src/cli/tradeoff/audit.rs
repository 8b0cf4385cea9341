//! `glint tradeoff audit`.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::json;

use super::super::Summary;
use super::srm::TruthArgs;
use super::{RunArgs, codec, fusion, render, srm};
use crate::progress::Progress;
use crate::tradeoff::audit::{AuditRecord, audit};
use crate::tradeoff::subject::PointRunner;
use crate::tradeoff::{TradeoffOptions, has_table};

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint tradeoff audit tradeoff --rows 3 --seed 7 --recording recordings/two-cans.glint --truth recordings/two-cans/truth"
)]
pub(super) struct AuditArgs {
    /// Folder with tables and their points.jsonl.
    folder: PathBuf,
    /// Rows of each table that are run again.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rows: u32,
    /// Seed of the choice.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The recording that codec, fusion and srm were measured on.
    #[arg(long)]
    recording: Option<PathBuf>,
    /// The run folder that render was measured on.
    #[arg(long)]
    run: Option<PathBuf>,
    #[command(flatten)]
    truth: TruthArgs,
    /// Masks that render was judged with.
    #[arg(long)]
    masks: Option<PathBuf>,
    /// Pairs that codec was measured with.
    #[arg(long, default_value_t = 120)]
    pairs: u32,
    /// The recorder of fusion.
    #[arg(long, value_name = "PATH")]
    glintd: Option<PathBuf>,
    /// Mesh that fusion was compared with.
    #[arg(long, value_name = "PLY")]
    reference_mesh: Option<PathBuf>,
    /// Longest time of a run, seconds.
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..))]
    timeout_s: u64,
}

/// Subjects in the order in which they are audited.
const SUBJECTS: [&str; 4] = ["codec", "fusion", "srm", "render"];

pub(super) fn run(args: &AuditArgs, progress: &Progress) -> anyhow::Result<Summary> {
    let found = SUBJECTS.into_iter();
    let found: Vec<&str> = found
        .filter(|subject| has_table(&args.folder, subject))
        .collect();
    if found.is_empty() {
        bail!(
            "{} holds no points.jsonl of any subject: `glint tradeoff` writes it beside its table",
            args.folder.display()
        );
    }
    let mut audits: Vec<(&str, AuditRecord)> = Vec::new();
    for subject in found {
        progress.stage(subject);
        let (runner, options) = prepared(subject, args, progress)
            .with_context(|| format!("the table of {subject} cannot be audited"))?;
        let audit = audit(runner.as_ref(), &options, args.rows as usize)?;
        audits.push((subject, audit));
    }
    let bad: Vec<String> = audits
        .iter()
        .flat_map(|(subject, audit)| {
            let rows = audit.disagreements().into_iter();
            rows.map(move |row| format!("{subject} {row}"))
        })
        .collect();
    if !bad.is_empty() {
        bail!(
            "{} rows do not agree with what is in {}:\n  {}",
            bad.len(),
            args.folder.display(),
            bad.join("\n  ")
        );
    }
    let lines = audits.iter();
    let lines: Vec<String> = lines
        .map(|(subject, audit)| format!("{subject}: {}", audit.sentence()))
        .collect();
    let json = json!({
        "audits": audits.iter().map(|(subject, audit)| json!({"subject": subject, "audit": audit}))
            .collect::<Vec<_>>(),
    });
    Ok(Summary::whole(lines.join("\n"), json))
}

/// Runner and options as the measurement had them.
fn prepared(
    subject: &str,
    args: &AuditArgs,
    progress: &Progress,
) -> anyhow::Result<(Box<dyn PointRunner>, TradeoffOptions)> {
    let measuring = RunArgs {
        repetitions: 1,
        seed: args.seed,
        timeout_s: args.timeout_s,
    };
    let recording = || -> anyhow::Result<&Path> {
        let recording = args.recording.as_deref();
        recording.context("give the recording that it was measured on with --recording")
    };
    Ok(match subject {
        "codec" => {
            let (runner, options) = codec(recording()?, args.pairs, &args.folder, &measuring)?;
            (Box::new(runner), options)
        }
        "fusion" => {
            let program = args.glintd.clone().map_or_else(fusion::find_recorder, Ok)?;
            let options = fusion::options(recording()?, &args.folder, &program, &measuring)?;
            let mesh = args.reference_mesh.as_deref();
            let runner = fusion::prepared(recording()?, mesh, &program, &options, progress)?;
            (Box::new(runner), options)
        }
        "srm" => {
            let (runner, options) = srm::srm(recording()?, &args.truth, &args.folder, &measuring)?;
            (Box::new(runner), options)
        }
        _ => {
            let run = args.run.as_deref();
            let run = run.context("give the run folder that it was measured on with --run")?;
            let masks = args.masks.clone();
            let (runner, options) = render::render(run, masks, &args.folder, &measuring)?;
            (Box::new(runner), options)
        }
    })
}
