//! `glint import`: a recording from a folder of frames or from another program's recording.
//!
//! [`rig`] cameras from TOML (`judge` their numbers, `transform` between them; `rig_writing` the other way) ·
//! `source` two streams of images with their times, and poses · `folder`, `seven_scenes` and `tum` the
//! layouts (`trajectory` lines of text with times, `frames_json` and `gaps` what a recording knew before it was
//! exported) · [`oni`] recordings of OpenNI, cameras and all · `split` who may see what · [`checks`] plausibility,
//! before anything is written · `copy` images into the recording · [`report`] what was done · [`error`] what
//! is refused.
//!
//! Every pixel and every time is kept: depth, PNG and raw colour are coded anew without loss, JPEG keeps its
//! bytes (and is decoded once, so that what is written can be read). Masks and truth beside the frames are not looked at.

pub mod checks;
mod copy;
pub mod error;
mod folder;
mod frames_json;
mod gaps;
mod judge;
pub mod oni;
pub mod report;
pub mod rig;
mod rig_writing;
mod seven_scenes;
mod source;
mod split;
pub(crate) mod trajectory;
mod transform;
mod tum;

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use geometry::Pose;
use sequence::{
    COLOR_STREAM, ColorEncoding, Created, DEPTH_STREAM, Description, FileId, FramePose, Recording,
    RecordingWriter, SequenceError, Split, StreamTiming, Streams,
};
use serde::Serialize;

pub use error::ImportError;
pub use report::{DepthReport, ImportReport};

use checks::{check_depth_unit, check_pose_direction};
use copy::{Loaded, copy_images, depth_codes, load_file};
use error::read_file;
use rig::{PoseCamera, Rig};
use source::{Source, SourceImage, StreamImage};

/// Name of the pose set that an import makes.
pub const POSE_SET: &str = "source";

/// Layout of what is imported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
pub enum ImportFormat {
    /// `frame-NNNNNN.color.png` (or .jpg, .yuv), `.depth.png`, `.pose.txt` in one folder.
    #[value(name = "7scenes")]
    #[serde(rename = "7scenes")]
    SevenScenes,
    /// `rgb.txt`, `depth.txt` and, where there are poses, `groundtruth.txt`.
    #[value(name = "tum")]
    #[serde(rename = "tum")]
    Tum,
    /// `frames/NNNNNN.color.jpg` (or .png, .yuv), `frames/NNNNNN.depth.png`, `poses.txt`.
    #[value(name = "folder")]
    #[serde(rename = "folder")]
    Folder,
    /// A recording of OpenNI or OpenNI2, one file.
    #[value(name = "oni")]
    #[serde(rename = "oni")]
    Oni,
}

/// What to import.
#[derive(Clone, Debug)]
pub struct ImportOptions {
    /// Folder with the frames, or a recording of OpenNI.
    pub input: PathBuf,
    /// Recording to write; replaced when it exists.
    pub output: PathBuf,
    /// Layout of the input; recognised when absent.
    pub format: Option<ImportFormat>,
    /// Rig file; when absent, `rig.toml` in the folder, or what the recording of OpenNI says.
    pub rig: Option<PathBuf>,
    /// Split file; `split.json` in the folder when absent, else all train.
    pub split: Option<PathBuf>,
    /// Frames by the numbers in their names, in TUM by the position of the depth image; all when absent.
    pub range: Option<Range<usize>>,
}

/// Imports a folder or a recording of OpenNI; `progress(done, of)` is called as frames are written. Nothing is left
/// under the name of the recording unless all went well.
///
/// # Errors
/// [`ImportError`] in what is imported, errors of the disk, an interruption.
pub fn import(
    options: &ImportOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<ImportReport> {
    let format = match options.format {
        Some(format) => format,
        None => recognise(&options.input)?,
    };
    if format == ImportFormat::Oni {
        let oni = oni::read(options)?;
        let (split, split_notes) = split::split_of(&oni.source, options.split.as_deref())?;
        let found = Found {
            format,
            source: &oni.source,
            streams: &oni.streams,
            split,
            poses: Vec::new(),
            pose_fit: None,
            notes: split_notes,
        };
        let mut report = found.write(options, &|image| Ok(oni.load(image)), progress)?;
        report.missing.splice(0..0, oni.missing);
        return Ok(report);
    }
    let rig_path = match &options.rig {
        Some(path) => path.clone(),
        None => options.input.join("rig.toml"),
    };
    if options.rig.is_none() && !rig_path.exists() {
        return Err(ImportError::NoRig { path: rig_path }.into());
    }
    let rig = Rig::read(&rig_path)?;
    let mut streams = rig.streams(&rig_path)?;
    let range = options.range.as_ref();
    let source = match format {
        ImportFormat::Folder => folder::read(&options.input, range)?,
        ImportFormat::SevenScenes => {
            let rate_hz = rig.frame_rate.unwrap_or(seven_scenes::ASSUMED_RATE_HZ);
            streams.depth_timing = StreamTiming::at_rate(rate_hz);
            streams.color_timing = streams.depth_timing;
            seven_scenes::read(&options.input, range, rate_hz)?
        }
        // OpenNI's are gone by now.
        ImportFormat::Tum | ImportFormat::Oni => tum::read(&options.input, range, rig.pose_stamps)?,
    };
    require_encoding(&source, streams.color.encoding)?;
    if let Some(recorded) = &source.recorded {
        streams.depth_timing = recorded.depth_timing;
        streams.color_timing = recorded.color_timing;
        streams.device = recorded.device.clone();
    }
    let split_path = options.split.clone().or_else(|| {
        let beside = options.input.join("split.json");
        beside.exists().then_some(beside)
    });
    let (split, mut notes) = split::split_of(&source, split_path.as_deref())?;
    let poses = world_from_depth(&source, rig.poses, &streams.color_from_depth);
    let pose_fit = check_samples(&source, &poses, &streams)?;
    notes.extend(rig.notes());
    if pose_fit.is_some_and(|fit| fit.given_fraction < 0.5) {
        notes.push(
            "depth agrees poorly between frames: poses, intrinsics or times may be wrong"
                .to_owned(),
        );
    }
    let found = Found {
        format,
        source: &source,
        streams: &streams,
        split,
        poses,
        pose_fit,
        notes,
    };
    found.write(
        options,
        &|image| load_file(&source, image, &streams),
        progress,
    )
}

/// What is to be written, all of it judged.
struct Found<'a> {
    format: ImportFormat,
    source: &'a Source,
    streams: &'a Streams,
    split: Split,
    /// World from depth camera, one for each depth image where it is known; may be empty.
    poses: Vec<Option<Pose>>,
    pose_fit: Option<checks::PoseFit>,
    /// Beside those of the source.
    notes: Vec<String>,
}

impl Found<'_> {
    fn write(
        self,
        options: &ImportOptions,
        load: &(dyn Fn(StreamImage) -> Result<Loaded, ImportError> + Sync),
        progress: &mut dyn FnMut(usize, usize),
    ) -> anyhow::Result<ImportReport> {
        let Self {
            format,
            source,
            streams,
            split,
            poses,
            pose_fit,
            notes: more_notes,
        } = self;
        let mut writer = begin(options, source, streams, &split)?;
        let posed = source
            .depth
            .iter()
            .zip(&poses)
            .filter_map(|(image, pose)| Some(FramePose::ok(image.times.number, (*pose)?)));
        let frame_poses: Vec<FramePose> = posed.collect();
        let set = if frame_poses.is_empty() {
            None
        } else {
            Some(writer.begin_poses(POSE_SET, WRITER, DEPTH_STREAM)?)
        };
        writer.write_split(&split)?;
        let copied = copy_images(source, streams, load, &mut writer, progress)?;
        if let Some(set) = set {
            writer.write_poses(set, &frame_poses)?;
        }
        let finished = writer.finish("complete")?;
        require_nothing_lost(&options.output, &finished.lost)?;
        let mut notes = source.notes.clone();
        notes.extend(more_notes);
        Ok(ImportReport {
            output: options.output.clone(),
            bytes: finished.bytes,
            format,
            frame_count: source.depth.len(),
            color_count: source.color.len(),
            // Pairing is the reader's: asked, not guessed.
            pair_count: Recording::open(&options.output)?.frame_count(),
            pose_count: frame_poses.len(),
            train_count: split.train.len(),
            unused_count: split.unused.len(),
            test_count: split.test.len(),
            duration_s: duration_s(source),
            depth: copied.depth_report(streams.depth.depth_scale),
            repeated_depth_count: copied.repeated_depth.count,
            repeated_color_count: copied.repeated_color.count,
            repeated_depth_frames: copied.repeated_depth.numbers,
            repeated_color_frames: copied.repeated_color.numbers,
            worst_rotation_error: source.worst_rotation_error,
            pose_fit,
            notes,
            missing: copied.damaged,
        })
    }
}

/// What the recording says made it.
const WRITER: &str = concat!("glint ", env!("CARGO_PKG_VERSION"));

fn begin(
    options: &ImportOptions,
    source: &Source,
    streams: &Streams,
    split: &Split,
) -> Result<RecordingWriter, SequenceError> {
    let description = Description {
        writer: WRITER.to_owned(),
        // Nothing was filmed now: an import is the same file at any time of day.
        created: Created::default(),
        part: None,
        streams: streams.clone(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    // Not random: the same folder makes the same file, wherever it lies.
    let images: Vec<_> = [&source.depth, &source.color]
        .into_iter()
        .flatten()
        .map(|image| {
            let bytes = std::fs::metadata(&image.path).map_or(0, |metadata| metadata.len());
            let name = image.path.strip_prefix(&options.input);
            (
                image.number.unwrap_or_default(),
                image.times.device_nanos,
                bytes,
                name.ok().map(Path::to_path_buf),
            )
        })
        .collect();
    let json = description.to_json()?;
    let text = format!("{split:?} {:?} {images:?}", source.world_from_camera);
    let mut parts = vec![json.as_slice(), text.as_bytes()];
    let times = |images: &[SourceImage]| images.iter().map(|image| image.times).collect::<Vec<_>>();
    let recorded = format!(
        "{:?} {:?} {:?}",
        times(&source.depth),
        times(&source.color),
        source.gaps
    );
    if source.recorded.is_some() {
        parts.push(recorded.as_bytes());
    }
    let file_id = FileId::of_content(&parts);
    RecordingWriter::create_beside(&options.output, file_id, &description)
}

/// From the first image of either stream to the last, seconds.
fn duration_s(source: &Source) -> f64 {
    let nanos = || {
        source
            .depth
            .iter()
            .chain(&source.color)
            .map(|image| i128::from(image.times.device_nanos))
    };
    let (first, last) = (nanos().min().unwrap_or(0), nanos().max().unwrap_or(0));
    (last - first) as f64 / 1e9
}

fn recognise(folder: &Path) -> Result<ImportFormat, ImportError> {
    if folder.is_file() {
        return Ok(ImportFormat::Oni);
    }
    if let Err(source) = std::fs::read_dir(folder) {
        return Err(ImportError::Read {
            path: folder.to_path_buf(),
            source,
        });
    }
    if folder.join("frames").is_dir() && folder.join("poses.txt").exists() {
        return Ok(ImportFormat::Folder);
    }
    if folder.join(tum::COLOR_LIST).exists() && folder.join(tum::DEPTH_LIST).exists() {
        return Ok(ImportFormat::Tum);
    }
    if source::has_numbered_file(folder, seven_scenes::PREFIX, seven_scenes::POSE_SUFFIX) {
        return Ok(ImportFormat::SevenScenes);
    }
    Err(ImportError::UnknownLayout {
        path: folder.to_path_buf(),
    })
}

/// All colour images must be what the rig file says; the names tell.
fn require_encoding(source: &Source, encoding: ColorEncoding) -> Result<(), ImportError> {
    let expected = match encoding {
        ColorEncoding::Jpeg => "jpeg",
        ColorEncoding::Rgb8 | ColorEncoding::BayerGrbg | ColorEncoding::Infrared10 => "png",
        ColorEncoding::Uyvy | ColorEncoding::Yuyv => "yuv",
    };
    for image in &source.color {
        let extension = image
            .path
            .extension()
            .and_then(|extension| extension.to_str());
        let is_raw = extension.filter(|extension| ["png", "yuv"].contains(extension));
        if is_raw.unwrap_or("jpeg") != expected {
            return Err(ImportError::MixedColor {
                path: image.path.clone(),
                expected,
            });
        }
    }
    Ok(())
}

/// An import is whole or it is none.
fn require_nothing_lost(path: &Path, lost: &[sequence::Gap]) -> anyhow::Result<()> {
    anyhow::ensure!(
        lost.is_empty(),
        "{}: the disk reported errors and {} frames are missing; import it again to another disk",
        path.display(),
        lost.iter().map(|gap| gap.count).sum::<u64>()
    );
    Ok(())
}

fn world_from_depth(
    source: &Source,
    camera: PoseCamera,
    color_from_depth: &Pose,
) -> Vec<Option<Pose>> {
    let of_depth = |world_from_camera: Pose| match camera {
        PoseCamera::Depth => world_from_camera,
        PoseCamera::Color => world_from_camera * *color_from_depth,
    };
    let poses = source.world_from_camera.iter();
    poses.map(|pose| pose.map(of_depth)).collect()
}

fn check_samples(
    source: &Source,
    poses: &[Option<Pose>],
    streams: &Streams,
) -> Result<Option<checks::PoseFit>, ImportError> {
    let paths: Vec<PathBuf> = source
        .depth
        .iter()
        .map(|image| image.path.clone())
        .collect();
    let codes = |path: &Path| depth_codes(path, &read_file(path)?, streams);
    check_depth_unit(&paths, &streams.depth, &codes)?;
    check_pose_direction(&paths, poses, &streams.depth, &source.poses_path, &codes)
}
