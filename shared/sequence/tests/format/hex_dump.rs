//! Section 10 of `docs/sequence-format.md`: every byte of a recording, said in words.

use std::fmt::Write as _;
use std::path::Path;

use sequence::layout::PAGE;
use sequence::record::RecordKind;
use sequence::{DEPTH_STREAM, DepthSamples, GapCause, Note};

use super::memory::MemoryFile;
use super::tiny::Scene;

const BEGIN: &str = "<!-- hex dump -->\n";
const END: &str = "<!-- end of hex dump -->";
/// Bytes in a line.
const LINE: usize = 16;

#[test]
fn the_hex_dump_of_the_format_page_is_true() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/sequence-format.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = page.split_once(BEGIN).unwrap();
    let (stands, after) = rest.split_once(END).unwrap();
    let bytes = recording();
    let dump = Dump::of(&bytes);
    let wanted = format!(
        "\nOne frame of 4x2 pixels a stream and a gap behind them; {} bytes. `…` stands for more bytes of the same field.\n\n```\n{dump}```\n\n",
        bytes.len()
    );
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, [before, BEGIN, &wanted, END, after].concat()).unwrap();
    } else {
        assert!(
            stands == wanted,
            "section 10 of docs/sequence-format.md is stale; UPDATE_DOCS=1 writes it anew"
        );
    }
}

/// The recording that is shown.
fn recording() -> Vec<u8> {
    let scene = Scene {
        width: 4,
        height: 2,
        samples: DepthSamples::Codes,
        seal_after: Vec::new(),
        end_number: 1,
        extra: None,
        ..Scene::default()
    };
    let file = MemoryFile::default();
    let mut writer = scene.begin(file.layer()).unwrap();
    scene.write_frames(&mut writer).unwrap();
    let gap = sequence::Gap {
        first_number: 1,
        count: 2,
        from_nanos: Some(0),
        to_nanos: None,
        cause: Some(GapCause::Unplug),
        ..scene.gap(DEPTH_STREAM)
    };
    writer.write_gap(&gap).unwrap();
    let note = Note {
        host_nanos: 5_100_000_000,
        text: "bag on a table".to_owned(),
    };
    writer.write_note(&note).unwrap();
    writer.finish("unplugged").unwrap();
    file.bytes()
}

/// Goes through a file from its first byte to its last.
struct Dump<'a> {
    bytes: &'a [u8],
    at: usize,
    text: String,
}

impl<'a> Dump<'a> {
    fn of(bytes: &'a [u8]) -> String {
        let mut dump = Self {
            bytes,
            at: 0,
            text: String::new(),
        };
        dump.file_header();
        while dump.at < bytes.len() {
            dump.chunk();
        }
        assert_eq!(dump.at, bytes.len());
        dump.text
    }

    fn file_header(&mut self) {
        self.title("file header");
        self.field(32, "first line");
        self.number(4, "minor version");
        self.zeros(4);
        self.field(16, "file id");
        self.zeros(4);
        self.field(4, "CRC of bytes 0 to 59");
        self.zeros(PAGE as usize - 64);
    }

    fn chunk(&mut self) {
        let start = self.at;
        let records_bytes = self.peek(start + 32, 8) as usize;
        self.title("chunk header");
        self.field(8, "magic");
        self.field(16, "file id");
        self.number(8, "chunk number");
        self.number(8, "P, bytes of all records");
        self.number(4, "records");
        self.number(4, "offset of the index record");
        self.number(8, "sequence number of the first record");
        self.field(4, "CRC of the P bytes");
        self.field(4, "CRC of this header");
        self.title("commit mark");
        self.field(8, "magic");
        self.number(8, "chunk number");
        self.field(4, "CRC of the P bytes");
        self.field(4, "CRC of the header");
        self.zeros(36);
        self.field(4, "CRC of this mark");
        let end = self.at + records_bytes;
        while self.at < end {
            self.record();
        }
        let page_end = self.at.next_multiple_of(PAGE as usize);
        self.title("zeros up to the next page");
        self.zeros(page_end - self.at);
    }

    fn record(&mut self) {
        let start = self.at;
        let kind = self.peek(start + 4, 2) as u16;
        let payload_bytes = self.peek(start + 8, 4) as usize;
        let sequence = self.peek(start + 16, 8);
        let known = RecordKind::from_number(kind).unwrap();
        self.title(&format!("record {sequence}: {}", name(known)));
        self.field(4, "magic");
        self.number(2, "kind");
        self.number(2, "stream");
        self.number(4, "n, bytes of payload");
        self.field(4, "CRC");
        self.number(8, "sequence number");
        let end = self.at + payload_bytes;
        self.payload(known, end);
        assert_eq!(self.at, end, "{known:?}");
        self.zeros(payload_bytes.next_multiple_of(8) - payload_bytes);
    }

    fn payload(&mut self, kind: RecordKind, end: usize) {
        match kind {
            RecordKind::Frame => {
                self.number(8, "frame number");
                self.number(8, "raw device counter");
                self.number(8, "device time, ns");
                self.number(8, "host time of the first byte, ns");
                self.number(8, "host time of the last byte, ns");
                self.number(4, "flags");
                self.zeros(4);
                self.field(1, "codec: raw");
                // The stream stands in the header of the record.
                if self.peek(self.at - 49 - 24 + 6, 2) == u64::from(DEPTH_STREAM) {
                    self.number(2, "table of codes, 0 for none");
                }
                self.field(end - self.at, "samples");
            }
            RecordKind::Gap => {
                self.number(8, "first missing number");
                self.number(8, "how many");
                self.number(8, "device time before, ns");
                self.field(8, "device time after: not known");
                self.number(2, "cause");
                self.zeros(6);
                self.field(end - self.at, "words");
            }
            RecordKind::Poses => {
                self.number(2, "set");
                self.zeros(6);
                while self.at < end {
                    self.pose();
                }
            }
            RecordKind::Event | RecordKind::Note => {
                self.number(8, "host time, ns");
                self.field(end - self.at, "words");
            }
            RecordKind::Index => {
                for entry in 0..(end - self.at) / 40 {
                    self.entry(entry == 0);
                }
            }
            _ => self.field(end - self.at, "JSON"),
        }
    }

    fn pose(&mut self) {
        self.number(8, "frame number");
        self.number(4, "map");
        self.number(1, "state");
        self.number(1, "axes not observed");
        self.number(2, "covariance is known");
        self.lines(32, 2, "quaternion x, y, z, w");
        self.field(24, "translation, m");
        self.lines(84, 1, "covariance");
        self.zeros(4);
    }

    /// The first entry by its fields, the others in a line.
    fn entry(&mut self, is_first: bool) {
        if is_first {
            self.number(4, "entry: offset in the chunk");
            self.number(4, "bytes of payload");
            self.number(2, "kind");
            self.number(2, "stream");
            self.number(4, "flags");
            self.number(8, "number");
            self.number(8, "device time, ns");
            self.number(8, "sequence number");
            return;
        }
        let offset = self.peek(self.at, 4);
        let kind = RecordKind::from_number(self.peek(self.at + 8, 2) as u16).unwrap();
        self.lines(40, 1, &format!("entry: {} at {offset}", name(kind)));
    }

    fn title(&mut self, words: &str) {
        let gap = if self.text.is_empty() { "" } else { "\n" };
        writeln!(self.text, "{gap}{words}").unwrap();
    }

    /// A number with its value; times and others are shown as signed.
    fn number(&mut self, bytes: usize, what: &str) {
        let value = self.peek(self.at, bytes) as i64;
        self.field(bytes, &format!("{what}: {value}"));
    }

    /// Bytes that must be zero.
    fn zeros(&mut self, bytes: usize) {
        if bytes > 0 {
            assert!(
                self.bytes[self.at..self.at + bytes]
                    .iter()
                    .all(|byte| *byte == 0)
            );
            self.lines(bytes, 1, "zero");
        }
    }

    fn field(&mut self, bytes: usize, what: &str) {
        if bytes > 0 {
            self.lines(bytes, 2, what);
        }
    }

    /// At most `most` lines of bytes, the first with `what`.
    fn lines(&mut self, bytes: usize, most: usize, what: &str) {
        let field = &self.bytes[self.at..self.at + bytes];
        for (line, part) in field.chunks(LINE).enumerate().take(most) {
            let mut digits: String = part.iter().map(|byte| format!("{byte:02x} ")).collect();
            let is_cut = line + 1 == most && bytes > most * LINE;
            if is_cut {
                digits.push('…');
            }
            let words = match (line, bytes > LINE) {
                (0, false) => what.to_owned(),
                (0, true) => format!("{what} ({bytes} bytes)"),
                _ => String::new(),
            };
            let text = readable(part).unwrap_or_default();
            let words = [words, text].concat();
            let line = format!("{:06x}  {digits:50}{words}", self.at + line * LINE);
            writeln!(self.text, "{}", line.trim_end()).unwrap();
        }
        self.at += bytes;
    }

    fn peek(&self, at: usize, bytes: usize) -> u64 {
        let mut value = [0; 8];
        value[..bytes].copy_from_slice(&self.bytes[at..at + bytes]);
        u64::from_le_bytes(value)
    }
}

/// Bytes that are letters, as such.
fn readable(bytes: &[u8]) -> Option<String> {
    let is_text = bytes.len() >= 4 && bytes.iter().all(|byte| (b' '..=b'~').contains(byte));
    is_text.then(|| format!("  |{}|", String::from_utf8_lossy(bytes)))
}

fn name(kind: RecordKind) -> &'static str {
    match kind {
        RecordKind::Description => "description",
        RecordKind::DepthTable => "table of codes",
        RecordKind::Frame => "frame",
        RecordKind::Gap => "gap",
        RecordKind::Event => "event",
        RecordKind::PoseSet => "pose set",
        RecordKind::Poses => "poses",
        RecordKind::Gravity => "gravity",
        RecordKind::Histogram => "histogram",
        RecordKind::Note => "note",
        RecordKind::Split => "split",
        RecordKind::Index => "index",
        RecordKind::End => "end",
    }
}
