//! The plain folder: pairs as an import reads them, single images beside them, everything else as JSON.

use geometry::Pose;
use sequence::scan::RecordPlace;

use crate::import::rig::{PoseCamera, PoseStamps, Rig};

use super::files::{FrameFiles, StreamKind, in_order, lost_frame};
use super::frames_json::{SingleFrame, frames_json};
use super::pairs::{unpaired, write_pairs};
use super::poses::{ExportPoses, tum_line};
use super::readme::Readme;
use super::target_folder::TargetFolder;
use super::{OnProgress, Written, counted};

pub(crate) fn write(
    files: &FrameFiles,
    poses: &ExportPoses,
    part: &TargetFolder,
    progress: OnProgress,
) -> anyhow::Result<Written> {
    part.make("frames")?;
    let mut written = write_pairs(files, part, "frames/", progress)?;
    let singles = write_singles(files, part, &mut written.missing, progress)?;
    let of_pairs: Vec<Option<Pose>> = written
        .pairs
        .iter()
        .map(|pair| poses.of_pair(pair.index))
        .collect();
    let mut text = String::from(
        "# world from depth camera, at the time of the depth image; a line for each pair of frames/\n# timestamp tx ty tz qx qy qz qw\n",
    );
    for (pair, pose) in written.pairs.iter().zip(&of_pairs) {
        text.push_str(&tum_line(pair.depth.device_nanos, *pose));
    }
    part.write("poses.txt", text.as_bytes())?;
    let json = frames_json(files, &written.pairs, &singles)?;
    part.write("frames.json", json.as_bytes())?;
    let rig = Rig::of(&files.streams(), PoseCamera::Depth, PoseStamps::Own, None);
    part.write("rig.toml", rig.to_toml()?.as_bytes())?;
    if let Some(split) = written.split(files) {
        part.write("split.json", split.as_bytes())?;
    }
    let sentence = format!(
        "{} with {}, and {} without a partner",
        counted(written.pairs.len(), "pair"),
        counted(of_pairs.iter().flatten().count(), "pose"),
        counted(singles.len(), "image"),
    );
    let readme = readme(files, poses, &sentence, &written.missing);
    part.write("README.txt", readme.as_bytes())?;
    Ok(Written {
        sentence,
        missing: written.missing,
    })
}

/// Writes the images without a partner as `unpaired/` + their numbers.
fn write_singles(
    files: &FrameFiles,
    part: &TargetFolder,
    missing: &mut Vec<String>,
    progress: OnProgress,
) -> anyhow::Result<Vec<SingleFrame>> {
    let places: Vec<(StreamKind, &RecordPlace)> = [StreamKind::Depth, StreamKind::Color]
        .into_iter()
        .flat_map(|kind| {
            unpaired(files, kind)
                .into_iter()
                .map(move |place| (kind, place))
        })
        .collect();
    if !places.is_empty() {
        part.make("unpaired")?;
    }
    let mut singles = Vec::new();
    in_order(
        &places,
        |(kind, place)| files.file(*kind, place),
        |(kind, place), file| {
            let file = match file {
                Ok(file) => file,
                Err(error) => {
                    missing.push(lost_frame(*kind, place, &error));
                    return Ok(());
                }
            };
            let (word, extension) = match kind {
                StreamKind::Depth => ("depth", "png"),
                StreamKind::Color => ("color", files.extension(StreamKind::Color)),
            };
            let name = format!("unpaired/{:06}.{word}.{extension}", place.label.number);
            part.write(&name, &file.bytes)?;
            singles.push(SingleFrame {
                kind: *kind,
                name,
                times: file.times,
            });
            Ok(())
        },
        progress,
    )?;
    Ok(singles)
}

fn readme(files: &FrameFiles, poses: &ExportPoses, sentence: &str, missing: &[String]) -> String {
    let mut readme = Readme::new("The frames of a glint recording as images and JSON", files);
    readme.line(sentence);
    readme.heading("Files");
    readme.line("frames/NNNNNN.color.*, .depth.png: a pair of images, matched by time, numbered from 0 without holes");
    readme.line("unpaired/NNNNNN.*: images without a partner, by their numbers in their streams");
    readme.line("poses.txt: a line for each pair; seven times nan where the pose is not known");
    readme.line("frames.json: all times and numbers, gaps, events, notes, gravity, histograms, pose sets, description of the streams; times and counters are strings of decimal digits, since they exceed 2^53");
    readme.line("rig.toml: both cameras; with it `glint import` reads this folder: all images with the numbers, times and gaps of frames.json, and the poses of poses.txt");
    readme.common(files, poses, PoseCamera::Depth);
    readme.heading("Not carried over");
    readme.line("nothing but the form: chunks, checksums and codes of the recording");
    readme.line("(an import reads no events, notes, gravity, histograms and no pose sets from frames.json: images without a partner come back without poses)");
    readme.missing(missing);
    readme.text()
}
