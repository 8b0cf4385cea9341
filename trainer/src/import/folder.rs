//! The plain folder: `frames/NNNNNN.color.jpg`, `frames/NNNNNN.depth.png`, `poses.txt` in TUM's form, and, where
//! the folder was exported from a recording, `frames.json` with `unpaired/`.

use std::ops::Range;
use std::path::{Path, PathBuf};

use geometry::Pose;
use sequence::{COLOR_STREAM, DEPTH_STREAM, FrameTimes};

use super::error::ImportError;
use super::frames_json::FramesJson;
use super::gaps::gaps_around;
use super::source::{Images, PairedImages, Source, SourceImage};
use super::trajectory::tum_lines;

/// Reads what is beside the images. Masks and truth are not looked at.
pub(crate) fn read(folder: &Path, range: Option<&Range<usize>>) -> Result<Source, ImportError> {
    let images = Images::find(&folder.join("frames"), "", range)?;
    let poses_path = folder.join("poses.txt");
    let lines = tum_lines(&poses_path)?;
    if lines.len() != images.numbers.len() {
        return Err(ImportError::PoseCount {
            path: poses_path,
            pose_count: lines.len(),
            frame_count: images.numbers.len(),
        });
    }
    let mut worst_rotation_error = 0.0_f64;
    let mut pairs: Vec<PairedImages> = Vec::with_capacity(images.wanted.len());
    let mut line_numbers = Vec::with_capacity(images.wanted.len());
    for (number, color, depth) in images.wanted {
        let line = &lines[number as usize - images.numbers.start];
        let (time_nanos, world_from_camera, rotation_error) = line.pose(&poses_path)?;
        worst_rotation_error = worst_rotation_error.max(rotation_error);
        line_numbers.push(line.number);
        pairs.push(PairedImages {
            number,
            time_nanos,
            color,
            depth,
            world_from_camera,
        });
    }
    let poses = PosesFile {
        path: poses_path,
        line_numbers,
        worst_rotation_error,
    };
    match FramesJson::find(folder)? {
        None => poses.source_of(pairs, images.numbers),
        Some(recorded) if recorded.pair_count() != images.numbers.len() => {
            Err(recorded.wrong(format!(
                "{} pairs, the folder has {}",
                recorded.pair_count(),
                images.numbers.len()
            )))
        }
        Some(recorded) => {
            poses.recorded_source_of(folder, pairs, images.numbers, &recorded, range.is_some())
        }
    }
}

/// What was read of `poses.txt` beside the poses.
struct PosesFile {
    path: PathBuf,
    /// Lines of the pairs, from 1.
    line_numbers: Vec<usize>,
    worst_rotation_error: f64,
}

impl PosesFile {
    /// Pairs that have the times of their poses.
    fn source_of(
        self,
        pairs: Vec<PairedImages>,
        numbers: Range<usize>,
    ) -> Result<Source, ImportError> {
        for (two, line) in pairs.windows(2).zip(self.line_numbers.iter().skip(1)) {
            let [previous_nanos, nanos] = [&two[0], &two[1]].map(|pair| pair.time_nanos);
            if nanos <= previous_nanos {
                return Err(ImportError::TimeOrder {
                    path: self.path,
                    line: *line,
                    nanos,
                    previous_nanos,
                });
            }
        }
        Ok(Source::of_pairs(
            pairs,
            numbers,
            self.path,
            self.worst_rotation_error,
            Vec::new(),
        ))
    }

    /// Pairs and single images with the numbers and times of the recording that they were exported from. Of an
    /// excerpt, the single images are those between the pairs.
    fn recorded_source_of(
        self,
        folder: &Path,
        pairs: Vec<PairedImages>,
        numbers: Range<usize>,
        recorded: &FramesJson,
        is_excerpt: bool,
    ) -> Result<Source, ImportError> {
        let mut depth: Vec<(SourceImage, Option<Pose>)> = Vec::with_capacity(pairs.len());
        let mut color: Vec<SourceImage> = Vec::with_capacity(pairs.len());
        for (pair, line) in pairs.into_iter().zip(&self.line_numbers) {
            let [depth_times, color_times] = recorded.pair(&pair.depth, &pair.color)?;
            if depth_times.device_nanos != pair.time_nanos {
                return Err(recorded.wrong(format!(
                    "the depth of pair {} has time {} ns, line {line} of poses.txt says {} ns",
                    pair.number, depth_times.device_nanos, pair.time_nanos
                )));
            }
            let image = |times, path| SourceImage {
                number: Some(pair.number),
                times,
                path,
            };
            depth.push((image(depth_times, pair.depth), pair.world_from_camera));
            color.push(image(color_times, pair.color));
        }
        let spans = [
            span(depth.iter().map(|(image, _)| image)),
            span(color.iter()),
        ];
        for single in &recorded.singles {
            let image = SourceImage {
                number: None,
                times: single.times,
                path: folder.join(&single.file),
            };
            let span = &spans[usize::from(single.stream == COLOR_STREAM)];
            if is_excerpt && !span.contains(&single.times.number) {
                continue;
            }
            match single.stream {
                DEPTH_STREAM => depth.push((image, None)),
                _ => color.push(image),
            }
        }
        depth.sort_by_key(|(image, _)| image.times.number);
        color.sort_by_key(|image| image.times.number);
        let (depth, world_from_camera): (Vec<SourceImage>, Vec<Option<Pose>>) =
            depth.into_iter().unzip();
        let mut gaps = Vec::new();
        for (stream, images) in [(DEPTH_STREAM, &depth), (COLOR_STREAM, &color)] {
            let frames: Vec<FrameTimes> = images.iter().map(|image| image.times).collect();
            gaps.extend(gaps_around(&recorded.gaps, stream, &frames, is_excerpt));
        }
        let note =
            "frames.json: numbers, times and gaps are those of the recording that was exported";
        Ok(Source {
            depth,
            color,
            world_from_camera,
            gaps,
            recorded: Some(recorded.streams.clone()),
            numbers,
            poses_path: self.path,
            worst_rotation_error: self.worst_rotation_error,
            notes: vec![note.to_owned()],
        })
    }
}

/// From the least number of a frame to the greatest.
fn span<'a>(images: impl Iterator<Item = &'a SourceImage> + Clone) -> Range<u64> {
    let numbers = images.map(|image| image.times.number);
    let least = numbers.clone().min().unwrap_or(0);
    least..numbers.max().map_or(0, |greatest| greatest + 1)
}
