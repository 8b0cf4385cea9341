//! Frames that are missing.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use zerocopy::FromBytes as _;

use crate::layout::GapHeader;

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
