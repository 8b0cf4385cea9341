//! `glint tradeoff fusion`.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use clap::Args;
use sequence::Recording;
use serde_json::json;

use super::super::Summary;
use super::{RunArgs, stem, summary};
use crate::progress::Progress;
use crate::tradeoff::fusion::careful::careful_mesh;
use crate::tradeoff::fusion::{self, FusionRunner};
use crate::tradeoff::{TradeoffOptions, measure, program_key};

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glint tradeoff fusion kitchen.glint -o tradeoff --glintd target/release/glintd"
)]
pub(super) struct FusionArgs {
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

pub(super) fn run(args: &FusionArgs, progress: &Progress) -> anyhow::Result<Summary> {
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
    let options = options(path, output, program, &args.run)?;
    let mesh = args.reference_mesh.as_deref();
    let runner = prepared(path, mesh, program, &options, progress)?;
    let measurement = measure(&runner, &options, progress)?;
    Ok(summary(&measurement, output))
}

/// What is measured, of a recording with poses `source`.
///
/// # Errors
/// When it has none, or cannot be read.
pub(super) fn options(
    path: &Path,
    output: &Path,
    program: &Path,
    run: &RunArgs,
) -> anyhow::Result<TradeoffOptions> {
    let recording = Recording::open(path)?;
    ensure!(
        recording.poses("source").is_some(),
        "{} has no poses `source`, by which the tracked path is judged; give a recording that has",
        path.display()
    );
    Ok(run.options(
        output,
        format!("{}, {} pairs", stem(path), recording.frame_count()),
        recording.content_hash().to_string(),
        program,
    ))
}

/// The runner with a mesh to compare with: the given one, else that of a run that spares nothing.
///
/// # Errors
/// When that run fails.
pub(super) fn prepared(
    recording: &Path,
    mesh: Option<&Path>,
    program: &Path,
    options: &TradeoffOptions,
    progress: &Progress,
) -> anyhow::Result<FusionRunner> {
    let mut runner = FusionRunner {
        subject: fusion::SUBJECT,
        flags: fusion::FLAGS,
        program: program.to_owned(),
        recording: recording.to_owned(),
        mesh: None,
        judged_meshes: fusion::JudgedMeshes::default(),
    };
    runner.mesh = Some(match mesh {
        Some(mesh) => mesh.to_owned(),
        None => careful_mesh(
            &runner,
            &options.output,
            &program_key(options)?,
            options.timeout,
            progress,
        )?,
    });
    Ok(runner)
}

/// `glintd` beside this program, else on PATH.
pub(super) fn find_recorder() -> anyhow::Result<PathBuf> {
    let program = std::env::current_exe().context("cannot find this program again")?;
    let beside = program.parent().map(Path::to_owned);
    let on_path = std::env::var_os("PATH").unwrap_or_default();
    let folders = beside.into_iter().chain(std::env::split_paths(&on_path));
    let mut found = folders.map(|folder| folder.join("glintd"));
    found
        .find(|path| path.is_file())
        .context("there is no glintd beside this program nor on PATH; give it with --glintd PATH")
}
