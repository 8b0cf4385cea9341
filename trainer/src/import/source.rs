//! What every layout of folder gives: numbered frames, times, poses.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use geometry::Pose;
use sequence::{FrameTimes, Gap};

use super::error::ImportError;
use super::frames_json::RecordedStreams;

/// A folder with its frames found and its poses read, before any image is opened.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    /// Depth images wanted, by the numbers of their frames. Never empty.
    pub(crate) depth: Vec<SourceImage>,
    /// Colour images wanted, by the numbers of their frames. Never empty.
    pub(crate) color: Vec<SourceImage>,
    /// World from the camera that the rig file names, one for each of `depth`, where it is known.
    pub(crate) world_from_camera: Vec<Option<Pose>>,
    /// Frames of both streams that are known to be missing, by stream and number.
    pub(crate) gaps: Vec<Gap>,
    /// What the folder knows of the streams beside the rig file.
    pub(crate) recorded: Option<RecordedStreams>,
    /// Numbers of all depth images of the folder, wanted or not.
    pub(crate) numbers: Range<usize>,
    /// Where the poses are, for messages.
    pub(crate) poses_path: PathBuf,
    /// How far the worst rotation was from one before it was made one: the largest entry of RᵀR − I, or the
    /// distance of a quaternion's length from 1.
    pub(crate) worst_rotation_error: f64,
    /// What was assumed, for the report.
    pub(crate) notes: Vec<String>,
}

/// An image of one stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SourceImage {
    /// Number in its file name, or position in its list: what a split names. Images without a partner have
    /// none.
    pub(crate) number: Option<u32>,
    /// Number and times of the frame in the recording; whether it repeats the one before is seen when it is
    /// copied.
    pub(crate) times: FrameTimes,
    pub(crate) path: PathBuf,
}

/// Gives frames whose numbers nobody knows those of their positions.
pub(crate) fn number_frames(images: &mut [SourceImage]) {
    for (number, image) in (0..).zip(images) {
        image.times.number = number;
    }
}

/// Whether a path in a file that was downloaded stays in the folder.
pub(crate) fn is_inside(path: &Path) -> bool {
    let is_plain = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    !path.as_os_str().is_empty() && path.components().all(is_plain)
}

impl Source {
    /// A source whose images come in pairs of one time, numbered from 0.
    pub(crate) fn of_pairs(
        pairs: Vec<PairedImages>,
        numbers: Range<usize>,
        poses_path: PathBuf,
        worst_rotation_error: f64,
        notes: Vec<String>,
    ) -> Self {
        let images = |path: fn(&PairedImages) -> &Path| {
            let image = |pair: &PairedImages| SourceImage {
                number: Some(pair.number),
                times: FrameTimes {
                    device_nanos: pair.time_nanos,
                    ..FrameTimes::default()
                },
                path: path(pair).to_path_buf(),
            };
            let mut images: Vec<SourceImage> = pairs.iter().map(image).collect();
            number_frames(&mut images);
            images
        };
        Self {
            depth: images(|pair| &pair.depth),
            color: images(|pair| &pair.color),
            gaps: Vec::new(),
            recorded: None,
            world_from_camera: pairs.iter().map(|pair| pair.world_from_camera).collect(),
            numbers,
            poses_path,
            worst_rotation_error,
            notes,
        }
    }

    /// The images of both streams by time, depth first where times are equal; each stream keeps its order.
    pub(crate) fn in_order_of_time(&self) -> Vec<StreamImage> {
        let mut order = Vec::with_capacity(self.depth.len() + self.color.len());
        let mut color = (0..self.color.len()).peekable();
        for depth in 0..self.depth.len() {
            let nanos = self.depth[depth].times.device_nanos;
            // Not sorted: where a clock was set back, numbers still rise.
            while let Some(earlier) =
                color.next_if(|&index| self.color[index].times.device_nanos < nanos)
            {
                order.push(StreamImage::Color(earlier));
            }
            order.push(StreamImage::Depth(depth));
        }
        order.extend(color.map(StreamImage::Color));
        order
    }

    pub(crate) fn image(&self, image: StreamImage) -> &SourceImage {
        match image {
            StreamImage::Depth(index) => &self.depth[index],
            StreamImage::Color(index) => &self.color[index],
        }
    }
}

/// An image of a [`Source`] by its position in its stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StreamImage {
    Depth(usize),
    Color(usize),
}

/// A frame of a folder that has both images under one number.
#[derive(Clone, Debug)]
pub(crate) struct PairedImages {
    pub(crate) number: u32,
    pub(crate) time_nanos: i64,
    pub(crate) color: PathBuf,
    pub(crate) depth: PathBuf,
    /// World from the camera that the rig file names.
    pub(crate) world_from_camera: Option<Pose>,
}

/// The images of a folder.
pub(crate) struct Images {
    /// Number, colour and depth of every frame wanted, without gaps.
    pub(crate) wanted: Vec<(u32, PathBuf, PathBuf)>,
    /// Numbers of all frames of the folder.
    pub(crate) numbers: Range<usize>,
}

const COLOR_SUFFIXES: [&str; 4] = [".color.jpg", ".color.jpeg", ".color.png", ".color.yuv"];
const DEPTH_SUFFIXES: [&str; 1] = [".depth.png"];

impl Images {
    /// Finds the images named `prefix` + number + suffix in `folder`. Those in `range` (all by default) must
    /// be complete.
    pub(crate) fn find(
        folder: &Path,
        prefix: &str,
        range: Option<&Range<usize>>,
    ) -> Result<Self, ImportError> {
        let files = numbered_files(folder, prefix)?;
        let mut color = with_suffix(&files, &COLOR_SUFFIXES)?;
        let mut depth = with_suffix(&files, &DEPTH_SUFFIXES)?;
        let used = || color.keys().chain(depth.keys()).copied();
        let (Some(first), Some(last)) = (used().min(), used().max()) else {
            return Err(ImportError::NoFrames {
                path: folder.to_path_buf(),
                expected: "images (NNNNNN.color.jpg, .color.png or .color.yuv, NNNNNN.depth.png)",
            });
        };
        let numbers = first as usize..last as usize + 1;
        let wanted_numbers = range.unwrap_or(&numbers);
        if wanted_numbers.start < numbers.start || wanted_numbers.end > numbers.end {
            return Err(ImportError::Range {
                start: wanted_numbers.start,
                end: wanted_numbers.end,
                first: numbers.start,
                stop: numbers.end,
            });
        }
        let mut wanted = Vec::new();
        // Stops at the first gap, so a stray number of 4 billion costs nothing.
        for number in wanted_numbers.clone() {
            let frame = number as u32;
            let missing = |part| ImportError::MissingPart {
                frame,
                part,
                path: folder.to_path_buf(),
            };
            let color = color.remove(&frame).ok_or(missing("colour image"))?;
            let depth = depth.remove(&frame).ok_or(missing("depth image"))?;
            wanted.push((frame, color, depth));
        }
        Ok(Self { wanted, numbers })
    }
}

/// A file whose name is a prefix, a number and a suffix.
struct NumberedFile {
    number: u32,
    suffix: String,
    path: PathBuf,
}

/// The files of `folder` called `prefix` + number + suffix, ordered by path.
fn numbered_files(folder: &Path, prefix: &str) -> Result<Vec<NumberedFile>, ImportError> {
    let read = |source| ImportError::Read {
        path: folder.to_path_buf(),
        source,
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        let name = entry.map_err(read)?.file_name();
        let Some(rest) = name.to_str().and_then(|name| name.strip_prefix(prefix)) else {
            continue;
        };
        let digit_count = rest.bytes().take_while(u8::is_ascii_digit).count();
        let (digits, suffix) = rest.split_at(digit_count);
        if let Ok(number) = digits.parse() {
            files.push(NumberedFile {
                number,
                suffix: suffix.to_owned(),
                path: folder.join(&name),
            });
        }
    }
    // The order of a folder is the file system's.
    files.sort_unstable_by(|a, b| a.path.cmp(&b.path));
    Ok(files)
}

/// The files with one of `suffixes`, by number; refuses two for one number.
fn with_suffix(
    files: &[NumberedFile],
    suffixes: &[&str],
) -> Result<BTreeMap<u32, PathBuf>, ImportError> {
    let mut chosen = BTreeMap::new();
    for file in files {
        if !suffixes.contains(&file.suffix.as_str()) {
            continue;
        }
        if let Some(first) = chosen.insert(file.number, file.path.clone()) {
            return Err(ImportError::TwoFiles {
                frame: file.number,
                first,
                second: file.path.clone(),
            });
        }
    }
    Ok(chosen)
}

/// Whether `folder` holds a file called `prefix` + number + `suffix`.
pub(crate) fn has_numbered_file(folder: &Path, prefix: &str, suffix: &str) -> bool {
    numbered_files(folder, prefix).is_ok_and(|files| files.iter().any(|file| file.suffix == suffix))
}
