//! The TUM RGB-D benchmark's folder: both streams whole, each with its own times.

use std::collections::{BTreeMap, BTreeSet};

use sequence::scan::RecordPlace;

use crate::import::rig::{PoseCamera, PoseStamps, Rig};

use super::files::{FrameFiles, StreamKind, in_order, lost_frame};
use super::poses::{ExportPoses, seconds, tum_line};
use super::readme::{Readme, camera_word};
use super::target_folder::TargetFolder;
use super::{OnProgress, Written, counted};

/// An image of a stream that will have a file.
struct Entry<'a> {
    kind: StreamKind,
    place: &'a RecordPlace,
    name: String,
}

pub(crate) fn write(
    files: &FrameFiles,
    poses: &ExportPoses,
    part: &TargetFolder,
    progress: OnProgress,
) -> anyhow::Result<Written> {
    part.make("depth")?;
    part.make("rgb")?;
    let mut entries = entries(files, StreamKind::Depth, "depth");
    entries.extend(self::entries(files, StreamKind::Color, "rgb"));
    let mut missing = Vec::new();
    let mut written = BTreeMap::new();
    in_order(
        &entries,
        |entry| files.file(entry.kind, entry.place),
        |entry, file| {
            match file {
                Ok(file) => {
                    part.write(&entry.name, &file.bytes)?;
                    written.insert(entry.place.offset, entry.name.clone());
                }
                Err(error) => missing.push(lost_frame(entry.kind, entry.place, &error)),
            }
            Ok(())
        },
        progress,
    )?;
    let names = Names(written);
    part.write("depth.txt", names.list(files, StreamKind::Depth).as_bytes())?;
    part.write("rgb.txt", names.list(files, StreamKind::Color).as_bytes())?;
    let (associations, pair_count) = names.associations(files)?;
    part.write("associations.txt", associations.as_bytes())?;
    let pose_count = write_poses(files, poses, part)?;
    let stamps = match poses.camera() {
        PoseCamera::Depth => PoseStamps::Frames,
        // An import wants poses of depth frames: between those of the colour frames.
        PoseCamera::Color => PoseStamps::Own,
    };
    let rig = Rig::of(&files.streams(), poses.camera(), stamps, None);
    part.write("rig.toml", rig.to_toml()?.as_bytes())?;
    if let Some(split) = names.split(files) {
        part.write("split.json", split.as_bytes())?;
    }
    let count = |kind| {
        files
            .places(kind)
            .iter()
            .filter(|place| names.of(place).is_some())
            .count()
    };
    let (depth_count, color_count) = (count(StreamKind::Depth), count(StreamKind::Color));
    let sentence = format!(
        "{} and {}, {}, {}",
        counted(depth_count, "depth image"),
        counted(color_count, "colour image"),
        counted(pair_count, "pair"),
        counted(pose_count, "pose"),
    );
    let readme = readme(files, poses, &sentence, &missing);
    part.write("README.txt", readme.as_bytes())?;
    Ok(Written { sentence, missing })
}

/// The frames of a stream with file names by time; a time that is there twice gets a suffix.
fn entries<'a>(files: &FrameFiles<'a>, kind: StreamKind, folder: &str) -> Vec<Entry<'a>> {
    let mut taken = BTreeSet::new();
    let extension = files.extension(kind);
    let entry = |place: &'a RecordPlace| {
        let time = seconds(place.label.device_nanos);
        let name = if taken.insert(place.label.device_nanos) {
            format!("{folder}/{time}.{extension}")
        } else {
            format!("{folder}/{time}-{}.{extension}", place.label.number)
        };
        Entry { kind, place, name }
    };
    files.places(kind).iter().map(entry).collect()
}

/// File names of the frames that were written, by their offsets in the recording.
struct Names(BTreeMap<u64, String>);

impl Names {
    fn of(&self, place: &RecordPlace) -> Option<&str> {
        self.0.get(&place.offset).map(String::as_str)
    }

    fn list(&self, files: &FrameFiles, kind: StreamKind) -> String {
        let mut text = format!("# {} images\n# timestamp filename\n", kind.word());
        for place in files.places(kind) {
            if let Some(name) = self.of(place) {
                text.push_str(&format!("{} {name}\n", seconds(place.label.device_nanos)));
            }
        }
        text
    }

    fn associations(&self, files: &FrameFiles) -> anyhow::Result<(String, usize)> {
        let mut text = String::from(
            "# pairs by time, no image twice\n# rgb timestamp, rgb filename, depth timestamp, depth filename\n",
        );
        let mut count = 0;
        for index in 0..files.recording.frame_count() {
            let depth = files.recording.depth_place(index)?;
            let color = files.recording.color_place(index)?;
            let (Some(depth_name), Some(color_name)) = (self.of(depth), self.of(color)) else {
                continue;
            };
            count += 1;
            text.push_str(&format!(
                "{} {color_name} {} {depth_name}\n",
                seconds(color.label.device_nanos),
                seconds(depth.label.device_nanos),
            ));
        }
        Ok((text, count))
    }

    /// The stored split with the positions that an import gives to the depth images.
    fn split(&self, files: &FrameFiles) -> Option<String> {
        let stored = files.recording.contents().split.as_ref()?;
        let places = files.places(StreamKind::Depth).iter();
        let mut written: Vec<&RecordPlace> =
            places.filter(|place| self.of(place).is_some()).collect();
        written.sort_by_key(|place| place.label.device_nanos);
        let positions: BTreeMap<u64, usize> = (0..)
            .zip(written)
            .map(|(position, place)| (place.label.number, position))
            .collect();
        let positions_of = |numbers: &[u32]| -> Vec<usize> {
            let known = numbers
                .iter()
                .filter_map(|number| positions.get(&u64::from(*number)));
            known.copied().collect()
        };
        let json = serde_json::json!({
            "train": positions_of(&stored.train),
            "unused": positions_of(&stored.unused),
            "test": positions_of(&stored.test),
        });
        Some(format!("{json}\n"))
    }
}

/// One line for each pose of the set; returns how many.
fn write_poses(
    files: &FrameFiles,
    poses: &ExportPoses,
    part: &TargetFolder,
) -> anyhow::Result<usize> {
    if poses.name().is_none() {
        return Ok(0);
    }
    let camera = camera_word(poses.camera());
    let kind = match poses.camera() {
        PoseCamera::Depth => StreamKind::Depth,
        PoseCamera::Color => StreamKind::Color,
    };
    let mut text = format!(
        "# world from {camera} camera, at the times of the {camera} images\n# timestamp tx ty tz qx qy qz qw\n"
    );
    let mut count = 0;
    for place in files.places(kind) {
        if let Some(pose) = poses.of_frame(place.label.number) {
            text.push_str(&tum_line(place.label.device_nanos, Some(pose)));
            count += 1;
        }
    }
    part.write("groundtruth.txt", text.as_bytes())?;
    Ok(count)
}

fn readme(files: &FrameFiles, poses: &ExportPoses, sentence: &str, missing: &[String]) -> String {
    let camera = camera_word(poses.camera());
    let mut readme = Readme::new("A folder in the form of the TUM RGB-D benchmark", files);
    readme.line(sentence);
    readme.heading("Files");
    readme
        .line("depth.txt, rgb.txt: time and name of every image; each stream keeps its own times");
    readme.line(
        "associations.txt: pairs by time, at most half a period (or 20 ms) apart, no image twice",
    );
    if poses.name().is_some() {
        readme.line(&format!(
            "groundtruth.txt: {camera} camera, one line for each of its images that has a pose (TUM's own files have the colour camera)"
        ));
    }
    readme.line("rig.toml: both cameras; with it `glint import` reads this folder");
    readme.common(files, poses, poses.camera());
    readme.heading("Not carried over");
    readme.line("raw counters of the device and times of the host; numbers of the frames and the gaps between them");
    readme.line("nominal rate; events, notes, gravity, histograms; state and covariance of poses; other pose sets");
    readme.line("(`glint export --to folder` writes all of these as JSON)");
    readme.missing(missing);
    readme.text()
}
