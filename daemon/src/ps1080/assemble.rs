//! From bytes of an endpoint to numbered frames: each is sent whole, or dropped with its cause.

use ps1080::Damage;
use ps1080::stream::{FrameEvent, FrameReceiver, LossCause, LossCounts, PacketKind, Padding};
use sequence::{FrameTimes, GapCause};

use crate::drops::{Drop, DropLog};
use crate::ps1080::frame_clock::{FrameClock, Origin};
use crate::ps1080::samples::Samples;
use crate::ps1080::usb::Arrival;
use crate::source::{self, SourceEnds};
use crate::status::{Status, StopFlag};

/// What an assembler needs of its surroundings.
pub(super) struct Surroundings<'a> {
    pub(super) ends: &'a mut SourceEnds,
    pub(super) status: &'a Status,
    pub(super) stop: &'a StopFlag,
    /// Time 0 of all streams.
    pub(super) origin: &'a mut Origin,
    /// Whether to wait for free frames.
    pub(super) waits: bool,
}

/// Something that the recording should say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Remark {
    /// The camera reports a fault: it must be stopped.
    Fault(PacketKind),
    /// The end of a frame that was sent already is in doubt.
    Doubt {
        /// Stream.
        stream: u16,
        /// Its number.
        number: u64,
    },
}

/// The frame that is being read.
struct Current<F> {
    /// None when no frame was free.
    frame: Option<Box<F>>,
    damage: Option<Damage>,
    first_host_nanos: i64,
}

/// Makes the frames of one stream.
pub(super) struct Assembler<S: Samples> {
    samples: S,
    receiver: FrameReceiver,
    clock: FrameClock,
    current: Option<Current<S::Frame>>,
    /// One that was taken and not sent.
    spare: Option<Box<S::Frame>>,
    /// Number of the last frame that was sent or dropped.
    last_number: Option<u64>,
    /// Frames that began since.
    begun_count: u64,
    /// Why the first frame since is missing.
    cause: Option<GapCause>,
    /// Bytes were lost on the bus since then.
    is_bus_damaged: bool,
    sent_count: u64,
    last_arrival_nanos: Option<i64>,
}

impl<S: Samples> Assembler<S> {
    pub(super) fn new(samples: S, clock: FrameClock) -> Self {
        Self {
            samples,
            receiver: FrameReceiver::new(S::KIND),
            clock,
            current: None,
            spare: None,
            last_number: None,
            begun_count: 0,
            cause: None,
            is_bus_damaged: false,
            sent_count: 0,
            last_arrival_nanos: None,
        }
    }

    /// Frames that were sent.
    pub(super) fn sent_count(&self) -> u64 {
        self.sent_count
    }

    /// When bytes came last.
    pub(super) fn last_arrival_nanos(&self) -> Option<i64> {
        self.last_arrival_nanos
    }

    /// The camera is switched off and on: that is why frames are missing from here on.
    pub(super) fn note_restart(&mut self) {
        self.give_up_current();
        self.cause.get_or_insert(GapCause::Restart);
        self.last_arrival_nanos = None;
    }

    /// What the receiver counted.
    pub(super) fn counts(&self) -> LossCounts {
        self.receiver.counts()
    }

    /// Takes bytes of the endpoint; a remark, if there is one to make.
    pub(super) fn take(
        &mut self,
        arrival: &Arrival<'_>,
        around: &mut Surroundings<'_>,
    ) -> Option<Remark> {
        if !arrival.bytes.is_empty() {
            self.last_arrival_nanos = Some(arrival.at_nanos);
        }
        self.is_bus_damaged |= arrival.is_damaged;
        let mut remark = None;
        let mut bytes = arrival.bytes;
        while let Some(event) = self.receiver.next(&mut bytes) {
            match event {
                FrameEvent::Started(padding) => self.start(padding, arrival.at_nanos, around),
                FrameEvent::Data(payload) => self.push(payload),
                FrameEvent::Ended(ticks) => {
                    let stamped = self.clock.stamp(
                        ticks,
                        arrival.at_nanos,
                        self.cause.is_some(),
                        around.origin,
                    );
                    let number = self.number(stamped.step_count, &mut around.ends.drops);
                    let times = FrameTimes {
                        number,
                        device_ticks: Some(ticks.0.into()),
                        device_nanos: stamped.nanos,
                        host_nanos: Some([arrival.at_nanos; 2]),
                        is_repeat: false,
                    };
                    self.end(times, around);
                }
                FrameEvent::Lost(loss) => {
                    self.give_up_current();
                    if loss.cause == LossCause::GarbageAfterEnd
                        && let Some(number) = self.last_number
                    {
                        remark = Some(Remark::Doubt {
                            stream: S::STREAM,
                            number,
                        });
                    }
                    self.cause
                        .get_or_insert(cause_of(loss.cause, self.is_bus_damaged));
                }
                FrameEvent::Fault(kind) => remark = Some(Remark::Fault(kind)),
            }
        }
        remark
    }

    fn start(&mut self, padding: Padding, at_nanos: i64, around: &mut Surroundings<'_>) {
        self.begun_count += 1;
        let mut frame = self.spare.take().or_else(|| {
            let (free, parker) = S::free(around.ends);
            source::take(free, parker, around.waits, around.stop)
        });
        if let Some(frame) = &mut frame {
            self.samples.begin(padding, frame);
        }
        self.current = Some(Current {
            frame,
            damage: None,
            first_host_nanos: at_nanos,
        });
    }

    fn push(&mut self, payload: &[u8]) {
        if let Some(current) = &mut self.current
            && current.damage.is_none()
            && let Some(frame) = &mut current.frame
        {
            current.damage = self.samples.push(payload, frame).err();
        }
    }

    fn give_up_current(&mut self) {
        if let Some(frame) = self.current.take().and_then(|current| current.frame) {
            self.spare = Some(frame);
        }
    }

    /// The number of the frame that ended; what is missing before it is dropped.
    fn number(&mut self, step_count: u64, drops: &mut DropLog) -> u64 {
        let begun_count = std::mem::take(&mut self.begun_count).max(1);
        let cause = self.cause.take();
        let is_bus_damaged = std::mem::take(&mut self.is_bus_damaged);
        let (first_missing, number) = match self.last_number {
            Some(last) => (last + 1, last + step_count.max(1)),
            // The camera began with those whose beginning was seen.
            None => (0, begun_count - 1),
        };
        self.last_number = Some(number);
        if number > first_missing {
            let unseen = if is_bus_damaged {
                GapCause::UsbShort
            } else {
                // The camera did not send them, or counts its packets as if it had not.
                GapCause::Source
            };
            drops.add(Drop {
                stream: S::STREAM,
                first_number: first_missing,
                count: number - first_missing,
                cause: cause.unwrap_or(unseen),
            });
        }
        number
    }

    fn end(&mut self, mut times: FrameTimes, around: &mut Surroundings<'_>) {
        let Some(mut current) = self.current.take() else {
            return;
        };
        around.status.add_in(1);
        let drop = |cause| Drop {
            stream: S::STREAM,
            first_number: times.number,
            count: 1,
            cause,
        };
        let Some(mut frame) = current.frame.take() else {
            return around.ends.drops.add(drop(GapCause::PoolEmpty));
        };
        let finished = match current.damage {
            None => self.samples.finish(&mut frame),
            Some(damage) => Err(damage),
        };
        if let Err(damage) = finished {
            tracing::debug!("frame {} of stream {}: {damage}", times.number, S::STREAM);
            self.spare = Some(frame);
            return around.ends.drops.add(drop(GapCause::Corrupt));
        }
        if let Some([first, _]) = &mut times.host_nanos {
            *first = current.first_host_nanos;
        }
        self.sent_count += 1;
        around.ends.send(S::sent(frame, times), S::STREAM);
    }

    /// The stream is over: frames that began and never ended are dropped; the last of them for `last_cause`, or not at
    /// all where the recording was told to end.
    pub(super) fn finish(&mut self, last_cause: Option<GapCause>, drops: &mut DropLog) {
        let is_within = self.current.is_some();
        self.give_up_current();
        let mut lost_count = self.begun_count - u64::from(is_within);
        let mut first_number = self.last_number.map_or(0, |last| last + 1);
        if lost_count > 0 {
            drops.add(Drop {
                stream: S::STREAM,
                first_number,
                count: lost_count,
                cause: self.cause.unwrap_or(GapCause::PacketLoss),
            });
            first_number += lost_count;
        }
        if is_within && let Some(cause) = last_cause {
            drops.add(Drop {
                stream: S::STREAM,
                first_number,
                count: 1,
                cause,
            });
            lost_count += 1;
        }
        if lost_count > 0 {
            self.last_number = Some(first_number);
        }
        self.begun_count = 0;
        drops.flush(S::STREAM);
    }
}

/// What the recording calls a loss.
fn cause_of(cause: LossCause, is_bus_damaged: bool) -> GapCause {
    match cause {
        _ if is_bus_damaged => GapCause::UsbShort,
        LossCause::PacketsMissing(_)
        | LossCause::IdRestarted
        | LossCause::EndMissing
        | LossCause::StartMissing => GapCause::PacketLoss,
        LossCause::Garbage | LossCause::PacketCut | LossCause::GarbageAfterEnd => GapCause::Corrupt,
    }
}
