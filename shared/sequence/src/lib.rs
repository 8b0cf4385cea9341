//! The `.glint` recording, version 1: `docs/sequence-format.md`.
//!
//! For: streams of depth and colour frames with their times, gaps, poses and calibration in one file that is
//! whole at every moment up to its last sealed chunk; reading any frame through a map; finding and naming all
//! damage. Not for: cameras and threads (the daemon has them), float colour, what a pose is good for, masks and
//! truth (no recording holds them).
//!
//! ```no_run
//! use sequence::Recording;
//! let recording = Recording::open("room.glint".as_ref())?;
//! let source = recording.poses("source").expect("imported with poses");
//! for &index in &recording.split().train {
//!     let depth = recording.depth_raw(index as usize)?;
//!     println!("{} ns, {:?}, {}", recording.time_nanos(index as usize), source[index as usize], depth.at(0, 0));
//! }
//! # Ok::<(), sequence::SequenceError>(())
//! ```
//!
//! Map, from the bytes up: [`layout`] structures · [`checksum`] what ties them to one file · [`record`] what
//! records hold · [`description`] and [`cameras`] streams and calibration · [`shift_table`] depth of
//! shifts · [`codecs`] lossless depth and colour · [`infrared`] in place of colour · [`file_layer`] calls to
//! the disk · [`chunk_writer`] chunks in the right order · [`writer`] and [`encode`] a recording is written ·
//! [`copy`] repair and excerpts · [`source`] bytes by map or `pread` · [`scan`] from chunk to chunk around
//! damage · [`contents`] everything but images · [`recording`] frames by index and time · [`follow`] a file that
//! grows · [`summary`] and [`verify`] what it holds and what it lacks · [`split`] training,
//! unused, test · [`clock`] device and host time · [`pairing`] depth with colour · [`error`] what is refused;
//! `map` and `time_index` are private.
//!
//! Invariants: a sealed chunk is never written again; a frame is checked against its own CRC-32C whenever it is
//! read, so one flipped bit costs one frame and says which; nothing is allocated for a size that was not checked
//! against the file; a [`Recording`] is `Sync` and never changes.

pub mod cameras;
pub mod checksum;
pub mod chunk_writer;
pub mod clock;
pub mod codecs;
pub mod contents;
pub mod copy;
pub mod decode;
pub mod description;
pub mod encode;
pub mod error;
pub mod file_layer;
pub mod follow;
pub mod infrared;
pub mod layout;
mod losses;
mod map;
pub mod nominal;
pub mod pairing;
pub mod record;
pub mod recording;
pub mod scan;
mod sealing;
pub mod shift_table;
pub mod source;
pub mod split;
pub mod summary;
mod time_index;
pub mod verify;
pub mod writer;

pub use cameras::{
    ColorCamera, ColorEncoding, DepthCamera, DepthSamples, Device, ResponseCurve, ShiftConstants,
    StreamTiming, Streams, TickClock, VignettingCurve, YuvMeaning,
};
pub use checksum::FileId;
pub use contents::Contents;
pub use description::{COLOR_STREAM, Created, DEPTH_STREAM, Description};
pub use error::SequenceError;
pub use infrared::{MAX_INFRARED, infrared_grey, infrared_samples};
pub use record::{
    Event, FramePose, FrameTimes, Gap, GapCause, Gravity, Histogram, Note, PoseState,
};
pub use recording::{PoseSet, Recording};
pub use split::Split;
pub use writer::RecordingWriter;
