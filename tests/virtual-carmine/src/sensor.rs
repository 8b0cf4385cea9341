//! A stream: frames made by deadline, cut into packets, stored or lost.

use ps1080::stream::{DeviceTicks, Packetiser, StreamKind};
use rand::RngExt as _;
use rand_pcg::Pcg64Mcg;

use crate::clock::DeviceClock;
use crate::counters::{DeliveredFrame, StreamCounters};
use crate::darkroom::Darkroom;
use crate::faults::{Faults, StreamName};
use crate::fifo::{Fifo, FrameEnd};
use crate::frame::{Frame, happens};
use crate::shot::Shot;

const NANOS_PER_SECOND: i64 = 1_000_000_000;
/// Share of the period in which a frame is read out: the rest is blanking.
const READOUT: (i64, i64) = (9, 10);

/// What all streams use.
pub(crate) struct Workshop<'a> {
    pub(crate) clock: &'a DeviceClock,
    pub(crate) darkroom: &'a mut Darkroom,
    pub(crate) faults: &'a Faults,
    pub(crate) random: &'a mut Pcg64Mcg,
}

/// What a stream films from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Exposure {
    pub(crate) shot: Shot,
    pub(crate) fps: u32,
    /// How much later than the grid of frame periods its frames begin.
    pub(crate) phase_nanos: i64,
    /// Infrared without depth: the counter stands still (a mistake of the firmware).
    pub(crate) has_frozen_stamp: bool,
}

pub(crate) struct Sensor {
    kind: StreamKind,
    packet_bytes: usize,
    fifo: Fifo,
    running: Option<Running>,
    last_stamp: DeviceTicks,
    /// The last byte that was stored ends a frame.
    is_at_frame_end: bool,
    pub(crate) counters: StreamCounters,
    pub(crate) delivered: Vec<DeliveredFrame>,
}

struct Running {
    exposure: Exposure,
    packetiser: Packetiser,
    started_nanos: i64,
    next_index: i64,
    last_film_index: u64,
    alarms_sent: usize,
    frame: Option<Frame>,
}

impl Sensor {
    pub(crate) fn new(kind: StreamKind, packet_bytes: usize, fifo_bytes: usize) -> Self {
        Self {
            kind,
            packet_bytes,
            fifo: Fifo::new(fifo_bytes),
            running: None,
            last_stamp: DeviceTicks(0),
            is_at_frame_end: false,
            counters: StreamCounters::default(),
            delivered: Vec::new(),
        }
    }

    /// Switches on at `now_nanos`; the first frame begins at the first place of its grid after `first_nanos`.
    pub(crate) fn start(
        &mut self,
        now_nanos: i64,
        first_nanos: i64,
        exposure: Exposure,
        clock: &DeviceClock,
    ) {
        self.fifo.clear();
        self.running = Packetiser::new(self.kind, self.packet_bytes).map(|packetiser| Running {
            exposure,
            packetiser,
            started_nanos: now_nanos,
            next_index: grid_index(clock.device_nanos(first_nanos), exposure),
            last_film_index: 0,
            alarms_sent: 0,
            frame: None,
        });
    }

    /// Switches off; what has not been fetched is gone.
    pub(crate) fn stop(&mut self) {
        self.running = None;
        self.fifo.clear();
    }

    pub(crate) fn is_running(&self) -> bool {
        self.running.is_some()
    }

    /// From the next frame on, films this way; never two frames at once.
    pub(crate) fn turn(&mut self, exposure: Exposure) {
        let Some(running) = &mut self.running else {
            return;
        };
        let before = running.exposure;
        if exposure.phase_nanos != before.phase_nanos {
            let free_nanos = grid_nanos(running.next_index, before);
            running.next_index = grid_index(free_nanos, exposure);
        }
        running.exposure = exposure;
    }

    /// Makes all that is due until `now_nanos`.
    pub(crate) fn advance(&mut self, now_nanos: i64, workshop: &mut Workshop<'_>) {
        while self
            .next_due_nanos(workshop.clock)
            .is_some_and(|due_nanos| due_nanos <= now_nanos)
        {
            let is_filming = self
                .running
                .as_ref()
                .is_some_and(|running| running.frame.is_some());
            if is_filming {
                self.store_packet(workshop.clock);
            } else {
                self.begin_frame(workshop);
            }
        }
    }

    /// When a frame begins or a packet is ready next.
    pub(crate) fn next_due_nanos(&self, clock: &DeviceClock) -> Option<i64> {
        let running = self.running.as_ref()?;
        let device_nanos = match &running.frame {
            None => grid_nanos(running.next_index, running.exposure),
            Some(frame) => frame.packet_nanos(frame.next_packet),
        };
        Some(clock.host_nanos(device_nanos))
    }

    /// When `bytes` can be there at the earliest; earlier than that a frame may end, or begin, which says more.
    pub(crate) fn ready_nanos(&self, bytes: usize, clock: &DeviceClock) -> Option<i64> {
        let running = self.running.as_ref()?;
        let missing = bytes.saturating_sub(self.fifo.len());
        let device_nanos = match &running.frame {
            _ if missing == 0 => return Some(i64::MIN),
            None => grid_nanos(running.next_index, running.exposure),
            Some(frame) => {
                let before = frame.next_packet.checked_sub(1);
                let sent = before.map_or(0, |before| frame.packet_ends[before]);
                let enough = frame
                    .packet_ends
                    .partition_point(|&end| end < sent + missing);
                frame.packet_nanos(enough.min(frame.packet_ends.len() - 1))
            }
        };
        Some(clock.host_nanos(device_nanos))
    }

    fn begin_frame(&mut self, workshop: &mut Workshop<'_>) {
        let Some(running) = &mut self.running else {
            return;
        };
        let exposure = running.exposure;
        let begin_device_nanos = grid_nanos(running.next_index, exposure);
        let mut film_index = running.next_index.max(0).cast_unsigned();
        running.next_index += 1;
        let faults = workshop.faults;
        if happens(faults.repeat_frame_chance, workshop.random) && self.counters.frames_filmed > 0 {
            film_index = running.last_film_index;
            self.counters.repeated_frames += 1;
        }
        let Some(payload) = workshop.darkroom.payload(exposure.shot, film_index) else {
            return;
        };
        running.last_film_index = film_index;
        let mut payload = &payload[..];
        let is_short = happens(faults.short_frame_chance, workshop.random);
        if is_short {
            payload = &payload[..workshop.random.random_range(0..payload.len().max(1))];
            self.counters.shortened_frames += 1;
        }
        if !exposure.has_frozen_stamp {
            self.last_stamp = workshop.clock.ticks(begin_device_nanos);
        }
        self.counters.frames_filmed += 1;
        let period_nanos = NANOS_PER_SECOND / i64::from(exposure.fps.max(1));
        let mut frame = Frame {
            film_index,
            stamp: self.last_stamp.0,
            begin_device_nanos,
            readout_nanos: period_nanos * READOUT.0 / READOUT.1,
            is_whole: !is_short,
            ..Frame::default()
        };
        let since_nanos = workshop.clock.host_nanos(begin_device_nanos) - running.started_nanos;
        running.alarms_sent += frame.prepend_alarms(
            faults,
            stream_name(self.kind),
            since_nanos,
            running.alarms_sent,
        );
        let padding = exposure.shot.padding();
        for packet in running.packetiser.frame(payload, padding, self.last_stamp) {
            self.counters.packets_made += 1;
            frame.append(
                &packet.header,
                packet.payload,
                faults,
                workshop.random,
                &mut self.counters,
            );
        }
        if frame.packet_ends.is_empty() {
            // All of it was dropped: the host sees nothing, not even an end.
            return;
        }
        running.frame = Some(frame);
    }

    fn store_packet(&mut self, clock: &DeviceClock) {
        let Some(running) = &mut self.running else {
            return;
        };
        let Some(frame) = &mut running.frame else {
            return;
        };
        let packet = frame.packet(frame.next_packet);
        let is_stored = self.fifo.push(packet);
        self.is_at_frame_end = false;
        if !is_stored {
            self.counters.fifo_lost_packets += 1;
            self.counters.fifo_lost_bytes += packet.len() as u64;
            frame.is_whole = false;
        }
        let ready_nanos = clock.host_nanos(frame.packet_nanos(frame.next_packet));
        frame.next_packet += 1;
        if frame.next_packet == frame.packet_ends.len() {
            self.is_at_frame_end = true;
            self.fifo.end_frame(FrameEnd {
                film_index: frame.film_index,
                ticks: frame.stamp,
                ready_nanos,
                is_whole: frame.is_whole,
            });
            running.frame = None;
        }
    }

    /// Until when the endpoint is silent on demand.
    pub(crate) fn stalled_until_nanos(&self, now_nanos: i64, faults: &Faults) -> Option<i64> {
        let since_nanos = now_nanos - self.running.as_ref()?.started_nanos;
        let name = stream_name(self.kind);
        let stalls = faults.stalls.iter().filter(|stall| stall.stream == name);
        stalls
            .map(|stall| (stall.after_nanos, stall.after_nanos + stall.length_nanos))
            .filter(|&(from, until)| (from..until).contains(&since_nanos))
            .map(|(_, until)| now_nanos + until - since_nanos)
            .max()
    }

    /// How many bytes a read of `room_bytes` gets in whole USB packets, and whether it ends there.
    pub(crate) fn available(
        &self,
        room_bytes: usize,
        usb_packet_bytes: usize,
        ends_transfers: bool,
    ) -> (usize, bool) {
        let there = self.fifo.len();
        if there >= room_bytes {
            return (room_bytes, true);
        }
        if ends_transfers && self.is_at_frame_end && there > 0 {
            return (there, true);
        }
        (there / usb_packet_bytes * usb_packet_bytes, false)
    }

    /// Takes bytes that are available.
    pub(crate) fn take(&mut self, out: &mut [u8]) {
        self.fifo.take(out);
        self.counters.delivered_bytes += out.len() as u64;
        while let Some(end) = self.fifo.pop_ended() {
            if !end.is_whole {
                self.counters.frames_damaged += 1;
                continue;
            }
            self.counters.frames_delivered += 1;
            self.delivered.push(DeliveredFrame {
                film_index: end.film_index,
                ticks: end.ticks,
                ready_nanos: end.ready_nanos,
            });
        }
    }
}

fn stream_name(kind: StreamKind) -> StreamName {
    match kind {
        StreamKind::Depth => StreamName::Depth,
        StreamKind::Image => StreamName::Image,
    }
}

/// When frame `index` begins, in the camera's time.
fn grid_nanos(index: i64, exposure: Exposure) -> i64 {
    let fps = i128::from(exposure.fps.max(1));
    let nanos = i128::from(index) * i128::from(NANOS_PER_SECOND);
    // An index is at most the camera's age times the rate.
    nanos.div_euclid(fps) as i64 + exposure.phase_nanos
}

/// The first frame that begins at `device_nanos` or after.
fn grid_index(device_nanos: i64, exposure: Exposure) -> i64 {
    let since = i128::from(device_nanos - exposure.phase_nanos) * i128::from(exposure.fps.max(1));
    let mut index = since.div_euclid(i128::from(NANOS_PER_SECOND)) as i64;
    while grid_nanos(index, exposure) < device_nanos {
        index += 1;
    }
    index
}
