//! `registration=on`: what the camera is told, and what the file says of it.

use std::sync::{Arc, Mutex};

use geometry::Pose;
use glintd::ps1080::Camera;
use glintd::ps1080::usb::{Arrival, QueueShape, UsbError, UsbTransport};
use glintd::source_spec::SourceSpec;
use ps1080::host::Request;
use ps1080::parameter::Parameter;
use ps1080::samples::NO_DEPTH;
use ps1080::stream::Padding;
use ps1080::usb::TransferKind;
use sequence::{COLOR_STREAM, DEPTH_STREAM};
use virtual_carmine::{Faults, Personality};

use crate::transport::{BusTransport, CYCLE, bus, film_with, pattern};

/// Lines that the chip cannot fill are announced, not sent.
const PADDING: Padding = Padding {
    before: 640,
    after: 321,
};
/// Columns of a depth image.
const WIDTH: u32 = 320;

type Heard = Arc<Mutex<Vec<Request>>>;

/// A transport that writes down what is asked.
struct Listening {
    usb: BusTransport,
    heard: Heard,
}

impl UsbTransport for Listening {
    fn now_nanos(&self) -> i64 {
        self.usb.now_nanos()
    }

    fn pause(&mut self, nanos: i64) {
        self.usb.pause(nanos);
    }

    fn time_waits(&self) -> bool {
        self.usb.time_waits()
    }

    fn control_out(&mut self, packet: &[u8], timeout_nanos: i64) -> Result<(), UsbError> {
        if let Ok((_, request)) = Request::decode(packet) {
            self.heard.lock().unwrap().push(request);
        }
        self.usb.control_out(packet, timeout_nanos)
    }

    fn control_in(&mut self, packet: &mut [u8], timeout_nanos: i64) -> Result<usize, UsbError> {
        self.usb.control_in(packet, timeout_nanos)
    }

    fn set_alternate(&mut self, setting: u8) -> Result<(), UsbError> {
        self.usb.set_alternate(setting)
    }

    fn endpoint_kind(&self, setting: u8, endpoint: u8) -> Option<TransferKind> {
        self.usb.endpoint_kind(setting, endpoint)
    }

    fn start(&mut self, endpoint: u8, shape: QueueShape) -> Result<(), UsbError> {
        self.usb.start(endpoint, shape)
    }

    fn stop(&mut self, endpoint: u8) {
        self.usb.stop(endpoint);
    }

    fn reap(
        &mut self,
        until_nanos: i64,
        take: &mut dyn FnMut(Arrival<'_>),
    ) -> Result<(), UsbError> {
        self.usb.reap(until_nanos, take)
    }
}

/// All parameters that were set, one by one, in their order.
fn set_parameters(heard: &Heard) -> Vec<(u16, u16)> {
    let heard = heard.lock().unwrap();
    let lists = heard.iter().filter_map(|request| match request {
        Request::SetParam { pairs } => Some(pairs.as_slice()),
        _ => None,
    });
    lists
        .flat_map(|words| words.as_chunks::<2>().0)
        .map(|&[id, value]| (id, value))
        .collect()
}

#[test]
fn registered_depth_is_asked_for_in_order_and_described_as_the_colour_cameras() {
    let personality = Personality {
        padding: PADDING,
        ..Personality::carmine_1_08()
    };
    let faults = Faults {
        unplug_after_nanos: Some(1_500_000_000),
        ..Faults::default()
    };
    let SourceSpec::Camera(spec) = "ps1080?registration=on&size=qvga".parse().unwrap() else {
        panic!("a camera was named");
    };
    let bus = bus(personality, faults);
    let heard = Heard::default();
    let usb = Box::new(Listening {
        usb: BusTransport::new(Arc::clone(&bus)),
        heard: Arc::clone(&heard),
    });
    let camera = Camera::open(usb, spec.wanted, "Carmine", "/sys/devices/virtual").unwrap();
    let filmed = film_with(camera, &bus);

    // Protocol section 5, depth start: the block of depth, then the switch.
    let set = set_parameters(&heard);
    let block = [18, 19, 20, 22, 21, 24, 2, 23, 36, 61, 73, 74, 45];
    let from = set.iter().position(|(id, _)| *id == 18).unwrap();
    let ids: Vec<u16> = set[from..].iter().map(|(id, _)| *id).collect();
    assert_eq!(ids[..block.len()], block, "{set:?}");
    let registration = Parameter::Registration as u16;
    let values: Vec<_> = set.iter().filter(|(id, _)| *id == registration).collect();
    assert_eq!(values, [&(registration, 1)]);
    let depth_on = (Parameter::Stream1Mode as u16, 2);
    let at = |wanted: (u16, u16)| set.iter().position(|pair| *pair == wanted).unwrap();
    assert!(at((registration, 1)) < at(depth_on), "{set:?}");

    let description = filmed.recording.description();
    let streams = &description.streams;
    assert!(streams.depth.is_registered);
    assert_eq!(streams.depth.intrinsics, streams.color.intrinsics);
    assert_eq!(streams.color_from_depth, Pose::IDENTITY);
    let json: serde_json::Value = serde_json::from_slice(&description.to_json().unwrap()).unwrap();
    let stored = json["streams"].as_array().unwrap();
    let of = |id: u16| stored.iter().find(|stream| stream["id"] == id).unwrap();
    assert_eq!(of(DEPTH_STREAM)["depth"]["registered_to"], COLOR_STREAM);
    assert_eq!(of(DEPTH_STREAM)["camera"], of(COLOR_STREAM)["camera"]);

    let count = filmed.recording.frame_count();
    assert!(count > 25, "{count}");
    for index in 0..count {
        assert_registered(filmed.recording.depth_raw(index).unwrap().pixels());
    }
}

/// Between the padding every pixel is one that was filmed as the colour camera sees it; the padding is no measurement.
fn assert_registered(pixels: &[u16]) {
    let pattern = pattern();
    let sent = usize::from(PADDING.before)..pixels.len() - usize::from(PADDING.after);
    let fits = |film_index: u64, place: usize| {
        let (x, y) = (place as u32 % WIDTH, place as u32 / WIDTH);
        pixels[place] == pattern.shift(film_index, x, y, true)
    };
    let film_index = (0..CYCLE).find(|index| sent.clone().take(40).all(|at| fits(*index, at)));
    let film_index = film_index.expect("a frame that was filmed");
    assert!(sent.clone().all(|place| fits(film_index, place)));
    let padding = pixels[..sent.start].iter().chain(&pixels[sent.end..]);
    assert!(padding.into_iter().all(|code| *code == NO_DEPTH));
}
