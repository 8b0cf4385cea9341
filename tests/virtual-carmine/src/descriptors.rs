//! Descriptors, as bytes (protocol section 1).

use ps1080::firmware::Feature;
use ps1080::usb::{TransferKind, VENDOR_ID, alternate_setting};

use crate::personality::Personality;

/// Largest packet of bulk endpoints, bytes.
pub(crate) const BULK_PACKET_BYTES: u16 = 512;
/// `wMaxPacketSize` of isochronous endpoints: two packets of 1020 bytes a microframe for the first endpoint, three for
/// the second. A guess: the real sizes are not public.
const ISO_PACKETS: [u16; 2] = [1 << 11 | 1020, 2 << 11 | 1020];
/// The same for the first endpoint of the setting with a small one.
const SMALL_ISO_PACKET: u16 = 1020;
/// Bytes that an endpoint may send in a microframe, by its `wMaxPacketSize`.
pub(crate) fn microframe_bytes(max_packet: u16) -> usize {
    (1 + usize::from(max_packet >> 11 & 3)) * usize::from(max_packet & 0x7FF)
}

const DEVICE: u8 = 1;
const CONFIGURATION: u8 = 2;
const STRING: u8 = 3;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
const VENDOR_CLASS: u8 = 0xFF;
const AUDIO_CLASS: u8 = 1;
const ENGLISH: u16 = 0x0409;

/// What the active setting says of the endpoints 0x81 and 0x82.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EndpointKinds {
    pub(crate) kind: TransferKind,
    pub(crate) max_packets: [u16; 2],
}

/// The alternate settings of the camera's interface, ascending.
pub(crate) fn settings(unit: &Personality) -> Vec<EndpointKinds> {
    let bulk = EndpointKinds {
        kind: TransferKind::Bulk,
        max_packets: [BULK_PACKET_BYTES; 2],
    };
    let iso = EndpointKinds {
        kind: TransferKind::Isochronous,
        max_packets: ISO_PACKETS,
    };
    let mut settings = vec![bulk, iso];
    if alternate_setting(unit.firmware(), TransferKind::Bulk) != 0 {
        settings.reverse();
    }
    if unit.has(Feature::SmallDepthSetting) {
        settings.push(EndpointKinds {
            kind: TransferKind::Isochronous,
            max_packets: [SMALL_ISO_PACKET, ISO_PACKETS[1]],
        });
    }
    settings
}

/// The descriptor of a GET_DESCRIPTOR's value; `None`: stall.
pub(crate) fn descriptor(value: u16, unit: &Personality) -> Option<Vec<u8>> {
    let [index, kind] = value.to_le_bytes();
    match (kind, index) {
        (DEVICE, 0) => Some(device(unit)),
        (CONFIGURATION, 0) => Some(configuration(unit)),
        (STRING, 0) => Some([&[4, STRING][..], &ENGLISH.to_le_bytes()].concat()),
        (STRING, 1) => Some(string("PrimeSense")),
        (STRING, 2) => Some(string("PrimeSense Device")),
        _ => None,
    }
}

fn device(unit: &Personality) -> Vec<u8> {
    let [vendor0, vendor1] = VENDOR_ID.to_le_bytes();
    let [product0, product1] = unit.product_id.to_le_bytes();
    // USB 2.0, class by interface, 64 bytes on endpoint 0, release 0.01, strings 1 and 2, no serial number.
    vec![
        18, DEVICE, 0x00, 0x02, 0, 0, 0, 64, vendor0, vendor1, product0, product1, 0x01, 0x00, 1,
        2, 0, 1,
    ]
}

fn configuration(unit: &Personality) -> Vec<u8> {
    let mut interfaces = Vec::new();
    for (number, setting) in settings(unit).iter().enumerate() {
        // There are at most three settings.
        interfaces.extend(interface(0, number as u8, 2, VENDOR_CLASS));
        for (address, max_packet) in [0x81, 0x82].into_iter().zip(setting.max_packets) {
            let attributes = match setting.kind {
                TransferKind::Bulk => 2,
                TransferKind::Isochronous => 1,
            };
            let interval = u8::from(setting.kind == TransferKind::Isochronous);
            let [size0, size1] = max_packet.to_le_bytes();
            interfaces.extend([7, ENDPOINT, address, attributes, size0, size1, interval]);
        }
    }
    if unit.has_microphones {
        interfaces.extend(interface(1, 0, 0, AUDIO_CLASS));
    }
    let total = 9 + interfaces.len() as u16;
    let [total0, total1] = total.to_le_bytes();
    let interface_count = 1 + u8::from(unit.has_microphones);
    // Configuration 1, powered by the bus, 500 mA.
    let head = [
        9,
        CONFIGURATION,
        total0,
        total1,
        interface_count,
        1,
        0,
        0x80,
        250,
    ];
    [&head[..], &interfaces].concat()
}

fn interface(number: u8, alternate: u8, endpoint_count: u8, class: u8) -> [u8; 9] {
    let subclass = u8::from(class == AUDIO_CLASS);
    [
        9,
        INTERFACE,
        number,
        alternate,
        endpoint_count,
        class,
        subclass,
        0,
        0,
    ]
}

fn string(text: &str) -> Vec<u8> {
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    // The texts are short.
    [&[2 + units.len() as u8, STRING][..], &units].concat()
}
