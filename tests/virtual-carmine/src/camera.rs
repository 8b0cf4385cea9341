//! The device.

use ps1080::parameter::Parameter;
use ps1080::stream::StreamKind;
use ps1080::usb::{REQUEST_TYPE_IN, REQUEST_TYPE_OUT, TransferKind, endpoint};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use crate::answers::{Effect, Memory};
use crate::clock::DeviceClock;
use crate::conversation::Conversation;
use crate::counters::{Counters, DeliveredFrame};
use crate::darkroom::Darkroom;
use crate::descriptors::{self, EndpointKinds, descriptor, microframe_bytes};
use crate::faults::Faults;
use crate::film::Film;
use crate::personality::Personality;
use crate::sensor::{Exposure, Sensor, Workshop};
use crate::usb::{Control, Setup, standard};

/// What a read of a data endpoint gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// So many bytes, now taken from the camera. A transfer that is full or gets `ends` (a short USB packet) is
    /// complete; else it goes on with the next read into the rest of its buffer.
    Bytes {
        /// Bytes written to the buffer; 0 only together with `ends`.
        count: usize,
        /// Whether the transfer ends here.
        ends: bool,
    },
    /// Nothing yet. Asking again before `at_nanos` gives the same; `None`: not before another control transfer.
    NotYet {
        /// The host's time of the next look.
        at_nanos: Option<i64>,
    },
    /// There is no such endpoint in the active setting.
    Stall,
    /// The camera has been unplugged.
    Gone,
}

/// The camera. It is driven by three calls: [`control`](Self::control), [`set_alt_setting`](Self::set_alt_setting),
/// [`read`](Self::read), each of which is told the time; times must not run backwards. It is plugged in at the time of
/// the first call.
///
/// [`read`](Self::read) is what one USB transfer in progress does to the camera. A host whose transfers are queued is
/// best put behind a [`Bus`](crate::Bus), which reads at the times at which hardware would.
pub struct VirtualCarmine {
    memory: Memory,
    faults: Faults,
    random: Pcg64Mcg,
    conversation: Conversation,
    clock: Option<DeviceClock>,
    now_nanos: i64,
    depth: Sensor,
    image: Sensor,
    alt_setting: u8,
    settings: Vec<EndpointKinds>,
    is_gone: bool,
    counters: Counters,
}

impl VirtualCarmine {
    /// A camera that is about to be plugged in.
    pub fn new(personality: Personality, film: Box<dyn Film>, faults: Faults) -> Self {
        let packet_bytes = personality.packet_bytes;
        // A memory that never has room for the next packet beside the last one would lose all.
        let fifo_bytes = personality.fifo_bytes.max(2 * packet_bytes);
        let settings = descriptors::settings(&personality);
        Self {
            random: Pcg64Mcg::seed_from_u64(faults.seed),
            memory: Memory::new(personality, Darkroom::new(film, faults.deviation)),
            faults,
            conversation: Conversation::default(),
            clock: None,
            now_nanos: i64::MIN,
            depth: Sensor::new(StreamKind::Depth, packet_bytes, fifo_bytes),
            image: Sensor::new(StreamKind::Image, packet_bytes, fifo_bytes),
            alt_setting: 0,
            settings,
            is_gone: false,
            counters: Counters::default(),
        }
    }

    /// A control transfer. `data` is the data stage: of an OUT transfer the bytes that are sent, of an IN transfer the
    /// room for those that come.
    ///
    /// The host protocol ([`Setup::vendor_out`], [`Setup::vendor_in`]) and the standard requests that operating systems
    /// send (descriptors, configuration, interface, status, halt) are served; anything else stalls.
    pub fn control(&mut self, now_nanos: i64, setup: Setup, data: &mut [u8]) -> Control {
        self.pass_time(now_nanos);
        if self.is_gone {
            return Control::Gone;
        }
        let room = data.len().min(usize::from(setup.length));
        let data = &mut data[..room];
        match (setup.request_type, setup.request) {
            (REQUEST_TYPE_OUT, 0) => self.take_request(data),
            (REQUEST_TYPE_IN, 0) => {
                let counters = &mut self.counters;
                Control::Done(self.conversation.reply(self.now_nanos, data, counters))
            }
            _ => self.standard(setup, data),
        }
    }

    /// Chooses the alternate setting of interface 0; all streams stop. Whether there is such a setting.
    pub fn set_alt_setting(&mut self, now_nanos: i64, setting: u8) -> bool {
        self.pass_time(now_nanos);
        let is_there = usize::from(setting) < self.settings.len();
        if is_there && !self.is_gone {
            self.alt_setting = setting;
            self.memory.settings.all_off();
            self.follow_settings();
        }
        is_there && !self.is_gone
    }

    /// Moves what has come on an endpoint (0x81, 0x82) until `now_nanos` into `buffer`, in whole USB packets. On an
    /// isochronous endpoint at most the bytes of a microframe.
    pub fn read(&mut self, now_nanos: i64, endpoint: u8, buffer: &mut [u8]) -> Read {
        self.pass_time(now_nanos);
        if self.is_gone {
            return Read::Gone;
        }
        let Some(kinds) = self.endpoint_kinds() else {
            return Read::Stall;
        };
        let Some(max_packet) = max_packet(kinds, endpoint) else {
            return Read::Stall;
        };
        let is_bulk = kinds.kind == TransferKind::Bulk;
        let ends_transfers = self.memory.unit.ends_transfers;
        let faults = &self.faults;
        let Some(clock) = self.clock else {
            return Read::NotYet { at_nanos: None };
        };
        let sensor = if endpoint == self.depth_endpoint() {
            &mut self.depth
        } else {
            &mut self.image
        };
        if let Some(until_nanos) = sensor.stalled_until_nanos(now_nanos, faults) {
            return Read::NotYet {
                at_nanos: Some(until_nanos),
            };
        }
        let (mut count, mut ends) = if is_bulk {
            sensor.available(buffer.len(), usize::from(max_packet), ends_transfers)
        } else {
            // Packets of any size: all that is there, none of it waits.
            sensor.available(buffer.len().min(microframe_bytes(max_packet)), 1, true)
        };
        if count == 0 {
            return Read::NotYet {
                at_nanos: sensor.next_due_nanos(&clock),
            };
        }
        let chance = faults.transfer_split_chance;
        if chance > 0.0 && self.random.random_bool(chance.min(1.0)) {
            count = self.random.random_range(0..=count);
            ends = true;
        }
        sensor.take(&mut buffer[..count]);
        self.pull_the_plug_by_bytes();
        Read::Bytes { count, ends }
    }

    /// Pulls the plug.
    pub fn unplug(&mut self) {
        self.is_gone = true;
        self.depth.stop();
        self.image.stop();
    }

    /// Whether the plug has been pulled.
    pub fn is_gone(&self) -> bool {
        self.is_gone
    }

    /// What the camera has counted so far.
    pub fn counters(&self) -> Counters {
        Counters {
            depth: self.depth.counters.clone(),
            image: self.image.counters.clone(),
            ..self.counters.clone()
        }
    }

    /// The frames of a stream that the host took whole, in order.
    pub fn delivered(&self, stream: StreamKind) -> &[DeliveredFrame] {
        match stream {
            StreamKind::Depth => &self.depth.delivered,
            StreamKind::Image => &self.image.delivered,
        }
    }

    /// The unit.
    pub fn personality(&self) -> &Personality {
        &self.memory.unit
    }

    /// Value of a parameter.
    pub fn parameter(&self, parameter: Parameter) -> u16 {
        self.memory.settings.get(parameter)
    }

    /// Whether the emitter is on.
    pub fn is_lit(&self) -> bool {
        self.memory.settings.is_lit()
    }

    /// How the endpoints of the active setting work.
    pub fn transfer_kind(&self) -> Option<TransferKind> {
        self.endpoint_kinds().map(|kinds| kinds.kind)
    }

    /// A descriptor by the value of GET_DESCRIPTOR (kind in the high byte, index in the low one), as bytes.
    pub fn descriptor(&self, value: u16) -> Option<Vec<u8>> {
        descriptor(value, &self.memory.unit)
    }

    /// When something happens next that no call causes, in the host's time: the plug is pulled.
    pub fn unplug_nanos(&self) -> Option<i64> {
        let clock = self.clock.as_ref()?;
        let after_nanos = self.faults.unplug_after_nanos?;
        Some(clock.host_nanos(0) + after_nanos)
    }

    /// When `bytes` more can have come on an endpoint at the earliest, in the host's time; something that is to be looked
    /// at, such as the end of a frame, may be earlier and is then what is said. `None`: not before a control transfer.
    pub fn ready_nanos(&self, endpoint: u8, bytes: usize) -> Option<i64> {
        let clock = self.clock.as_ref()?;
        let sensor = if endpoint == self.depth_endpoint() {
            &self.depth
        } else {
            &self.image
        };
        if let Some(until_nanos) = sensor.stalled_until_nanos(self.now_nanos, &self.faults) {
            return Some(until_nanos);
        }
        if self.faults.transfer_split_chance > 0.0 {
            return sensor.next_due_nanos(clock);
        }
        sensor.ready_nanos(bytes, clock)
    }

    fn endpoint_kinds(&self) -> Option<EndpointKinds> {
        self.settings.get(usize::from(self.alt_setting)).copied()
    }

    fn depth_endpoint(&self) -> u8 {
        endpoint(self.memory.unit.firmware(), StreamKind::Depth)
    }

    fn take_request(&mut self, packet: &[u8]) -> Control {
        let effect = self.conversation.request(
            self.now_nanos,
            packet,
            &mut self.memory,
            &mut self.faults,
            &mut self.random,
            &mut self.counters,
        );
        match effect {
            None => return Control::NoAnswer,
            Some(Effect::None) => {}
            Some(Effect::Streams) => self.follow_settings(),
            Some(Effect::Leaves) => self.unplug(),
        }
        Control::Done(packet.len())
    }

    fn standard(&mut self, setup: Setup, data: &mut [u8]) -> Control {
        use standard::*;
        let reply = match (setup.request_type & 0x7F, setup.request) {
            (0x00, GET_DESCRIPTOR) => match self.descriptor(setup.value) {
                Some(descriptor) => descriptor,
                None => return Control::Stall,
            },
            (0x00, GET_CONFIGURATION) => vec![1],
            (0x01, GET_INTERFACE) => vec![if setup.index == 0 {
                self.alt_setting
            } else {
                0
            }],
            (0x00..=0x02, GET_STATUS) => vec![0, 0],
            (0x01, SET_INTERFACE) if setup.index == 0 => {
                // Values above 255 do not exist.
                let setting = u8::try_from(setup.value).unwrap_or(u8::MAX);
                if !self.set_alt_setting(self.now_nanos, setting) {
                    return Control::Stall;
                }
                Vec::new()
            }
            (0x00, SET_CONFIGURATION) if setup.value <= 1 => Vec::new(),
            (0x00..=0x02, CLEAR_FEATURE | SET_FEATURE) => Vec::new(),
            _ => return Control::Stall,
        };
        if !setup.is_in() {
            return Control::Done(data.len());
        }
        let length = reply.len().min(data.len());
        data[..length].copy_from_slice(&reply[..length]);
        Control::Done(length)
    }

    /// Lets the camera work until `now_nanos`.
    pub(crate) fn pass_time(&mut self, now_nanos: i64) {
        let clock = *self.clock.get_or_insert_with(|| {
            DeviceClock::new(
                now_nanos,
                self.faults.clock_drift_ppm,
                self.faults.first_ticks,
                self.memory.unit.ticks_per_microsecond,
            )
        });
        // A host that gives two threads' times in the wrong order does not turn time back.
        self.now_nanos = self.now_nanos.max(now_nanos);
        if self
            .unplug_nanos()
            .is_some_and(|unplug_nanos| unplug_nanos <= self.now_nanos)
        {
            self.unplug();
        }
        let mut workshop = Workshop {
            clock: &clock,
            darkroom: &mut self.memory.darkroom,
            faults: &self.faults,
            random: &mut self.random,
        };
        self.depth.advance(self.now_nanos, &mut workshop);
        self.image.advance(self.now_nanos, &mut workshop);
    }

    /// Starts, stops and turns streams to what the parameters say.
    fn follow_settings(&mut self) {
        let Some(clock) = self.clock else {
            return;
        };
        let unit = &self.memory.unit;
        let settings = &mut self.memory.settings;
        let first_nanos = self.now_nanos + unit.start_nanos;
        let depth = settings.has_depth().then(|| settings.depth_shot(unit));
        let image = (settings.image_mode() != 0).then(|| settings.image_shot(unit));
        let is_synced = settings.get(Parameter::FrameSync) == 1;
        let skew_nanos = if is_synced {
            unit.synced_skew_nanos
        } else {
            unit.skew_nanos
        };
        let exposures = [
            (depth.flatten(), 0, false),
            (
                image.flatten(),
                skew_nanos,
                settings.image_mode() == 3 && !settings.has_depth(),
            ),
        ];
        for (sensor, (shot, phase_nanos, has_frozen_stamp)) in [&mut self.depth, &mut self.image]
            .into_iter()
            .zip(exposures)
        {
            let exposure = shot.map(|(shot, fps)| Exposure {
                shot,
                fps,
                phase_nanos,
                has_frozen_stamp,
            });
            match exposure {
                None => sensor.stop(),
                Some(exposure) if sensor.is_running() => sensor.turn(exposure),
                Some(exposure) => sensor.start(self.now_nanos, first_nanos, exposure, &clock),
            }
        }
    }

    fn pull_the_plug_by_bytes(&mut self) {
        let taken = self.depth.counters.delivered_bytes + self.image.counters.delivered_bytes;
        if self
            .faults
            .unplug_after_bytes
            .is_some_and(|limit| taken >= limit)
        {
            self.unplug();
        }
    }
}

/// `wMaxPacketSize` of an endpoint of the setting.
fn max_packet(kinds: EndpointKinds, endpoint: u8) -> Option<u16> {
    let index = endpoint.checked_sub(0x81)?;
    kinds.max_packets.get(usize::from(index)).copied()
}
