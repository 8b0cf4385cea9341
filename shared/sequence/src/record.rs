//! What records hold, as values: `docs/sequence-format.md` section 6.

use std::fmt;
use std::str::FromStr;

use geometry::{DVec3, Pose};
use serde::{Deserialize, Serialize};
use zerocopy::byteorder::little_endian::{F32, F64};
use zerocopy::{FromBytes as _, IntoBytes as _};

use crate::description::pose_from_numbers;
use crate::error::SequenceError;
use crate::layout::{
    FLAG_HOST, FLAG_REPEAT, FLAG_TICKS, FrameHeader, GapHeader, GravityBytes, PoseBytes,
    PosesHeader,
};

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

/// Why frames are missing. The numbers are those of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[repr(u16)]
pub enum GapCause {
    /// A USB transfer was short.
    UsbShort = 1,
    /// Packets were lost.
    PacketLoss = 2,
    /// The frame did not decode.
    Corrupt = 3,
    /// No partner in the other stream.
    Unmatched = 4,
    /// No buffer was free.
    PoolEmpty = 5,
    /// The ring in front of the writer was full.
    RingFull = 6,
    /// The disk was too slow.
    DiskLate = 7,
    /// The camera was unplugged.
    Unplug = 8,
    /// The camera was started anew.
    Restart = 9,
    /// The source itself has the hole.
    Source = 10,
    /// The disk was full.
    DiskFull = 11,
    /// A repair found the frames damaged.
    Damaged = 12,
    /// The disk reported an error.
    DiskError = 13,
    /// Left out on purpose.
    Cut = 14,
}

impl GapCause {
    /// All causes, in the order of their numbers.
    pub const ALL: [Self; 14] = [
        Self::UsbShort,
        Self::PacketLoss,
        Self::Corrupt,
        Self::Unmatched,
        Self::PoolEmpty,
        Self::RingFull,
        Self::DiskLate,
        Self::Unplug,
        Self::Restart,
        Self::Source,
        Self::DiskFull,
        Self::Damaged,
        Self::DiskError,
        Self::Cut,
    ];

    const NAMES: [&str; 14] = [
        "usb-short",
        "packet-loss",
        "corrupt",
        "unmatched",
        "pool-empty",
        "ring-full",
        "disk-late",
        "unplug",
        "restart",
        "source",
        "disk-full",
        "damaged",
        "disk-error",
        "cut",
    ];

    /// The cause with this number, if version 1.0 has it.
    pub fn from_number(number: u16) -> Option<Self> {
        Self::ALL.get(usize::from(number.checked_sub(1)?)).copied()
    }
}

impl fmt::Display for GapCause {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(Self::NAMES[*self as usize - 1])
    }
}

impl FromStr for GapCause {
    type Err = ();

    fn from_str(name: &str) -> Result<Self, ()> {
        let position = Self::NAMES
            .iter()
            .position(|known| *known == name)
            .ok_or(())?;
        Ok(Self::ALL[position])
    }
}

/// Frames that should be in the file and are not (section 6.4).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Stream.
    pub stream: u16,
    /// First number that is missing.
    pub first_number: u64,
    /// How many are missing, at least 1.
    pub count: u64,
    /// Device time of the last frame before.
    pub from_nanos: Option<i64>,
    /// Device time of the first frame after.
    pub to_nanos: Option<i64>,
    /// Why; `None` for a cause of a later version.
    pub cause: Option<GapCause>,
    /// More words, may be empty.
    pub note: String,
}

impl Gap {
    /// The bytes before the words.
    pub fn header(&self) -> GapHeader {
        GapHeader {
            first_number: self.first_number.into(),
            count: self.count.into(),
            from_nanos: self.from_nanos.unwrap_or(i64::MIN).into(),
            to_nanos: self.to_nanos.unwrap_or(i64::MAX).into(),
            cause: self.cause.map_or(0, |cause| cause as u16).into(),
            reserved: [0; 6],
        }
    }

    /// The gap that the bytes and words say.
    pub fn of(stream: u16, header: &GapHeader, note: String) -> Self {
        let (from, to) = (header.from_nanos.get(), header.to_nanos.get());
        Self {
            stream,
            first_number: header.first_number.get(),
            count: header.count.get(),
            from_nanos: (from != i64::MIN).then_some(from),
            to_nanos: (to != i64::MAX).then_some(to),
            cause: GapCause::from_number(header.cause.get()),
            note,
        }
    }

    pub(crate) fn read(stream: u16, payload: &[u8]) -> Option<Self> {
        let (header, note) = GapHeader::ref_from_prefix(payload).ok()?;
        header.first_number.get().checked_add(header.count.get())?;
        let note = String::from_utf8_lossy(note).into_owned();
        Some(Self::of(stream, header, note))
    }
}

/// Whether tracking knew where the camera was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseState {
    /// All axes observed.
    #[default]
    Ok,
    /// Some axes kept their prediction: bits 0 to 2 rotation about x, y, z, bits 3 to 5 translation.
    Weak(u8),
    /// The pose is the last that was known.
    Lost,
}

/// A pose of one frame in a set (section 6.7).
#[derive(Clone, Debug, PartialEq)]
pub struct FramePose {
    /// Number of the frame in the set's stream.
    pub number: u64,
    /// World that the pose is in.
    pub map: u32,
    /// How far it can be trusted.
    pub state: PoseState,
    /// World from camera, metres.
    pub world_from_camera: Pose,
    /// Upper triangle by rows, of rotation (radians) and translation (metres) in camera axes.
    pub covariance: Option<[f32; 21]>,
}

impl FramePose {
    /// A pose that is known well, in map 0.
    pub fn ok(number: u64, world_from_camera: Pose) -> Self {
        Self {
            number,
            map: 0,
            state: PoseState::Ok,
            world_from_camera,
            covariance: None,
        }
    }

    pub(crate) fn bytes(&self) -> PoseBytes {
        let (state, weak_axes) = match self.state {
            PoseState::Ok => (1, 0),
            PoseState::Weak(axes) => (2, axes),
            PoseState::Lost => (3, 0),
        };
        let pose = &self.world_from_camera;
        PoseBytes {
            number: self.number.into(),
            map: self.map.into(),
            state,
            weak_axes,
            flags: u16::from(self.covariance.is_some()).into(),
            rotation: pose.rotation().to_array().map(Into::into),
            translation: pose.translation().to_array().map(Into::into),
            covariance: self.covariance.unwrap_or([0.0; 21]).map(Into::into),
            reserved: [0; 4],
        }
    }

    fn read(bytes: &PoseBytes, set: &str) -> Result<Self, SequenceError> {
        let number = bytes.number.get();
        let state = match bytes.state {
            1 => PoseState::Ok,
            2 => PoseState::Weak(bytes.weak_axes),
            3 => PoseState::Lost,
            other => {
                return Err(SequenceError::Value {
                    name: "the state of a stored pose",
                    value: f64::from(other),
                    expected: "1, 2 or 3",
                });
            }
        };
        let rotation = bytes.rotation.map(F64::get);
        let translation = bytes.translation.map(F64::get);
        let world_from_camera =
            pose_from_numbers(rotation, translation).map_err(|source| SequenceError::Pose {
                set: set.to_owned(),
                number,
                source,
            })?;
        Ok(Self {
            number,
            map: bytes.map.get(),
            state,
            world_from_camera,
            covariance: (bytes.flags.get() & 1 != 0).then(|| bytes.covariance.map(F32::get)),
        })
    }
}

/// Head of a pose set (section 6.6), as JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoseSetHead {
    /// Unique in the file.
    pub id: u16,
    /// `source`, `live`, `refined` …
    pub name: String,
    /// Program that made it.
    pub producer: String,
    /// Stream whose camera the poses are of.
    pub stream: u16,
}

/// Payload of a poses record.
pub(crate) fn poses_payload(set: u16, poses: &[FramePose]) -> Vec<u8> {
    let head = PosesHeader {
        set: set.into(),
        reserved: [0; 6],
    };
    let mut payload = head.as_bytes().to_vec();
    for pose in poses {
        payload.extend_from_slice(pose.bytes().as_bytes());
    }
    payload
}

/// Set and poses of a record; `set_name` names a set in errors.
pub(crate) fn read_poses(
    payload: &[u8],
    set_name: &dyn Fn(u16) -> String,
) -> Result<(u16, Vec<FramePose>), SequenceError> {
    let unfit = || SequenceError::Payload {
        what: "a record of poses",
    };
    let (head, entries) = PosesHeader::ref_from_prefix(payload).map_err(|_| unfit())?;
    let entries = <[PoseBytes]>::ref_from_bytes(entries).map_err(|_| unfit())?;
    let set = head.set.get();
    let name = set_name(set);
    let poses = entries
        .iter()
        .map(|entry| FramePose::read(entry, &name))
        .collect::<Result<_, _>>()?;
    Ok((set, poses))
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
