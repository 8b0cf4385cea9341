//! What an import did, in words and numbers.

use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

use super::ImportFormat;
use super::checks::PoseFit;

/// The result of an import.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// The recording.
    pub output: PathBuf,
    /// Its length in bytes.
    pub bytes: u64,
    /// Layout of the input.
    pub format: ImportFormat,
    /// Depth images imported.
    pub frame_count: usize,
    /// Colour images imported.
    pub color_count: usize,
    /// Pairs of depth and colour, by time, each image in one at most.
    pub pair_count: usize,
    /// Depth images with a pose.
    pub pose_count: usize,
    /// Training frames.
    pub train_count: usize,
    /// Frames of neither part.
    pub unused_count: usize,
    /// Held-out frames.
    pub test_count: usize,
    /// Time from the first frame to the last, seconds.
    pub duration_s: f64,
    /// What the depth images hold.
    pub depth: DepthReport,
    /// Depth images that repeat the one before sample by sample.
    pub repeated_depth_count: usize,
    /// Colour images that repeat the one before byte for byte.
    pub repeated_color_count: usize,
    /// Their numbers in the folder, of those in pairs.
    pub repeated_depth_frames: Vec<u32>,
    /// Their numbers in the folder, of those in pairs.
    pub repeated_color_frames: Vec<u32>,
    /// How far the worst rotation was from one before it was made one (largest entry of RᵀR − I, or distance
    /// of a quaternion's length from 1).
    pub worst_rotation_error: f64,
    /// Agreement of depth under the poses; absent when there was too little to compare.
    pub pose_fit: Option<PoseFit>,
    /// What was assumed or left out.
    pub notes: Vec<String>,
    /// What the input had lost, a line each; gaps of the recording.
    pub missing: Vec<String>,
}

/// Depth samples by what they say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DepthReport {
    /// Samples inside the range of the depth camera.
    pub measured_count: u64,
    /// Samples of code 0: no measurement.
    pub code_0_count: u64,
    /// Samples of code 65535: no measurement.
    pub code_65535_count: u64,
    /// Measurements outside the range; kept in the recording, ignored by readers.
    pub out_of_range_count: u64,
    /// Median of all measurements, metres; 0 when there is none.
    pub median_m: f64,
}

impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { depth, .. } = self;
        let sample_count = depth.measured_count
            + depth.code_0_count
            + depth.code_65535_count
            + depth.out_of_range_count;
        let percent = |count: u64| 100.0 * count as f64 / sample_count.max(1) as f64;
        writeln!(
            f,
            "{}: {} frames over {:.1} s, {:.1} MB ({} train, {} unused, {} test)",
            self.output.display(),
            self.frame_count,
            self.duration_s,
            self.bytes as f64 / 1e6,
            self.train_count,
            self.unused_count,
            self.test_count,
        )?;
        let is_all_paired = self.pair_count == self.frame_count.max(self.color_count);
        if matches!(self.format, ImportFormat::Tum | ImportFormat::Oni) || !is_all_paired {
            writeln!(
                f,
                "{} depth and {} colour images make {} pairs by time",
                self.frame_count, self.color_count, self.pair_count,
            )?;
        }
        writeln!(
            f,
            "depth: {:.1} % measured, median {:.3} m; no measurement: {:.1} % code 0, {} samples code 65535; {} samples out of range",
            percent(depth.measured_count),
            depth.median_m,
            percent(depth.code_0_count),
            depth.code_65535_count,
            depth.out_of_range_count,
        )?;
        if self.pose_count == 0 {
            write!(f, "poses: none")?;
        } else {
            write!(
                f,
                "poses: {} of {} frames, rotations made exact, the worst was off by {:.1e}",
                self.pose_count, self.frame_count, self.worst_rotation_error
            )?;
        }
        match self.pose_fit {
            Some(fit) => write!(
                f,
                "; depth agrees on {:.1} % between {} pairs of frames (poses inverted: {:.1} %)",
                100.0 * fit.given_fraction,
                fit.pair_count,
                100.0 * fit.inverse_fraction,
            )?,
            None if self.pose_count == 0 => {}
            None => write!(f, "; too little overlap to check their direction")?,
        }
        write!(
            f,
            "\nrepeated frames: {}; {}",
            repeats(
                "depth",
                self.repeated_depth_count,
                &self.repeated_depth_frames
            ),
            repeats(
                "colour",
                self.repeated_color_count,
                &self.repeated_color_frames
            ),
        )?;
        for note in &self.notes {
            write!(f, "\nnote: {note}")?;
        }
        Ok(())
    }
}

/// Frame numbers that a line of text lists.
const MOST_LISTED: usize = 8;

/// "17 depth (222, 305, …)".
fn repeats(stream: &str, count: usize, frames: &[u32]) -> String {
    let mut text = format!("{count} {stream}");
    if frames.is_empty() {
        return text;
    }
    let listed: Vec<String> = frames
        .iter()
        .take(MOST_LISTED)
        .map(u32::to_string)
        .collect();
    let more = if frames.len() > MOST_LISTED {
        ", …"
    } else {
        ""
    };
    text.push_str(&format!(" ({}{more})", listed.join(", ")));
    text
}
