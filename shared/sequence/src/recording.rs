//! Reading a recording.

use std::path::{Path, PathBuf};

use geometry::Pose;
use imaging::{
    Image, Rgb8Image, decode_jpeg, decode_png_gray16, decode_png_rgb8, jpeg_is_subsampled,
};
use zerocopy::byteorder::little_endian::F64;

use crate::cameras::{ColorCamera, ColorCodec, DepthCamera, Streams};
use crate::description::{Description, pose_from_numbers};
use crate::error::SequenceError;
use crate::layout::{FrameEntry, Header, PoseEntry, Section, table};
use crate::map::LockedMap;
use crate::split::Split;
use crate::writer::{PoseSet, require_pose_set_name};

/// An open recording. Frames are read through a map, from any thread.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    map: LockedMap,
    frames: Vec<FrameEntry>,
    streams: Streams,
    pose_sets: Vec<PoseSet>,
    split: Split,
}

/// What stands beside the payloads.
struct Contents {
    frames: Vec<FrameEntry>,
    streams: Streams,
    pose_sets: Vec<PoseSet>,
    split: Split,
}

impl Recording {
    /// Opens and checks everything but the frames themselves, which are checked when they are read.
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        let opened = LockedMap::open(path).and_then(|map| {
            let contents = Contents::parse(map.bytes())?;
            Ok((map, contents))
        });
        let (map, contents) = opened.map_err(|error| error.in_file(path))?;
        Ok(Self {
            path: path.to_path_buf(),
            map,
            frames: contents.frames,
            streams: contents.streams,
            pose_sets: contents.pose_sets,
            split: contents.split,
        })
    }

    /// The path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How many frames there are.
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// The depth camera.
    pub fn depth_camera(&self) -> &DepthCamera {
        &self.streams.depth
    }

    /// The colour camera and its calibration.
    pub fn color_camera(&self) -> &ColorCamera {
        &self.streams.color
    }

    /// From depth camera axes to colour camera axes, metres.
    pub fn color_from_depth(&self) -> Pose {
        self.streams.color_from_depth
    }

    /// Which frames training may see.
    pub fn split(&self) -> &Split {
        &self.split
    }

    /// The pose sets in the order they were written.
    pub fn pose_sets(&self) -> &[PoseSet] {
        &self.pose_sets
    }

    /// World from depth camera of every frame in the set `name`; `None` when there is no such set.
    pub fn poses(&self, name: &str) -> Option<&[Option<Pose>]> {
        let set = self.pose_sets.iter().find(|set| set.name == name)?;
        Some(&set.world_from_depth)
    }

    /// Time of frame `index` in nanoseconds; strictly increasing, the zero is the source's.
    ///
    /// # Panics
    /// When `index` is not below [`Recording::frame_count`].
    pub fn time_nanos(&self, index: usize) -> i64 {
        self.frames[index].time_nanos.get()
    }

    /// Depth codes of frame `index`, as the sensor gave them: 0 and 65535 are no measurement, others times
    /// [`DepthCamera::depth_scale`] are metres.
    pub fn depth_raw(&self, index: usize) -> Result<Image<u16>, SequenceError> {
        let camera = &self.streams.depth.intrinsics;
        self.payload(
            "depth",
            index,
            |entry| &entry.depth,
            |bytes| {
                let codes = decode_png_gray16(bytes)?;
                require_size(&codes, camera.width(), camera.height())?;
                Ok(codes)
            },
        )
    }

    /// Colour codes of frame `index`.
    pub fn color(&self, index: usize) -> Result<Rgb8Image, SequenceError> {
        let camera = &self.streams.color;
        self.payload(
            "color",
            index,
            |entry| &entry.color,
            |bytes| {
                let codes = match camera.codec {
                    ColorCodec::Jpeg => decode_jpeg(bytes)?,
                    ColorCodec::Png => decode_png_rgb8(bytes)?,
                };
                let intrinsics = &camera.intrinsics;
                require_size(&codes, intrinsics.width(), intrinsics.height())?;
                Ok(codes)
            },
        )
    }

    /// Whether chroma of frame `index` is stored at a lower resolution than luma.
    pub fn color_is_subsampled(&self, index: usize) -> Result<bool, SequenceError> {
        let codec = self.streams.color.codec;
        self.payload(
            "color",
            index,
            |entry| &entry.color,
            |bytes| match codec {
                ColorCodec::Jpeg => Ok(jpeg_is_subsampled(bytes)?),
                ColorCodec::Png => Ok(false),
            },
        )
    }

    /// The colour payload of frame `index` as it is stored, in [`ColorCamera::codec`].
    pub fn color_bytes(&self, index: usize) -> Result<&[u8], SequenceError> {
        self.section(index, |entry| &entry.color)
            .map_err(|error| error.in_frame("color", index).in_file(&self.path))
    }

    /// The depth payload of frame `index` as it is stored: a PNG of 16-bit grey.
    pub fn depth_bytes(&self, index: usize) -> Result<&[u8], SequenceError> {
        self.section(index, |entry| &entry.depth)
            .map_err(|error| error.in_frame("depth", index).in_file(&self.path))
    }

    /// BLAKE3 of the whole file. Reads all of it.
    pub fn content_hash(&self) -> blake3::Hash {
        blake3::hash(self.map.bytes())
    }

    /// Finds, checks and decodes one payload.
    fn payload<T>(
        &self,
        stream: &'static str,
        index: usize,
        choose: impl Fn(&FrameEntry) -> &Section,
        decode: impl FnOnce(&[u8]) -> Result<T, SequenceError>,
    ) -> Result<T, SequenceError> {
        self.section(index, choose)
            .and_then(decode)
            .map_err(|error| error.in_frame(stream, index).in_file(&self.path))
    }

    fn section(
        &self,
        index: usize,
        choose: impl Fn(&FrameEntry) -> &Section,
    ) -> Result<&[u8], SequenceError> {
        let entry = self.frames.get(index).ok_or(SequenceError::NoSuchFrame {
            index,
            frame_count: self.frames.len(),
        })?;
        choose(entry).read(self.map.bytes(), "the payload")
    }
}

fn require_size<T>(image: &Image<T>, width: u32, height: u32) -> Result<(), SequenceError> {
    if (image.width(), image.height()) == (width, height) {
        return Ok(());
    }
    Err(SequenceError::ImageSize {
        width: image.width(),
        height: image.height(),
        camera_width: width,
        camera_height: height,
    })
}

impl Contents {
    fn parse(file: &[u8]) -> Result<Self, SequenceError> {
        let header = Header::of(file)?;
        let description =
            Description::from_json(header.description.read(file, "the description")?)?;
        let index_bytes = header.frames.read(file, "the frame index")?;
        let frames: &[FrameEntry] = table(index_bytes, &header.frames, "the frame index")?;
        require_increasing_times(frames)?;
        let pose_bytes = header.poses.read(file, "the pose tables")?;
        let entries: &[PoseEntry] = table(pose_bytes, &header.poses, "the pose tables")?;
        // The section's length has 32 bits, so the number of its entries has fewer.
        description.split.check(frames.len() as u32)?;
        Ok(Self {
            frames: frames.to_vec(),
            streams: description.streams()?,
            pose_sets: pose_sets(&description.pose_sets, entries, frames.len())?,
            split: description.split,
        })
    }
}

fn require_increasing_times(frames: &[FrameEntry]) -> Result<(), SequenceError> {
    let unordered = frames
        .windows(2)
        .position(|pair| pair[1].time_nanos.get() <= pair[0].time_nanos.get());
    match unordered {
        None => Ok(()),
        Some(before) => Err(SequenceError::TimeOrder {
            index: before + 1,
            nanos: frames[before + 1].time_nanos.get(),
            previous_nanos: frames[before].time_nanos.get(),
        }),
    }
}

/// One set a name, `frame_count` entries each.
fn pose_sets(
    names: &[String],
    entries: &[PoseEntry],
    frame_count: usize,
) -> Result<Vec<PoseSet>, SequenceError> {
    if names.len().checked_mul(frame_count) != Some(entries.len()) {
        return Err(SequenceError::Count {
            what: "stored poses",
            count: entries.len() as u64,
            expected: (names.len() as u64).saturating_mul(frame_count as u64),
            of: "frames and pose sets",
        });
    }
    let mut sets: Vec<PoseSet> = Vec::with_capacity(names.len());
    for (position, name) in names.iter().enumerate() {
        require_pose_set_name(name, &sets)?;
        let own = &entries[position * frame_count..][..frame_count];
        let world_from_depth = own
            .iter()
            .enumerate()
            .map(|(index, entry)| stored_pose(entry, name, index))
            .collect::<Result<_, _>>()?;
        sets.push(PoseSet {
            name: name.clone(),
            world_from_depth,
        });
    }
    Ok(sets)
}

fn stored_pose(entry: &PoseEntry, set: &str, index: usize) -> Result<Option<Pose>, SequenceError> {
    match entry.state.get() {
        0 => Ok(None),
        1 => {
            let rotation = entry.rotation.map(F64::get);
            let translation = entry.translation.map(F64::get);
            pose_from_numbers(rotation, translation)
                .map(Some)
                .map_err(|source| SequenceError::Pose {
                    set: set.to_owned(),
                    index,
                    source,
                })
        }
        other => Err(SequenceError::Value {
            name: "the state of a stored pose",
            value: other as f64,
            expected: "0 or 1",
        }),
    }
}
