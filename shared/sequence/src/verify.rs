//! Whether a recording holds everything that it should: `docs/sequence-format.md` section 7.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use crate::contents::Contents;
use crate::decode::StreamDecoders;
use crate::description::Description;
use crate::error::SequenceError;
use crate::layout::FrameHeader;
use crate::record::{Gap, RecordKind};
use crate::scan::{Checking, Damage, RecordPlace, Scanner};
use crate::source::{ByteSource, PreadFile};
use crate::summary::Summary;

/// What a check found.
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// The recording in numbers.
    pub summary: Summary,
    /// Frames that are not in the file, and why.
    pub missing: Vec<Missing>,
    /// Everything else that is not as it should be, a sentence each.
    pub findings: Vec<String>,
    /// Books of the streams.
    pub books: Vec<Book>,
    /// What training will lack: no loss of this file.
    pub remarks: Vec<String>,
}

/// Frames that are not in the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// Stream.
    pub stream: u16,
    /// First number.
    pub first_number: u64,
    /// How many.
    pub count: u64,
    /// Cause of the gap, `damaged`, or `unexplained`.
    pub cause: String,
}

/// Whether frames and gaps of a stream add up to the time that passed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Book {
    /// Stream.
    pub stream: u16,
    /// Frames in the file.
    pub frames: u64,
    /// Frames that gaps name between the first and the last frame.
    pub in_gaps: u64,
    /// Frames that device time and nominal rate ask for between the first and the last, both included; absent
    /// where no rate is promised.
    pub expected: Option<f64>,
    /// They agree within half a frame and 500 ppm.
    pub balances: bool,
}

impl Verification {
    /// Whether nothing is missing or damaged.
    pub fn is_whole(&self) -> bool {
        self.missing.is_empty()
            && self.findings.is_empty()
            && self.books.iter().all(|book| book.balances)
    }
}

/// Checks every byte of a file, and with `decode` that every frame decodes. Reads with `pread`.
pub fn verify(path: &Path, decode: bool) -> Result<Verification, SequenceError> {
    PreadFile::open(path)
        .and_then(|file| verify_source(&file, decode))
        .map_err(|error| error.in_file(path))
}

/// As [`verify`], of any source.
pub fn verify_source<S: ByteSource + ?Sized>(
    source: &S,
    decode: bool,
) -> Result<Verification, SequenceError> {
    let scanner = Scanner::begin(source, Checking::Everything)?;
    let file_id = scanner.file_id();
    let contents = Contents::of_scan(scanner)?;
    let description = contents
        .description
        .as_ref()
        .ok_or(SequenceError::NoDescription)?;
    let mut findings = findings_of(&contents, source)?;
    let mut missing: Vec<Missing> = contents.gaps.iter().map(Missing::of_gap).collect();
    let lost = damaged_frames(&contents);
    missing.extend(
        lost.iter()
            .map(|(stream, number)| Missing::damaged(*stream, *number)),
    );
    if decode {
        let scanner = Scanner::of_file(source, file_id, Checking::Everything)?;
        for place in undecodable(&scanner, &contents, description, &mut findings)? {
            missing.push(Missing::damaged(place.label.stream, place.label.number));
        }
    }
    let mut books = Vec::new();
    for id in [description.depth_id, description.color_id] {
        missing.extend(unexplained(&contents, id, &lost));
        books.push(book_of(&contents, description, id));
    }
    missing.sort_by_key(|missing| (missing.stream, missing.first_number));
    Ok(Verification {
        summary: Summary::of(&contents, description),
        missing,
        findings,
        books,
        remarks: remarks_of(&contents, description),
    })
}

fn findings_of<S: ByteSource + ?Sized>(
    contents: &Contents,
    source: &S,
) -> Result<Vec<String>, SequenceError> {
    let mut findings: Vec<String> = contents.damages.iter().map(ToString::to_string).collect();
    match &contents.end {
        None => findings.push(format!(
            "the file was not closed: its writer runs still, or died; {} records behind the last sealed chunk can be recovered",
            contents.tail.len()
        )),
        Some(end) => {
            for totals in &end.streams {
                let found = contents.stream(totals.id).len() as u64;
                if found != totals.frames {
                    findings.push(format!(
                        "stream {} was closed with {} frames, {found} are here",
                        totals.id, totals.frames
                    ));
                }
            }
            let byte_count = source.byte_count()?;
            if byte_count > contents.sealed_bytes && contents.tail.is_empty() {
                findings.push(format!(
                    "{} bytes follow the end of the recording",
                    byte_count - contents.sealed_bytes
                ));
            }
        }
    }
    Ok(findings)
}

/// Stream and number of the frames whose records are damaged.
pub(crate) fn damaged_frames(contents: &Contents) -> Vec<(u16, u64)> {
    let frame = |damage: &Damage| match damage {
        Damage::Record { label, .. } if label.kind == RecordKind::Frame as u16 => {
            Some((label.stream, label.number))
        }
        _ => None,
    };
    contents.damages.iter().filter_map(frame).collect()
}

/// Frames whose checksum is right and whose payload is not; each gets a sentence.
fn undecodable<S: ByteSource + ?Sized>(
    scanner: &Scanner<'_, S>,
    contents: &Contents,
    description: &Description,
    findings: &mut Vec<String>,
) -> Result<Vec<RecordPlace>, SequenceError> {
    let mut decoders = StreamDecoders::new(description)?;
    let mut bad = Vec::new();
    for id in [description.depth_id, description.color_id] {
        for place in contents.stream(id) {
            let Some(payload) = scanner.payload(place)? else {
                continue;
            };
            let image = payload.get(size_of::<FrameHeader>()..).unwrap_or_default();
            let decoded = if id == description.depth_id {
                decoders.depth(image, id, &contents.tables).map(|_| ())
            } else {
                decoders.check_color(image)
            };
            if let Err(error) = decoded {
                findings.push(format!(
                    "frame {} of stream {id} does not decode: {error}",
                    place.label.number
                ));
                bad.push(*place);
            }
        }
    }
    Ok(bad)
}

/// Holes in the numbers of a stream that neither a gap nor a damaged record explains.
pub(crate) fn unexplained(contents: &Contents, id: u16, lost: &[(u16, u64)]) -> Vec<Missing> {
    let mut known: Vec<(u64, u64)> = contents
        .stream(id)
        .iter()
        .map(|place| (place.label.number, 1))
        .chain(
            lost.iter()
                .filter(|(stream, _)| *stream == id)
                .map(|(_, number)| (*number, 1)),
        )
        .chain(
            contents
                .gaps
                .iter()
                .filter(|gap| gap.stream == id)
                .map(|gap| (gap.first_number, gap.count)),
        )
        .collect();
    known.sort_unstable();
    let mut missing = Vec::new();
    let Some(&(mut next, _)) = known.first() else {
        return missing;
    };
    for (first, count) in known {
        if first > next {
            missing.push(Missing {
                stream: id,
                first_number: next,
                count: first - next,
                cause: "unexplained".to_owned(),
            });
        }
        next = next.max(first.saturating_add(count));
    }
    missing
}

fn book_of(contents: &Contents, description: &Description, id: u16) -> Book {
    let places = contents.stream(id);
    let timing = if id == description.depth_id {
        description.streams.depth_timing
    } else {
        description.streams.color_timing
    };
    let (Some(first), Some(last)) = (places.first(), places.last()) else {
        return Book {
            stream: id,
            frames: 0,
            in_gaps: 0,
            expected: None,
            balances: true,
        };
    };
    let within = first.label.number..last.label.number;
    let in_gaps = contents
        .gaps
        .iter()
        .filter(|gap| gap.stream == id && within.contains(&gap.first_number))
        .fold(0, |sum: u64, gap| sum.saturating_add(gap.count));
    let nanos = i128::from(last.label.device_nanos) - i128::from(first.label.device_nanos);
    let expected = timing
        .rate_hz
        .map(|rate_hz| nanos as f64 * rate_hz / 1e9 + 1.0);
    let counted = places.len() as f64 + in_gaps as f64;
    Book {
        stream: id,
        frames: places.len() as u64,
        in_gaps,
        expected,
        balances: expected
            .is_none_or(|expected| (counted - expected).abs() <= 0.5 + 500e-6 * expected.abs()),
    }
}

fn remarks_of(contents: &Contents, description: &Description) -> Vec<String> {
    let mut remarks = Vec::new();
    if contents.pose_sets.is_empty() {
        remarks.push("no poses: training has to track the camera first".to_owned());
    }
    let color = &description.streams.color;
    if *color.response_curve() == crate::ResponseCurve::Identity {
        remarks.push("no response curve: codes are taken for linear".to_owned());
    }
    if *color.vignetting_curve() == crate::VignettingCurve::None {
        remarks.push("no vignetting: taken for none".to_owned());
    }
    if color.encoding.lossless().is_none() {
        remarks.push("colour is JPEG: not what the sensor gave".to_owned());
    }
    for id in [description.depth_id, description.color_id] {
        let repeats = contents
            .stream(id)
            .iter()
            .filter(|place| place.is_repeat())
            .count();
        if repeats > 0 {
            remarks.push(format!(
                "stream {id}: {repeats} frames repeat the one before"
            ));
        }
    }
    remarks
}

impl Missing {
    pub(crate) fn of_gap(gap: &Gap) -> Self {
        Self {
            stream: gap.stream,
            first_number: gap.first_number,
            count: gap.count,
            cause: gap
                .cause
                .map_or("unknown".to_owned(), |cause| cause.to_string()),
        }
    }

    pub(crate) fn damaged(stream: u16, number: u64) -> Self {
        Self {
            stream,
            first_number: number,
            count: 1,
            cause: "damaged".to_owned(),
        }
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            stream,
            first_number,
            count,
            cause,
        } = self;
        match count {
            1 => write!(f, "stream {stream}: frame {first_number} ({cause})"),
            _ => write!(
                f,
                "stream {stream}: {count} frames from {first_number} on ({cause})"
            ),
        }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FileHeader => write!(f, "the first page of the file is damaged"),
            Self::Header { offset, bytes } => write!(
                f,
                "no chunk begins at byte {offset}, where one should; {bytes} bytes were searched for records"
            ),
            Self::CommitMark { chunk } => {
                write!(
                    f,
                    "the commit mark of chunk {chunk} is damaged; its records are whole"
                )
            }
            Self::Index { chunk } => {
                write!(
                    f,
                    "the index of chunk {chunk} is damaged; its records were searched"
                )
            }
            Self::Record { offset, label } => {
                let kind = RecordKind::from_number(label.kind);
                match kind {
                    Some(RecordKind::Frame) => write!(
                        f,
                        "frame {} of stream {} at byte {offset} is damaged",
                        label.number, label.stream
                    ),
                    Some(kind) => write!(f, "a record ({kind:?}) at byte {offset} is damaged"),
                    None => write!(
                        f,
                        "a record of kind {} at byte {offset} is damaged",
                        label.kind
                    ),
                }
            }
            Self::Padding { chunk } => write!(
                f,
                "bytes between the records of chunk {chunk} are damaged; no record is"
            ),
            Self::Tail { offset, bytes } => write!(
                f,
                "{bytes} bytes from byte {offset} on were never sealed, or are cut off"
            ),
        }
    }
}
