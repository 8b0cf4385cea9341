//! USB with a camera in software behind it. Time stands still while nobody asks.

use std::path::Path;
use std::sync::{Arc, Mutex};

use glintd::capture::{CaptureOptions, capture_from};
use glintd::outcome::Outcome;
use glintd::ps1080::Camera;
use glintd::ps1080::modes::Wanted;
use glintd::ps1080::usb::{Arrival, QueueShape, UsbError, UsbTransport};
use glintd::status::StopFlag;
use ps1080::mode::Resolution;
use ps1080::usb::TransferKind;
use sequence::verify::{Verification, verify};
use sequence::{ColorEncoding, Recording};
use virtual_carmine::{
    Bus, Control, Counters, Faults, Personality, Setup, TestPattern, TransferStatus, VirtualCarmine,
};

/// What a control transfer takes at least: three microframes.
const CONTROL_NANOS: i64 = 375_000;
/// All endpoint queues of a transport, for tokens.
type SharedBus = Arc<Mutex<Bus>>;

/// The transport; the test keeps the bus as well, to ask the camera what it counted.
pub(crate) struct BusTransport {
    bus: SharedBus,
    now_nanos: i64,
    setting: u8,
    next_token: u64,
    /// Settings with bulk endpoints are not shown.
    is_iso_only: bool,
    /// Endpoint, its transfers, and their shape.
    queues: Vec<(u8, Vec<u64>, QueueShape)>,
}

impl BusTransport {
    pub(crate) fn new(bus: SharedBus) -> Self {
        Self {
            bus,
            now_nanos: 1_000_000_000,
            setting: 0,
            next_token: 0,
            is_iso_only: false,
            queues: Vec::new(),
        }
    }

    /// A machine on which bulk is not to be had.
    pub(crate) fn iso_only(bus: SharedBus) -> Self {
        Self {
            is_iso_only: true,
            ..Self::new(bus)
        }
    }

    fn submit(bus: &mut Bus, now_nanos: i64, endpoint: u8, token: u64, shape: QueueShape) {
        if bus.camera().transfer_kind() == Some(TransferKind::Isochronous) {
            let packets = vec![3072; shape.iso_packet_count];
            bus.submit_iso(now_nanos, endpoint, token, &packets);
        } else {
            bus.submit(now_nanos, endpoint, token, shape.bulk_bytes);
        }
    }

    fn control(&mut self, setup: Setup, data: &mut [u8], timeout: i64) -> Result<usize, UsbError> {
        self.now_nanos += CONTROL_NANOS;
        let control = self
            .bus
            .lock()
            .unwrap()
            .control(self.now_nanos, setup, data);
        match control {
            Control::Done(length) => Ok(length),
            Control::Stall => Err(UsbError::Stall),
            Control::Gone => Err(UsbError::Gone),
            Control::NoAnswer => {
                self.now_nanos += timeout;
                Err(UsbError::Timeout)
            }
        }
    }
}

impl UsbTransport for BusTransport {
    fn now_nanos(&self) -> i64 {
        self.now_nanos
    }

    fn pause(&mut self, nanos: i64) {
        self.now_nanos += nanos;
        self.bus.lock().unwrap().advance(self.now_nanos);
    }

    fn time_waits(&self) -> bool {
        true
    }

    fn control_out(&mut self, packet: &[u8], timeout_nanos: i64) -> Result<(), UsbError> {
        let setup = Setup::vendor_out(packet.len() as u16);
        self.control(setup, &mut packet.to_vec(), timeout_nanos)?;
        Ok(())
    }

    fn control_in(&mut self, packet: &mut [u8], timeout_nanos: i64) -> Result<usize, UsbError> {
        let setup = Setup::vendor_in(packet.len() as u16);
        self.control(setup, packet, timeout_nanos)
    }

    fn set_alternate(&mut self, setting: u8) -> Result<(), UsbError> {
        let mut bus = self.bus.lock().unwrap();
        self.setting = setting;
        if bus.set_alt_setting(self.now_nanos, setting) {
            Ok(())
        } else {
            Err(UsbError::NotFound)
        }
    }

    fn endpoint_kind(&self, setting: u8, endpoint: u8) -> Option<TransferKind> {
        let bus = self.bus.lock().unwrap();
        let descriptor = bus.camera().descriptor(0x0200)?;
        let (mut rest, mut within) = (descriptor.as_slice(), false);
        while let Some(&length) = rest.first().filter(|length| **length >= 2) {
            let (one, later) = rest.split_at_checked(length.into())?;
            match one {
                [_, 4, number, alternate, ..] => within = (*number, *alternate) == (0, setting),
                [_, 5, address, attributes, ..] if within && *address == endpoint => {
                    let kind = match attributes & 3 {
                        1 => TransferKind::Isochronous,
                        _ => TransferKind::Bulk,
                    };
                    let is_hidden = self.is_iso_only && kind == TransferKind::Bulk;
                    return (!is_hidden).then_some(kind);
                }
                _ => {}
            }
            rest = later;
        }
        None
    }

    fn start(&mut self, endpoint: u8, shape: QueueShape) -> Result<(), UsbError> {
        let mut bus = self.bus.lock().unwrap();
        let mut tokens = Vec::new();
        let kind = bus.camera().transfer_kind();
        for _ in 0..shape.transfer_count(kind.unwrap_or(TransferKind::Bulk)) {
            Self::submit(&mut bus, self.now_nanos, endpoint, self.next_token, shape);
            tokens.push(self.next_token);
            self.next_token += 1;
        }
        self.queues.push((endpoint, tokens, shape));
        Ok(())
    }

    fn stop(&mut self, endpoint: u8) {
        let mut bus = self.bus.lock().unwrap();
        let is_other = |queue: &(u8, Vec<u64>, QueueShape)| queue.0 != endpoint;
        for (_, tokens, _) in self.queues.iter().filter(|queue| !is_other(queue)) {
            for token in tokens {
                bus.cancel(self.now_nanos, *token);
            }
        }
        self.queues.retain(is_other);
    }

    fn reap(
        &mut self,
        until_nanos: i64,
        take: &mut dyn FnMut(Arrival<'_>),
    ) -> Result<(), UsbError> {
        let bus = Arc::clone(&self.bus);
        let mut bus = bus.lock().unwrap();
        let mut is_any = false;
        loop {
            while let Some(transfer) = bus.completed() {
                let Some((endpoint, _, shape)) = self
                    .queues
                    .iter()
                    .find(|(_, tokens, _)| tokens.contains(&transfer.token))
                else {
                    continue;
                };
                is_any = true;
                take(Arrival {
                    endpoint: *endpoint,
                    bytes: &transfer.data,
                    at_nanos: self.now_nanos,
                    is_damaged: false,
                });
                match transfer.status {
                    TransferStatus::NoDevice => return Err(UsbError::Gone),
                    TransferStatus::Stall => return Err(UsbError::Stall),
                    TransferStatus::Completed | TransferStatus::Cancelled => {
                        let (endpoint, shape) = (*endpoint, *shape);
                        bus.recycle(transfer.data);
                        Self::submit(&mut bus, self.now_nanos, endpoint, transfer.token, shape);
                    }
                }
            }
            if bus.camera().is_gone() {
                return Err(UsbError::Gone);
            }
            if is_any || self.now_nanos >= until_nanos {
                return Ok(());
            }
            let next_nanos = bus.next_nanos().unwrap_or(until_nanos);
            self.now_nanos = next_nanos.clamp(self.now_nanos + 1, until_nanos);
            bus.advance(self.now_nanos);
        }
    }
}

/// What was filmed.
pub(crate) const SEED: u64 = 11;
/// More than any test films, so that the first pixel names the frame.
pub(crate) const CYCLE: u64 = 250;

pub(crate) fn pattern() -> TestPattern {
    TestPattern::with_cycle(SEED, CYCLE)
}

/// QVGA: the tests are about packets, not about pixels.
pub(crate) fn small() -> Wanted {
    Wanted::default().of_size(Resolution::Qvga)
}

pub(crate) fn bus(personality: Personality, faults: Faults) -> SharedBus {
    let camera = VirtualCarmine::new(personality, Box::new(pattern()), faults);
    Arc::new(Mutex::new(Bus::new(camera)))
}

pub(crate) fn open(bus: &SharedBus, wanted: Wanted) -> anyhow::Result<Camera> {
    open_over(BusTransport::new(Arc::clone(bus)), wanted)
}

pub(crate) fn open_over(usb: BusTransport, wanted: Wanted) -> anyhow::Result<Camera> {
    let usb = Box::new(usb);
    Camera::open(usb, wanted, "Carmine", "/sys/devices/virtual")
}

/// A recording of a camera, and what the camera says of it.
pub(crate) struct Filmed {
    pub(crate) outcome: Outcome,
    pub(crate) recording: Recording,
    pub(crate) verified: Verification,
    pub(crate) counters: Counters,
    _folder: tempfile::TempDir,
}

/// Records until the camera is unplugged.
pub(crate) fn film(personality: Personality, faults: Faults, wanted: Wanted) -> Filmed {
    let bus = bus(personality, faults);
    let camera = open(&bus, wanted).unwrap();
    film_with(camera, &bus)
}

/// The same, of a camera that is open.
pub(crate) fn film_with(camera: Camera, bus: &SharedBus) -> Filmed {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.glint");
    let outcome = record(camera, &output).unwrap();
    let counters = bus.lock().unwrap().camera().counters();
    Filmed {
        outcome,
        recording: Recording::open(&output).unwrap(),
        verified: verify(&output, true).unwrap(),
        counters,
        _folder: folder,
    }
}

fn record(mut camera: Camera, output: &Path) -> anyhow::Result<Outcome> {
    let mut options = CaptureOptions::new("ps1080".parse().unwrap(), output.to_owned());
    // The machine's disk is not what is tested.
    options.reserve_bytes = Some(0);
    capture_from(&mut camera, options, &StopFlag::default(), &mut |_| {})
}

/// Why nothing comes of a recording.
pub(crate) fn failure(camera: Camera) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error = record(camera, &folder.path().join("out.glint")).unwrap_err();
    format!("{error:#}")
}

impl Filmed {
    /// Every frame of the recording is one that was filmed, pixel by pixel; how many of each stream.
    pub(crate) fn assert_pixels(&self) -> (usize, usize) {
        let pattern = pattern();
        let intrinsics = self.recording.depth_camera().intrinsics;
        let (width, height) = (intrinsics.width(), intrinsics.height());
        let (depth_count, color_count) = self.counts();
        let mut decoders =
            sequence::decode::StreamDecoders::new(self.recording.description()).unwrap();
        let contents = self.recording.contents();
        let mut samples = vec![0; width as usize * height as usize];
        for place in contents.stream(sequence::DEPTH_STREAM) {
            let (_, payload) = self.recording.frame(place).unwrap();
            let stream = place.label.stream;
            decoders
                .depth_into(payload, stream, &contents.tables, &mut samples)
                .unwrap();
            let index = pattern.depth_index(&samples).unwrap();
            for y in 0..height {
                for x in 0..width {
                    let got = samples[(y * width + x) as usize];
                    let filmed = pattern.shift(index, x, y, false);
                    assert_eq!(got, filmed, "depth {index} at {x} {y}");
                }
            }
        }
        self.assert_images();
        (depth_count, color_count)
    }

    /// The same of what comes beside depth, with the dots of the emitter.
    pub(crate) fn assert_images(&self) {
        let pattern = pattern();
        let camera = self.recording.color_camera();
        let (width, encoding) = (camera.intrinsics.width(), camera.encoding);
        // Which frame it is stands in the first byte of luma or of chroma, of the mosaic, of the brightness.
        let (index_at, row_bytes) = match encoding {
            ColorEncoding::BayerGrbg => (0, width),
            ColorEncoding::Yuyv => (1, 2 * width),
            _ => (0, 2 * width),
        };
        let filmed = |index, x: u32, y| match encoding {
            ColorEncoding::BayerGrbg => pattern.bayer_byte(index, x, y),
            ColorEncoding::Uyvy => pattern.uyvy_byte(index, x, y),
            ColorEncoding::Yuyv => pattern.uyvy_byte(index, x ^ 1, y),
            ColorEncoding::Infrared10 => {
                pattern.infrared_sample(index, x / 2, y).to_le_bytes()[x as usize % 2]
            }
            other => panic!("{other:?} is not filmed"),
        };
        let mut decoders =
            sequence::decode::StreamDecoders::new(self.recording.description()).unwrap();
        let mut bytes = Vec::new();
        for place in self.recording.contents().stream(sequence::COLOR_STREAM) {
            let (_, payload) = self.recording.frame(place).unwrap();
            decoders.color_into(payload, &mut bytes).unwrap();
            assert_eq!(bytes.len() as u32, row_bytes * camera.intrinsics.height());
            let index = u64::from(bytes[index_at]);
            for (place, got) in (0..).zip(&bytes) {
                let (x, y) = (place % row_bytes, place / row_bytes);
                assert_eq!(
                    *got,
                    filmed(index, x, y),
                    "{encoding} {index} at {x} {y}",
                    encoding = encoding.name()
                );
            }
        }
    }

    /// Frames of depth and colour.
    pub(crate) fn counts(&self) -> (usize, usize) {
        let contents = self.recording.contents();
        (
            contents.stream(sequence::DEPTH_STREAM).len(),
            contents.stream(sequence::COLOR_STREAM).len(),
        )
    }
}
