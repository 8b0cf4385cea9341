//! From packets to frames: which bytes are of which frame, which frames are not whole, and why.

use crate::stream::packet::{
    PACKET_MAGIC, PacketHeader, PacketKind, Padding, PartKind, StreamKind,
};
use crate::stream::parser::{PacketParser, Piece};
use crate::stream::ticks::DeviceTicks;

/// Why a frame is not whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LossCause {
    /// The next id is ahead: this many packets did not arrive. Between two frames it is whole frames that are
    /// missing.
    PacketsMissing(u16),
    /// The next id is behind: the camera's counter began anew, or the id is damaged.
    IdRestarted,
    /// A frame began before the one before had ended.
    EndMissing,
    /// A frame goes on that never began, as when listening starts late.
    StartMissing,
    /// Bytes that are no packet between two packets of the frame: some of a packet were lost.
    Garbage,
    /// The last packet holds the header of the next frame: bytes of its own are missing.
    PacketCut,
    /// Bytes that are no packet directly behind a frame that was handed out as whole: up to three of its last bytes may
    /// be missing, and its last pixels are in doubt. (Bytes are not lost one by one within a transfer, so this is
    /// damage of another kind.)
    GarbageAfterEnd,
}

/// A frame, or more than one, that did not arrive whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loss {
    /// What was noticed first.
    pub cause: LossCause,
    /// Bytes of payload that had been handed out for the frame and are to be thrown away.
    pub payload_bytes: u64,
}

/// What [`FrameReceiver::next`] has to say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameEvent<'a> {
    /// A frame begins.
    Started(Padding),
    /// Its next bytes.
    Data(&'a [u8]),
    /// It is complete, by its packets; whether the payload makes a picture is for the decoder to say. The stamp is the
    /// frame's.
    Ended(DeviceTicks),
    /// The frame that began last is lost, or frames that never began. Data come again after the next `Started`.
    Lost(Loss),
    /// The camera reports [`PacketKind::ProjectorFault`] or [`PacketKind::Overheat`]: stop it.
    Fault(PacketKind),
}

/// Counts of one stream since it was started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LossCounts {
    /// Frames that began.
    pub started_count: u64,
    /// Frames handed out whole.
    pub ended_count: u64,
    /// Times that [`FrameEvent::Lost`] was said.
    pub lost_count: u64,
    /// Packets missing by their ids.
    pub missing_packet_count: u64,
    /// Packets that came a second time and were left out.
    pub repeated_packet_count: u64,
    /// Packets of other kinds on this endpoint.
    pub foreign_packet_count: u64,
    /// Bytes that belong to no packet.
    pub garbage_bytes: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Between frames.
    Between,
    /// In a frame that is whole so far.
    In,
    /// In or after a lost frame, until the next START.
    Lost,
}

/// Receives one stream of one endpoint. It knows no clock: stamps become times in crate sequence (`TickUnwrapper`).
///
/// A frame counts as whole when it has its START, its END and all packets between by their ids. This is stricter than
/// OpenNI2, which lets any id 0 pass: here only START may begin to count anew. A packet that equals the one before in
/// its header is a repetition and is left out.
///
/// Packets have no checksum. Bits that change in a payload, and bytes missing of just the length at which what is left
/// fits together (a whole packet's, from within one END to within the next START), cannot be seen here before the frame
/// is handed out; the latter breaks the ids right after it.
#[derive(Clone, Debug)]
pub struct FrameReceiver {
    kind: StreamKind,
    parser: PacketParser,
    state: State,
    latest: Option<PacketHeader>,
    /// The packet that is being read, if its payload counts.
    current: Option<PacketHeader>,
    waiting: Option<FrameEvent<'static>>,
    frame_bytes: u64,
    cut: CutDetector,
    /// Nothing has come since a frame ended.
    is_after_end: bool,
    counts: LossCounts,
}

impl FrameReceiver {
    /// For the packets of `kind`, before the first.
    pub fn new(kind: StreamKind) -> Self {
        Self {
            kind,
            parser: PacketParser::new(),
            state: State::Between,
            latest: None,
            current: None,
            waiting: None,
            frame_bytes: 0,
            cut: CutDetector::default(),
            is_after_end: false,
            counts: LossCounts::default(),
        }
    }

    /// The next event of `transfer`, from which what was used is taken off; `None` when all of it is used. To be called
    /// until then.
    pub fn next<'a>(&mut self, transfer: &mut &'a [u8]) -> Option<FrameEvent<'a>> {
        if let Some(event) = self.waiting.take() {
            return Some(event);
        }
        while let Some(piece) = self.parser.next(transfer) {
            let event = match piece {
                Piece::Header(header) => self.header(header),
                Piece::Payload(bytes) => self.payload(bytes),
                Piece::Complete => self.complete(),
                Piece::Garbage(count) => self.garbage(count),
            };
            if event.is_some() {
                return event;
            }
        }
        None
    }

    /// What has been counted.
    pub fn counts(&self) -> LossCounts {
        self.counts
    }

    fn header(&mut self, header: PacketHeader) -> Option<FrameEvent<'static>> {
        self.current = None;
        self.is_after_end = false;
        match header.kind {
            PacketKind::Frame(kind, part) if kind == self.kind => self.own_header(header, part),
            PacketKind::ProjectorFault | PacketKind::Overheat => {
                Some(FrameEvent::Fault(header.kind))
            }
            _ => {
                self.counts.foreign_packet_count += 1;
                None
            }
        }
    }

    fn own_header(&mut self, header: PacketHeader, part: PartKind) -> Option<FrameEvent<'static>> {
        if self.latest == Some(header) {
            self.counts.repeated_packet_count += 1;
            return None;
        }
        let break_cause = self.break_before(&header, part);
        self.latest = Some(header);
        if let Some(LossCause::PacketsMissing(count)) = break_cause {
            self.counts.missing_packet_count += u64::from(count);
        }
        let unexpected = match (self.state, part) {
            (State::In, PartKind::Start) => Some(LossCause::EndMissing),
            (State::Between, PartKind::Buffer | PartKind::End) => Some(LossCause::StartMissing),
            _ => None,
        };
        // A frame is lost once.
        let cause = break_cause
            .or(unexpected)
            .filter(|_| self.state != State::Lost);
        let lost = cause.map(|cause| self.lose(cause));
        if part == PartKind::Start {
            let started = self.start(header);
            if lost.is_none() {
                return Some(started);
            }
            self.waiting = Some(started);
        } else if self.state == State::In {
            self.current = Some(header);
            self.cut = CutDetector::default();
            // The header may be what was cut.
            if let Some(bytes) = header.encode().filter(|_| part == PartKind::End) {
                self.cut.look(self.kind, next_id(&header), &bytes);
            }
        }
        lost
    }

    /// How the ids are broken between the latest packet and this one.
    fn break_before(&self, header: &PacketHeader, part: PartKind) -> Option<LossCause> {
        let expected = self.latest?.id.wrapping_add(1);
        let ahead = header.id.wrapping_sub(expected);
        match ahead {
            0 => None,
            _ if part == PartKind::Start && header.id == 0 => None,
            // Half the range is ahead, half behind.
            1..0x8000 => Some(LossCause::PacketsMissing(ahead)),
            _ => Some(LossCause::IdRestarted),
        }
    }

    fn start(&mut self, header: PacketHeader) -> FrameEvent<'static> {
        self.state = State::In;
        self.frame_bytes = 0;
        self.counts.started_count += 1;
        self.current = Some(header);
        FrameEvent::Started(header.padding())
    }

    fn lose(&mut self, cause: LossCause) -> FrameEvent<'static> {
        let payload_bytes = if self.state == State::In {
            self.frame_bytes
        } else {
            0
        };
        self.state = State::Lost;
        self.current = None;
        self.counts.lost_count += 1;
        FrameEvent::Lost(Loss {
            cause,
            payload_bytes,
        })
    }

    fn payload<'a>(&mut self, bytes: &'a [u8]) -> Option<FrameEvent<'a>> {
        let current = self.current?;
        if is_end(&current) {
            self.cut.look(self.kind, next_id(&current), bytes);
        }
        self.frame_bytes += bytes.len() as u64;
        Some(FrameEvent::Data(bytes))
    }

    fn complete(&mut self) -> Option<FrameEvent<'static>> {
        let current = self.current.take()?;
        if !is_end(&current) {
            return None;
        }
        if self.cut.found || self.cut.ends_within_a_header(self.kind, next_id(&current)) {
            return Some(self.lose(LossCause::PacketCut));
        }
        self.state = State::Between;
        self.is_after_end = true;
        self.counts.ended_count += 1;
        Some(FrameEvent::Ended(current.ticks()?))
    }

    fn garbage(&mut self, count: usize) -> Option<FrameEvent<'static>> {
        self.counts.garbage_bytes += count as u64;
        if core::mem::take(&mut self.is_after_end) {
            return Some(self.lose(LossCause::GarbageAfterEnd));
        }
        (self.state == State::In).then(|| self.lose(LossCause::Garbage))
    }
}

fn next_id(header: &PacketHeader) -> u16 {
    header.id.wrapping_add(1)
}

fn is_end(header: &PacketHeader) -> bool {
    matches!(header.kind, PacketKind::Frame(_, PartKind::End))
}

/// Looks for the header of the frame that follows in the payload of an END packet: there it is when bytes of that
/// packet were lost, and nothing else would tell. Cuts elsewhere show in the ids.
#[derive(Clone, Copy, Debug, Default)]
struct CutDetector {
    /// The latest eight bytes.
    window: u64,
    found: bool,
}

impl CutDetector {
    fn look(&mut self, kind: StreamKind, next_id: u16, bytes: &[u8]) {
        let sought = first_six_bytes(kind, next_id);
        for &byte in bytes {
            self.window = self.window << 8 | u64::from(byte);
            self.found |= self.window & 0xFFFF_FFFF_FFFF == sought;
        }
    }

    /// Whether the payload ends with the first four or five bytes of that header: fewer are there by chance.
    fn ends_within_a_header(&self, kind: StreamKind, next_id: u16) -> bool {
        let sought = first_six_bytes(kind, next_id);
        self.window & 0xFFFF_FFFF == sought >> 16 || self.window & 0xFF_FFFF_FFFF == sought >> 8
    }
}

/// Of the header of a START packet, the first the highest.
fn first_six_bytes(kind: StreamKind, id: u16) -> u64 {
    let [magic0, magic1] = PACKET_MAGIC;
    let code = PacketKind::Frame(kind, PartKind::Start).code();
    let ([kind0, kind1], [id0, id1]) = (code.to_le_bytes(), id.to_le_bytes());
    u64::from_be_bytes([0, 0, magic0, magic1, kind0, kind1, id0, id1])
}
