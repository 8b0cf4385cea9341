//! Without trouble: everything that was filmed is in the file.

use glintd::ps1080::modes::{ColorChoice, ExposurePlan, Wanted};
use ps1080::color::ColorFormat;
use ps1080::parameter::Parameter;
use ps1080::samples::SampleFormat;
use ps1080::usb::TransferKind;
use sequence::{ColorEncoding, DepthSamples};
use virtual_carmine::{Faults, Personality};

use crate::transport::{BusTransport, Filmed, bus, film, film_with, open, open_over, small};

/// Time until the plug is pulled, nanoseconds.
const SHORT_NANOS: i64 = 1_500_000_000;

pub(crate) fn unplugged_after(nanos: i64) -> Faults {
    Faults {
        unplug_after_nanos: Some(nanos),
        ..Faults::default()
    }
}

/// Bit-equal, none lost but the two that the plug cut.
pub(crate) fn assert_whole(filmed: &Filmed, least: usize) {
    let (depth, color) = filmed.assert_pixels();
    assert!(depth >= least && color >= least, "{depth} {color}");
    let lost =
        [&filmed.counters.depth, &filmed.counters.image].map(|stream| stream.fifo_lost_bytes);
    assert_eq!(lost, [0, 0]);
    assert!(filmed.outcome.is_whole(), "{:?}", filmed.outcome.missing);
    assert_eq!(filmed.outcome.reason, "unplugged");
    assert!(filmed.outcome.gaps <= 2, "{:?}", filmed.outcome.missing);
    assert!(filmed.verified.findings.is_empty(), "{:?}", filmed.verified);
    assert!(filmed.verified.books.iter().all(|book| book.balances));
}

#[test]
fn every_format_of_depth_comes_as_filmed() {
    for depth_format in [
        SampleFormat::Raw16,
        SampleFormat::Compressed,
        SampleFormat::Packed11,
        SampleFormat::Packed12,
    ] {
        let wanted = Wanted {
            depth_format,
            ..small()
        };
        let filmed = film(
            Personality::carmine_1_08(),
            unplugged_after(SHORT_NANOS),
            wanted,
        );
        assert_whole(&filmed, 30);
    }
}

#[test]
fn every_format_of_color_comes_as_filmed() {
    for (format, encoding) in [
        (ColorFormat::CompressedBayer, ColorEncoding::BayerGrbg),
        (ColorFormat::Bayer, ColorEncoding::BayerGrbg),
        (ColorFormat::CompressedYuv422, ColorEncoding::Uyvy),
        (ColorFormat::Uyvy, ColorEncoding::Uyvy),
        (ColorFormat::Yuyv, ColorEncoding::Yuyv),
    ] {
        let wanted = Wanted {
            color: ColorChoice::Format(format),
            ..small()
        };
        let filmed = film(
            Personality::carmine_1_09(),
            unplugged_after(SHORT_NANOS),
            wanted,
        );
        assert_eq!(filmed.recording.color_camera().encoding, encoding);
        assert_whole(&filmed, 30);
    }
}

#[test]
fn every_firmware_is_spoken_to_in_its_own_way() {
    const SECOND: i64 = 1_000_000_000;
    // Old firmware wants long waits before it streams.
    for (personality, encoding, length_nanos) in [
        (
            Personality::firmware_5_1(),
            ColorEncoding::Uyvy,
            10 * SECOND,
        ),
        (
            Personality::firmware_5_4(),
            ColorEncoding::BayerGrbg,
            2 * SECOND,
        ),
        (Personality::carmine_1_08(), ColorEncoding::Uyvy, 2 * SECOND),
        (
            Personality::carmine_1_09(),
            ColorEncoding::BayerGrbg,
            2 * SECOND,
        ),
    ] {
        let firmware = personality.firmware().to_string();
        let filmed = film(personality, unplugged_after(length_nanos), small());
        let device = filmed.recording.description().streams.device.clone();
        let device = device.unwrap();
        assert!(device.firmware.starts_with(&firmware), "{device:?}");
        assert_eq!(filmed.recording.color_camera().encoding, encoding);
        assert_whole(&filmed, 30);
    }
}

#[test]
fn where_bulk_is_not_to_be_had_isochronous_transfers_do() {
    for personality in [Personality::carmine_1_09(), Personality::firmware_5_4()] {
        let bus = bus(personality, unplugged_after(2 * SHORT_NANOS));
        let usb = BusTransport::iso_only(std::sync::Arc::clone(&bus));
        let camera = open_over(usb, small()).unwrap();
        assert_eq!(camera.transfer_kind(), TransferKind::Isochronous);
        assert_whole(&film_with(camera, &bus), 30);
    }
}

#[test]
fn the_file_says_what_the_camera_is() {
    let filmed = film(
        Personality::carmine_1_08(),
        unplugged_after(SHORT_NANOS),
        small(),
    );
    let streams = &filmed.recording.description().streams;
    assert_eq!(streams.depth.samples, DepthSamples::Codes);
    let table = streams.depth.shift_table_mm().unwrap().unwrap();
    // Protocol section 8.2, of a real camera.
    assert_eq!(
        (table[1], table[100], table[800], table[1052]),
        (315, 346, 1193, 9870)
    );
    let focal = streams.depth.intrinsics.focal();
    assert!((focal.x - 570.34 / 2.0).abs() < 0.01, "{focal}");
    assert_eq!(streams.depth_timing.clock.unwrap().tick_hz, 60_000_000);
    assert!(streams.color.yuv.is_some());
    assert!((streams.color_from_depth.translation().x + 0.0263).abs() < 1e-6);
    assert_eq!(streams.device.as_ref().unwrap().serial, "1206090000");
}

#[test]
fn frames_are_synchronised_and_the_file_proves_it() {
    let filmed = film(
        Personality::carmine_1_08(),
        unplugged_after(3_000_000_000),
        small(),
    );
    let histograms = &filmed.recording.contents().histograms;
    let (_, skews) = histograms
        .iter()
        .find(|(_, histogram)| histogram.name == "pair-skew")
        .unwrap();
    let below: u64 = skews
        .counts
        .iter()
        .zip(&skews.edges[1..])
        .filter(|(_, upper)| **upper <= 3.0)
        .map(|(count, _)| count)
        .sum();
    let all: u64 = skews.counts.iter().sum();
    assert!(
        all >= 70 && all - below <= 1,
        "{below} of {all} within 3 ms"
    );
}

#[test]
fn exposure_is_locked_after_the_stream_runs_and_written_down() {
    let manual = ExposurePlan::Manual {
        exposure: 77,
        gain: 120,
    };
    for plan in [ExposurePlan::Lock, manual] {
        let wanted = Wanted {
            exposure: plan,
            ..small()
        };
        let bus = bus(Personality::carmine_1_09(), unplugged_after(4_000_000_000));
        let filmed = film_with(open(&bus, wanted).unwrap(), &bus);
        let events = &filmed.recording.contents().events;
        let settings = events
            .iter()
            .find(|event| event.details["event"] == "settings")
            .unwrap_or_else(|| panic!("{events:?}"));
        assert_eq!(settings.details["exposure_locked"], true);
        let camera = bus.lock().unwrap();
        let value = |parameter| camera.camera().parameter(parameter);
        assert_eq!(value(Parameter::AutoExposure), 0);
        assert_eq!(value(Parameter::AutoWhiteBalance), 0);
        assert_eq!(value(Parameter::LowLightCompensation), 0);
        assert_eq!(
            settings.details["exposure_bar"],
            value(Parameter::ExposureBar)
        );
        assert_eq!(settings.details["gain"], value(Parameter::ImageGain));
        if plan == manual {
            assert_eq!(value(Parameter::ExposureBar), 77);
        }
        assert_eq!(value(Parameter::DepthMirror), 0);
        assert_eq!(value(Parameter::ImageMirror), 0);
        assert_eq!(value(Parameter::FrameSync), 1);
    }
}
