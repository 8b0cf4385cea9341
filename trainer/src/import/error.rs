//! What an import refuses, each in one sentence: what, where, how to mend it.

use std::path::{Path, PathBuf};

use geometry::{CameraError, PoseError};
use imaging::ImagingError;
use sequence::SequenceError;

use super::oni::OniDamage;

/// Why something cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file or folder that cannot be read.
    #[error("{}: {source}; is the path right, and may you read it?", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// Something that is no ordinary file, or too large to be what its name says.
    #[error("{}: {bytes} bytes; this must be an ordinary file of at most {limit} bytes", path.display())]
    FileSize {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The largest size accepted.
        limit: u64,
    },
    /// A folder of no known layout.
    #[error(
        "{} looks like no layout that is known: 7-Scenes has frame-000000.color.jpg (or .png), .depth.png and .pose.txt, TUM has rgb.txt and depth.txt, a plain folder has frames/ and poses.txt, a recording of OpenNI is one file; name one with --format to see what is missing",
        path.display()
    )]
    UnknownLayout {
        /// The folder.
        path: PathBuf,
    },
    /// A recording of OpenNI that cannot be read.
    #[error("{}: {what}: {source}", path.display())]
    Oni {
        /// The file.
        path: PathBuf,
        /// Which part of it.
        what: String,
        /// What is wrong.
        source: OniDamage,
    },
    /// No description of the cameras.
    #[error("there is no rig file: give one with --rig, or put it at {}", path.display())]
    NoRig {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// A text file that is not what it should be.
    #[error("{}{}: {message}", path.display(), line_text(*line))]
    Text {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: Option<usize>,
        /// What the parser says.
        message: String,
    },
    /// A number in the rig file outside its range.
    #[error("{}: {key} is {value}, it must be {expected}", path.display())]
    RigValue {
        /// The rig file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// The value given.
        value: f64,
        /// The range in words.
        expected: &'static str,
    },
    /// Neither or both ways of saying how the cameras are mounted.
    #[error(
        "{}: say how the cameras are mounted with exactly one of depth.color_from_depth and depth.depth_from_color (\"identity\" when depth is registered to colour)",
        path.display()
    )]
    RigExtrinsic {
        /// The rig file.
        path: PathBuf,
    },
    /// Depth that is said to lie on the colour camera's pixels, by cameras that differ.
    #[error(
        "{}: depth.registered says that depth pixels are colour pixels, so both cameras must have the same size, intrinsics and distortion, and depth_from_color = \"identity\"",
        path.display()
    )]
    RigRegistered {
        /// The rig file.
        path: PathBuf,
    },
    /// A meaning of YUV samples that is not known, or of samples that are none.
    #[error(
        "{}: color.yuv belongs to the formats uyvy and yuyv and says matrix = \"bt601\" or \"bt709\", range = \"full\" or \"limited\", siting = \"left\" or \"center\"",
        path.display()
    )]
    RigYuv {
        /// The rig file.
        path: PathBuf,
    },
    /// Intrinsics that no camera has.
    #[error("{}: {stream} camera: {source}; correct the intrinsics in the rig file", path.display())]
    Camera {
        /// The rig file.
        path: PathBuf,
        /// "depth" or "color".
        stream: &'static str,
        /// What is wrong.
        source: CameraError,
    },
    /// A field of view that no RGB-D camera has.
    #[error(
        "{}: the {stream} camera would see {degrees:.0} degrees across, RGB-D cameras see 25 to 130: focal length and image size do not belong together",
        path.display()
    )]
    FieldOfView {
        /// The rig file.
        path: PathBuf,
        /// "depth" or "color".
        stream: &'static str,
        /// Horizontal angle.
        degrees: f64,
    },
    /// A number in the description that a recording cannot hold.
    #[error("{}: {source}", path.display())]
    Description {
        /// The rig file.
        path: PathBuf,
        /// What is wrong.
        source: SequenceError,
    },
    /// A folder without images.
    #[error("{} holds no {expected}; give the folder that holds the frames", path.display())]
    NoFrames {
        /// The folder.
        path: PathBuf,
        /// The names looked for.
        expected: &'static str,
    },
    /// Two files for one frame.
    #[error("frame {frame} has two files, {} and {}: remove one", first.display(), second.display())]
    TwoFiles {
        /// The frame.
        frame: u32,
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// A frame that lacks a file.
    #[error("frame {frame} has no {part} in {}: copy it again, or leave the frame out with --range", path.display())]
    MissingPart {
        /// The frame.
        frame: u32,
        /// "colour image", "depth image" or "pose".
        part: &'static str,
        /// Where it was looked for.
        path: PathBuf,
    },
    /// Colour images of two formats.
    #[error("{} is not of the format of the other colour images ({expected}): convert one kind", path.display())]
    MixedColor {
        /// The image.
        path: PathBuf,
        /// Format of the others, or of the rig file.
        expected: &'static str,
    },
    /// More or fewer poses than frames.
    #[error("{} has {pose_count} poses for {frame_count} frames: it needs one line a frame, in order", path.display())]
    PoseCount {
        /// The file of poses.
        path: PathBuf,
        /// Lines with a pose.
        pose_count: usize,
        /// Frames of the folder.
        frame_count: usize,
    },
    /// A pose that is no rigid transform.
    #[error("{}{}: {source}; correct the pose, or leave the frame out with --range", path.display(), line_text(*line))]
    Pose {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: Option<usize>,
        /// What is wrong.
        source: PoseError,
    },
    /// A time that is not after the one before.
    #[error("{}, line {line}: time {nanos} ns is not after the time before it ({previous_nanos} ns): sort the lines and remove doubles", path.display())]
    TimeOrder {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The time.
        nanos: i64,
        /// The time before.
        previous_nanos: i64,
    },
    /// A range that the folder does not hold.
    #[error("--range {start}..{end} leaves the folder, which has the frames {first}..{stop}")]
    Range {
        /// First frame wanted.
        start: usize,
        /// Frame after the last wanted.
        end: usize,
        /// First frame there is.
        first: usize,
        /// Frame after the last there is.
        stop: usize,
    },
    /// A frame in two lists of the split, or twice in one.
    #[error("{}: frame {frame} is named twice; every frame belongs to one of train, unused and test", path.display())]
    SplitOverlap {
        /// The split file.
        path: PathBuf,
        /// The frame.
        frame: u32,
    },
    /// A split that names a frame the folder does not have.
    #[error("{} names frame {frame}, the folder has {first}..{stop}: is this the split of another capture?", path.display())]
    SplitBeyond {
        /// The split file.
        path: PathBuf,
        /// The frame.
        frame: u32,
        /// First frame there is.
        first: usize,
        /// Frame after the last there is.
        stop: usize,
    },
    /// No frame is left for training.
    #[error("{} leaves no training frame among the frames imported: change the split or --range", path.display())]
    NothingToTrain {
        /// The split file.
        path: PathBuf,
    },
    /// An image that cannot be decoded.
    #[error("{}: {source}; copy the file again, or leave the frame out with --range", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// What is wrong.
        source: ImagingError,
    },
    /// An image of another size than its camera's.
    #[error(
        "{} has {width}x{height} pixels, the {stream} camera of the rig file {camera_width}x{camera_height}: all images of a stream and its intrinsics must agree",
        path.display()
    )]
    ImageSize {
        /// The image.
        path: PathBuf,
        /// "depth" or "color".
        stream: &'static str,
        /// Columns of the image.
        width: u32,
        /// Rows of the image.
        height: u32,
        /// Columns of the camera.
        camera_width: u32,
        /// Rows of the camera.
        camera_height: u32,
    },
    /// A raw colour frame of another length than its camera's.
    #[error("{}: {bytes} bytes, a raw frame of the color camera of the rig file has {expected}: width and height must be those of the images, without padding", path.display())]
    RawSize {
        /// The image.
        path: PathBuf,
        /// Its length.
        bytes: usize,
        /// The length of a frame.
        expected: usize,
    },
    /// Depth images without a measurement.
    #[error("none of the depth images looked at ({}, …) holds a measurement: is it the right folder?", path.display())]
    NoDepth {
        /// One of the images.
        path: PathBuf,
    },
    /// A range that leaves most of the depth out.
    #[error(
        "only {percent:.0} % of the depth measurements lie between {near} and {far} m, their median is {median_m:.3} m: correct depth.scale or depth.range in the rig file"
    )]
    DepthRange {
        /// Share inside the range, per cent.
        percent: f64,
        /// Nearest depth accepted, metres.
        near: f32,
        /// Farthest depth accepted, metres.
        far: f32,
        /// Median of all measurements, metres.
        median_m: f64,
    },
    /// A depth unit that is not what the rig says.
    #[error(
        "the median depth is {median_m:.3e} m with depth.scale = {scale} m a unit, which no RGB-D camera sees (0.2 to 10 m): correct depth.scale in the rig file"
    )]
    DepthUnit {
        /// Median of all measurements, metres.
        median_m: f64,
        /// Metres a unit.
        scale: f64,
    },
    /// Poses the other way round.
    #[error(
        "the poses are the wrong way round: read as world from camera, {given_percent:.0} % of depth agrees between frames, read as camera from world {inverse_percent:.0} %; invert every pose in {}",
        path.display()
    )]
    PoseDirection {
        /// Where the poses are.
        path: PathBuf,
        /// Share that agrees as they are, per cent.
        given_percent: f64,
        /// Share that agrees inverted, per cent.
        inverse_percent: f64,
    },
}

fn line_text(line: Option<usize>) -> String {
    line.map_or_else(String::new, |line| format!(", line {line}"))
}

/// Largest file that an import reads: an uncompressed colour image of 16 megapixels fits.
const LARGEST_FILE_BYTES: u64 = 64 << 20;

/// Reads an ordinary file of bounded size.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, ImportError> {
    let read = |source| ImportError::Read {
        path: path.to_path_buf(),
        source,
    };
    // Asked before opening: a pipe would block.
    let metadata = std::fs::metadata(path).map_err(read)?;
    if !metadata.is_file() || metadata.len() > LARGEST_FILE_BYTES {
        return Err(ImportError::FileSize {
            path: path.to_path_buf(),
            bytes: metadata.len(),
            limit: LARGEST_FILE_BYTES,
        });
    }
    std::fs::read(path).map_err(read)
}

/// Reads a text file.
pub(crate) fn read_text(path: &Path) -> Result<String, ImportError> {
    String::from_utf8(read_file(path)?).map_err(|error| ImportError::Text {
        path: path.to_path_buf(),
        line: None,
        message: format!("byte {} is no UTF-8 text", error.utf8_error().valid_up_to()),
    })
}
