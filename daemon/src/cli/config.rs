//! The configuration file of `glintd record`: the flags that a rig sets once. What stands on the command line wins.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use fusion::VolumeConfig;
use serde::Deserialize;

use super::record::{DepthChoice, RecordArgs};
use crate::source_spec::SourceSpec;

/// Every key, each named as its flag.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RecordConfig {
    /// Folder of the recordings.
    output: Option<PathBuf>,
    /// Options of the camera, joined by `&`, as behind `ps1080?`.
    camera: Option<String>,
    split_mb: Option<u64>,
    split_seconds: Option<f64>,
    reserve_mb: Option<u64>,
    keep_mb: Option<u64>,
    depth_codec: Option<DepthChoice>,
    /// `false` is `--no-fuse`.
    fuse: Option<bool>,
    voxel_mm: Option<f32>,
    truncation_voxels: Option<f32>,
    fuse_threads: Option<u64>,
    fuse_stride: Option<u64>,
    fuse_memory_mb: Option<u64>,
}

/// `args` with what the file that it names says of flags that are not given.
///
/// # Errors
/// A file that cannot be read or is no TOML, an unknown key (all are listed), a value that cannot be.
pub(super) fn resolved(args: &RecordArgs) -> anyhow::Result<RecordArgs> {
    let mut args = args.clone();
    if let Some(path) = &args.config {
        let config = read(path)?;
        let path = path.display().to_string();
        config.require_ranges().context(path)?;
        config.fill(&mut args);
    }
    Ok(args)
}

fn read(path: &Path) -> anyhow::Result<RecordConfig> {
    let place = path.display();
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("{place}: the configuration cannot be read"))?;
    toml::from_str(&text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start));
        let line = before.map_or(1, |before| 1 + before.matches('\n').count());
        // The message of a syntax error has several lines.
        let words = error.message().replace('\n', ", ");
        anyhow::anyhow!("{place}, line {line}: {words}")
    })
}

impl RecordConfig {
    fn require_ranges(&self) -> anyhow::Result<()> {
        let within = |key: &str, value: Option<u64>, most: u64| {
            ensure!(
                value.is_none_or(|value| (1..=most).contains(&value)),
                "{key} goes from 1 to {most}"
            );
            Ok(())
        };
        within("split_mb", self.split_mb, u64::MAX)?;
        within("keep_mb", self.keep_mb, u64::MAX)?;
        within("fuse_threads", self.fuse_threads, 64)?;
        within("fuse_stride", self.fuse_stride, u64::MAX)?;
        within("fuse_memory_mb", self.fuse_memory_mb, 1 << 20)?;
        let mut volume = VolumeConfig::default();
        if let Some(voxel_mm) = self.voxel_mm {
            volume.voxel_size = voxel_mm / 1000.0;
        }
        if let Some(truncation_voxels) = self.truncation_voxels {
            volume.truncation_voxels = truncation_voxels;
        }
        volume.check()?;
        if let Some(seconds) = self.split_seconds
            && let Err(words) = super::record::parse_seconds(&seconds.to_string())
        {
            bail!("split_seconds: {words}");
        }
        if let Some(options) = &self.camera {
            let source = format!("ps1080?{options}");
            source.parse::<SourceSpec>().context("camera")?;
        }
        Ok(())
    }

    fn fill(self, args: &mut RecordArgs) {
        fn missing<T>(flag: &mut Option<T>, key: Option<T>) {
            *flag = flag.take().or(key);
        }
        if let Some(options) = &self.camera {
            args.source = with_options(&args.source, options);
        }
        missing(&mut args.output, self.output);
        missing(&mut args.split_mb, self.split_mb);
        missing(&mut args.split_seconds, self.split_seconds);
        missing(&mut args.reserve_mb, self.reserve_mb);
        missing(&mut args.keep_mb, self.keep_mb);
        missing(&mut args.depth_codec, self.depth_codec);
        let fuse = &mut args.fuse;
        missing(&mut fuse.voxel_mm, self.voxel_mm);
        missing(&mut fuse.truncation_voxels, self.truncation_voxels);
        missing(&mut fuse.fuse_threads, self.fuse_threads);
        missing(&mut fuse.fuse_stride, self.fuse_stride);
        missing(&mut fuse.fuse_memory_mb, self.fuse_memory_mb);
        args.no_fuse |= self.fuse == Some(false) && !args.with_fuse && args.fuse.mesh.is_none();
    }
}

/// A camera's source with options of the file that the command line does not give; other sources as they are.
fn with_options(source: &str, options: &str) -> String {
    let (name, given) = source.rsplit_once('?').unwrap_or((source, ""));
    if name.split(':').next() != Some("ps1080") {
        return source.to_owned();
    }
    // Gain goes with exposure.
    let key = |option: &str| match option.split('=').next().unwrap_or_default() {
        "gain" => "exposure".to_owned(),
        key => key.to_owned(),
    };
    let given_keys: Vec<String> = given.split('&').map(key).collect();
    let kept = options
        .split('&')
        .filter(|option| !given_keys.contains(&key(option)));
    let joined: Vec<&str> = kept.chain(given.split('&')).collect();
    format!("{name}?{}", joined.join("&"))
}

#[cfg(test)]
mod tests;
