//! Requests and what the camera refuses.

use ps1080::blocks::{BlockCollector, FixedParams, Presets, decode_tick_rate};
use ps1080::firmware::Version;
use ps1080::host::{AlgorithmKind, Nack, Request};
use ps1080::mode::CameraMode;
use ps1080::parameter::{PARAMETERS, Parameter};
use ps1080::stream::TickRate;
use virtual_carmine::{Control, Faults, Personality, Setup};

use crate::host::Host;

fn host(unit: Personality) -> Host {
    Host::new(unit, Faults::default())
}

#[test]
fn all_that_opening_asks_is_answered() {
    for unit in [
        Personality::carmine_1_09(),
        Personality::carmine_1_08(),
        Personality::firmware_5_4(),
        Personality::firmware_5_1(),
    ] {
        let mut host = host(unit.clone());
        let version = host.ask(Request::GetVersion).unwrap().unwrap();
        assert_eq!(Version::decode(&version), Some(unit.version));
        assert_eq!(host.ask(Request::GetMode), Some(Ok(vec![1, 0])));
        let reset = Request::SetMode {
            mode: CameraMode::SoftReset.code(),
        };
        assert_eq!(host.ask(reset), Some(Ok(Vec::new())));
        assert_eq!(host.ask(Request::KeepAlive), Some(Ok(Vec::new())));
        let mut block = BlockCollector::<{ FixedParams::BYTES }>::of_double_words();
        while let Some(offset) = block.next_offset() {
            let part = host.ask(Request::GetFixedParams { offset });
            block.push(&part.unwrap().unwrap()).unwrap();
        }
        assert_eq!(block.block(), Some(&unit.fixed.encode()));
        let frequency = Request::algorithm(AlgorithmKind::Frequency, 0, 30, 0);
        let frequency = host.ask(frequency).unwrap().unwrap();
        let rate = decode_tick_rate(&frequency.try_into().unwrap());
        assert_eq!(rate, Some(TickRate::PS1080));
    }
}

#[test]
fn requests_of_later_firmware_are_unknown_to_earlier() {
    let mut old = host(Personality::firmware_5_1());
    let mut new = host(Personality::carmine_1_09());
    for request in [
        Request::GetSerialNumber,
        Request::GetPlatformString,
        Request::GetCmosPresets { cmos: 0 },
    ] {
        assert_eq!(old.ask(request), Some(Err(Nack::InvalidCommand)));
        assert!(new.ask(request).unwrap().is_ok());
    }
}

#[test]
fn presets_have_bayer_where_the_unit_has() {
    for (unit, has_bayer) in [
        (Personality::carmine_1_09(), true),
        (Personality::carmine_1_08(), false),
    ] {
        let mut host = host(unit);
        let data = host
            .ask(Request::GetCmosPresets { cmos: 0 })
            .unwrap()
            .unwrap();
        assert_eq!(
            Presets::decode(&data).any(|preset| preset.format == 6),
            has_bayer
        );
        // One of 0 frames a second is there, for the host to leave out.
        assert!(Presets::decode(&data).count() < data.len() / 6);
    }
}

#[test]
fn what_is_written_is_read_again() {
    let mut host = host(Personality::carmine_1_09());
    for parameter in PARAMETERS {
        if parameter == Parameter::Stream2Mode || !parameter.accepts(1) {
            continue;
        }
        let value = match parameter {
            Parameter::Stream0Mode => 1,
            Parameter::ImageCropMode | Parameter::DepthCropMode | Parameter::InfraredCropMode => 0,
            _ => 1,
        };
        if parameter == Parameter::Stream0Mode {
            continue;
        }
        host.set(parameter, value);
        let read = host.ask(Request::get(parameter));
        assert_eq!(read, Some(Ok(vec![value as u8, 0])), "{parameter:?}");
    }
    // All ids up to 85 are held, also those without a name.
    assert!(host.ask(Request::GetParam { id: 85 }).unwrap().is_ok());
    let beyond = host.ask(Request::GetParam { id: 86 });
    assert_eq!(beyond, Some(Err(Nack::BadParameters)));
}

#[test]
fn what_section_5_forbids_is_refused() {
    use Parameter::*;
    let mut host = host(Personality::carmine_1_09());
    host.refuses(DepthMirror, 2);
    host.refuses(DepthFps, 31);
    host.set(DepthResolution, 2);
    host.refuses(Stream1Mode, 2);
    host.set(DepthResolution, 1);
    host.set(Stream1Mode, 2);
    host.refuses(DepthFormat, 0);
    host.refuses(DepthResolution, 0);
    host.set(DepthMirror, 0);
    host.set(Stream0Mode, 1);
    // Colour to infrared only through off.
    host.refuses(Stream0Mode, 3);
    host.set(Stream0Mode, 0);
    // Infrared beside depth must be of its size.
    host.set(InfraredResolution, 0);
    host.refuses(Stream0Mode, 3);
    host.set(InfraredResolution, 1);
    host.set(Stream0Mode, 3);
    host.set(Stream1Mode, 0);
    // Depth must be started first.
    host.refuses(Stream1Mode, 2);
    // Several values in one request are written together or not at all.
    let both = Request::set_all(&[(DepthGain, 7), (DepthMirror, 9)]).unwrap();
    assert_eq!(host.ask(both), Some(Err(Nack::BadParameters)));
    assert_eq!(host.bus.camera().parameter(DepthGain), 42);
}

#[test]
fn sensor_registers_keep_what_is_written() {
    let mut host = host(Personality::firmware_5_4());
    let list = |words: &[u16]| ps1080::host::WordList::new(words).unwrap();
    let (bus, slave) = (0, 0x5D);
    let write = Request::I2cWrite {
        bus,
        slave,
        words: list(&[6, 0x40, 0x02]),
    };
    assert_eq!(host.ask(write), Some(Ok(Vec::new())));
    let read = Request::I2cRead {
        bus,
        slave,
        read_count: 2,
        words: list(&[6]),
    };
    // A word for each byte, the high one first.
    assert_eq!(host.ask(read), Some(Ok(vec![0x40, 0, 0x02, 0])));
    let nobody = Request::I2cRead {
        bus,
        slave: 1,
        read_count: 2,
        words: list(&[6]),
    };
    assert_eq!(host.ask(nobody), Some(Err(Nack::I2cFailed)));
}

#[test]
fn standard_requests_give_descriptors_and_the_setting() {
    let mut host = host(Personality::firmware_5_4());
    let mut data = [0; 256];
    let get = |request, value, length| Setup {
        request_type: 0x80,
        request,
        value,
        index: 0,
        length,
    };
    let device = host.bus.control(0, get(6, 0x0100, 18), &mut data);
    assert_eq!(device, Control::Done(18));
    assert_eq!(data[8..12], [0x27, 0x1D, 0x01, 0x06]);
    let configuration = host.bus.control(0, get(6, 0x0200, 256), &mut data);
    let Control::Done(length) = configuration else {
        panic!("{configuration:?}");
    };
    assert_eq!(usize::from(data[2]), length);
    // Before 5.5, setting 0 is isochronous.
    assert_eq!(data[9 + 9 + 3], 1);
    assert!(host.bus.set_alt_setting(0, 1));
    let setting = Setup {
        request_type: 0x81,
        ..get(10, 0, 1)
    };
    assert_eq!(host.bus.control(0, setting, &mut data), Control::Done(1));
    assert_eq!(data[0], 1);
    assert!(!host.bus.set_alt_setting(0, 2));
    assert_eq!(
        host.bus.control(0, get(6, 0x0700, 8), &mut data),
        Control::Stall
    );
}
