//! Where a JPEG stream ends: at its marker EOI, whatever fills the payload after it (protocol section 7.8).

use crate::damage::Damage;

const MARKER: u8 = 0xFF;
const SOI: u8 = 0xD8;
const EOI: u8 = 0xD9;
const SOS: u8 = 0xDA;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// Before the first two bytes: how many of them have been seen.
    Begin(u8),
    /// Before a marker's first byte.
    Marker,
    /// After it: fill bytes may follow.
    MarkerCode,
    /// At the two bytes of a segment's length; its marker, the byte that was read.
    Length(u8, Option<u8>),
    /// In a segment: what may hold a picture of its own is passed over.
    Segment(u8, u16),
    /// In coded data.
    Scan,
    /// In coded data after [`MARKER`].
    ScanMarker,
    /// After EOI.
    End,
}

/// Follows a JPEG stream in pieces of any size.
#[derive(Clone, Copy, Debug)]
pub struct JpegFramer {
    place: Place,
}

impl Default for JpegFramer {
    fn default() -> Self {
        Self::new()
    }
}

impl JpegFramer {
    /// Before the first byte.
    pub fn new() -> Self {
        Self {
            place: Place::Begin(0),
        }
    }

    /// How many bytes of `data`, which goes on where the last call ended, belong to the stream: all until its end.
    ///
    /// # Errors
    /// [`Damage::NotJpeg`] when no SOI is at the beginning, or no marker where one must be.
    pub fn push(&mut self, data: &[u8]) -> Result<usize, Damage> {
        let mut used = 0;
        while let Some((&byte, rest)) = data.get(used..).and_then(<[u8]>::split_first) {
            match self.place {
                Place::End => return Ok(used),
                Place::Segment(marker, left) if left > 1 => {
                    // The whole rest of the segment, or of the data, at once.
                    let taken = usize::from(left).min(rest.len() + 1);
                    self.place = after_segment(marker, left - taken as u16);
                    used += taken;
                    continue;
                }
                Place::Scan => {
                    let marker = rest_to_marker(byte, rest);
                    used += marker;
                    if data.get(used).is_none() {
                        return Ok(used);
                    }
                    self.place = Place::ScanMarker;
                }
                _ => self.place = self.after(byte)?,
            }
            used += 1;
        }
        Ok(used)
    }

    /// Whether EOI has been seen.
    pub fn is_complete(&self) -> bool {
        self.place == Place::End
    }

    fn after(self, byte: u8) -> Result<Place, Damage> {
        Ok(match (self.place, byte) {
            (Place::Begin(0), MARKER) => Place::Begin(1),
            (Place::Begin(1), SOI) => Place::Marker,
            (Place::Begin(_), _) => return Err(Damage::NotJpeg),
            (Place::Marker, MARKER) | (Place::MarkerCode, MARKER) => Place::MarkerCode,
            (Place::Marker, _) => return Err(Damage::NotJpeg),
            (Place::MarkerCode, EOI) => Place::End,
            // Markers without a segment.
            (Place::MarkerCode, 0x01 | 0xD0..=0xD7) => Place::Marker,
            (Place::MarkerCode, 0x00 | SOI) => return Err(Damage::NotJpeg),
            (Place::MarkerCode, marker) => Place::Length(marker, None),
            (Place::Length(marker, None), high) => Place::Length(marker, Some(high)),
            (Place::Length(marker, Some(high)), low) => {
                // The length counts its own two bytes.
                let length = u16::from_be_bytes([high, low]).checked_sub(2);
                after_segment(marker, length.ok_or(Damage::NotJpeg)?)
            }
            (Place::Segment(marker, left), _) => after_segment(marker, left.saturating_sub(1)),
            // A stuffed zero and restart markers go on with the scan.
            (Place::ScanMarker, 0x00 | 0xD0..=0xD7) => Place::Scan,
            (Place::ScanMarker, MARKER) => Place::ScanMarker,
            (Place::ScanMarker, EOI) | (Place::End, _) => Place::End,
            (Place::ScanMarker, SOI) => return Err(Damage::NotJpeg),
            (Place::ScanMarker, marker) => Place::Length(marker, None),
            (Place::Scan, MARKER) => Place::ScanMarker,
            (Place::Scan, _) => Place::Scan,
        })
    }
}

/// Where to go with `left` bytes of a segment to come.
fn after_segment(marker: u8, left: u16) -> Place {
    match (left, marker) {
        (0, SOS) => Place::Scan,
        (0, _) => Place::Marker,
        _ => Place::Segment(marker, left),
    }
}

/// Bytes before the next marker, `first` among them; all where there is none.
fn rest_to_marker(first: u8, rest: &[u8]) -> usize {
    if first == MARKER {
        return 0;
    }
    let found = rest.iter().position(|&byte| byte == MARKER);
    1 + found.unwrap_or(rest.len())
}
