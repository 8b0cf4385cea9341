//! Recordings of OpenNI and OpenNI2 (`.oni`), read without their library.
//!
//! `record` headers and fields of records · [`OniContents`] which frames there are (`container`) · [`Properties`] what
//! is said of them · [`codec`] 16z and 8z · `frame` samples · `cameras` what the recording is told of the cameras ·
//! [`OniDamage`] what is wrong. Sections that are named are those of the project's description of the format.

mod cameras;
pub mod codec;
mod container;
mod damage;
mod frame;
mod properties;
mod record;

use std::fs::File;
use std::path::Path;

use sequence::{COLOR_STREAM, DEPTH_STREAM, FrameTimes, Gap, GapCause};

pub use container::{NodeKind, OniCodec, OniContents, OniFrame, OniNode, ReadAt};
pub use damage::OniDamage;
pub use frame::{OniSamples, decode_frame, read_frame};
pub use properties::{OniPixels, OniShape, Properties};

use super::ImportOptions;
use super::copy::Loaded;
use super::error::ImportError;
use super::rig::Rig;
use super::source::{Source, SourceImage, StreamImage};
use super::tum::around;
use cameras::{Stream, cameras};
use imaging::Image;
use sequence::{ColorEncoding, Streams};

/// A file whose frames are known.
pub(super) struct OniSource {
    file: File,
    contents: OniContents,
    pub(super) source: Source,
    pub(super) streams: Streams,
    /// Frames of the file behind the images of `source`: depth, colour.
    wanted: [Vec<OniFrame>; 2],
    /// What the file has lost, a line each.
    pub(super) missing: Vec<String>,
}

/// Finds the frames of a file.
pub(super) fn read(options: &ImportOptions) -> Result<OniSource, ImportError> {
    let path = &options.input;
    let file = File::open(path).map_err(|source| ImportError::Read {
        path: path.clone(),
        source,
    })?;
    let contents = OniContents::read(&file).map_err(|source| ImportError::Oni {
        path: path.clone(),
        what: "the file".to_owned(),
        source,
    })?;
    let depth = stream(path, &contents, NodeKind::Depth)?;
    let color = stream(path, &contents, NodeKind::Image)?;
    let (nominal, mut notes) = cameras(path, depth, color)?;
    let streams = match &options.rig {
        None => nominal,
        Some(rig_path) => {
            let rig = Rig::read(rig_path)?;
            notes = rig.notes();
            with_rig(rig_path, rig.streams(rig_path)?, &nominal)?
        }
    };
    notes.extend(left_out(&contents));
    let missing: Vec<String> = contents
        .cut_at
        .map(|at| format!("the file breaks off at byte {at}, without an END record"))
        .into_iter()
        .collect();
    let [mut depth, mut color] = [depth, color].map(|stream| {
        stream.map_or_else(Vec::new, |stream| {
            images(path, &stream.node.frames, &mut notes)
        })
    });
    let leading_count = if depth.is_empty() {
        color.len()
    } else {
        depth.len()
    };
    let numbers = 0..leading_count;
    if let Some(range) = &options.range {
        if range.end > leading_count {
            return Err(ImportError::Range {
                start: range.start,
                end: range.end,
                first: 0,
                stop: leading_count,
            });
        }
        if depth.is_empty() {
            color = color[range.clone()].to_vec();
        } else {
            depth = depth[range.clone()].to_vec();
            color = around(&color, &depth);
        }
    }
    let frame_of = |kind, images: &[SourceImage]| {
        let frames = contents.node(kind).map_or(&[][..], |node| &node.frames);
        // Numbers of images are positions in the file.
        let positions = images.iter().filter_map(|image| image.number);
        positions
            .filter_map(|position| frames.get(position as usize).cloned())
            .collect()
    };
    let wanted = [
        frame_of(NodeKind::Depth, &depth),
        frame_of(NodeKind::Image, &color),
    ];
    let mut gaps = number(&mut depth, DEPTH_STREAM);
    gaps.extend(number(&mut color, COLOR_STREAM));
    let source = Source {
        world_from_camera: vec![None; depth.len()],
        depth,
        color,
        gaps,
        recorded: None,
        numbers,
        poses_path: path.clone(),
        worst_rotation_error: 0.0,
        notes,
    };
    Ok(OniSource {
        file,
        contents,
        source,
        streams,
        wanted,
        missing,
    })
}

impl OniSource {
    /// Reads and decodes an image; what is damaged becomes a gap.
    pub(super) fn load(&self, image: StreamImage) -> Loaded {
        let (kind, frame, size) = match image {
            StreamImage::Depth(index) => (
                NodeKind::Depth,
                &self.wanted[0][index],
                &self.streams.depth.intrinsics,
            ),
            StreamImage::Color(index) => (
                NodeKind::Image,
                &self.wanted[1][index],
                &self.streams.color.intrinsics,
            ),
        };
        let damaged = |damage: OniDamage| Loaded::Damaged(damage.to_string());
        let Some(node) = self.contents.node(kind) else {
            return damaged(OniDamage::NoShape);
        };
        let is_of_size =
            |shape: OniShape| (shape.width, shape.height) == (size.width(), size.height());
        let first = node.frames.first().and_then(|frame| frame.shape);
        // A recording has one size and one kind of samples a stream.
        if !frame.shape.is_some_and(is_of_size)
            || frame.shape.map(|shape| shape.pixels) != first.map(|shape| shape.pixels)
        {
            return damaged(OniDamage::NoShape);
        }
        match (read_frame(&self.file, node, frame), image) {
            (Err(damage), _) => damaged(damage),
            (Ok(OniSamples::Words(words)), StreamImage::Depth(_)) => {
                match Image::from_vec(size.width(), size.height(), words) {
                    Ok(codes) => Loaded::Depth(codes),
                    Err(error) => Loaded::Damaged(error.to_string()),
                }
            }
            (Ok(OniSamples::Jpeg(bytes)), StreamImage::Color(_)) => Loaded::Color(bytes),
            (Ok(OniSamples::Bytes(bytes)), StreamImage::Color(_)) => {
                let is_gray = frame
                    .shape
                    .is_some_and(|shape| shape.pixels == OniPixels::Gray8);
                Loaded::Color(if is_gray {
                    bytes.iter().flat_map(|&gray| [gray; 3]).collect()
                } else {
                    bytes
                })
            }
            (Ok(_), _) => damaged(OniDamage::Codec),
        }
    }
}

/// The stream of a kind, if it has frames that can be recordings.
fn stream<'a>(
    path: &Path,
    contents: &'a OniContents,
    kind: NodeKind,
) -> Result<Option<Stream<'a>>, ImportError> {
    let Some(node) = contents.node(kind).filter(|node| !node.frames.is_empty()) else {
        return Ok(None);
    };
    let refused = |source| ImportError::Oni {
        path: path.to_path_buf(),
        what: format!("stream `{}`", node.name),
        source,
    };
    let shape = node.frames[0]
        .shape
        .ok_or_else(|| refused(OniDamage::NoShape))?;
    let is_fit = match node.codec {
        OniCodec::Unknown(_) => false,
        OniCodec::Z16 | OniCodec::Z16Table => kind == NodeKind::Depth,
        OniCodec::Jpeg | OniCodec::Z8 => kind == NodeKind::Image,
        OniCodec::Raw => true,
    };
    if !is_fit || shape.pixels == OniPixels::Gray16 {
        return Err(refused(OniDamage::Codec));
    }
    Ok(Some(Stream { node, shape }))
}

/// The cameras of a rig file with what the file itself knows; sizes and samples must agree.
fn with_rig(path: &Path, rig: Streams, file: &Streams) -> Result<Streams, ImportError> {
    let size = |streams: &Streams| {
        [&streams.depth.intrinsics, &streams.color.intrinsics]
            .map(|camera| [camera.width(), camera.height()])
    };
    let encoding = |streams: &Streams| match streams.color.encoding {
        ColorEncoding::Jpeg => "jpeg",
        ColorEncoding::Rgb8 => "png",
        other => other.name(),
    };
    let message = if size(&rig) != size(file) {
        let [[depth_width, depth_height], [color_width, color_height]] = size(file);
        format!(
            "the file has depth of {depth_width} x {depth_height} and colour of {color_width} x {color_height} pixels, the rig file says otherwise"
        )
    } else if encoding(&rig) != encoding(file) {
        format!(
            "color.format is `{}`, the file needs `{}`",
            encoding(&rig),
            encoding(file)
        )
    } else if (rig.depth.depth_scale / file.depth.depth_scale - 1.0).abs() > 1e-9 {
        format!(
            "depth.scale is {}, the file counts {} m a unit",
            rig.depth.depth_scale, file.depth.depth_scale
        )
    } else {
        return Ok(Streams {
            depth: sequence::DepthCamera {
                samples: file.depth.samples,
                shift: file.depth.shift.clone(),
                ..rig.depth
            },
            depth_timing: file.depth_timing,
            color_timing: file.color_timing,
            ..rig
        });
    };
    Err(ImportError::Text {
        path: path.to_path_buf(),
        line: None,
        message,
    })
}

/// What of the file a recording does not hold.
fn left_out(contents: &OniContents) -> Vec<String> {
    let is_taken = |node: &OniNode| {
        contents
            .node(node.kind)
            .is_some_and(|taken| std::ptr::eq(taken, node))
    };
    let lines = contents.nodes.iter().filter_map(|node| {
        let why = match node.kind {
            NodeKind::Infrared => "infrared",
            NodeKind::Other => "neither depth nor colour",
            _ if is_taken(node) => return None,
            _ => "a second stream of its kind",
        };
        let count = node.frames.len();
        (count > 0).then(|| format!("stream `{}`, {why}, is left out: {count} frames", node.name))
    });
    lines.collect()
}

/// The frames of a node as images, numbered by position; times as the file has them.
fn images(path: &Path, frames: &[OniFrame], notes: &mut Vec<String>) -> Vec<SourceImage> {
    let is_rising = frames.is_sorted_by(|a, b| a.number < b.number);
    if !is_rising {
        notes.push("frame numbers do not rise: frames are numbered as they stand".to_owned());
    }
    let (first, count) = match frames.first() {
        Some(frame) => (frame.number, frames.len() as u32),
        None => return Vec::new(),
    };
    let numbers = (0..count).zip(frames);
    numbers
        .map(|(position, frame)| SourceImage {
            number: Some(position),
            times: FrameTimes {
                number: u64::from(if is_rising {
                    frame.number - first
                } else {
                    position
                }),
                device_ticks: Some(frame.timestamp_us),
                device_nanos: i64::try_from(frame.timestamp_us)
                    .unwrap_or(i64::MAX)
                    .saturating_mul(1000),
                ..FrameTimes::default()
            },
            path: path.to_path_buf(),
        })
        .collect()
}

/// Lets the numbers of wanted images begin at 0 and says which are missing between them.
fn number(images: &mut [SourceImage], stream: u16) -> Vec<Gap> {
    let first = images.first().map_or(0, |image| image.times.number);
    for image in images.iter_mut() {
        image.times.number -= first;
    }
    let holes = images.windows(2).filter_map(|pair| {
        let [before, after] = [pair[0].times, pair[1].times];
        let count = after.number - before.number - 1;
        (count > 0).then(|| Gap {
            stream,
            first_number: before.number + 1,
            count,
            from_nanos: Some(before.device_nanos),
            to_nanos: Some(after.device_nanos),
            cause: Some(GapCause::Source),
            note: String::new(),
        })
    });
    holes.collect()
}
