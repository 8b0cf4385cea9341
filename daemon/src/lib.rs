//! glintd, the recorder: frames of a camera, or of a recording that stands in for one, into a `.glint` file that
//! can be trusted; beside it the camera is tracked and its frames are fused.
//!
//! For: never losing a frame silently, bounded memory, a file that is whole at every moment. Not for: training,
//! networks, rendering.
//!
//! ```no_run
//! use glintd::capture::{CaptureOptions, capture};
//! use glintd::source_spec::SourceSpec;
//! use glintd::status::StopFlag;
//! let source: SourceSpec = "replay:room.glint?speed=max".parse()?;
//! let outcome = capture(CaptureOptions::new(source, "copy.glint".into()), &StopFlag::default())?;
//! println!("{} frames", outcome.frames_recorded);
//! # Ok::<(), anyhow::Error>(())
//! ```
//!
//! Map, along the way of a frame: [`source_spec`] what stands on the command line · [`source`] what a source is · [`replay`] a
//! recording as a camera · [`frame`] frames and their pools · [`drops`] what is missing, and why · [`pair`] depth with colour ·
//! [`record`] encoding · [`fuse`] tracking and fusion · [`message`] encoded records in a ring of bytes · [`disk`] the
//! writer · [`mesh`] the surface at the end · [`capture`] the threads · `priority` what they ask of the system · [`clock`] and [`status`] what they share · [`latency`] and [`outcome`] what is
//! counted · [`service`] what systemd
//! is told · [`shelf`] names of files, and which are removed · [`inspect`] info, verify, recover, cut · [`cli`] the command line.
//!
//! ```text
//! source ─ring─► pair ─ring─► record ─ring of bytes (3 s)─► disk
//!    ▲                           ├─ring (8)─► fuse ─ring of bytes─┘
//!    └────── free frames ────────┴─────────────┘
//! ```
//!
//! Invariants: nothing is allocated per frame once warm, but by the JPEG decoder (`tests/allocations.rs`); no thread waits for a later one
//! unless the source can be paused (`speed=max`); every frame that the source numbered is in the file or in a gap.

pub mod capture;
pub mod cli;
pub mod clock;
pub mod disk;
pub mod doctor;
pub mod drops;
pub mod frame;
pub mod fuse;
pub mod inspect;
pub mod latency;
pub mod mesh;
pub mod message;
#[cfg(feature = "openni2")]
pub mod openni2;
pub mod outcome;
pub mod pair;
mod priority;
pub mod ps1080;
pub mod record;
pub mod replay;
pub mod service;
pub mod shelf;
pub mod source;
pub mod source_spec;
pub mod status;
