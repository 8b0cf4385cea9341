//! The `.glint` recording, version 0: written once by `glint import`, read by everything else.
//!
//! For: two streams (depth, colour) described once, their frames and times, named pose sets, calibration
//! and the split into training and test frames, in one file with access to any frame through a map.
//! Not for: live capture and repair after a crash (a later version of the layout), float colour, what a
//! pose is good for, masks and truth (no recording holds them).
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
//! Map: [`recording`] the reader · [`writer`] beside, sync, rename · [`cameras`] both streams and their
//! calibration · [`codecs`] lossless depth
//! and colour · [`split`] training, unused, test · [`layout`] the bytes · [`error`] what is refused;
//! `description` and `map` are private.
//!
//! Invariants: a file that opens is whole (its length is the one it states) and its header, description,
//! frame index and pose tables match their checksums; a frame is checked against its own CRC-32C whenever
//! it is read, so one flipped bit costs one frame and says which; nothing is allocated for a size that was
//! not checked against the file; a [`Recording`] is `Sync` and never changes.

pub mod cameras;
pub mod codecs;
mod description;
pub mod error;
pub mod layout;
mod map;
pub mod recording;
pub mod split;
pub mod writer;

pub use cameras::{ColorCamera, ColorCodec, DepthCamera, ResponseCurve, Streams, VignettingCurve};
pub use error::SequenceError;
pub use recording::Recording;
pub use split::Split;
pub use writer::{PoseSet, RecordingWriter};
