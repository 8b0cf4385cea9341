//! What depends on the version of the firmware, from 5.1 to 5.8, and modes.

use ps1080::blocks::{FixedField, FixedParams};
use ps1080::firmware::{Feature, Firmware, Hardware, Version};
use ps1080::mode::{CameraMode, Cmos, Resolution};
use ps1080::samples::{DepthSensor, InfraredRows, SampleFormat};
use ps1080::shift::{ReferencePattern, ShiftParameters};
use ps1080::stream::StreamKind;
use ps1080::timing::{Delays, UsbCore};
use ps1080::usb::{TransferKind, alternate_setting, endpoint};

const fn v(minor: u8, build: u16) -> Firmware {
    Firmware::new(5, minor, build)
}

#[test]
fn endpoints_and_settings_of_section_1() {
    let all = |firmware| {
        (
            endpoint(firmware, StreamKind::Depth),
            endpoint(firmware, StreamKind::Image),
            alternate_setting(firmware, TransferKind::Bulk),
            alternate_setting(firmware, TransferKind::Isochronous),
        )
    };
    assert_eq!(all(v(1, 0)), (0x82, 0x81, 1, 0));
    assert_eq!(all(v(2, 0)), (0x81, 0x82, 1, 0));
    assert_eq!(all(v(4, 99)), (0x81, 0x82, 1, 0));
    assert_eq!(all(v(5, 0)), (0x81, 0x82, 0, 1));
    assert_eq!(all(v(8, 22)), (0x81, 0x82, 0, 1));
}

#[test]
fn features_begin_and_end_where_section_3_says() {
    for (feature, last_without, first_with) in [
        (Feature::Presets, v(3, 28), v(3, 29)),
        (Feature::SerialNumber, v(3, 99), v(4, 0)),
        (Feature::CloseRange, v(5, 99), v(6, 0)),
        (Feature::ImageParameters, v(8, 8), v(8, 9)),
        (Feature::SmallDepthSetting, v(8, 15), v(8, 16)),
    ] {
        assert!(
            !last_without.has(feature) && first_with.has(feature),
            "{feature:?}"
        );
        assert!(v(9, 0).has(feature));
    }
    assert!(v(2, 0).has(Feature::Fps25) && !v(6, 0).has(Feature::Fps25));
    assert!(v(1, 0).has(Feature::OwnAudio) && !v(6, 0).has(Feature::OwnAudio));
    assert!(!v(0, 9).is_known() && v(1, 0).is_known() && v(8, 22).is_known());
    assert!(!Firmware::new(4, 1, 0).is_known());
    assert_eq!(v(8, 22).to_string(), "5.8.22");
}

#[test]
fn waits_of_section_2() {
    let old = Delays::of(v(3, 15), UsbCore::Jungo);
    assert_eq!((old.receive_millis, old.soft_reset_millis), (100, 800));
    assert_eq!((old.depth_mode_millis, old.flicker_millis), (300, 300));
    assert_eq!(Delays::of(v(1, 0), UsbCore::Jungo).flicker_millis, 3000);
    let new = Delays::of(v(3, 16), UsbCore::Jungo);
    assert_eq!((new.receive_millis, new.before_send_millis), (1, 0));
    assert_eq!((new.after_send_millis, new.soft_reset_millis), (0, 1));
    let gadget = Delays::of(v(8, 22), UsbCore::GadgetFs);
    assert_eq!((gadget.receive_millis, gadget.before_send_millis), (100, 1));
    assert_eq!(
        (gadget.after_send_millis, gadget.depth_mode_millis),
        (10, 1)
    );
}

#[test]
fn builds_are_decimal_numbers_in_hexadecimal_digits() {
    for build in 0..=9999 {
        let version = Version {
            firmware: v(8, build),
            chip: Version::PS1080,
            hardware_word: 6,
            system: 0xABCD,
        };
        let data = version.encode().unwrap();
        assert_eq!(Version::decode(&data), Some(version));
        assert_eq!(
            format!("{:x}", u16::from_le_bytes([data[2], data[3]])),
            build.to_string()
        );
    }
    assert_eq!(
        Version::decode(&[8, 5, 0x1A, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        None
    );
    assert_eq!(Version::decode(&[8, 5, 0x22, 0, 0, 0, 0, 0, 0, 0, 0]), None);
}

#[test]
fn boards_of_section_3() {
    let board = |firmware, hardware_word| {
        Version {
            firmware,
            chip: 0,
            hardware_word,
            system: 0,
        }
        .hardware()
    };
    assert_eq!(board(v(1, 0), 6), Hardware::Rd5);
    assert_eq!(board(v(3, 27), 0), Hardware::Rd1081);
    assert_eq!(board(v(3, 28), 0), Hardware::Rd1082);
    assert_eq!(board(v(4, 1), 0), Hardware::Rd1082);
    assert_eq!(board(v(6, 6), 0), Hardware::Rd1081);
    assert_eq!(board(v(6, 6), 1), Hardware::Rd1082);
    assert_eq!(board(v(8, 22), 6), Hardware::Rd109);
    assert_eq!(board(v(8, 22), 0x21), Hardware::Fpdb);
    assert_eq!(board(v(8, 22), 77), Hardware::Other(77));
}

#[test]
fn numbers_of_modes() {
    for code in 0..16 {
        assert_eq!(
            Resolution::from_code(code).map(Resolution::code),
            Some(code)
        );
    }
    assert_eq!(Resolution::from_code(16), None);
    assert_eq!(Resolution::Vga.size(), (640, 480));
    assert_eq!(Resolution::P960.code(), 15);
    for code in 0..=10 {
        assert_eq!(
            CameraMode::from_code(code).map(CameraMode::code),
            Some(code)
        );
    }
    assert_eq!(CameraMode::Safe.code(), 10);
    assert_eq!(CameraMode::from_code(11), None);
    assert_eq!(Cmos::from_code(1), Some(Cmos::Depth));
}

#[test]
fn sizes_of_section_6() {
    use SampleFormat::{Packed10, Packed11, Packed12, Raw16};
    let bytes = |format: SampleFormat, resolution: Resolution| {
        let (width, height) = resolution.size();
        format.max_bytes(usize::from(width) * usize::from(height), width.into())
    };
    for (resolution, expected) in [
        (Resolution::Qqvga, [38_400, 28_800, 26_400]),
        (Resolution::Qvga, [153_600, 115_200, 105_600]),
        (Resolution::Vga, [614_400, 460_800, 422_400]),
    ] {
        assert_eq!(
            [Raw16, Packed12, Packed11].map(|format| bytes(format, resolution)),
            expected
        );
    }
    let infrared = |sensor, resolution: Resolution| {
        let rows = InfraredRows::of(sensor, resolution);
        let (width, height) = resolution.size();
        assert_eq!(rows.shown, height);
        Packed10.max_bytes(usize::from(width) * usize::from(rows.sent), width.into())
    };
    let (old, new) = (DepthSensor::Mt9m001, DepthSensor::Ar0130);
    assert_eq!(infrared(new, Resolution::Qvga), 96_000);
    assert_eq!(infrared(old, Resolution::Qvga), 96_000 + 3200);
    assert_eq!(infrared(old, Resolution::Vga), 384_000 + 6400);
    assert_eq!(infrared(old, Resolution::Sxga), 1_638_400);
    assert_eq!(infrared(new, Resolution::Sxga), 1_536_000);
}

#[test]
fn constants_that_are_no_lengths_are_refused() {
    let lengths = [
        FixedField::ZeroPlaneDistance,
        FixedField::ZeroPlanePixel,
        FixedField::EmitterDistance,
    ];
    for field in lengths {
        for length in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            let mut fixed = FixedParams::xtion();
            fixed.set_length(field, length);
            assert_eq!(
                ShiftParameters::new(&fixed, 200, ReferencePattern::OwnSize),
                None
            );
        }
    }
    let mut fixed = FixedParams::xtion();
    fixed.set_length(FixedField::ZeroPlaneDistance, 120.9);
    let shift = ShiftParameters::new(&fixed, 200, ReferencePattern::Vga).unwrap();
    assert_eq!(
        (shift.zero_plane_mm, shift.pixel_size_factor),
        (1200.0, 2.0)
    );
}
