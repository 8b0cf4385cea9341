//! The bytes of version 0. All numbers are little-endian, all offsets count from the start of the file.
//!
//! ```text
//! Header          104 bytes
//! payloads        of frame 0: depth, colour; of frame 1: depth, colour; …
//! description     JSON (UTF-8): both cameras, extrinsic, calibration, names of the pose sets, split
//! frame index     one FrameEntry a frame
//! pose tables     one PoseEntry a frame, for each pose set in the order of their names
//! ```
//!
//! A depth payload is a PNG of 16-bit grey, a colour payload a JPEG or a PNG of 8-bit RGB, as the description
//! says. This layout is not frozen: a later version replaces it and refuses this one.

use zerocopy::byteorder::little_endian::{F64, I64, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::error::SequenceError;

/// The first bytes of a file of this version.
pub const MAGIC: [u8; 32] = *b"glint recording, version 0\n\0\0\0\0\0";

/// How recordings of every version begin.
const ANY_VERSION: &[u8] = b"glint recording, version ";

/// A stretch of the file and its checksum.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct Section {
    /// First byte.
    pub offset: U64,
    /// Length in bytes.
    pub bytes: U32,
    /// CRC-32C (Castagnoli) of the stretch.
    pub crc: U32,
}

/// The beginning of the file.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: [u8; 32],
    /// Length of the whole file in bytes.
    pub file_bytes: U64,
    /// The description.
    pub description: Section,
    /// The frame index.
    pub frames: Section,
    /// The pose tables.
    pub poses: Section,
    /// Zero.
    pub reserved: [u8; 12],
    /// CRC-32C of the 100 bytes before.
    pub crc: U32,
}

/// Length of [`Header`] in bytes.
pub const HEADER_BYTES: usize = size_of::<Header>();

/// One frame.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct FrameEntry {
    /// Time of the frame in nanoseconds; the zero is the source's.
    pub time_nanos: I64,
    /// Its depth payload.
    pub depth: Section,
    /// Its colour payload.
    pub color: Section,
}

/// The pose of one frame in one set: world from depth camera.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct PoseEntry {
    /// 0: no pose for this frame, the rest is zero. 1: a pose.
    pub state: U64,
    /// Unit quaternion x, y, z, w.
    pub rotation: [F64; 4],
    /// Translation in metres.
    pub translation: [F64; 3],
}

impl Section {
    /// The section that `content` makes at `offset`, or `None` when it is 4 GiB or longer.
    pub fn of(offset: u64, content: &[u8]) -> Option<Self> {
        Some(Self {
            offset: offset.into(),
            bytes: u32::try_from(content.len()).ok()?.into(),
            crc: crc32c::crc32c(content).into(),
        })
    }

    /// The bytes of this section of `file`, checked against its bounds and its checksum. `part` names it in
    /// errors.
    pub fn read<'a>(&self, file: &'a [u8], part: &'static str) -> Result<&'a [u8], SequenceError> {
        let (offset, bytes) = (self.offset.get(), u64::from(self.bytes.get()));
        let outside = SequenceError::Section {
            part,
            offset,
            bytes,
        };
        let Some(end) = offset.checked_add(bytes) else {
            return Err(outside);
        };
        let (Ok(start), Ok(end)) = (usize::try_from(offset), usize::try_from(end)) else {
            return Err(outside);
        };
        let content = file.get(start..end).ok_or(outside)?;
        let got = crc32c::crc32c(content);
        if got != self.crc.get() {
            return Err(SequenceError::Checksum {
                part,
                offset,
                expected: self.crc.get(),
                got,
            });
        }
        Ok(content)
    }
}

impl Header {
    /// A header whose checksum is right.
    pub fn sealed(file_bytes: u64, description: Section, frames: Section, poses: Section) -> Self {
        let mut header = Self {
            magic: MAGIC,
            file_bytes: file_bytes.into(),
            description,
            frames,
            poses,
            reserved: [0; 12],
            crc: 0.into(),
        };
        header.crc = header.computed_crc().into();
        header
    }

    /// The header of `file`, its checksum and the length of the file checked.
    pub fn of(file: &[u8]) -> Result<&Self, SequenceError> {
        if !file.starts_with(&MAGIC) {
            return Err(if file.starts_with(ANY_VERSION) {
                SequenceError::OtherVersion
            } else {
                SequenceError::NotARecording
            });
        }
        let (header, _) = Self::ref_from_prefix(file).map_err(|_| SequenceError::Length {
            expected: HEADER_BYTES as u64,
            got: file.len() as u64,
        })?;
        let got = header.computed_crc();
        if got != header.crc.get() {
            return Err(SequenceError::Checksum {
                part: "the header",
                offset: 0,
                expected: header.crc.get(),
                got,
            });
        }
        if header.file_bytes.get() != file.len() as u64 {
            return Err(SequenceError::Length {
                expected: header.file_bytes.get(),
                got: file.len() as u64,
            });
        }
        Ok(header)
    }

    fn computed_crc(&self) -> u32 {
        let bytes = self.as_bytes();
        crc32c::crc32c(&bytes[..bytes.len() - size_of::<U32>()])
    }
}

/// The entries of a table, or an error when its bytes are no whole number of them.
pub(crate) fn table<'a, Entry>(
    bytes: &'a [u8],
    section: &Section,
    part: &'static str,
) -> Result<&'a [Entry], SequenceError>
where
    Entry: FromBytes + Immutable + KnownLayout + Unaligned,
{
    <[Entry]>::ref_from_bytes(bytes).map_err(|_| SequenceError::Section {
        part,
        offset: section.offset.get(),
        bytes: bytes.len() as u64,
    })
}

// The layout is part of files: a change of these numbers is a change of the version.
const _: () = assert!(HEADER_BYTES == 104);
const _: () = assert!(size_of::<FrameEntry>() == 40 && size_of::<PoseEntry>() == 64);
