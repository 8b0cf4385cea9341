//! Writing a recording: frames go to a file beside the final name, which appears when all is in.

use std::fs::{File, Permissions};
use std::io::{BufWriter, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use geometry::Pose;
use tempfile::NamedTempFile;
use zerocopy::IntoBytes as _;

use crate::cameras::Streams;
use crate::description::Description;
use crate::error::SequenceError;
use crate::layout::{FrameEntry, HEADER_BYTES, Header, PoseEntry, Section};
use crate::split::Split;

/// A named path of the depth camera.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseSet {
    /// `source`, `live`, `refined` …
    pub name: String,
    /// World from depth camera, one a frame; `None` where the producer has no pose.
    pub world_from_depth: Vec<Option<Pose>>,
}

/// Writes one recording. Dropped before [`RecordingWriter::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct RecordingWriter {
    path: PathBuf,
    file: BufWriter<NamedTempFile>,
    /// Bytes written so far.
    end: u64,
    streams: Streams,
    frames: Vec<FrameEntry>,
}

impl RecordingWriter {
    /// Begins the recording that will be `path`; its folder must exist.
    pub fn create(path: &Path, streams: Streams) -> Result<Self, SequenceError> {
        let part = begin(path).map_err(|error| SequenceError::from(error).in_file(path))?;
        Ok(Self {
            path: path.to_path_buf(),
            file: part,
            end: HEADER_BYTES as u64,
            streams,
            frames: Vec::new(),
        })
    }

    /// How many frames have been written.
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Appends a frame: its time, later than the one before, its depth as a PNG of 16-bit grey and its colour
    /// in the codec of the colour camera. The bytes are kept as they are; the caller has made sure that
    /// they decode to images of the cameras' sizes.
    pub fn write_frame(
        &mut self,
        time_nanos: i64,
        depth_png: &[u8],
        color: &[u8],
    ) -> Result<(), SequenceError> {
        let index = self.frames.len();
        if let Some(last) = self.frames.last()
            && time_nanos <= last.time_nanos.get()
        {
            return Err(SequenceError::TimeOrder {
                index,
                nanos: time_nanos,
                previous_nanos: last.time_nanos.get(),
            });
        }
        let depth = self.append(depth_png, "a depth payload")?;
        let color = self.append(color, "a colour payload")?;
        self.frames.push(FrameEntry {
            time_nanos: time_nanos.into(),
            depth,
            color,
        });
        Ok(())
    }

    /// Writes pose sets, split and index, makes all of it durable and gives the file its name. Returns its
    /// length in bytes.
    pub fn finish(mut self, pose_sets: &[PoseSet], split: &Split) -> Result<u64, SequenceError> {
        let path = self.path.clone();
        self.append_tables(pose_sets, split)
            .and_then(|header| self.seal(&header))
            .map_err(|error| error.in_file(&path))
    }

    fn append_tables(
        &mut self,
        pose_sets: &[PoseSet],
        split: &Split,
    ) -> Result<Header, SequenceError> {
        let frame_count = u32::try_from(self.frames.len()).map_err(|_| SequenceError::Value {
            name: "the number of frames",
            value: self.frames.len() as f64,
            expected: "below 2^32",
        })?;
        split.check(frame_count)?;
        let mut poses = Vec::with_capacity(pose_sets.len() * self.frames.len());
        for (position, set) in pose_sets.iter().enumerate() {
            require_pose_set_name(&set.name, &pose_sets[..position])?;
            if set.world_from_depth.len() != self.frames.len() {
                return Err(SequenceError::Count {
                    what: "poses",
                    count: set.world_from_depth.len() as u64,
                    expected: self.frames.len() as u64,
                    of: "frames",
                });
            }
            poses.extend(set.world_from_depth.iter().map(pose_entry));
        }
        let names = pose_sets.iter().map(|set| set.name.clone()).collect();
        let json = Description::new(&self.streams, names, split.clone()).to_json()?;
        let description = self.append(&json, "the description")?;
        let frames = std::mem::take(&mut self.frames);
        let frames = self.append(frames.as_bytes(), "the frame index")?;
        let poses = self.append(poses.as_bytes(), "the pose tables")?;
        Ok(Header::sealed(self.end, description, frames, poses))
    }

    /// The header last: until then the file does not begin like a recording.
    fn seal(mut self, header: &Header) -> Result<u64, SequenceError> {
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(header.as_bytes())?;
        let part = self
            .file
            .into_inner()
            .map_err(std::io::IntoInnerError::into_error)?;
        part.as_file().sync_all()?;
        part.persist(&self.path).map_err(|error| error.error)?;
        // Makes the name itself durable.
        File::open(folder_of(&self.path))?.sync_all()?;
        Ok(self.end)
    }

    fn append(&mut self, content: &[u8], part: &'static str) -> Result<Section, SequenceError> {
        let section = Section::of(self.end, content).ok_or(SequenceError::Section {
            part,
            offset: self.end,
            bytes: content.len() as u64,
        })?;
        self.file
            .write_all(content)
            .map_err(|error| SequenceError::from(error).in_file(&self.path))?;
        self.end += content.len() as u64;
        Ok(section)
    }
}

fn begin(path: &Path) -> std::io::Result<BufWriter<NamedTempFile>> {
    let part = tempfile::Builder::new()
        .prefix(".glint-")
        .suffix(".part")
        // As any program's files: the umask decides. Temporary files would be private.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder_of(path))?;
    let mut file = BufWriter::with_capacity(1 << 20, part);
    file.write_all(&[0; HEADER_BYTES])?;
    Ok(file)
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn pose_entry(pose: &Option<Pose>) -> PoseEntry {
    let Some(pose) = pose else {
        return PoseEntry {
            state: 0.into(),
            rotation: [0.0.into(); 4],
            translation: [0.0.into(); 3],
        };
    };
    PoseEntry {
        state: 1.into(),
        rotation: pose.rotation().to_array().map(Into::into),
        translation: pose.translation().to_array().map(Into::into),
    }
}

/// Pose sets that a recording may have: keeps a hostile list of names from costing time.
const MOST_POSE_SETS: usize = 256;

/// Refuses a name that would be awkward on a command line, one that `earlier` sets have, and too many.
pub(crate) fn require_pose_set_name(name: &str, earlier: &[PoseSet]) -> Result<(), SequenceError> {
    let usable = (1..=64).contains(&name.len())
        && name
            .bytes()
            .all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_');
    if usable && earlier.len() < MOST_POSE_SETS && earlier.iter().all(|set| set.name != name) {
        Ok(())
    } else {
        Err(SequenceError::PoseSetName(name.to_owned()))
    }
}
