//! `glint import`: a recording from a folder of frames.
//!
//! [`rig`] cameras from TOML (`judge` their numbers, `transform` between them) · `source` frames by number ·
//! `folder` and `seven_scenes` the two layouts · `split` who may see what · [`checks`] plausibility, before
//! anything is written · [`report`] what was done · [`error`] what is refused.
//!
//! Every pixel is kept: depth and PNG colour are coded anew without loss, JPEG keeps its bytes (and is decoded
//! once, so that what is written can be read). Masks and truth beside the frames are not looked at.

pub mod checks;
pub mod error;
mod folder;
mod judge;
pub mod report;
pub mod rig;
mod seven_scenes;
mod source;
mod split;
mod transform;

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use geometry::Pose;
use imaging::{Image, decode_jpeg, decode_png_gray16, decode_png_rgb8, metres_from_raw};
use rayon::prelude::*;
use sequence::codecs::DepthCodec;
use sequence::encode::{ColorStreamEncoder, DepthStreamEncoder};
use sequence::{
    COLOR_STREAM, ColorEncoding, Created, DEPTH_STREAM, Description, FileId, FramePose, FrameTimes,
    RecordingWriter, StreamTiming, Streams,
};
use serde::Serialize;

pub use error::ImportError;
pub use report::{DepthReport, ImportReport};

use checks::{check_depth_unit, check_pose_direction, median_code};
use error::read_file;
use rig::{PoseCamera, Rig};
use source::{Source, SourceFrame};

/// Name of the pose set that an import makes.
pub const POSE_SET: &str = "source";

/// Layout of a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
pub enum ImportFormat {
    /// `frame-NNNNNN.color.png` (or .jpg), `.depth.png`, `.pose.txt` in one folder.
    #[value(name = "7scenes")]
    #[serde(rename = "7scenes")]
    SevenScenes,
    /// `frames/NNNNNN.color.jpg` (or .png), `frames/NNNNNN.depth.png`, `poses.txt`.
    #[value(name = "folder")]
    #[serde(rename = "folder")]
    Folder,
}

/// What to import.
#[derive(Clone, Debug)]
pub struct ImportOptions {
    /// Folder with the frames.
    pub input: PathBuf,
    /// Recording to write; replaced when it exists.
    pub output: PathBuf,
    /// Layout of the folder; recognised when absent.
    pub format: Option<ImportFormat>,
    /// Rig file; `rig.toml` in the folder when absent.
    pub rig: Option<PathBuf>,
    /// Split file; `split.json` in the folder when absent, else all train.
    pub split: Option<PathBuf>,
    /// Frames by the numbers in their names; all when absent.
    pub range: Option<Range<usize>>,
}

/// Frames that are read and decoded at a time, by all threads together.
const BATCH: usize = 16;

/// Imports a folder; `progress(done, of)` is called as frames are written. Nothing is left under the name
/// of the recording unless all went well.
pub fn import(
    options: &ImportOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<ImportReport> {
    let rig_path = match &options.rig {
        Some(path) => path.clone(),
        None => options.input.join("rig.toml"),
    };
    let format = match options.format {
        Some(format) => format,
        None => recognise(&options.input)?,
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
    };
    require_encoding(&source, streams.color.encoding)?;
    let split_path = options.split.clone().or_else(|| {
        let beside = options.input.join("split.json");
        beside.exists().then_some(beside)
    });
    let (split, split_notes) = split::split_of(&source, split_path.as_deref())?;
    let poses = world_from_depth(&source, rig.poses, &streams.color_from_depth);
    let pose_fit = check_samples(&source, &poses, &streams)?;

    let description = Description {
        writer: concat!("glint ", env!("CARGO_PKG_VERSION")).to_owned(),
        // Nothing was filmed now: an import is the same file at any time of day.
        created: Created::default(),
        part: None,
        streams: streams.clone(),
        depth_id: DEPTH_STREAM,
        color_id: COLOR_STREAM,
    };
    let poses: Vec<FramePose> = (0..)
        .zip(poses)
        .map(|(number, pose)| FramePose::ok(number, pose))
        .collect();
    // Not random: the same folder makes the same file.
    let file_id = FileId::of_content(&[
        &description.to_json()?,
        format!("{split:?} {poses:?} {:?}", source.frames).as_bytes(),
    ]);
    let mut writer = RecordingWriter::create_beside(&options.output, file_id, &description)?;
    let set = writer.begin_poses(POSE_SET, &description.writer, DEPTH_STREAM)?;
    writer.write_split(&split)?;
    let copied = copy_frames(&source, &streams, &mut writer, progress)?;
    let times = [source.frames.first(), source.frames.last()]
        .map(|frame| frame.map_or(0, |frame| frame.time_nanos));
    writer.write_poses(set, &poses)?;
    let finished = writer.finish("complete")?;
    require_nothing_lost(&options.output, &finished.lost)?;
    let bytes = finished.bytes;
    let mut notes = source.notes;
    notes.extend(split_notes);
    notes.extend(rig.notes());
    if pose_fit.is_some_and(|fit| fit.given_fraction < 0.5) {
        notes.push(
            "depth agrees poorly between frames: poses, intrinsics or times may be wrong"
                .to_owned(),
        );
    }
    Ok(ImportReport {
        output: options.output.clone(),
        bytes,
        format,
        frame_count: source.frames.len(),
        train_count: split.train.len(),
        unused_count: split.unused.len(),
        test_count: split.test.len(),
        duration_s: (i128::from(times[1]) - i128::from(times[0])) as f64 / 1e9,
        depth: copied.depth_report(streams.depth.depth_scale),
        repeated_depth_count: copied.repeated_depth_count,
        repeated_color_count: copied.repeated_color_count,
        worst_rotation_error: source.worst_rotation_error,
        pose_fit,
        notes,
    })
}

fn recognise(folder: &Path) -> Result<ImportFormat, ImportError> {
    if let Err(source) = std::fs::read_dir(folder) {
        return Err(ImportError::Read {
            path: folder.to_path_buf(),
            source,
        });
    }
    if folder.join("frames").is_dir() && folder.join("poses.txt").exists() {
        return Ok(ImportFormat::Folder);
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
    for frame in &source.frames {
        let is_png = frame
            .color
            .extension()
            .is_some_and(|extension| extension == "png");
        if is_png != (encoding == ColorEncoding::Rgb8) {
            return Err(ImportError::MixedColor {
                path: frame.color.clone(),
                expected: if is_png { "jpeg" } else { "png" },
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

fn world_from_depth(source: &Source, camera: PoseCamera, color_from_depth: &Pose) -> Vec<Pose> {
    source
        .frames
        .iter()
        .map(|frame| match camera {
            PoseCamera::Depth => frame.world_from_camera,
            PoseCamera::Color => frame.world_from_camera * *color_from_depth,
        })
        .collect()
}

fn check_samples(
    source: &Source,
    poses: &[Pose],
    streams: &Streams,
) -> Result<Option<checks::PoseFit>, ImportError> {
    let paths: Vec<PathBuf> = source
        .frames
        .iter()
        .map(|frame| frame.depth.clone())
        .collect();
    let codes = |path: &Path| depth_codes(path, &read_file(path)?, streams);
    check_depth_unit(&paths, &streams.depth, &codes)?;
    check_pose_direction(&paths, poses, &streams.depth, &source.poses_path, &codes)
}

/// Decodes a depth image and refuses another size than the camera's.
fn depth_codes(path: &Path, bytes: &[u8], streams: &Streams) -> Result<Image<u16>, ImportError> {
    let codes = decode_png_gray16(bytes).map_err(|source| ImportError::Image {
        path: path.to_path_buf(),
        source,
    })?;
    require_size(path, "depth", &codes, &streams.depth.intrinsics)?;
    Ok(codes)
}

fn require_size<T>(
    path: &Path,
    stream: &'static str,
    image: &Image<T>,
    camera: &geometry::Intrinsics,
) -> Result<(), ImportError> {
    if (image.width(), image.height()) == (camera.width(), camera.height()) {
        return Ok(());
    }
    Err(ImportError::ImageSize {
        path: path.to_path_buf(),
        stream,
        width: image.width(),
        height: image.height(),
        camera_width: camera.width(),
        camera_height: camera.height(),
    })
}

/// A frame that was read and decoded.
struct LoadedFrame {
    codes: Image<u16>,
    /// What the colour encoder takes: the file itself for JPEG, the samples for PNG.
    color: Vec<u8>,
}

fn load(frame: &SourceFrame, streams: &Streams) -> Result<LoadedFrame, ImportError> {
    let codes = depth_codes(&frame.depth, &read_file(&frame.depth)?, streams)?;
    let file = read_file(&frame.color)?;
    let decoded = match streams.color.encoding {
        ColorEncoding::Jpeg => decode_jpeg(&file),
        _ => decode_png_rgb8(&file),
    };
    let decoded = decoded.map_err(|source| ImportError::Image {
        path: frame.color.clone(),
        source,
    })?;
    require_size(&frame.color, "color", &decoded, &streams.color.intrinsics)?;
    let color = match streams.color.encoding {
        ColorEncoding::Jpeg => file,
        _ => decoded.pixels().as_flattened().to_vec(),
    };
    Ok(LoadedFrame { codes, color })
}

/// What was counted while frames were copied.
struct Copied {
    depth: DepthReport,
    histogram: Vec<u64>,
    repeated_depth_count: usize,
    repeated_color_count: usize,
}

impl Copied {
    fn depth_report(&self, scale: f64) -> DepthReport {
        DepthReport {
            median_m: median_code(&self.histogram).map_or(0.0, |code| code * scale),
            ..self.depth
        }
    }

    fn count(&mut self, codes: &Image<u16>, streams: &Streams) {
        let camera = &streams.depth;
        for code in codes.pixels() {
            self.histogram[usize::from(*code)] += 1;
        }
        let (_, counts) = metres_from_raw(codes, camera.depth_scale, camera.depth_range.clone());
        self.depth.measured_count += counts.measured_count;
        self.depth.out_of_range_count += counts.out_of_range_count;
        self.depth.code_0_count = self.histogram[0];
        self.depth.code_65535_count = self.histogram[usize::from(u16::MAX)];
    }
}

fn copy_frames(
    source: &Source,
    streams: &Streams,
    writer: &mut RecordingWriter,
    progress: &mut dyn FnMut(usize, usize),
) -> anyhow::Result<Copied> {
    let mut copied = Copied {
        depth: DepthReport::default(),
        histogram: vec![0; 1 << 16],
        repeated_depth_count: 0,
        repeated_color_count: 0,
    };
    let mut depth_encoder = DepthStreamEncoder::new(streams, DepthCodec::Dense)?;
    let mut color_encoder = ColorStreamEncoder::new(streams)?;
    let mut previous: Option<LoadedFrame> = None;
    let mut number = 0;
    for batch in source.frames.chunks(BATCH) {
        crate::interrupt::check()?;
        let loaded: Vec<Result<LoadedFrame, ImportError>> =
            batch.par_iter().map(|frame| load(frame, streams)).collect();
        for (frame, loaded) in batch.iter().zip(loaded) {
            // In order: the first bad frame is the one reported, whatever thread met another.
            let loaded = loaded?;
            let repeats = |is_same: fn(&LoadedFrame, &LoadedFrame) -> bool| {
                previous
                    .as_ref()
                    .is_some_and(|previous| is_same(previous, &loaded))
            };
            let depth_times = FrameTimes {
                number,
                device_nanos: frame.time_nanos,
                is_repeat: repeats(|a, b| a.codes == b.codes),
                ..FrameTimes::default()
            };
            let color_times = FrameTimes {
                is_repeat: repeats(|a, b| a.color == b.color),
                ..depth_times
            };
            let (payload, table) = depth_encoder.encode(loaded.codes.pixels())?;
            if let Some(table) = table {
                writer.write_table(DEPTH_STREAM, table)?;
            }
            writer.write_frame(DEPTH_STREAM, &depth_times, payload)?;
            let payload = color_encoder.encode(&loaded.color)?;
            writer.write_frame(COLOR_STREAM, &color_times, payload)?;
            writer.seal_if_due(frame.time_nanos)?;
            copied.count(&loaded.codes, streams);
            copied.repeated_depth_count += usize::from(depth_times.is_repeat);
            copied.repeated_color_count += usize::from(color_times.is_repeat);
            previous = Some(loaded);
            number += 1;
            progress(number as usize, source.frames.len());
        }
    }
    Ok(copied)
}
