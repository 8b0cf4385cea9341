//! What records hold, as values: `docs/sequence-format.md` section 6.

mod gap;
mod poses;

use geometry::DVec3;
use serde::{Deserialize, Serialize};
use zerocopy::FromBytes as _;
use zerocopy::byteorder::little_endian::F64;

pub use gap::{Gap, GapCause};
pub use poses::{FramePose, PoseSetHead, PoseState};
pub(crate) use poses::{poses_header, read_poses};

use crate::layout::{FLAG_HOST, FLAG_REPEAT, FLAG_TICKS, FrameHeader, GravityBytes};

/// Kind of a record. The numbers are those of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum RecordKind {
    /// Streams, calibration: JSON.
    Description = 1,
    /// Table of depth codes.
    DepthTable = 2,
    /// One image with its times.
    Frame = 3,
    /// Frames that are missing.
    Gap = 4,
    /// A change of settings or calibration, a warning.
    Event = 5,
    /// Name of a pose set.
    PoseSet = 6,
    /// Poses of a set.
    Poses = 7,
    /// Direction of down.
    Gravity = 8,
    /// Counts.
    Histogram = 9,
    /// Words of the user.
    Note = 10,
    /// Which frames training may see.
    Split = 11,
    /// The records of a chunk.
    Index = 12,
    /// The file is complete.
    End = 13,
}

impl RecordKind {
    /// The kind with this number, if version 1.0 has it.
    pub fn from_number(number: u16) -> Option<Self> {
        use RecordKind::{
            DepthTable, Description, End, Event, Frame, Gap, Gravity, Histogram, Index, Note,
            PoseSet, Poses, Split,
        };
        let kinds = [
            Description,
            DepthTable,
            Frame,
            Gap,
            Event,
            PoseSet,
            Poses,
            Gravity,
            Histogram,
            Note,
            Split,
            Index,
            End,
        ];
        kinds.get(usize::from(number.checked_sub(1)?)).copied()
    }
}

/// Kinds with this bit must be understood by a reader.
pub const MUST_UNDERSTAND: u16 = 0x8000;

/// When a frame was taken and came in (`docs/sequence-format.md` section 6.3). Nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameTimes {
    /// Counts what the source sent or should have sent, from 0.
    pub number: u64,
    /// The device counter as it was sent, where there is one.
    pub device_ticks: Option<u64>,
    /// Device time, unwrapped; its zero is the source's.
    pub device_nanos: i64,
    /// Monotonic time of the host at the first and the last byte, where known.
    pub host_nanos: Option<[i64; 2]>,
    /// The samples are those of the frame before, byte for byte.
    pub is_repeat: bool,
}

impl FrameTimes {
    /// The bytes of the times.
    pub fn header(&self) -> FrameHeader {
        let [first, last] = self.host_nanos.unwrap_or_default();
        FrameHeader {
            number: self.number.into(),
            device_ticks: self.device_ticks.unwrap_or_default().into(),
            device_nanos: self.device_nanos.into(),
            host_first_nanos: first.into(),
            host_last_nanos: last.into(),
            flags: self.flags().into(),
            reserved: [0; 4],
        }
    }

    pub(crate) fn flags(&self) -> u32 {
        let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
        flag(self.is_repeat, FLAG_REPEAT)
            | flag(self.device_ticks.is_some(), FLAG_TICKS)
            | flag(self.host_nanos.is_some(), FLAG_HOST)
    }

    /// The times that the bytes say.
    pub fn of(header: &FrameHeader) -> Self {
        let flags = header.flags.get();
        Self {
            number: header.number.get(),
            device_ticks: (flags & FLAG_TICKS != 0).then(|| header.device_ticks.get()),
            device_nanos: header.device_nanos.get(),
            host_nanos: (flags & FLAG_HOST != 0)
                .then(|| [header.host_first_nanos.get(), header.host_last_nanos.get()]),
            is_repeat: flags & FLAG_REPEAT != 0,
        }
    }
}

/// Which way is down (section 6.8).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gravity {
    /// Number of the frame.
    pub number: u64,
    /// Unit vector in camera axes.
    pub down: DVec3,
    /// Standard deviation, radians.
    pub sigma: f32,
}

impl Gravity {
    pub(crate) fn bytes(&self) -> GravityBytes {
        GravityBytes {
            number: self.number.into(),
            down: self.down.to_array().map(Into::into),
            sigma: self.sigma.into(),
            reserved: [0; 4],
        }
    }

    pub(crate) fn read(payload: &[u8]) -> Option<Self> {
        let bytes = GravityBytes::ref_from_bytes(payload).ok()?;
        let down = DVec3::from_array(bytes.down.map(F64::get));
        let sigma = bytes.sigma.get();
        ((down.length() - 1.0).abs() < 1e-3 && sigma >= 0.0).then_some(Self {
            number: bytes.number.get(),
            down,
            sigma,
        })
    }
}

/// Counts of a value in bins (section 6.9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Of what.
    pub name: String,
    /// Unit of the edges.
    pub unit: String,
    /// Bounds of the bins, rising, one more than there are bins.
    pub edges: Vec<f64>,
    /// How many values fell into each bin; lower edge included, upper not.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// How many values were counted.
    pub fn count(&self) -> u64 {
        self.counts.iter().copied().fold(0, u64::saturating_add)
    }

    /// The bin, by its index, that a share of `fraction` (0 to 1) of all values reaches; `None` of no values.
    pub fn quantile_bin(&self, fraction: f64) -> Option<usize> {
        let all = self.count();
        let wanted = ((fraction.clamp(0.0, 1.0) * all as f64).ceil() as u64).clamp(1, all.max(1));
        let mut reached: u64 = 0;
        self.counts.iter().position(|count| {
            reached = reached.saturating_add(*count);
            reached >= wanted
        })
    }
}

/// A change or a warning (section 6.5).
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Stream, 0 for none.
    pub stream: u16,
    /// Monotonic time of the host, nanoseconds.
    pub host_nanos: i64,
    /// What happened: JSON with the key `event`.
    pub details: serde_json::Value,
}

impl Event {
    pub(crate) fn payload(&self) -> Vec<u8> {
        let mut payload = self.host_nanos.to_le_bytes().to_vec();
        payload.extend_from_slice(self.details.to_string().as_bytes());
        payload
    }

    pub(crate) fn read(stream: u16, payload: &[u8]) -> Option<Self> {
        let (nanos, details) = payload.split_first_chunk()?;
        Some(Self {
            stream,
            host_nanos: i64::from_le_bytes(*nanos),
            details: serde_json::from_slice(details).ok()?,
        })
    }
}

/// Words of the user (section 6.10).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// Monotonic time of the host, nanoseconds.
    pub host_nanos: i64,
    /// The words.
    pub text: String,
}

impl Note {
    pub(crate) fn payload(&self) -> Vec<u8> {
        let mut payload = self.host_nanos.to_le_bytes().to_vec();
        payload.extend_from_slice(self.text.as_bytes());
        payload
    }

    pub(crate) fn read(payload: &[u8]) -> Option<Self> {
        let (nanos, text) = payload.split_first_chunk()?;
        Some(Self {
            host_nanos: i64::from_le_bytes(*nanos),
            text: String::from_utf8_lossy(text).into_owned(),
        })
    }
}

/// Why and with what a file ended (section 6.13).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct End {
    /// `complete`, `stopped`, `duration`, `part`, `disk-full`, `disk-error`, `unplugged`, `recovered`.
    pub reason: String,
    /// Totals of each stream.
    pub streams: Vec<StreamTotals>,
}

/// What was counted of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StreamTotals {
    /// Stream.
    pub id: u16,
    /// Frames in the file.
    pub frames: u64,
    /// Frames that repeat their predecessor.
    pub repeats: u64,
    /// Frames that gaps name.
    pub missing: u64,
}
