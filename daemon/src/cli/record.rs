//! `glintd record`.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use sequence::codecs::DepthCodec;
use sequence::file_layer::WritePath;
use serde_json::json;

use super::{exit_code, stop_on_signals};
use crate::capture::{CaptureOptions, capture_with};
use crate::disk::Rotation;
use crate::fuse::FuseOptions;
use crate::replay::camera_name;
use crate::source_spec::SourceSpec;
use crate::status::StatusNow;

/// How much work goes into depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DepthChoice {
    /// A tenth of the raw size, about 1.5 ms a VGA frame.
    Fast,
    /// Half of that, about 4 ms.
    Dense,
}

/// How bytes reach the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum WriteChoice {
    /// Mapped where reserved space is a promise, else pwrite.
    Auto,
    /// Into a map of the file.
    Mapped,
    /// By pwrite calls.
    Pwrite,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  glintd record 'replay:recordings/two-cans.glint?speed=max' -o copy.glint --mesh copy.ply"
)]
pub(super) struct RecordArgs {
    /// ps1080[:SERIAL] or ps1080:/SYSFS-PATH, a PrimeSense camera, with ?size=vga|qvga, fps=30|60, color=best|yuv422|…,
    /// registration=off|on, exposure=lock|auto|N&gain=N; or replay:FILE, with ?speed=max (wait for the recorder, drop
    /// nothing), ?speed=0.5 (of the camera's), &loop.
    #[cfg_attr(
        feature = "openni2",
        doc = "Or openni2[:URI], openni2:FILE.oni, what the OpenNI2 library opens, with ?registration=on|off."
    )]
    source: SourceSpec,
    /// File to make, or a folder: the file is then named by source and time.
    #[arg(short, long)]
    output: PathBuf,
    /// Record without tracking and fusing.
    #[arg(long)]
    no_fuse: bool,
    #[command(flatten)]
    fuse: FuseArgs,
    /// End after this many seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    duration: Option<f64>,
    /// How much work goes into depth.
    #[arg(long, value_enum, default_value = "fast")]
    depth_codec: DepthChoice,
    /// How bytes reach the disk.
    #[arg(long, value_enum, default_value = "auto")]
    write_path: WriteChoice,
    /// Free space that is left alone, MB (10^6 bytes). Default: 2147, or a minute of recording if that is more.
    #[arg(long, value_name = "MB")]
    reserve_mb: Option<u64>,
    /// Keep the last S seconds in memory, and begin the recording with them when SIGUSR1 comes.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pre_trigger: Option<f64>,
    /// Go on in another file (NAME-002.glint …) at this size, MB (10^6 bytes).
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    split_mb: Option<u64>,
    /// Go on in another file after this many seconds.
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    split_seconds: Option<f64>,
}

/// Tracking and fusing.
#[derive(Debug, Args)]
#[group(skip)]
struct FuseArgs {
    /// Write the surface of the largest world as PLY when the recording is closed; a second signal stops that.
    #[arg(long, value_name = "PLY", conflicts_with = "no_fuse")]
    mesh: Option<PathBuf>,
    /// Edge of a voxel, mm.
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 5.0,
        conflicts_with = "no_fuse"
    )]
    voxel_mm: f32,
    /// Distance from the surface within which voxels are kept, voxels, 4 to 64. Default: 6.
    #[arg(long, value_name = "N", conflicts_with = "no_fuse")]
    truncation_voxels: Option<f32>,
    /// Workers that track and fuse; they rank behind the recorder.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=64), conflicts_with = "no_fuse")]
    fuse_threads: u64,
    /// Fuse every Nth frame only; all are tracked.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "no_fuse")]
    fuse_stride: u64,
    /// Most memory of the volume, MB (2^20 bytes): beyond it new surface is left out, and counted.
    #[arg(long, value_name = "MB", default_value_t = 2048, value_parser = clap::value_parser!(u64).range(1..=1 << 20), conflicts_with = "no_fuse")]
    fuse_memory_mb: u64,
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

impl FuseArgs {
    fn options(&self) -> FuseOptions {
        let mut options = FuseOptions {
            mesh: self.mesh.clone(),
            threads: self.fuse_threads as usize,
            stride: self.fuse_stride,
            ..FuseOptions::default()
        };
        let volume = &mut options.live.volume;
        volume.voxel_size = self.voxel_mm / 1000.0;
        if let Some(truncation_voxels) = self.truncation_voxels {
            volume.truncation_voxels = truncation_voxels;
        }
        volume.memory_limit_bytes = (self.fuse_memory_mb as usize) << 20;
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
    let stop = stop_on_signals()?;
    let name = match &args.source {
        SourceSpec::Replay(spec) => camera_name(&spec.path),
        SourceSpec::Camera(spec) => spec.which.file_name(),
        #[cfg(feature = "openni2")]
        SourceSpec::OpenNi2(spec) => match &spec.uri {
            Some(uri) if uri.ends_with(".oni") => camera_name(Path::new(uri)),
            _ => "openni2".to_owned(),
        },
    };
    let output = output_path(&args.output, &name)?;
    if output.exists() {
        bail!(
            "{}: this file exists; remove it, or choose another name",
            output.display()
        );
    }
    if let Some(mesh) = args.fuse.mesh.as_ref().filter(|mesh| mesh.exists()) {
        bail!(
            "{}: this file exists; remove it, or choose another name for the mesh",
            mesh.display()
        );
    }
    let options = CaptureOptions {
        depth_codec: match args.depth_codec {
            DepthChoice::Fast => DepthCodec::Fast,
            DepthChoice::Dense => DepthCodec::Dense,
        },
        write_path: match args.write_path {
            WriteChoice::Auto => WritePath::Auto,
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
        ..CaptureOptions::new(args.source.clone(), output)
    };
    if options.pre_trigger.is_some() {
        let signal = signal_hook::consts::SIGUSR1;
        signal_hook::flag::register(signal, Arc::clone(&options.trigger))?;
    }
    let bar = progress_bar();
    let mut shown = 0;
    let outcome = capture_with(options, &stop, &mut |status| {
        shown += 1;
        show_status(status, &bar, json, shown);
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

/// Plain lines are ten times rarer than the calls: one in five seconds.
const PLAIN_EVERY: u64 = 10;

fn show_status(status: &StatusNow, bar: &ProgressBar, json: bool, shown: u64) {
    let bytes_a_minute = status.file_bytes as f64 / bar.elapsed().as_secs_f64() * 60.0;
    let left = if bytes_a_minute > 0.0 {
        format!(
            ", {:.0} minutes left",
            status.room_bytes as f64 / bytes_a_minute
        )
    } else {
        String::new()
    };
    let seen = status.tracked + status.lost;
    let mut fusion = String::new();
    if seen + status.skipped > 0 {
        let percent = 100.0 * status.tracked as f64 / seen.max(1) as f64;
        fusion = format!(", {percent:.0} % tracked, {} skipped", status.skipped);
    }
    if status.effort_level > 0 {
        fusion += &format!(", effort reduced by {}", status.effort_level);
    }
    let line = format!(
        "{} frames recorded, {} missing, {:.1} MB, buffer {} % full{fusion}{left}",
        status.frames_recorded,
        status.frames_missing,
        status.payload_bytes as f64 / 1e6,
        status.ring_fill_percent
    );
    if json && let Ok(mut event) = serde_json::to_value(status) {
        event["event"] = json!("status");
        println!("{event}");
    }
    if std::io::stderr().is_terminal() {
        bar.set_message(line);
        bar.tick();
    } else if shown.is_multiple_of(PLAIN_EVERY) {
        eprintln!("{line}");
    }
}

fn progress_bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {elapsed} {msg}");
    let bar = ProgressBar::new_spinner();
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
}

/// The file itself, or a new name in a folder.
fn output_path(output: &Path, camera: &str) -> anyhow::Result<PathBuf> {
    if !output.is_dir() {
        return Ok(output.to_path_buf());
    }
    let seconds = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .context("the clock of this machine is before 1970; set it, or name the file")?
        .as_secs();
    Ok(output.join(format!("{camera}-{}.glint", utc_name(seconds))))
}

/// `20261126T104530Z` of seconds since 1970.
fn utc_name(seconds: u64) -> String {
    // Days to year, month, day by the civil calendar (Hinnant, "chrono-compatible date algorithms").
    let days = seconds / 86_400 + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 {
        shifted_month + 3
    } else {
        shifted_month - 9
    };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
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

fn parse_seconds(text: &str) -> Result<f64, String> {
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

    #[test]
    fn file_names_carry_the_utc_time() {
        assert_eq!(utc_name(0), "19700101T000000Z");
        assert_eq!(utc_name(951_782_400), "20000229T000000Z");
        assert_eq!(utc_name(1_798_761_599), "20261231T235959Z");
    }
}
