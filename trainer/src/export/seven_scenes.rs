//! The folder of 7-Scenes: pairs only, one file for each image and pose.

use anyhow::ensure;
use geometry::Pose;

use crate::import::rig::{PoseCamera, PoseStamps, Rig};

use super::files::{FrameFiles, StreamKind};
use super::pairs::{WrittenPairs, unpaired, write_pairs};
use super::poses::ExportPoses;
use super::readme::Readme;
use super::target_folder::TargetFolder;
use super::{OnProgress, Written, counted};

pub(crate) fn write(
    files: &FrameFiles,
    poses: &ExportPoses,
    part: &TargetFolder,
    progress: OnProgress,
) -> anyhow::Result<Written> {
    let path = files.recording.path().display();
    ensure!(
        files.recording.frame_count() > 0,
        "{path} has no pair of depth and colour; --to tum writes the streams as they are"
    );
    let written = write_pairs(files, part, "frame-", progress)?;
    let mut pose_count = 0;
    for (number, pair) in written.pairs.iter().enumerate() {
        let pose = poses.of_pair(pair.index);
        pose_count += usize::from(pose.is_some());
        let name = format!("frame-{number:06}.pose.txt");
        part.write(&name, matrix_text(pose).as_bytes())?;
    }
    let streams = files.streams();
    let rate_hz = streams.depth_timing.rate_hz.or(written.mean_rate_hz());
    let rig = Rig::of(&streams, PoseCamera::Depth, PoseStamps::Own, rate_hz);
    part.write("rig.toml", rig.to_toml()?.as_bytes())?;
    if let Some(split) = written.split(files) {
        part.write("split.json", split.as_bytes())?;
    }
    let [depth_count, color_count] =
        [StreamKind::Depth, StreamKind::Color].map(|kind| unpaired(files, kind).len());
    let sentence = format!(
        "{} with {}; left out, since 7-Scenes holds pairs: {} and {} without a partner",
        counted(written.pairs.len(), "pair"),
        counted(pose_count, "pose"),
        counted(depth_count, "depth image"),
        counted(color_count, "colour image"),
    );
    let readme = readme(files, poses, &sentence, &written, rate_hz);
    part.write("README.txt", readme.as_bytes())?;
    Ok(Written {
        sentence,
        missing: written.missing,
    })
}

/// Four rows of four numbers, to their last bits; all `nan` without a pose.
fn matrix_text(world_from_camera: Option<Pose>) -> String {
    let mut text = String::new();
    for row in 0..3 {
        let numbers = world_from_camera.map(|pose| {
            let r = pose.matrix().row(row);
            [r.x, r.y, r.z, pose.translation()[row]]
        });
        let words = match numbers {
            Some(numbers) => numbers.map(|number| format!("{number:e}")),
            None => std::array::from_fn(|_| "nan".to_owned()),
        };
        text.push_str(&words.join("\t"));
        text.push('\n');
    }
    text.push_str("0\t0\t0\t1\n");
    text
}

fn readme(
    files: &FrameFiles,
    poses: &ExportPoses,
    sentence: &str,
    written: &WrittenPairs,
    rate_hz: Option<f64>,
) -> String {
    let mut readme = Readme::new("A folder in the form of the data set 7-Scenes", files);
    readme.line(sentence);
    readme.heading("Files");
    readme.line("frame-NNNNNN.color.*, .depth.png: a pair of images, matched by time, numbered from 0 without holes");
    readme.line("frame-NNNNNN.pose.txt: 4x4 matrix, world from DEPTH camera, metres; all nan where the pose is not known");
    readme.line("rig.toml: both cameras; with it `glint import` reads this folder");
    readme.common(files, poses, PoseCamera::Depth);
    readme.heading("Not carried over");
    readme.line(&match rate_hz {
        Some(rate_hz) => format!(
            "all times: 7-Scenes has none; an import takes pair number / frame_rate of rig.toml ({rate_hz} Hz)"
        ),
        None => "all times: 7-Scenes has none".to_owned(),
    });
    readme.line("images without a partner; numbers of the frames and the gaps between them");
    readme
        .line("events, notes, gravity, histograms; state and covariance of poses; other pose sets");
    readme.line("(`glint export --to tum` keeps all images and times, `--to folder` writes the rest as JSON)");
    readme.missing(&written.missing);
    readme.text()
}
