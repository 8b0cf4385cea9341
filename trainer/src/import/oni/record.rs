//! Headers and fields of the records of an `.oni` file (oni-format section 1).

use super::OniDamage;

/// Bytes before the first record.
pub(super) const FILE_HEADER_LEN: u64 = 24;

/// Bytes of the longest fields that are believed: the largest known property has 20 KB.
const MOST_FIELDS: u32 = 1 << 20;

/// Width of positions in a file: OpenNI before 1.0.1.0 wrote 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Positions {
    Bits32,
    Bits64,
}

impl Positions {
    /// Judges the header of a file.
    pub(super) fn of_file(header: &[u8; FILE_HEADER_LEN as usize]) -> Result<Self, OniDamage> {
        if &header[..4] != b"NI10" {
            return Err(OniDamage::NoOni);
        }
        let maintenance = u16::from_le_bytes([header[6], header[7]]);
        let build = u32::from_le_bytes([header[8], header[9], header[10], header[11]]);
        let version = (header[4], header[5], maintenance, build);
        if !((1, 0, 0, 4)..=(1, 0, 1, 0)).contains(&version) {
            return Err(OniDamage::Version { version });
        }
        Ok(if version == (1, 0, 1, 0) {
            Self::Bits64
        } else {
            Self::Bits32
        })
    }

    /// Bytes of a record's header.
    pub(super) fn header_len(self) -> usize {
        match self {
            Self::Bits32 => 24,
            Self::Bits64 => 28,
        }
    }
}

/// What a record is, of the kinds that matter here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RecordKind {
    NodeAdded,
    IntProperty,
    RealProperty,
    StringProperty,
    GeneralProperty,
    NewData,
    End,
    /// Of no interest, or of a kind that is not known: skipped by its size.
    Other,
}

/// The header of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordHeader {
    pub(super) kind: RecordKind,
    /// The node it belongs to.
    pub(super) node: u32,
    /// Bytes of the fields after this header.
    pub(super) fields_len: usize,
    /// Bytes of the payload after the fields.
    pub(super) payload_len: u32,
}

impl RecordHeader {
    /// Reads the header of a record; `None` where none begins.
    pub(super) fn read(bytes: &[u8], positions: Positions) -> Option<Self> {
        let words = bytes.get(..20)?.as_chunks::<4>().0;
        let word = |index: usize| u32::from_le_bytes(words[index]);
        if &words[0] != b"NIR\0" || word(3) > MOST_FIELDS {
            return None;
        }
        let fields_len = (word(3) as usize).checked_sub(positions.header_len())?;
        let kind = match word(1) {
            0x02 | 0x0C | 0x0D => RecordKind::NodeAdded,
            0x03 => RecordKind::IntProperty,
            0x04 => RecordKind::RealProperty,
            0x05 => RecordKind::StringProperty,
            0x06 => RecordKind::GeneralProperty,
            0x0A => RecordKind::NewData,
            0x0B => RecordKind::End,
            _ => RecordKind::Other,
        };
        Some(Self {
            kind,
            node: word(2),
            fields_len,
            payload_len: word(4),
        })
    }
}

/// A cursor over the fields of a record; everything is `None` beyond their end.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    /// The next bytes.
    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(*self.take(4)?.first_chunk()?))
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(*self.take(8)?.first_chunk()?))
    }

    /// A text with its length, which counts the zero at its end.
    pub(super) fn text(&mut self) -> Option<String> {
        let len = self.u32()? as usize;
        let bytes = self.take(len)?;
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(len);
        Some(String::from_utf8_lossy(&bytes[..end]).into_owned())
    }

    /// A value with its length.
    pub(super) fn sized(&mut self) -> Option<&'a [u8]> {
        let len = self.u32()? as usize;
        self.take(len)
    }
}
