//! `glintd record`.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use sequence::codecs::DepthCodec;
use sequence::file_layer::WritePath;
use serde_json::json;

use super::config::resolved;
use super::{exit_code, stop_on_signals};
use crate::capture::{CaptureOptions, capture_with};
use crate::disk::Rotation;
use crate::fuse::FuseOptions;
use crate::replay::camera_name;
use crate::service::{Service, Word, status_line};
use crate::shelf::{Removed, Shelf};
use crate::source_spec::SourceSpec;
use crate::status::StatusNow;

/// How much work goes into depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum DepthChoice {
    /// A tenth of the raw size, about 1.5 ms a VGA frame.
    Fast,
    /// Half of that, about 4 ms.
    Dense,
}

/// How bytes reach the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum WriteChoice {
    /// By pwrite calls.
    Pwrite,
    /// Into a map of the file, where reserved space is a promise.
    Mapped,
}

#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Example:\n  glintd record 'replay:recordings/two-cans.glint?speed=max' -o copy.glint --mesh copy.ply"
)]
pub(super) struct RecordArgs {
    /// ps1080[:SERIAL] or ps1080:/SYSFS-PATH, a PrimeSense camera, with ?size=vga|qvga, fps=30|60,
    /// color=best|yuv422|infrared|…, emitter=on|off, registration=off|on, exposure=lock|auto|N&gain=N; or replay:FILE,
    /// with ?speed=max (wait for the recorder, drop nothing), ?speed=0.5 (of the camera's), &loop.
    #[cfg_attr(
        feature = "openni2",
        doc = "Or openni2[:URI], openni2:FILE.oni, what the OpenNI2 library opens, with ?registration=on|off."
    )]
    pub(super) source: String,
    /// File to make, or a folder: the file is then named by source and time.
    #[arg(short, long, required_unless_present = "config")]
    pub(super) output: Option<PathBuf>,
    /// File of settings, TOML: `output`, `camera` (options of the camera, joined by &), `fuse`, and flags of this page by
    /// their names with `_`. What stands on the command line wins.
    #[arg(long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
    /// Record without tracking and fusing.
    #[arg(long)]
    pub(super) no_fuse: bool,
    /// Track and fuse although the file of settings says not to.
    #[arg(long = "fuse", conflicts_with = "no_fuse")]
    pub(super) with_fuse: bool,
    #[command(flatten)]
    pub(super) fuse: FuseArgs,
    /// End after this many seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    duration: Option<f64>,
    /// How much work goes into depth. Default: fast.
    #[arg(long, value_enum)]
    pub(super) depth_codec: Option<DepthChoice>,
    /// How bytes reach the disk.
    #[arg(long, value_enum, default_value = "pwrite")]
    write_path: WriteChoice,
    /// Free space that is left alone, MB (10^6 bytes). Default: 2147, or a minute of recording if that is more.
    #[arg(long, value_name = "MB")]
    pub(super) reserve_mb: Option<u64>,
    /// Remove the oldest recordings of this camera from the folder so that they take no more than this, MB (10^6 bytes);
    /// the file that is being written stays. Without it nothing is removed.
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) keep_mb: Option<u64>,
    /// Keep the last S seconds in memory, and begin the recording with them when SIGUSR1 comes.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pre_trigger: Option<f64>,
    /// Go on in another file (NAME-002.glint …) at this size, MB (10^6 bytes).
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) split_mb: Option<u64>,
    /// Go on in another file after this many seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub(super) split_seconds: Option<f64>,
}

/// Tracking and fusing.
#[derive(Clone, Debug, Args)]
#[group(skip)]
pub(super) struct FuseArgs {
    /// Write the surface of the largest world as PLY when the recording is closed; a second signal stops that.
    #[arg(long, value_name = "PLY", conflicts_with = "no_fuse")]
    pub(super) mesh: Option<PathBuf>,
    /// Edge of a voxel, mm. Default: 5.
    #[arg(long, value_name = "MM", conflicts_with = "no_fuse")]
    pub(super) voxel_mm: Option<f32>,
    /// Distance from the surface within which voxels are kept, voxels, 4 to 64. Default: 6.
    #[arg(long, value_name = "N", conflicts_with = "no_fuse")]
    pub(super) truncation_voxels: Option<f32>,
    /// Workers that track and fuse; they rank behind the recorder. Default: 2.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64), conflicts_with = "no_fuse")]
    pub(super) fuse_threads: Option<u64>,
    /// Fuse every Nth frame only; all are tracked. Default: 1.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "no_fuse")]
    pub(super) fuse_stride: Option<u64>,
    /// Most memory of the volume, MB (2^20 bytes): beyond it new surface is left out, and counted. Default: 2048.
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1 << 20), conflicts_with = "no_fuse")]
    pub(super) fuse_memory_mb: Option<u64>,
    /// Size at which the model is predicted for tracking: 0 = half, 1 = quarter, 2 = eighth, 3 = sixteenth of the
    /// image. Default: 2.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=3), conflicts_with = "no_fuse")]
    view_level: Option<u64>,
    /// Most iterations of the alignment at an eighth, a quarter and half of the image. Default: 8/5/4.
    #[arg(long, value_name = "N/N/N", value_parser = parse_iterations, conflicts_with = "no_fuse")]
    icp_iterations: Option<[usize; 3]>,
    /// Whether photographs help to track where the shape leaves directions open.
    #[arg(long, value_enum, default_value = "on", conflicts_with = "no_fuse")]
    photometric: Switch,
}

/// Whether something is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Switch {
    On,
    Off,
}

const FUSE_THREADS: u64 = 2;
const VOXEL_MM: f32 = 5.0;
const FUSE_MEMORY_MB: u64 = 2048;

impl FuseArgs {
    fn options(&self) -> FuseOptions {
        let mut options = FuseOptions {
            mesh: self.mesh.clone(),
            threads: self.fuse_threads.unwrap_or(FUSE_THREADS) as usize,
            stride: self.fuse_stride.unwrap_or(1),
            ..FuseOptions::default()
        };
        let volume = &mut options.live.volume;
        volume.voxel_size = self.voxel_mm.unwrap_or(VOXEL_MM) / 1000.0;
        if let Some(truncation_voxels) = self.truncation_voxels {
            volume.truncation_voxels = truncation_voxels;
        }
        volume.memory_limit_bytes = (self.fuse_memory_mb.unwrap_or(FUSE_MEMORY_MB) as usize) << 20;
        if let Some(level) = self.view_level {
            options.live.view_level = level as usize;
        }
        let passes = &mut options.live.icp.passes;
        if let Some(iterations) = self.icp_iterations {
            for (pass, iterations) in passes.iter_mut().zip(iterations) {
                pass.iterations = iterations;
            }
        }
        if self.photometric == Switch::Off {
            for pass in passes {
                pass.photometric = false;
            }
        }
        options
    }
}

/// Records, and says what came of it.
pub(super) fn run_record(args: &RecordArgs, json: bool) -> anyhow::Result<ExitCode> {
    let args = resolved(args)?;
    let stop = stop_on_signals()?;
    let source: SourceSpec = args.source.parse()?;
    let camera = match &source {
        SourceSpec::Replay(spec) => camera_name(&spec.path),
        SourceSpec::Camera(spec) => spec.which.file_name(),
        #[cfg(feature = "openni2")]
        SourceSpec::OpenNi2(spec) => match &spec.uri {
            Some(uri) if uri.ends_with(".oni") => camera_name(Path::new(uri)),
            _ => "openni2".to_owned(),
        },
    };
    let (output, shelf) = output_of(&args, &camera)?;
    if let Some(shelf) = &shelf {
        make_room(shelf, args.keep_mb, None);
    }
    let service = Service::of_this_process();
    if service.is_listening() {
        // The line that a journal begins with.
        tracing::info!("{}: recording {}", output.display(), args.source);
    }
    service.say(&Word::Status("waiting for the first frames".to_owned()));
    let options = CaptureOptions {
        service,
        ..options_of(&args, source, output.clone())
    };
    if options.pre_trigger.is_some() {
        let signal = signal_hook::consts::SIGUSR1;
        signal_hook::flag::register(signal, Arc::clone(&options.trigger))?;
    }
    let bar = progress_bar();
    let mut shown = 0;
    let outcome = capture_with(options, &stop, &mut |status| {
        shown += 1;
        show_status(status, &bar, json, shown, service);
        if let Some(shelf) = shelf.as_ref().filter(|_| shown.is_multiple_of(TRIM_EVERY)) {
            make_room(shelf, args.keep_mb, Some(&output));
        }
    })?;
    bar.finish_and_clear();
    if json {
        let mut event = serde_json::to_value(&outcome)?;
        event["event"] = json!("summary");
        println!("{event}");
    } else {
        print!("{outcome}");
    }
    let has_mesh = outcome
        .mesh
        .as_ref()
        .is_none_or(|mesh| mesh.problem.is_none());
    Ok(exit_code(outcome.is_whole() && has_mesh))
}

fn options_of(args: &RecordArgs, source: SourceSpec, output: PathBuf) -> CaptureOptions {
    CaptureOptions {
        depth_codec: match args.depth_codec.unwrap_or(DepthChoice::Fast) {
            DepthChoice::Fast => DepthCodec::Fast,
            DepthChoice::Dense => DepthCodec::Dense,
        },
        write_path: match args.write_path {
            WriteChoice::Mapped => WritePath::Mapped,
            WriteChoice::Pwrite => WritePath::Pwrite,
        },
        reserve_bytes: args.reserve_mb.map(|mb| mb.saturating_mul(1_000_000)),
        rotation: Rotation {
            bytes: args.split_mb.map(|mb| mb.saturating_mul(1_000_000)),
            age: args.split_seconds.map(Duration::from_secs_f64),
        },
        pre_trigger: args.pre_trigger.map(Duration::from_secs_f64),
        fuse: (!args.no_fuse).then(|| args.fuse.options()),
        duration: args.duration.map(Duration::from_secs_f64),
        ..CaptureOptions::new(source, output)
    }
}

/// The file to make, and the folder of this camera's recordings where only that was named. Neither this file nor the
/// mesh exists.
fn output_of(args: &RecordArgs, camera: &str) -> anyhow::Result<(PathBuf, Option<Shelf>)> {
    let Some(output) = &args.output else {
        bail!("no output is named; give -o, or `output` in the file of settings");
    };
    let shelf = output.is_dir().then(|| Shelf::new(output, camera));
    let file = match &shelf {
        Some(shelf) => shelf
            .place(SystemTime::now())
            .context("the clock of this machine is before 1970; set it, or name the file")?,
        None if args.keep_mb.is_some() => bail!(
            "{}: old recordings can be removed from a folder only; name a folder that exists, or leave --keep-mb out",
            output.display()
        ),
        None => output.clone(),
    };
    if file.exists() {
        bail!(
            "{}: this file exists; remove it, or choose another name",
            file.display()
        );
    }
    if let Some(mesh) = args.fuse.mesh.as_ref().filter(|mesh| mesh.exists()) {
        bail!(
            "{}: this file exists; remove it, or choose another name for the mesh",
            mesh.display()
        );
    }
    Ok((file, shelf))
}

/// Calls from one look at the folder to the next: ten seconds.
const TRIM_EVERY: u64 = 20;

/// Removes the oldest recordings beyond `keep_mb`, and says so. What cannot be removed does not stop a recording.
fn make_room(shelf: &Shelf, keep_mb: Option<u64>, current: Option<&Path>) {
    let Some(keep_mb) = keep_mb else {
        return;
    };
    match shelf.trim(keep_mb.saturating_mul(1_000_000), current) {
        Ok(removed) => {
            for Removed {
                path,
                bytes,
                problem,
            } in removed
            {
                let place = path.display();
                match problem {
                    None => tracing::info!(
                        "{place}: removed, {:.1} MB: recordings of this camera took more than {keep_mb} MB",
                        bytes as f64 / 1e6
                    ),
                    Some(error) => tracing::warn!("{place}: cannot be removed: {error}"),
                }
            }
        }
        Err(error) => tracing::warn!("old recordings cannot be looked for: {error}"),
    }
}

/// Plain lines are ten times rarer than the calls: one in five seconds.
const PLAIN_EVERY: u64 = 10;
/// The service manager hears every second.
const TOLD_EVERY: u64 = 2;

fn show_status(status: &StatusNow, bar: &ProgressBar, json: bool, shown: u64, service: Service) {
    let bytes_a_minute = status.file_bytes as f64 / bar.elapsed().as_secs_f64() * 60.0;
    let left = if bytes_a_minute > 0.0 {
        format!(
            ", {:.0} minutes left",
            status.room_bytes as f64 / bytes_a_minute
        )
    } else {
        String::new()
    };
    if service.is_listening() && shown.is_multiple_of(TOLD_EVERY) {
        service.say(&Word::Status(status_line(status, &left)));
    }
    if json && let Ok(mut event) = serde_json::to_value(status) {
        event["event"] = json!("status");
        println!("{event}");
    }
    let mut more = String::new();
    if status.skipped > 0 {
        more = format!(", {} skipped by tracking", status.skipped);
    }
    if status.effort_level > 0 {
        more += &format!(", effort reduced by {}", status.effort_level);
    }
    let line = format!(
        "{}, buffer {} % full{more}",
        status_line(status, &left),
        status.ring_fill_percent
    );
    if std::io::stderr().is_terminal() {
        bar.set_message(line);
        bar.tick();
    } else if shown.is_multiple_of(PLAIN_EVERY) && !service.is_listening() {
        eprintln!("{line}");
    }
}

fn progress_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {elapsed} {msg}");
    let bar = ProgressBar::new_spinner();
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
}

/// Three counts, the coarsest pass first; a hundred is far beyond what converges.
fn parse_iterations(text: &str) -> Result<[usize; 3], String> {
    let counts: Vec<usize> = text
        .split('/')
        .filter_map(|count| count.parse().ok().filter(|count| (1..=100).contains(count)))
        .collect();
    match <[usize; 3]>::try_from(counts) {
        Ok(counts) if text.split('/').count() == 3 => Ok(counts),
        _ => Err(format!(
            "`{text}` is not three numbers from 1 to 100; write 8/5/4"
        )),
    }
}

pub(super) fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text
        .parse()
        .map_err(|_| format!("`{text}` is no number of seconds"))?;
    // A hundred years is far inside what a Duration holds.
    if seconds > 0.0 && seconds < 3.2e9 {
        Ok(seconds)
    } else {
        Err(format!(
            "`{text}` seconds cannot be: give a positive number"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iterations_are_three_counts() {
        assert_eq!(parse_iterations("8/5/4"), Ok([8, 5, 4]));
        for text in ["", "8/5", "8/5/4/1", "8/5/0", "8/5/x", "8/5/4/", "101/1/1"] {
            assert!(parse_iterations(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_iterations_in_the_help_are_the_default() {
        let passes = FuseOptions::default().live.icp.passes;
        let counts: Vec<usize> = passes.iter().map(|pass| pass.iterations).collect();
        assert_eq!(counts, [8, 5, 4]);
    }
}
