//! What can go wrong with a recording.

use std::path::PathBuf;

use geometry::{CameraError, PoseError};
use imaging::ImagingError;

use crate::codecs::CodecError;

/// Why a recording cannot be read or written. Every sentence says what, where and how to mend it.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// Another error, of a named file.
    #[error("{}: {source}", path.display())]
    InFile {
        /// The recording.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<SequenceError>,
    },
    /// The operating system refuses.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// Something that is not an ordinary file.
    #[error("this is no file; give a recording (`glint import` makes one)")]
    NotAFile,
    /// The first bytes are not those of a recording.
    #[error("this is no glint recording; make one with `glint import`")]
    NotARecording,
    /// A recording of another version.
    #[error(
        "this recording is not of version 1, the one that this glint reads (version 0 was a draft); import it anew, or use the glint that wrote it"
    )]
    OtherVersion,
    /// Another process holds the lock of a writer.
    #[error("another program is writing this file; wait until it is done")]
    Busy,
    /// The first page is damaged; the rest may be whole.
    #[error(
        "the beginning of this recording is damaged; `glintd recover` makes a whole file of the rest"
    )]
    HeaderDamaged,
    /// No chunk holds a description that is whole.
    #[error(
        "this recording has no sealed chunk: it was cut, or ended within its first second; `glintd recover` shows what is left"
    )]
    NoDescription,
    /// A record kind that must be understood and is not.
    #[error(
        "this recording has records of kind {kind:#06x}, which this glint does not know; use a newer glint"
    )]
    UnknownKind {
        /// The kind.
        kind: u16,
    },
    /// A stream that must be there.
    #[error("the description names no {kind} stream")]
    NoStream {
        /// `depth`, `color`.
        kind: &'static str,
    },
    /// A record that is whole and does not hold what its kind demands.
    #[error("{what} does not hold what it should; the program that wrote it is at fault")]
    Payload {
        /// Which record.
        what: &'static str,
    },
    /// A frame that does not match its checksum.
    #[error("the record at byte {offset} is damaged; `glintd verify` lists all damage")]
    Damaged {
        /// Where it begins.
        offset: u64,
    },
    /// A frame whose table of codes is gone.
    #[error("its table of codes (number {id}) is damaged in all chunks")]
    NoTable {
        /// Id of the table.
        id: u16,
    },
    /// Samples or payloads that a codec refuses.
    #[error("{0}")]
    Codec(#[from] CodecError),
    /// Depth of which nobody can say how far it is.
    #[error(
        "its depth is the sensor's shifts without the table that makes depth of them, and without usable constants"
    )]
    NoShiftTable,
    /// A table of shifts that is none.
    #[error("its table from shift to depth falls at shift {shift}; depth grows with shift")]
    ShiftTable {
        /// The first shift that is nearer than one before it.
        shift: usize,
    },
    /// A word about YUV that this version does not know.
    #[error("{key} of YUV is {word:?}; this version knows {expected}")]
    YuvWord {
        /// What the word is about.
        key: &'static str,
        /// The word in the file.
        word: String,
        /// The words known.
        expected: &'static str,
    },
    /// Infrared in place of colour, where colours are needed.
    #[error("the recording has infrared and no colours")]
    NoColors,
    /// A recording without a frame.
    #[error("there is no frame in this recording")]
    NoFrames,
    /// A file that would be written over.
    #[error("this file exists; remove it, or choose another name")]
    Exists,
    /// An excerpt that would be empty.
    #[error("no depth frame has a number in {start}..{end}; they go from {first} to {last}")]
    EmptyRange {
        /// First number asked for.
        start: u64,
        /// The number after the last one asked for.
        end: u64,
        /// First number that there is.
        first: u64,
        /// Last number that there is.
        last: u64,
    },
    /// The disk refuses to keep anything.
    #[error("the disk reports errors and keeps nothing more; what was sealed before is whole")]
    NotDurable,
    /// A part that reaches beyond the file or has an impossible length.
    #[error(
        "{part} claims {bytes} bytes at byte {offset}, which cannot be; the program that wrote it is at fault"
    )]
    Section {
        /// Which part.
        part: &'static str,
        /// Where it claims to begin.
        offset: u64,
        /// The length it claims.
        bytes: u64,
    },
    /// JSON that is not what its record must hold.
    #[error("the description of the streams is unusable: {0}; import the recording anew")]
    Description(#[from] serde_json::Error),
    /// A number outside its range.
    #[error("{name} is {value}, it must be {expected}")]
    Value {
        /// Name of the number.
        name: &'static str,
        /// The value given.
        value: f64,
        /// The range in words.
        expected: &'static str,
    },
    /// Two numbers that belong together differ.
    #[error("{count} {what} for {expected} {of}: there must be as many")]
    Count {
        /// What was counted.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// How many there must be.
        expected: u64,
        /// What they belong to.
        of: &'static str,
    },
    /// Intrinsics that no camera has.
    #[error("{stream} camera: {source}")]
    Camera {
        /// "depth" or "color".
        stream: &'static str,
        /// What is wrong.
        source: CameraError,
    },
    /// A pose that is no rigid transform.
    #[error("pose of frame {number} in set `{set}`: {source}")]
    Pose {
        /// Name of the set.
        set: String,
        /// Number of the frame.
        number: u64,
        /// What is wrong.
        source: PoseError,
    },
    /// Response or vignetting that cannot be used.
    #[error("calibration of the colour camera: {0}")]
    Calibration(#[source] ImagingError),
    /// A measured response that does not rise strictly everywhere.
    #[error(
        "the response table falls or stands still at {changed_count} codes; repair it with imaging::Response::from_table first"
    )]
    ResponseNotRising {
        /// Entries that would have to change, all channels.
        changed_count: u32,
    },
    /// A split that names a frame twice, or one that does not exist, or not all.
    #[error(
        "the split names frame {frame} {times} times; every frame of 0..{frame_count} must be in exactly one list"
    )]
    Split {
        /// The frame.
        frame: u32,
        /// How often it is named.
        times: u32,
        /// Frames of the recording.
        frame_count: u32,
    },
    /// A pose set's name that is empty, too long or taken.
    #[error(
        "`{0}` cannot name a pose set: use 1 to 64 letters, digits, - or _, each name once, 256 sets at most"
    )]
    PoseSetName(String),
    /// A frame beyond the end.
    #[error("frame {index} does not exist, the recording has {frame_count}")]
    NoSuchFrame {
        /// The frame asked for.
        index: usize,
        /// Frames of the recording.
        frame_count: usize,
    },
    /// A frame that is damaged or does not fit its stream.
    #[error("{stream} of frame {index}: {source}")]
    Frame {
        /// "depth" or "color".
        stream: &'static str,
        /// The frame.
        index: usize,
        /// What is wrong.
        source: Box<SequenceError>,
    },
    /// An image that cannot be decoded.
    #[error("{0}")]
    Image(#[from] ImagingError),
    /// An image of another size than its camera's.
    #[error("the image has {width}x{height} pixels, the camera {camera_width}x{camera_height}")]
    ImageSize {
        /// Columns of the image.
        width: u32,
        /// Rows of the image.
        height: u32,
        /// Columns of the camera.
        camera_width: u32,
        /// Rows of the camera.
        camera_height: u32,
    },
}

impl SequenceError {
    /// This error with the file it happened in.
    #[must_use]
    pub fn in_file(self, path: &std::path::Path) -> Self {
        Self::InFile {
            path: path.to_path_buf(),
            source: Box::new(self),
        }
    }

    /// Whether the disk, or a quota on it, is full.
    pub fn is_disk_full(&self) -> bool {
        match self {
            Self::InFile { source, .. } => source.is_disk_full(),
            Self::Io(error) => crate::chunk_writer::is_full(error),
            _ => false,
        }
    }

    /// Whether the operating system refused a call for a file.
    pub fn is_disk_error(&self) -> bool {
        match self {
            Self::InFile { source, .. } => source.is_disk_error(),
            Self::Io(_) | Self::NotDurable => true,
            _ => false,
        }
    }

    /// This error with the frame it happened in.
    pub(crate) fn in_frame(self, stream: &'static str, index: usize) -> Self {
        Self::Frame {
            stream,
            index,
            source: Box::new(self),
        }
    }
}
